/* How the processor rounds in this thread: the control bits of its floating-point units.
 *
 * Purpose: an FMU that changes the rounding mode, flushes denormal numbers or enables floating-point traps changes what everybody
 *          computes after it. It is looked at after each call of an FMU, so it is inline and needs no system call.
 * Thread:  each thread has control bits of its own; a new thread begins with those of its creator.
 * Source:  Intel SDM volume 1, 8.1.5 and 10.2.3; Arm ARM, FPCR and FPSCR.
 */
#ifndef TL_FIRMWARE_PROCESS_FP_CONTROL_H
#define TL_FIRMWARE_PROCESS_FP_CONTROL_H

#include <fenv.h>
#include <float.h>
#include <stdbool.h>
#include <stdint.h>

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

#endif
