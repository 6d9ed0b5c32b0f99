/* Process end: see process_end.h. */
#include "firmware/process/process_end.h"

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/process/fmu_call.h"

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define TL_FINDS_LEAKS
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(TL_FINDS_LEAKS)
#include <sanitizer/lsan_interface.h>
#endif
#if defined(TL_COVERAGE)
#include <gcov.h>
#endif

enum { FMU_FAILED = 70, FLUSH_S = 1 };

/* State of the process, which ends only once. */
static pid_t process; /* the process that this module ends; processes that an FMU forks are not affected */
static volatile sig_atomic_t ending;
static volatile sig_atomic_t complete; /* only FMUs are freed from now on */
static volatile sig_atomic_t end_code;
static tl_process_saver *end_keeper;
static void *keeper_context;
static bool runs_exit_handlers;

static void end_late(int number) {
    (void)number;
    _exit(end_code);
}

/* After this time the process exits, even if a lock is not released. */
static void limit_duration(unsigned seconds) {
    struct sigaction action = {.sa_handler = end_late};
    sigset_t set;
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGALRM, &action, NULL);
    (void)sigemptyset(&set);
    (void)sigaddset(&set, SIGALRM);
    (void)pthread_sigmask(SIG_UNBLOCK, &set, NULL);
    (void)alarm(seconds);
}

/* The time is limited, because a thread that an FMU has left may hold the lock of a stream for
 * ever. */
static void flush_and_end(void) __attribute__((noreturn));

static void flush_and_end(void) {
    limit_duration(FLUSH_S);
    (void)fflush(NULL);
#if defined(TL_COVERAGE)
    __gcov_dump();
#endif
    _exit(end_code);
}

static void set_ending(int code) {
    end_code = code;
    ending = 1;
}

/* exit() was called: by us, after all handlers that were registered later have run, or by an FMU.
 */
static void on_exit_called(int code, void *unused) {
    char reason[256];
    tl_fmu_call call;
    (void)unused;
    if (process != getpid()) {
        return;
    }
    if (ending != 0) {
        flush_and_end();
    }
    if (tl_fmu_calls_is_own_thread() && tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call)) {
        (void)snprintf(
            reason, sizeof reason,
            "FMU %s called exit(%d) in %s, which ends the whole process; export it again, or contact its maker",
            call.fmu, code, call.function);
    } else {
        (void)snprintf(
            reason, sizeof reason,
            "an FMU called exit(%d) in a thread of its own, which ends the whole process; export it again, or contact "
            "its maker",
            code);
    }
    if (complete != 0) {
        tl_log(TL_LOG_WARNING, "%s (the results are complete)", reason);
        flush_and_end();
    }
    tl_process_give_up(reason);
}

void tl_process_begin(void) {
    static bool registered;
    process = getpid();
    registered = registered || on_exit(on_exit_called, NULL) == 0;
}

void tl_process_complete(int code) {
    end_code = code;
    complete = 1;
}

bool tl_process_is_complete(void) {
    return complete != 0;
}

void tl_process_end(int code) {
    set_ending(code);
    if (__atomic_load_n(&runs_exit_handlers,
                        __ATOMIC_RELAXED)) { /* interpreters free their memory themselves, if at all */
        limit_duration(TL_PROCESS_END_S);
        exit(code); // NOLINT(concurrency-mt-unsafe): no other code of ours ends the process
    }
#if defined(__SANITIZE_ADDRESS__) || defined(TL_FINDS_LEAKS)
    __lsan_do_leak_check();
#endif
    flush_and_end();
}

void tl_process_give_up(const char *why) {
    set_ending(FMU_FAILED);
    tl_process_saver *keeper = __atomic_load_n(&end_keeper, __ATOMIC_ACQUIRE);
    limit_duration(TL_PROCESS_END_S);
    tl_log(TL_LOG_ERROR, "%s", why);
    if (keeper != NULL) {
        keeper(keeper_context, why);
    }
    flush_and_end();
}

void tl_process_set_saver(tl_process_saver *keeper, void *context) {
    __atomic_store_n(&end_keeper, NULL, __ATOMIC_RELEASE);
    keeper_context = context;
    __atomic_store_n(&end_keeper, keeper, __ATOMIC_RELEASE);
}

void tl_process_run_exit_handlers(void) {
    __atomic_store_n(&runs_exit_handlers, true, __ATOMIC_RELAXED);
}

void tl_process_end_if_ending(void) {
    if (ending != 0 && process == getpid()) {
        _exit(end_code);
    }
}

void tl_process_end_if_complete(void) {
    if (complete != 0 && process == getpid()) {
        _exit(end_code);
    }
}
