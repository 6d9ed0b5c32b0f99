/* Ends the process at the CALL-th call of the function AT. HOW is the statement that ends it. */
#include "tests/fmu/hostile/hostile.h"

#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

#ifndef CALL
#define CALL 1
#endif

bool hostile_before(const char *function) {
    static int calls;
    if (strcmp(function, AT) == 0 && ++calls == CALL) {
        HOW;
    }
    return true;
}
