/* Verification of restored states, and which cause a difference has.
 *
 * Thread:  the one that steps the twin.
 */
#ifndef TL_MASTER_SYNC_VERIFIER_H
#define TL_MASTER_SYNC_VERIFIER_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/fmi/component.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/sync/record.h"

/* ---- Why an FMU does not come back to where it was: found out by leading it back in several ways.
 *
 * Purpose: a word for who asks the FMU's vendor, or reads of it. Each is by what was seen, and not by what exporter it is. It takes a copy of all that the FMU knows
 *          beside its states (tl_component_keep()), to which it always comes back.
 * Thread:  the twin's. It takes some twenty steps, and so the time of none that has a deadline.
 */

/* A component that stands at the beginning of `step`, and what it is given in `steps` steps from there on. */
typedef struct tl_restore_trial {
    tl_component *component;
    tl_time macro_step; /* ns */
    int64_t step;
    unsigned steps;
    fmi2FMUstate state;          /* one that there is, or NULL */
    const unsigned char *inputs; /* of the steps, one behind the other, so many bytes apart; */
    size_t input_bytes;
    const unsigned char *elsewhere; /* what leads it far from there, in as many steps; NULL: that is not tried */
    unsigned char *outputs;         /* scratch: the same, of steps + 1 */
    size_t output_bytes;
} tl_restore_trial;

/* What that means, for people: "incomplete state: …"; "" of one that says nothing. */
const char *tl_restore_cause_text(tl_restore_cause cause);

/* The component has been kept, and stands where it did afterwards; what is in its ports is anything. Errors: TL_FMU_FAILED: it could not be brought back;
 * TL_FMU_FATAL. */
tl_status tl_restore_cause_find(const tl_restore_trial *trial, tl_restore_cause *cause, tl_error *error);

/* ---- Whether FMUs still come back to where they were: for as long as a twin runs, committed steps are executed again, and must give the same bits.
 *
 * Purpose: the proof (proof.h) sees an FMU where it begins, and some are exact there and wrong later. So one component after the other takes its turn: its
 *          state at the committed instant is saved, what it is given in the next TL_VERIFIED_STEPS committed steps is noted, and what it gives;
 *          then it is led back, is given the same again, and is led to where it was.
 * No harm:  if there is a copy of all that it knows beside its own states (tl_fmi2_aside), of 16 MiB at most, that copy leads it to where it was, and not a state of the kind
 *          that is in question. Values, caches and counts of executions are as if nothing had been: what is executed here is counted apart.
 * Time:    between two ticks, a turn's work is done at once or not begun: it needs TL_VERIFIER_ROOM times what it is expected to take.
 * Not:     for a twin that adjusts nothing, since it never goes back; nor with an event horizon, which holds states of its own.
 * Thread:  the twin's. Memory: the arena, at start-up; two states of each FMU, made at its start.
 */

enum {
    TL_VERIFIED_STEPS = 3, /* a solver that begins anew shows it in the second */
    TL_VERIFIER_ROOM = 2
};

/* What was found: an output that is not the same. */
typedef struct tl_verifier_finding {
    size_t component;
    const tl_port *port; /* NULL: the FMU failed, which it had not done before */
    int64_t step;        /* that was executed again, */
    unsigned after;      /* 1 … TL_VERIFIED_STEPS: the how manieth since the state was saved */
    double committed;
    double again;
    tl_restore_cause cause; /* looked for only if there is time enough, and a copy of its memory */
} tl_verifier_finding;

typedef struct tl_verifier_counts {
    uint64_t turns; /* that came to their end */
    uint64_t found; /* of them, with a finding */
    uint64_t executions;
} tl_verifier_counts;

/* One component's. */
typedef struct tl_verified {
    fmi2FMUstate earlier; /* NULL: none yet */
    fmi2FMUstate aside;
    tl_time there_and_back; /* ns, without steps; 0: not known */
    bool differs;           /* and has no other way: it gets no turn any more */
} tl_verified;

typedef enum tl_verifier_phase {
    TL_VERIFIER_RESTS,
    TL_VERIFIER_BEGINS,
    TL_VERIFIER_NOTES,
    TL_VERIFIER_REPEATS
} tl_verifier_phase;

/* Fields are private. Zeroed: one that verifies nothing. */
typedef struct tl_verifier {
    tl_exchange *exchange;
    const tl_graph *graph;
    tl_verified *verified; /* one per component */
    uint32_t every;        /* committed steps from one turn's end to the next one's beginning; 0: there are no turns */
    tl_verifier_phase phase;
    uint32_t waited;  /* committed steps in this phase */
    size_t component; /* whose turn it is */
    int64_t first;    /* step of those noted */
    uint32_t noted;
    tl_exchange_note note; /* where the step to come is noted */
    size_t input_bytes;    /* of the component with the most, */
    size_t output_bytes;
    unsigned char *inputs; /* of the steps noted, one behind the other, and of the present */
    unsigned char *outputs;
    tl_verifier_counts counts;
} tl_verifier;

/* For an exchange whose values are placed. False when memory is out. */
bool tl_verifier_init(tl_verifier *verifier, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph,
                      uint32_t every);

/* The FMUs stand where the twin begins, and are proved. Makes their states; if `budget` has a clock, takes the time of it. */
tl_status tl_verifier_start(tl_verifier *verifier, const tl_budget *budget, tl_error *error);

/* This step was committed. */
void tl_verifier_committed(tl_verifier *verifier, int64_t step);

/* Between two ticks: goes on, if what is left of `budget` is enough (no clock: it is). *found: there is a finding. Errors: TL_FMU_FAILED: a component could not be
 * brought to where it was; TL_FMU_FATAL. */
tl_status tl_verifier_go_on(tl_verifier *verifier, const tl_budget *budget, tl_verifier_finding *finding, bool *found,
                            tl_error *error);

/* The component of a finding has no other way. */
void tl_verifier_leave_out(tl_verifier *verifier, size_t component);

/* The FMUs begin anew: what was noted is of no use. */
void tl_verifier_abandon(tl_verifier *verifier);

/* Gives a component's states back, and what is kept of it, before it is freed or its states are worth nothing. They are made again when they are needed. */
void tl_verifier_end_component(tl_verifier *verifier, size_t component);

#endif
