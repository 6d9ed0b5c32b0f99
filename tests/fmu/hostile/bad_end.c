/* Crashes, or hangs (HANGS), when the process ends: in its destructor, or in an atexit() function
 * (AT_EXIT). */
#include "tests/fmu/hostile/hostile.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void crash(void) {
    (void)fputs("ending\n", stderr);
#ifdef HANGS
    for (;;) {
        (void)pause();
    }
#endif
    abort();
}

#ifndef AT_EXIT
__attribute__((destructor)) static void end(void) {
    crash();
}
#endif

bool hostile_before(const char *function) {
#ifdef AT_EXIT
    if (strcmp(function, "fmi2Instantiate") == 0) {
        return atexit(crash) == 0;
    }
#endif
    return function != NULL;
}
