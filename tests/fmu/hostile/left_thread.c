/* Starts a thread that never ends. The thread runs code of the FMU and holds the lock of stdin.
 * HOW: a statement that the thread executes, for example to end the process. */
#include "tests/fmu/hostile/hostile.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void *work(void *unused) {
    (void)unused;
    flockfile(stdin);
    for (;;) {
        (void)usleep(1000);
#ifdef HOW
        HOW;
#endif
    }
}

bool hostile_before(const char *function) {
    static pthread_t thread;
    return strcmp(function, "fmi2Instantiate") != 0 || pthread_create(&thread, NULL, work, NULL) == 0;
}
