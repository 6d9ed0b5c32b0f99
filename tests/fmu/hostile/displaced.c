/* Handles SIGFPE itself, as a virtual machine does: its handler is installed in fmi2Instantiate, and puts right what fmi2DoStep
 * then does. Where CALLS_PREVIOUS is defined it is one that tells of a crash and gives the signal to who had it before, as Python's
 * faulthandler does. */
#include "tests/fmu/hostile/hostile.h"

#include <setjmp.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

static sigjmp_buf back;
static struct sigaction previous;

static void handle(int number) {
    static int handled;
    if (handled++ == 0) {
        (void)fputs("the FMU's own handler\n", stderr);
    }
#ifdef CALLS_PREVIOUS
    (void)sigaction(number, &previous, NULL);
    (void)raise(number);
#else
    (void)number;
    siglongjmp(back, 1);
#endif
}

bool hostile_before(const char *function) {
    if (strcmp(function, "fmi2Instantiate") == 0) {
        struct sigaction own = {.sa_handler = handle, .sa_flags = SA_NODEFER};
        (void)sigemptyset(&own.sa_mask);
        return sigaction(SIGFPE, &own, &previous) == 0;
    }
    if (strcmp(function, "fmi2DoStep") == 0 && sigsetjmp(back, 1) == 0) {
        (void)raise(SIGFPE);
        return false;
    }
    return true;
}
