/* Writes TOUCHES pages of memory at the start and in each step, with the same contents. A copy of
 * the memory then takes far longer than a save by the FMU's own state functions. */
#ifndef TL_TESTS_FMU_KEEPER_TOUCH_H
#define TL_TESTS_FMU_KEEPER_TOUCH_H

#ifndef TOUCHES
#define TOUCHES 0
#endif

static volatile unsigned char touched[TOUCHES * 4096 + 1];

static inline void touch(void) {
    for (unsigned i = TOUCHES; i > 0; i--) {
        touched[i * 4096] = 1;
    }
}

#endif
