/* Two twins of one configuration in one process: whether the same inputs lead to the same values, and whether one is disturbed by the other.
 *
 * Purpose: for `check`, in a process of its own. The first twin makes some steps; then the second one is built beside it, with FMUs that have libraries of their own, as every
 *          component's are (own_copies.h), and makes the same steps. Each value that an FMU gives must be the same to the bit.
 * Inputs:  the plant's initial values; what is adjusted moves as in far_look.h, but with an event horizon, where it stays.
 * Account: in memory that another process reads while this one may crash, hang or lie.
 * Memory:  the values of the first twin, while both are compared.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_PAIR_H
#define TL_FIRMWARE_TWIN_TWIN_PAIR_H

#include <stdint.h>

#include "firmware/twin/assembly.h"

enum { TL_PAIR_STEPS = 100, TL_PAIR_LEAST = 10, TL_PAIR_NAME = TL_ASSEMBLY_NAME };

/* The first twin begins no further step after that, if it has made TL_PAIR_LEAST; the second one makes as many. */
#define TL_PAIR_LONGEST (TL_SECOND / 4)

typedef struct tl_twin_pair_account {
    uint32_t steps;                /* of the first twin; 0: it cannot step with the plant's initial values */
    uint64_t marks[TL_PAIR_STEPS]; /* of all values after each of them */
    uint32_t has_second;           /* 1: the second one was begun */
    char component[TL_PAIR_NAME];  /* the first that differs, or that fails; "": none */
} tl_twin_pair_account;

/* `first` was built, `second` has a configuration. With `alone` the second one is left out. If there is a difference error->text says which, else it is empty.
 * Errors: TL_TRY_AGAIN; any other, with a text or what was said on the log: there is no second twin, or it cannot step. */
tl_status tl_twin_pair_compare(const tl_assembly *first, tl_assembly *second, bool alone, tl_twin_pair_account *account,
                               tl_error *error);

#endif
