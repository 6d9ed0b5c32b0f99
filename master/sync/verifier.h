/* Verification during the run that rollbacks are exact, and the cause if one is not.
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
 * Purpose: finds the cause by experiments, for the user and the FMU's vendor. This needs a full
 *          copy of the FMU in addition to its states (tl_component_save_copy()), so that the FMU
 *          can always be restored.
 * Thread:  the twin's. It executes about twenty steps, so it never runs in a cycle with a deadline.
 */

/* A component at the beginning of `step`, and its inputs for `steps` steps from `step` on. */
typedef struct tl_restore_trial {
    tl_component *component;
    tl_time macro_step; /* ns */
    int64_t step;
    unsigned steps;
    fmi2FMUstate state;          /* a handle to reuse, which stays valid; NULL: none */
    const unsigned char *inputs; /* of the steps, one after the other, each of input_bytes */
    size_t input_bytes;
    const unsigned char *
        distant_inputs; /* inputs of as many steps that move it to a distant state; NULL: this experiment is left out */
    unsigned char *outputs; /* scratch: outputs of steps + 1 steps */
    size_t output_bytes;
} tl_restore_trial;

/* Description of a cause: "incomplete state: …"; "" if it is unknown. */
const char *tl_restore_cause_text(tl_restore_cause cause);

/* Determines the cause. Call tl_component_save_copy() before. Afterwards the component has its old
 * state, but its port values are undefined. Errors: TL_FMU_FAILED if it could not be restored;
 * TL_FMU_FATAL. */
tl_status tl_restore_cause_find(const tl_restore_trial *trial, tl_restore_cause *cause, tl_error *error);

/* ---- Verification: during the whole run, executes committed steps again after a rollback and
 * compares the bits.
 *
 * Purpose: the proof (proof.h) tests an FMU at its start, but some become inexact later. So the
 *          components are verified in turn. In a turn, the state of one component is saved at the
 *          committed instant. Its inputs and outputs of the next TL_VERIFIED_STEPS committed steps
 *          are stored. Then three runs start from the saved state: the steps of a candidate, the
 *          committed steps, and the candidate again. The last run saves and restores the state once
 *          more after its first step. Finally the component is restored to its present state.
 *          An FMU that is rolled back by its own states must also have the same internal variables
 *          after both runs of the candidate (tl_component_hash()).
 *          The candidate shows whether states lack data that only a candidate changes. It comes
 *          from the searches of these steps. If there was none, the committed inputs are changed by
 *          a twentieth. The candidate is left out if there is time for the committed steps only.
 * No harm: the component is restored from a full copy (tl_fmi2_fallback), because a state may be
 *          inexact. Without a full copy, or if it exceeds 16 MiB, the component is restored from a
 *          state. Values, caches and counts of executions do not change; these executions are
 *          counted separately.
 * Time:    the runs of a turn are made together, between two ticks. They start only if
 *          TL_VERIFIER_RESERVE times their expected duration is left.
 * Not for: a twin that adjusts nothing, because it never rolls back; an event horizon, which has
 *          states of its own.
 * Thread:  the twin's. Memory: the arena, at start-up; two states of each FMU, created at its
 *          start.
 */

enum {
    TL_VERIFIED_STEPS = 3, /* a restart of an FMU's internal solver shows only in the second step */
    TL_VERIFIED_EXECUTIONS = 3 * TL_VERIFIED_STEPS, /* of a whole turn */
    TL_VERIFIER_RESERVE = 2
};

/* A finding: an output that differs. */
typedef struct tl_verifier_finding {
    size_t component;
    const tl_port *port;    /* NULL: an internal variable differs, or the FMU failed (TL_CAUSE_REFUSES) */
    int64_t step;           /* the step that was executed again */
    unsigned after;         /* 1 … TL_VERIFIED_STEPS: number of steps since the saved state */
    double committed;       /* value in the committed step */
    double again;           /* value in the repeated step */
    tl_restore_cause cause; /* determined only if there is enough time and a full copy */
} tl_verifier_finding;

typedef struct tl_verifier_counts {
    uint64_t turns; /* completed turns */
    uint64_t found; /* of these, turns with a finding */
    uint64_t executions;
} tl_verifier_counts;

/* Verification data of one component. */
typedef struct tl_verified {
    fmi2FMUstate earlier;   /* state at the start of a turn; NULL: none yet */
    fmi2FMUstate full_copy; /* present state, if it is not in a tl_fmi2_fallback copy; NULL: none yet */
    tl_time there_and_back; /* ns: restore of the earlier and of the present state, without steps; 0: not known */
    bool differs;           /* not exact, and without another rollback method: not verified any more */
} tl_verified;

typedef enum tl_verifier_phase {
    TL_VERIFIER_PAUSES, /* between two turns */
    TL_VERIFIER_BEGINS, /* waits for time to save the state */
    TL_VERIFIER_NOTES,  /* stores inputs and outputs of committed steps */
    TL_VERIFIER_REPEATS /* waits for time for the runs */
} tl_verifier_phase;

/* Fields are private. Zeroed: verifies nothing. */
typedef struct tl_verifier {
    tl_exchange *exchange;
    const tl_graph *graph;
    tl_verified *verified; /* one per component */
    uint32_t every;        /* committed steps from the end of one turn to the start of the next; 0: no turns */
    tl_verifier_phase phase;
    uint32_t waited;       /* committed steps in this phase */
    size_t component;      /* the component of this turn */
    int64_t first;         /* first stored step */
    uint32_t noted;        /* number of stored steps */
    tl_exchange_note note; /* buffers for the next step */
    size_t input_bytes;    /* largest of all components, like output_bytes */
    size_t output_bytes;
    unsigned char *inputs; /* of the stored steps, of the candidate's steps, and the present ones */
    unsigned char *outputs;
    tl_verifier_counts counts;
} tl_verifier;

/* For an exchange that is initialised. Returns false if memory is out. */
bool tl_verifier_init(tl_verifier *verifier, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph,
                      uint32_t every);

/* Call at the start of the twin, after the proof: creates the states. If `budget` has a clock,
 * measures the duration of restoring the earlier and the present state. */
tl_status tl_verifier_start(tl_verifier *verifier, const tl_budget *budget, tl_error *error);

/* Reports a committed step. */
void tl_verifier_committed(tl_verifier *verifier, int64_t step);

/* Call between two ticks: continues the turn if the rest of `budget` is long enough. Without a
 * clock it always is. *found: there is a finding. Errors: TL_FMU_FAILED if a component could not be
 * restored; TL_FMU_FATAL. */
tl_status tl_verifier_continue(tl_verifier *verifier, const tl_budget *budget, tl_verifier_finding *finding,
                               bool *found, tl_error *error);

/* Excludes the component of a finding that has no other rollback method. */
void tl_verifier_exclude(tl_verifier *verifier, size_t component);

/* Call after a reset of the FMUs: abandons the current turn. */
void tl_verifier_abandon(tl_verifier *verifier);

/* Frees a component's states and abandons the current turn. Call it before the component is freed,
 * or if its states have become invalid. States are created again when needed. */
void tl_verifier_end_component(tl_verifier *verifier, size_t component);

#endif
