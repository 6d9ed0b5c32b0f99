/* Functions of the C library that FMUs get from us, since they keep state: random numbers, locale, names of users, conversions.
 *
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_KEEPING_H
#define TL_FIRMWARE_ROLLBACK_FMU_KEEPING_H

#include "firmware/rollback/fmu_heap.h"

/* ---- The random numbers of the C library as part of an FMU's memory.
 *
 * Purpose: the C library keeps one state of rand(), random() and drand48() for the whole program. An FMU that is saved and restored, or that has another one
 *          beside it, must find its own. So the program defines these functions: in a call of an FMU with a heap (fmu_heap.h) they count in that heap, from
 *          the same beginning as a program that has just started, and give the same numbers.
 * Thread:  as fmu_heap.h.
 */

/* The first thing that is taken from a heap. False: there is no room. */
bool tl_fmu_random_begin(tl_fmu_heap *heap);

/* ---- What the C library keeps for itself when an FMU calls it.
 *
 * Purpose: some functions of the C library allocate what the library holds on to from then on: the environment, locales, time zones, what is to be called at the end, character sets,
 *          texts of other languages, users. That is everybody's, and must not lie in the heap of the FMU that happened to be the first to ask: after a restore the library
 *          would find there what was before it came. So the program defines these functions: they are as they were, but leave the heap while they run.
 * Limits:  what is kept so is not restored either: an FMU that changes its environment, and looks at it later, finds what it has set last. Not here: what a
 *          function keeps for one caller (strtok(), hsearch(), a stream that stays open).
 * Thread:  any.
 */

/* Before the first FMU has a heap: finds the C library's functions. */
void tl_fmu_keeping_begin(void);

#endif
