/* Saves and restores process state that an FMU can change by accident: rounding mode, locale,
 * current folder, signal handlers.
 *
 * Thread:  the thread that calls the FMU.
 */
#ifndef TL_FIRMWARE_PROCESS_HOST_STATE_H
#define TL_FIRMWARE_PROCESS_HOST_STATE_H

#include <fenv.h>
#include <float.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Floating-point control of this thread: rounding mode, denormals, traps.
 *
 * Purpose: an FMU that changes the rounding mode, flushes denormals or enables floating-point traps
 *          affects all later computations of its thread. The control bits are checked after each
 *          FMU call, so these functions are inline and make no system call. tl_fp_control_get()
 *          returns the present bits, for tl_fp_control_set() and tl_fp_control_check().
 * Others:  on an architecture that is not listed below, only the rounding mode is covered.
 * Thread:  each thread has its own control bits; a new thread starts with those of its creator.
 * Source:  Intel SDM volume 1, 8.1.5 and 10.2.3; Arm ARM, FPCR and FPSCR.
 */

#if defined(__x86_64__)

/* SSE bits in the lower half, the x87 control word in the upper half. The status bits of SSE are
 * masked out, because every computation changes them. */
static inline uint64_t tl_fp_control_get(void) {
    uint32_t sse = 0;
    uint16_t x87 = 0;
    __asm__ volatile("stmxcsr %0" : "=m"(sse));
    __asm__ volatile("fnstcw %0" : "=m"(x87));
    return (sse & 0xFFC0U) | (uint64_t)x87 << 32;
}

static inline void tl_fp_control_set(uint64_t control) {
    uint32_t sse = (uint32_t)control; /* clears all status bits, so that a pending exception does not trap now */
    uint16_t x87 = (uint16_t)(control >> 32);
    __asm__ volatile("ldmxcsr %0" : : "m"(sse));
    __asm__ volatile("fnclex\n\tfldcw %0" : : "m"(x87));
}

/* Checks whether the control bits are still those of *control. In *control, the rounding mode must
 * be round-to-nearest, and denormals must not be flushed. Does not read the SSE bits, because on
 * some processors that takes longer than a step of a small FMU. Instead, four additions in one
 * instruction detect another rounding mode and flushed denormals. If they and the x87 control word
 * show no difference, writes the SSE bits of *control and returns true. Writing takes a tenth of
 * the time of reading. It disables traps that an FMU has enabled, and clears the SSE exception
 * flags. Otherwise returns false and does not write the SSE bits. */
static inline bool tl_fp_control_check(const uint64_t *control) {
    static const float values[4] __attribute__((aligned(16))) = {1.0F, 1.0F, FLT_MIN / 4.0F, FLT_MIN / 4.0F};
    static const float added[4] __attribute__((aligned(16))) = {1e-30F, -1e-30F, 0.0F, 0.0F};
    uint16_t x87 = 0;
    uint32_t equal = 0; /* bit i: sum i */
    __asm__ volatile("movaps %1, %%xmm0\n\taddps %2, %%xmm0\n\tpcmpeqd %1, %%xmm0\n\tmovmskps %%xmm0, %0"
                     : "=r"(equal)
                     : "m"(values), "m"(added)
                     : "xmm0");
    __asm__ volatile("fnstcw %0" : "=m"(x87));
    bool usual = equal == 0xFU && x87 == (uint16_t)(*control >> 32);
    if (usual) {
        __asm__ volatile("ldmxcsr %0" : : "m"(*control));
    }
    return usual;
}

#elif defined(__aarch64__)

static inline uint64_t tl_fp_control_get(void) {
    uint64_t control = 0;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    return control;
}

static inline void tl_fp_control_set(uint64_t control) {
    __asm__ volatile("msr fpcr, %0" : : "r"(control));
}

#elif defined(__arm__) && defined(__ARM_FP)

/* FPSCR also contains status and condition bits, which are masked out. */
static inline uint64_t tl_fp_control_get(void) {
    uint32_t control = 0;
    __asm__ volatile("vmrs %0, fpscr" : "=r"(control));
    return control & 0x07F79F00U;
}

static inline void tl_fp_control_set(uint64_t control) {
    __asm__ volatile("vmsr fpscr, %0" : : "r"((uint32_t)control));
}

#else

static inline uint64_t tl_fp_control_get(void) {
    return (uint64_t)fegetround();
}

static inline void tl_fp_control_set(uint64_t control) {
    (void)fesetround((int)control);
}

#endif

#if !defined(__x86_64__)

static inline bool tl_fp_control_check(const uint64_t *control) {
    return tl_fp_control_get() == *control;
}

#endif

/* ---- Saves and restores the process state that an FMU can change unnoticed.
 *
 * Purpose: an FMU shares the process with us and with other FMUs. If an FMU changes the rounding
 *          mode, results differ. If an FMU catches SIGTERM, the process cannot be ended. If an FMU
 *          changes the current folder, relative file names are wrong. This module restores the
 *          state that was saved before an FMU was called.
 * Covers:  of the thread: floating-point control bits, locale, signal mask, scheduling, processors
 *          and timer slack. Of the process: locale (except LC_CTYPE), the signal handlers of the
 *          program, current folder, umask and limits. Without privileges, a hard limit that an FMU
 *          has lowered stays lowered; this is reported once. Scheduling, processors or timer slack
 *          stay changed without a report if the kernel does not restore them, for example because
 *          a processor was switched off.
 * Ignores: handlers of all other signals, timers, environment, open files.
 * Thread:  the FMU thread. tl_host_state_handle() may only be called while no FMU is being called.
 */

/* Kinds of change, as bits. */
typedef enum tl_host_change {
    TL_HOST_ROUNDING = 1,
    TL_HOST_LOCALE = 2,
    TL_HOST_SIGNAL_MASK = 4,
    TL_HOST_HANDLERS = 8,
    TL_HOST_FOLDER = 16,
    TL_HOST_UMASK = 32,
    TL_HOST_SCHEDULING = 64,
    TL_HOST_PROCESSORS = 128,
    TL_HOST_TIMER_SLACK = 256,
    TL_HOST_LIMITS = 512
} tl_host_change;

/* Number of these kinds; size of a text in bytes, with its final zero; number of calls of
 * tl_host_state_restore_part() after which all parts are restored. */
enum { TL_HOST_CHANGES = 10, TL_HOST_CHANGE_TEXT = 256, TL_HOST_STATE_TURNS = 16 };

/* Saves the current state for tl_host_state_restore(). Call it in the FMU thread, before the first
 * call of an FMU. Only the first call in the process saves the folder and the umask. */
void tl_host_state_save(void);

/* Restores what differs from the saved state and returns the changes as bits of tl_host_change.
 * Returns 0 if no state was saved. Makes at most 34 system calls if nothing has changed. */
unsigned tl_host_state_restore(void);

/* As tl_host_state_restore(), for a part of the state: the floating-point control bits, the locale,
 * one further kind, one signal handler and one limit. The next call restores the next kind, handler
 * and limit; TL_HOST_STATE_TURNS calls restore all. Makes at most three system calls if nothing has
 * changed. */
unsigned tl_host_state_restore_part(void);

/* Callback after one of the program's handlers was restored. `foreign`: the handler that an FMU had
 * installed instead. */
typedef void tl_host_state_displaced(int signal, const struct sigaction *foreign);

/* Installs a handler of the program like sigaction(). From now on tl_host_state_restore() restores
 * the handler. At most 12 signals are restored; further handlers are only installed. `displaced`
 * may be NULL. Returns 0, or -1 with errno. */
int tl_host_state_handle(int signal, const struct sigaction *action, tl_host_state_displaced *displaced);

/* Lists the changes in words, for example "the locale and the umask". `changes`: bits of
 * tl_host_change; 0: "". */
void tl_host_state_describe(unsigned changes, char text[TL_HOST_CHANGE_TEXT]);

#endif
