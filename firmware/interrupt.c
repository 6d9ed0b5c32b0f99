/* SIGINT and SIGTERM as a flag: see interrupt.h. */
#include "firmware/interrupt.h"

#include <signal.h>
#include <stddef.h>

static volatile sig_atomic_t received; /* the only global state: a signal handler can have no other */

static void note(int signal) {
    received = signal;
}

void tl_interrupt_install(void) {
    struct sigaction action = {.sa_handler = note};
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    action.sa_handler = SIG_IGN;
    (void)sigaction(SIGPIPE, &action, NULL);
}

const char *tl_interrupt_requested(void) {
    return received == 0 ? NULL : received == SIGTERM ? "SIGTERM" : "SIGINT";
}
