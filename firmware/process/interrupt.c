/* Interrupt flag: see interrupt.h. */
#include "firmware/process/interrupt.h"

#include <signal.h>
#include <stddef.h>

#include "firmware/process/host_state.h"

static int received_signal; /* global, because a signal handler cannot access other state */
static unsigned signal_count;
static bool handles_hangup;

static void note_signal(int signal) {
    __atomic_store_n(&received_signal, signal, __ATOMIC_RELAXED);
    (void)__atomic_add_fetch(&signal_count, 1, __ATOMIC_RELAXED);
}

bool tl_interrupt_ignores_hangup(void) {
    struct sigaction now;
    return sigaction(SIGHUP, NULL, &now) == 0 && now.sa_handler == SIG_IGN;
}

/* Installs our handlers and registers them with host_state.h. `again`: only reinstalls those that
 * were replaced. */
static void set_handlers(bool again) {
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    struct sigaction handler = {.sa_handler = note_signal};
    (void)sigemptyset(&handler.sa_mask);
    for (size_t i = 0; i < (handles_hangup ? 3 : 2); i++) {
        struct sigaction now;
        if (!again) {
            (void)tl_host_state_handle(numbers[i], &handler, NULL);
        } else if (sigaction(numbers[i], NULL, &now) == 0 && now.sa_handler != note_signal) {
            (void)sigaction(numbers[i], &handler, NULL);
        }
    }
}

void tl_interrupt_install(void) {
    struct sigaction ignored = {.sa_handler = SIG_IGN};
    handles_hangup = !tl_interrupt_ignores_hangup();
    set_handlers(false);
    (void)tl_host_state_handle(SIGPIPE, &ignored, NULL);
}

void tl_interrupt_reclaim(void) {
    set_handlers(true);
}

unsigned tl_interrupt_times(void) {
    return __atomic_load_n(&signal_count, __ATOMIC_RELAXED);
}

int tl_interrupt_signal(void) {
    return __atomic_load_n(&received_signal, __ATOMIC_RELAXED);
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
