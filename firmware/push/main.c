/* twinlock-push: the program, from its beginning to its end. `twinlock push` starts it. */
#include "firmware/base/c_locale.h"
#include "firmware/process/crash.h"
#include "firmware/push/push_verb.h"
#include "master/base/status.h"

int main(int argc, char **argv) {
    tl_push_options options;
    tl_crash_install();
    tl_locale_use();
    switch (tl_push_options_read(argc, argv, &options)) {
    case TL_PROGRAM_READ:
        return tl_push_verb_run(&options);
    case TL_PROGRAM_HELPED:
        return tl_exit_code(TL_OK);
    case TL_PROGRAM_WRONG:
        break;
    }
    return tl_exit_code(TL_BAD_USAGE);
}
