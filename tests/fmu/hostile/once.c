/* An FMU that works only once in a process, although its description does not say so. Copies of its
 * library do not help, because its instances find each other by an environment variable. In the
 * function AT the second instance "crashes", "hangs" or "refuses" (HOW). */
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
