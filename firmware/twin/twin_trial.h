/* What `check` tries of a twin: a look far from the start, and in processes of its own a second twin beside it and other ways of leading components back.
 *
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_TRIAL_H
#define TL_FIRMWARE_TWIN_TWIN_TRIAL_H

#include <stdint.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_step.h"

/* ---- A look far from the start: whether the FMUs of a twin come back to where they were, after so many steps, and with inputs that move.
 *
 * Purpose: the proof before the first step sees FMUs at one place, and what some of them forget is of no weight there. A check has time to look further: it goes on with steps of which
 *          the adjusted variables go up and down, or on and off, and after as many of them as it can it asks whether the FMUs come back (tl_twin_look()).
 * Not:     for a twin that adjusts nothing, or has an event horizon: it looks at nothing.
 * Thread:  that of the FMUs. The twin is of no other use afterwards.
 */

enum { TL_FAR_STEPS = 1000 };

#define TL_FAR_LONGEST (TL_SECOND / 2)

typedef struct tl_far_look {
    int64_t first;  /* the tick with which it began */
    int64_t steps;  /* that it took; it ends with the first finding that is not mended, or with an FMU that fails: */
    uint64_t times; /* FMUs were led back and compared */
    tl_twin_look_news news; /* the last finding */
    tl_status status;       /* TL_FMU_FAILED: of what it was given, which says nothing about the rollback */
    tl_error error;
} tl_far_look;

/* `tick` is the next one of a twin that has begun, none of whose signals has a reading. */
void tl_far_look_take(const tl_assembly *assembly, int64_t tick, tl_far_look *look);

/* ---- Two twins of one configuration in one process: whether the same inputs lead to the same values, and whether one is disturbed by the other.
 *
 * Purpose: for `check`, in a process of its own. The first twin makes some steps; then the second one is built beside it, with FMUs that have libraries of their own, as every
 *          component's are (own_copies.h), and makes the same steps. Each value that an FMU gives must be the same to the bit.
 * Inputs:  the plant's initial values; what is adjusted moves as in a far look, but with an event horizon, where it stays.
 * Account: in memory that another process reads while this one may crash, hang or lie.
 * Memory:  the values of the first twin, while both are compared.
 * Thread:  that of the FMUs.
 */

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

/* ---- By which way each component of a twin is led back, and what that costs: as a process with FMUs tells it to the one that has started it.
 *
 * Purpose: for `check`. Of a twin that it has looked at it notes the ways; and in a process of its own it tries others (check_trials.h): proof at the start and far look are those of
 *          a check, then it is measured what a save and a restore take.
 * Account: in memory that another process reads while this one may crash, hang or lie.
 * Thread:  that of the FMUs. The twin is of no other use afterwards.
 */

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
