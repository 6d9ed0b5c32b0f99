/* Crash report: see crash.h. The handler calls only async-signal-safe functions. */
#include "firmware/process/crash.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/process/fmu_call.h"
#include "firmware/process/host_state.h"
#include "firmware/process/process_end.h"

enum { ALTERNATE_STACK = 64 * 1024, LINE = 512 };

typedef struct crash_signal {
    int number;
    const char *name;
    struct sigaction before;  /* handler before ours */
    struct sigaction foreign; /* handler of an FMU */
    bool has_foreign;
} crash_signal;

/* Signal handlers belong to the process, so this is static. */
static crash_signal signals[] = {
    {.number = SIGSEGV, .name = "Segmentation fault"},
    {.number = SIGBUS, .name = "Bus error"},
    {.number = SIGFPE, .name = "Floating point exception"},
    {.number = SIGILL, .name = "Illegal instruction"},
    {.number = SIGABRT, .name = "Aborted"},
};

enum { SIGNALS = sizeof signals / sizeof signals[0] };

static pid_t process;
static char prefix[TL_LOG_PREFIX];
static char warning_prefix[TL_LOG_PREFIX];
static pid_t reporting_thread; /* thread that reports; 0: none */

/* Alternate stacks of the main thread and of the FMU thread. */
static unsigned char alternate[2][ALTERNATE_STACK] __attribute__((aligned(64)));

static __thread tl_crash_thread thread_kind;
static __thread uintptr_t stack_end; /* lowest address of the thread's stack */
static __thread uintptr_t stack_guard;
static __thread uintptr_t in_foreign; /* frame that calls an FMU's handler; 0: none */
static __thread sigjmp_buf catch_point;
static __thread volatile bool is_caught; /* a crash continues at catch_point */
static __thread const char *volatile caught_signal = "";

static crash_signal *find_signal(int number) {
    for (size_t i = 0; i < SIGNALS; i++) {
        if (signals[i].number == number) {
            return &signals[i];
        }
    }
    return NULL;
}

/* ---- the line ---- */

typedef struct crash_line {
    char text[LINE];
    size_t length;
} crash_line;

static void add_text(crash_line *line, const char *text) {
    for (; *text != '\0' && line->length < sizeof line->text - 1; text++) {
        line->text[line->length++] = *text;
    }
}

/* The address is in the guard page, or so close to it that a large frame has skipped it. */
static bool is_overflow(int number, const siginfo_t *info) {
    uintptr_t address = (uintptr_t)info->si_addr;
    return number == SIGSEGV && info->si_code > 0 && stack_end != 0 && address >= stack_end - stack_guard &&
           address < stack_end + stack_guard;
}

/* An FMU whose memory is rolled back may crash because other FMUs share a library with it. */
static const char *remedy_of(const char *function, bool overflow) {
    if (strcmp(function, "fmi2DeSerializeFMUstate") == 0) {
        return "; it cannot load a state of another process: set \"record.resume_s\": 0, or use --supervise --state DIR";
    }
    return strcmp(function, "fmi2DoStep") == 0 && !overflow
               ? "; try \"rollback\": \"replay\" in its component, export it again, or contact its maker"
               : "; export it again, or contact its maker";
}

static void describe_crash(crash_line *line, const char *signal, bool overflow) {
    tl_fmu_call call;
    const char *cause = overflow ? "stack overflow (its thread has 8 MiB)" : signal;
    if (thread_kind == TL_CRASH_CALLS_FMUS && tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call)) {
        add_text(line, "FMU ");
        add_text(line, call.fmu);
        add_text(line, " crashed in ");
        add_text(line, call.function);
        add_text(line, ": ");
        add_text(line, cause);
        add_text(line, remedy_of(call.function, overflow));
    } else if (thread_kind == TL_CRASH_FOREIGN) {
        add_text(line, "a thread of an FMU crashed: ");
        add_text(line, cause);
        add_text(line, "; export the FMU again, or contact its maker");
    } else {
        add_text(line, "twinlock crashed outside of its FMUs: ");
        add_text(line, cause);
        add_text(line, "; a bug of twinlock, or an FMU has overwritten twinlock's memory: please report it");
    }
}

static void report_crash(const crash_signal *signal, const siginfo_t *info) {
    crash_line line = {.length = 0};
    add_text(&line, tl_process_is_complete() ? warning_prefix : prefix);
    describe_crash(&line, signal->name, is_overflow(signal->number, info));
    add_text(&line, tl_process_is_complete() ? " (the results are complete)" : "");
    add_text(&line, "\n");
    ssize_t written = write(STDERR_FILENO, line.text, line.length);
    (void)written; /* if stderr fails, there is no other output */
}

/* ---- the handler ---- */

static void call_handler(const struct sigaction *action, int number, siginfo_t *info, void *context) {
    if ((action->sa_flags & SA_SIGINFO) != 0) {
        action->sa_sigaction(number, info, context);
    } else {
        action->sa_handler(number);
    }
}

static bool is_handler(const struct sigaction *action) {
    return (action->sa_flags & SA_SIGINFO) != 0 || (action->sa_handler != SIG_DFL && action->sa_handler != SIG_IGN);
}

/* Returns true if an FMU's handler has handled the signal. Returns false if there is no such
 * handler, or if it has forwarded the signal. Then it has raised the signal again: this function
 * runs inside that handler, or the signal is pending afterwards. If that handler has jumped away,
 * in_foreign is still set, but this frame is not below it. */
static bool is_handled(const crash_signal *signal, siginfo_t *info, void *context) {
    uintptr_t frame = (uintptr_t)__builtin_frame_address(0);
    sigset_t set;
    bool is_forwarded = info->si_code <= 0 && in_foreign != 0 && frame < in_foreign;
    if (!__atomic_load_n(&signal->has_foreign, __ATOMIC_ACQUIRE) || is_forwarded) {
        return false;
    }
    in_foreign = frame;
    if ((signal->foreign.sa_flags & SA_NODEFER) != 0) {
        (void)sigemptyset(&set);
        (void)sigaddset(&set, signal->number);
        (void)pthread_sigmask(SIG_UNBLOCK, &set, NULL);
    }
    call_handler(&signal->foreign, signal->number, info, context);
    in_foreign = 0;
    return sigpending(&set) != 0 || sigismember(&set, signal->number) != 1;
}

/* Only one thread reports. Other crashing threads wait for the end of the process. */
static bool may_report(void) {
    pid_t expected = 0;
    pid_t self = gettid();
    if (__atomic_compare_exchange_n(&reporting_thread, &expected, self, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
        return true;
    }
    while (expected != self) {
        (void)pause();
    }
    return false;
}

/* Continues at the catch point of this thread, if it has one. */
static void continue_caught(const crash_signal *signal) {
    sigset_t set;
    if (is_caught && process == getpid()) {
        is_caught = false;
        caught_signal = signal->name;
        (void)sigemptyset(&set);
        (void)sigaddset(&set, signal->number);
        (void)pthread_sigmask(SIG_UNBLOCK, &set, NULL);
        siglongjmp(catch_point, 1);
    }
}

sigjmp_buf *tl_crash_catch_begin(void) {
    is_caught = true;
    return &catch_point;
}

void tl_crash_catch_end(void) {
    is_caught = false;
}

const char *tl_crash_caught(void) {
    return caught_signal;
}

static void on_crash(int number, siginfo_t *info, void *context) {
    int saved = errno;
    const crash_signal *signal = find_signal(number);
    tl_process_end_if_ending();
    if (is_handled(signal, info, context)) {
        errno = saved;
        return;
    }
    continue_caught(signal);
    if (process == getpid() && may_report()) {
        report_crash(signal, info);
        tl_process_end_if_complete();
        if (is_handler(&signal->before)) {
            call_handler(&signal->before, number, info, context);
        }
    }
    /* Raises the signal again with the default action; the kernel delivers it when this handler
     * returns. A fault would recur anyway. After another signal the process would continue: one
     * that was sent, or one that the kernel raised for a call (uretprobe on x86-64 outside of a
     * probe). */
    const struct sigaction standard = {.sa_handler = SIG_DFL};
    (void)sigaction(number, &standard, NULL);
    (void)raise(number);
}

/* ---- installing ---- */

static bool is_own(const struct sigaction *action) {
    return (action->sa_flags & SA_SIGINFO) != 0 && action->sa_sigaction == on_crash;
}

/* An FMU has installed `foreign`, and ours was restored. From now on ours calls it first. SIG_DFL,
 * SIG_IGN and our own handler cannot be called. */
static void chain_handler(int number, const struct sigaction *foreign) {
    crash_signal *signal = find_signal(number);
    if (signal == NULL) {
        return;
    }
    __atomic_store_n(&signal->has_foreign, false, __ATOMIC_RELEASE);
    if (is_handler(foreign) && !is_own(foreign)) {
        signal->foreign = *foreign;
        __atomic_store_n(&signal->has_foreign, true, __ATOMIC_RELEASE);
    }
}

static void use_alternate_stack(unsigned char *stack) {
    stack_t now;
    const stack_t own = {.ss_sp = stack, .ss_size = ALTERNATE_STACK};
    if (sigaltstack(NULL, &now) == 0 && (now.ss_flags & SS_DISABLE) != 0) { /* a sanitizer sets its own */
        (void)sigaltstack(&own, NULL);
    }
}

/* Finds the end of this thread's stack. */
static void find_stack(void) {
    pthread_attr_t attributes;
    void *lowest = NULL;
    size_t size = 0;
    size_t guard = 0;
    if (pthread_getattr_np(pthread_self(), &attributes) != 0) {
        return;
    }
    if (pthread_attr_getstack(&attributes, &lowest, &size) == 0 &&
        pthread_attr_getguardsize(&attributes, &guard) == 0) {
        stack_end = (uintptr_t)lowest;
        stack_guard = guard;
    }
    (void)pthread_attr_destroy(&attributes);
}

void tl_crash_enter(tl_crash_thread entered) {
    thread_kind = entered;
    if (entered == TL_CRASH_CALLS_FMUS) {
        tl_fmu_calls_enter_thread();
        use_alternate_stack(alternate[1]);
        find_stack();
    }
}

void tl_crash_install(void) {
    struct sigaction own = {.sa_flags = SA_SIGINFO | SA_ONSTACK};
    own.sa_sigaction = on_crash;
    (void)sigemptyset(&own.sa_mask);
    process = getpid();
    tl_log_prefix(TL_LOG_ERROR, prefix, sizeof prefix);
    tl_log_prefix(TL_LOG_WARNING, warning_prefix, sizeof warning_prefix);
    use_alternate_stack(alternate[0]);
    tl_crash_enter(TL_CRASH_OURS);
    for (size_t i = 0; i < SIGNALS; i++) {
        struct sigaction now;
        if (sigaction(signals[i].number, NULL, &now) == 0 && !is_own(&now) && now.sa_handler != SIG_IGN) {
            signals[i].before = now;
            (void)tl_host_state_handle(signals[i].number, &own, chain_handler);
        }
    }
}
