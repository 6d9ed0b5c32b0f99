/* twinlock-serve: the program, from its beginning to its end. `twinlock serve` and `twinlock token` start it. */
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/process/crash.h"
#include "firmware/serve/serve_verb.h"

int main(int argc, char **argv) {
    tl_crash_install();
    tl_locale_use();
    return argc > 1 && strcmp(argv[1], "token") == 0 ? tl_token_verb_run(argc - 1, argv + 1)
                                                     : tl_serve_verb_run(argc, argv);
}
