/* Handles SIGFPE itself, as a virtual machine does: fmi2Instantiate installs a handler, which
 * catches the SIGFPE that each fmi2DoStep raises. With CALLS_PREVIOUS the handler reports a crash
 * and passes the signal to the previous handler, as Python's faulthandler does. */
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
