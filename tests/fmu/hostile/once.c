/* What a process can have once, although it does not say so, and not because of its own globals: its instances meet in the environment of the process. In the function AT
 * the second one of them does what HOW says: "crashes", "hangs" or "refuses". */
#include "tests/fmu/hostile/hostile.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#ifndef AT
#define AT "fmi2DoStep"
#endif

static const char MET[] = "TWINLOCK_TEST_ONCE";
static bool is_second; /* each instance has its own library */

static void hang(void) {
    for (;;) {
        (void)pause();
    }
}

bool hostile_before(const char *function) {
    if (strcmp(function, "load") == 0) {
        is_second = getenv(MET) != NULL;
        (void)setenv(MET, "1", 1);
    }
    if (!is_second || strcmp(function, AT) != 0) {
        return true;
    }
    if (strcmp(HOW, "crashes") == 0) {
        (void)raise(SIGABRT);
    }
    if (strcmp(HOW, "hangs") == 0) {
        hang();
    }
    return false;
}
