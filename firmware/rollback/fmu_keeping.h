/* What the C library keeps for itself when an FMU calls it.
 *
 * Purpose: some functions of the C library allocate what the library holds on to from then on: the environment, locales, time zones, what is to be called at the end, character sets,
 *          texts of other languages, users. That is everybody's, and must not lie in the heap of the FMU that happened to be the first to ask: after a restore the library
 *          would find there what was before it came. So the program defines these functions: they are as they were, but leave the heap while they run.
 * Limits:  what is kept so is not restored either: an FMU that changes its environment, and looks at it later, finds what it has set last. Not here: what a
 *          function keeps for one caller (strtok(), hsearch(), a stream that stays open).
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_KEEPING_H
#define TL_FIRMWARE_ROLLBACK_FMU_KEEPING_H

/* Before the first FMU has a heap: finds the C library's functions. */
void tl_fmu_keeping_begin(void);

#endif
