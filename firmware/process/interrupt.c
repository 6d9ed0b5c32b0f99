/* SIGINT, SIGTERM and SIGHUP as a flag: see interrupt.h. */
#include "firmware/process/interrupt.h"

#include <signal.h>
#include <stddef.h>

#include "firmware/process/host_state.h"

static int received; /* global state: a signal handler can have no other */
static unsigned times;
static bool hears_hangup;

static void note(int signal) {
    __atomic_store_n(&received, signal, __ATOMIC_RELAXED);
    (void)__atomic_add_fetch(&times, 1, __ATOMIC_RELAXED);
}

bool tl_interrupt_ignores_hangup(void) {
    struct sigaction now;
    return sigaction(SIGHUP, NULL, &now) == 0 && now.sa_handler == SIG_IGN;
}

static void claim(int signal) {
    struct sigaction action = {.sa_handler = note};
    (void)sigemptyset(&action.sa_mask);
    (void)tl_host_state_handle(signal, &action, NULL);
}

void tl_interrupt_install(void) {
    struct sigaction ignored = {.sa_handler = SIG_IGN};
    hears_hangup = !tl_interrupt_ignores_hangup();
    claim(SIGINT);
    claim(SIGTERM);
    if (hears_hangup) {
        claim(SIGHUP);
    }
    (void)tl_host_state_handle(SIGPIPE, &ignored, NULL);
}

static void reclaim(int signal) {
    struct sigaction now;
    struct sigaction own = {.sa_handler = note};
    (void)sigemptyset(&own.sa_mask);
    if (sigaction(signal, NULL, &now) == 0 && now.sa_handler != note) {
        (void)sigaction(signal, &own, NULL);
    }
}

void tl_interrupt_reclaim(void) {
    reclaim(SIGINT);
    reclaim(SIGTERM);
    if (hears_hangup) {
        reclaim(SIGHUP);
    }
}

unsigned tl_interrupt_times(void) {
    return __atomic_load_n(&times, __ATOMIC_RELAXED);
}

int tl_interrupt_signal(void) {
    return __atomic_load_n(&received, __ATOMIC_RELAXED);
}

const char *tl_interrupt_requested(void) {
    switch (tl_interrupt_signal()) {
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
