/* twinlock-serve: the program, from its beginning to its end. `twinlock serve` and `twinlock token` start it. */
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/process/crash.h"
#include "firmware/serve/serve_verb.h"
#include "firmware/serve/token_verb.h"
#include "master/base/status.h"

static int code_of(tl_options_outcome outcome) {
    return tl_exit_code(outcome == TL_OPTIONS_HELPED ? TL_OK : TL_BAD_USAGE);
}

static int be_token(int argc, char **argv) {
    tl_token_options options;
    tl_options_outcome outcome = tl_token_options_read(argc, argv, &options);
    return outcome == TL_OPTIONS_READ ? tl_token_verb_run(&options) : code_of(outcome);
}

int main(int argc, char **argv) {
    tl_serve_options options;
    tl_crash_install();
    tl_locale_use();
    if (argc > 1 && strcmp(argv[1], "token") == 0) {
        return be_token(argc - 1, argv + 1);
    }
    tl_options_outcome outcome = tl_serve_options_read(argc, argv, &options);
    return outcome == TL_OPTIONS_READ ? tl_serve_verb_run(&options) : code_of(outcome);
}
