/* State of the process that an FMU may change: rounding, locale, directory, signals.
 *
 * Thread:  the one that calls the FMU.
 */
#ifndef TL_FIRMWARE_PROCESS_HOST_STATE_H
#define TL_FIRMWARE_PROCESS_HOST_STATE_H

#include <fenv.h>
#include <float.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- How the processor rounds in this thread: the control bits of its floating-point units.
 *
 * Purpose: an FMU that changes the rounding mode, flushes denormal numbers or enables floating-point traps changes what everybody
 *          computes after it. It is looked at after each call of an FMU, so it is inline and needs no system call.
 * Thread:  each thread has control bits of its own; a new thread begins with those of its creator.
 * Source:  Intel SDM volume 1, 8.1.5 and 10.2.3; Arm ARM, FPCR and FPSCR.
 */

#if defined(__x86_64__)

/* SSE in the lower half, the x87 unit in the upper one. Status bits are left out: every computation changes those. */
static inline uint32_t tl_fp_control_get(void) {
    uint32_t sse = 0;
    uint16_t x87 = 0;
    __asm__ volatile("stmxcsr %0" : "=m"(sse));
    __asm__ volatile("fnstcw %0" : "=m"(x87));
    return (sse & 0xFFC0U) | (uint32_t)(x87 & 0x0F3FU) << 16;
}

static inline void tl_fp_control_set(uint32_t control) {
    uint32_t sse = control & 0xFFC0U; /* with all status bits cleared: a pending one must not trap now */
    uint16_t x87 = (uint16_t)(control >> 16 | 0x0040U);
    __asm__ volatile("ldmxcsr %0" : : "m"(sse));
    __asm__ volatile("fnclex\n\tfldcw %0" : : "m"(x87));
}

/* The same is in force, found without reading the SSE bits, which on some processors takes longer than a small FMU's step. They are judged
 * by what they do to three additions, and written, which takes a tenth: traps that were enabled there are put back unseen. False:
 * something differs, and nothing was put back. */
static inline bool tl_fp_control_holds(uint32_t control) {
    static const volatile double one = 1.0;
    static const volatile double tiny = 1e-30;
    static const volatile double denormal = DBL_MIN / 4.0;
    double least = denormal;
    uint16_t x87 = 0;
    uint32_t sse = control & 0xFFC0U;
    __asm__ volatile("fnstcw %0" : "=m"(x87));
    bool usual = one + tiny == one && one - tiny == one && least + least > 0.0 && (x87 & 0x0F3FU) == control >> 16;
    if (usual) {
        __asm__ volatile("ldmxcsr %0" : : "m"(sse));
    }
    return usual;
}

#elif defined(__aarch64__)

static inline uint32_t tl_fp_control_get(void) {
    uint64_t control = 0;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    return (uint32_t)control;
}

static inline void tl_fp_control_set(uint32_t control) {
    __asm__ volatile("msr fpcr, %0" : : "r"((uint64_t)control));
}

#elif defined(__arm__) && defined(__ARM_FP)

/* Status and condition bits are in the same register. */
static inline uint32_t tl_fp_control_get(void) {
    uint32_t control = 0;
    __asm__ volatile("vmrs %0, fpscr" : "=r"(control));
    return control & 0x07F79F00U;
}

static inline void tl_fp_control_set(uint32_t control) {
    __asm__ volatile("vmsr fpscr, %0" : : "r"(control));
}

#else

static inline uint32_t tl_fp_control_get(void) {
    return (uint32_t)fegetround();
}

static inline void tl_fp_control_set(uint32_t control) {
    (void)fesetround((int)control);
}

#endif

#if !defined(__x86_64__)

static inline bool tl_fp_control_holds(uint32_t control) {
    return tl_fp_control_get() == control;
}

#endif

/* ---- The state of this process that an FMU can change behind our back, kept and put back.
 *
 * Purpose: an FMU shares the process with us and with other FMUs. One that sets another rounding mode changes bits in silence, one
 *          that takes SIGTERM cannot be ended, one that changes the folder makes relative file names wrong. What was so before the
 *          FMU was loaded is put back.
 * Covers:  the floating-point control bits, the locale, the signal mask and the scheduling of the thread; the locale, the handlers of the signals
 *          that the program itself handles, the current folder and the umask of the process.
 * Left alone: handlers of all other signals, timers, limits, environment, open files.
 * Thread:  that of the FMUs, but for tl_host_state_handle(), which is for a time when no FMU is being called.
 */

/* What can be found changed: bits. */
typedef enum tl_host_change {
    TL_HOST_ROUNDING = 1,
    TL_HOST_LOCALE = 2,
    TL_HOST_SIGNAL_MASK = 4,
    TL_HOST_HANDLERS = 8,
    TL_HOST_FOLDER = 16,
    TL_HOST_UMASK = 32,
    TL_HOST_SCHEDULING = 64
} tl_host_change;

enum { TL_HOST_CHANGES = 7, TL_HOST_CHANGE_TEXT = 192 };

/* What is in force now is right: for the thread that calls, before FMUs are called in it. Folder and umask are those of the first time. */
void tl_host_state_keep(void);

/* Puts back what differs from what was kept; the bits of what did. Nothing was ever kept: does nothing. Costs some 14 system calls. */
unsigned tl_host_state_put_back(void);

/* Told, after a handler of ours was put back, which one of an FMU's had been in its place. */
typedef void tl_host_state_displaced(int signal, const struct sigaction *foreign);

/* sigaction(), for a handler of the program itself: it is kept from now on. `displaced` may be NULL. 0, or -1 with errno. */
int tl_host_state_handle(int signal, const struct sigaction *action, tl_host_state_displaced *displaced);

/* "the rounding mode and the locale" */
void tl_host_state_describe(unsigned changes, char text[TL_HOST_CHANGE_TEXT]);

#endif
