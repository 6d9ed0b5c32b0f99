/* The random numbers of the C library as part of an FMU's memory.
 *
 * Purpose: the C library keeps one state of rand(), random() and drand48() for the whole program. An FMU that is saved and restored, or that has another one
 *          beside it, must find its own. So the program defines these functions: in a call of an FMU with a heap (fmu_allocation.h) they count in that heap, from
 *          the same beginning as a program that has just started, and give the same numbers.
 * Thread:  as fmu_allocation.h.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_RANDOM_H
#define TL_FIRMWARE_ROLLBACK_FMU_RANDOM_H

#include "firmware/rollback/fmu_heap.h"

/* The first thing that is taken from a heap. False: there is no room. */
bool tl_fmu_random_begin(tl_fmu_heap *heap);

#endif
