/* Saves the account of restarts in a folder again and again: restarts_probe FOLDER
 *
 * It prints each number of starts after it is saved. For tests/hil/power_cuts, which checks that a
 * printed number survives a power cut. */
#include <inttypes.h>
#include <stdio.h>
#include <time.h>

#include "firmware/live/restarts.h"

int main(int argc, char **argv) {
    const struct timespec pause = {.tv_sec = 0, .tv_nsec = 50000000};
    tl_restarts restarts;
    tl_error error = {0};
    if (argc != 2 || tl_restarts_open(argv[1], false, &restarts, &error) != TL_OK) {
        (void)fprintf(stderr, "restarts_probe: %s\n", argc == 2 ? error.text : "expected one folder");
        return 2;
    }
    for (;;) {
        tl_restarts_begin(&restarts, false);
        if (restarts.unwritten) {
            return 1;
        }
        (void)printf("starts %" PRIu64 "\n", restarts.starts);
        (void)fflush(stdout);
        (void)nanosleep(&pause, NULL);
    }
}
