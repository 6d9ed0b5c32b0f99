/* Verification of restored states during the run, and the cause of a difference.
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

/* ---- Cause of an inexact rollback.
 *
 * Purpose: names the cause for the user and the FMU's vendor, from experiments and not from the
 *          exporter's name. It needs a full copy of the FMU besides its states
 *          (tl_component_save_copy()), from which it can always be restored.
 * Thread:  the twin's. Takes some twenty steps, so it never runs in a cycle with a deadline.
 */

/* A component at the beginning of `step`, and its inputs for `steps` steps from there on. */
typedef struct tl_restore_trial {
    tl_component *component;
    tl_time macro_step; /* ns */
    int64_t step;
    unsigned steps;
    fmi2FMUstate state;          /* an existing state, or NULL */
    const unsigned char *inputs; /* of the steps, one after the other, each of input_bytes */
    size_t input_bytes;
    const unsigned char *elsewhere; /* inputs that lead it far away in as many steps; NULL: not tried */
    unsigned char *outputs;         /* scratch: outputs of steps + 1 steps */
    size_t output_bytes;
} tl_restore_trial;

/* Description of a cause: "incomplete state: …"; "" if it is unknown. */
const char *tl_restore_cause_text(tl_restore_cause cause);

/* Determines the cause. The component must have been kept and is left where it was; its port values
 * are undefined. Errors: TL_FMU_FAILED if it could not be restored; TL_FMU_FATAL. */
tl_status tl_restore_cause_find(const tl_restore_trial *trial, tl_restore_cause *cause, tl_error *error);

/* ---- Verification: executes committed steps again after a rollback and compares the bits, for as
 * long as a twin runs.
 *
 * Purpose: the proof (proof.h) tests an FMU at its start, but some become inexact later. So the
 *          components are verified in turn: the state of one is saved at the committed instant, and
 *          its inputs and outputs of the next TL_VERIFIED_STEPS committed steps are noted. Then it
 *          is rolled back, executes the steps of a candidate twice and the committed ones once,
 *          each from the same state, and is restored to where it was. The candidate comes from the
 *          searches of these steps; if there was none, the committed inputs are changed by a
 *          twentieth. It shows an FMU whose states lack what only a candidate changes, and is left
 *          out if there is time for the committed steps only.
 * No harm: if there is a full copy besides its own states (tl_fmi2_fallback) of at most 16 MiB, it
 *          is restored from that copy, not from a state of the kind in question. Values, caches and
 *          counts of executions are unchanged; these executions are counted separately.
 * Time:    the work of a turn is done between two ticks, whole or not at all: it needs
 *          TL_VERIFIER_RESERVE times its expected duration.
 * Not for: a twin that adjusts nothing, since it never rolls back; an event horizon, which holds
 *          states of its own.
 * Thread:  the twin's. Memory: the arena, at start-up; two states of each FMU, created at its
 *          start.
 */

enum {
    TL_VERIFIED_STEPS = 3, /* an internal solver that restarts shows it in the second */
    TL_VERIFIED_EXECUTIONS = 3 * TL_VERIFIED_STEPS,
    TL_VERIFIER_RESERVE = 2
};

/* A finding: an output that differs. */
typedef struct tl_verifier_finding {
    size_t component;
    const tl_port *port; /* NULL: the FMU failed, which it had not done before */
    int64_t step;        /* the step that was executed again */
    unsigned after;      /* 1 … TL_VERIFIED_STEPS: number of steps since the saved state */
    double committed;    /* value the first time */
    double again;
    tl_restore_cause cause; /* determined only if there is enough time and a full copy */
} tl_verifier_finding;

typedef struct tl_verifier_counts {
    uint64_t turns; /* completed */
    uint64_t found; /* of these, with a finding */
    uint64_t executions;
} tl_verifier_counts;

/* State of one component. */
typedef struct tl_verified {
    fmi2FMUstate earlier; /* NULL: none yet */
    fmi2FMUstate full_copy;
    tl_time there_and_back; /* ns, without steps; 0: not known */
    bool differs;           /* it has no other method and is not verified any more */
} tl_verified;

typedef enum tl_verifier_phase {
    TL_VERIFIER_PAUSES,
    TL_VERIFIER_BEGINS,
    TL_VERIFIER_NOTES,
    TL_VERIFIER_REPEATS
} tl_verifier_phase;

/* Fields are private. Zeroed: verifies nothing. */
typedef struct tl_verifier {
    tl_exchange *exchange;
    const tl_graph *graph;
    tl_verified *verified; /* one per component */
    uint32_t every;        /* committed steps from the end of one turn to the start of the next; 0: no turns */
    tl_verifier_phase phase;
    uint32_t waited;  /* committed steps in this phase */
    size_t component; /* the component of this turn */
    int64_t first;    /* first noted step */
    uint32_t noted;
    tl_exchange_note note; /* where the next step is noted */
    size_t input_bytes;    /* of the component with the most */
    size_t output_bytes;
    unsigned char *inputs; /* of the noted steps, of the candidate's, and of the present */
    unsigned char *outputs;
    tl_verifier_counts counts;
} tl_verifier;

/* For an exchange that is initialised. Returns false if memory is out. */
bool tl_verifier_init(tl_verifier *verifier, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph,
                      uint32_t every);

/* At the start of the twin, after the proof: creates the states. If `budget` has a clock, the
 * duration is measured. */
tl_status tl_verifier_start(tl_verifier *verifier, const tl_budget *budget, tl_error *error);

/* Reports a committed step. */
void tl_verifier_committed(tl_verifier *verifier, int64_t step);

/* Between two ticks: continues if the rest of `budget` is long enough (always without a clock).
 * *found: there is a finding. Errors: TL_FMU_FAILED: a component could not be restored;
 * TL_FMU_FATAL. */
tl_status tl_verifier_continue(tl_verifier *verifier, const tl_budget *budget, tl_verifier_finding *finding,
                               bool *found, tl_error *error);

/* Excludes the component of a finding that has no other rollback method. */
void tl_verifier_exclude(tl_verifier *verifier, size_t component);

/* After a reset of the FMUs: drops what was noted. */
void tl_verifier_abandon(tl_verifier *verifier);

/* Frees a component's states and notes, before it is freed or if its states have become invalid.
 * They are created again when needed. */
void tl_verifier_end_component(tl_verifier *verifier, size_t component);

#endif
