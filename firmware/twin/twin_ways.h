/* By which way each component of a twin is led back, and what that costs: as a process with FMUs tells it to the one that has started it.
 *
 * Purpose: for `check`. Of a twin that it has looked at it notes the ways; and in a process of its own it tries others (check_trials.h): proof at the start and far look are those of
 *          a check, then it is measured what a save and a restore take.
 * Account: in memory that another process reads while this one may crash, hang or lie.
 * Thread:  that of the FMUs. The twin is of no other use afterwards.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_WAYS_H
#define TL_FIRMWARE_TWIN_TWIN_WAYS_H

#include <stdint.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"

typedef struct tl_twin_way {
    uint32_t rollback;       /* tl_rollback, as it is now */
    uint32_t is_given_again; /* 1: by its state, and it is given again what it had been given */
    uint32_t is_measured;    /* 1: what follows is */
    int64_t save;            /* ns, median */
    int64_t restore;
    uint64_t bytes; /* of a state; 0: not known */
} tl_twin_way;

typedef struct tl_twin_ways {
    uint32_t cannot_return;           /* 1: one of them does not come back to where it was, */
    char component[TL_ASSEMBLY_NAME]; /* this one, or the one with which a trial has failed; "": not known, or none */
    tl_twin_way of[TL_RECORDER_COMPONENTS];
} tl_twin_ways;

/* Of a twin that has begun. */
void tl_twin_ways_note(const tl_assembly *assembly, tl_twin_ways *ways);

/* Of an assembly that was opened, whose components have the ways that are to be tried: builds it, and begins. TL_OK: all of them come back; or, with ways->component, that one does not, and
 * error->text says how. Errors, with that name if it is known: it cannot be built, or not begin. Nothing is said on the log but what an FMU says. */
tl_status tl_twin_ways_try(tl_assembly *assembly, tl_twin_ways *ways, tl_error *error);

#endif
