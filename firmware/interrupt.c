/* SIGINT, SIGTERM and SIGHUP as a flag: see interrupt.h. */
#include "firmware/interrupt.h"

#include <signal.h>
#include <stddef.h>

#include "firmware/host_state.h"

static volatile sig_atomic_t received; /* the only global state: a signal handler can have no other */

static void note(int signal) {
    received = signal;
}

bool tl_interrupt_ignores_hangup(void) {
    struct sigaction now;
    return sigaction(SIGHUP, NULL, &now) == 0 && now.sa_handler == SIG_IGN;
}

void tl_interrupt_install(void) {
    struct sigaction action = {.sa_handler = note};
    (void)sigemptyset(&action.sa_mask);
    (void)tl_host_state_handle(SIGINT, &action);
    (void)tl_host_state_handle(SIGTERM, &action);
    if (!tl_interrupt_ignores_hangup()) {
        (void)tl_host_state_handle(SIGHUP, &action);
    }
    action.sa_handler = SIG_IGN;
    (void)tl_host_state_handle(SIGPIPE, &action);
}

const char *tl_interrupt_requested(void) {
    switch (received) {
    case 0:
        return NULL;
    case SIGTERM:
        return "SIGTERM";
    case SIGHUP:
        return "SIGHUP";
    default:
        return "SIGINT";
    }
}
