/* Rollback proof before a run, and choice of the faster of two exact rollback methods.
 *
 * Thread:  the one that steps the twin.
 */
#ifndef TL_MASTER_SYNC_PROOF_H
#define TL_MASTER_SYNC_PROOF_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/graph/snapshot.h"
#include "master/sync/synchroniser.h"

/* ---- Choice between two exact rollback methods: copies of the memory, or the FMU's own states.
 *
 * Purpose: a copy of the memory lacks nothing that the FMU keeps there. Own states are as exact as
 *          their author made them: some lack what only a candidate changes. But for an FMU with
 *          much memory its own states may be far faster, and a search does little else. So both are
 *          measured in repeated rounds of save, step and restore.
 * Choice:  a copy, unless a round by it takes TL_ROLLBACK_TIMING_MARGIN times as long and the
 *          difference is not negligible. Then own states.
 * Exact:   the copy is not proved yet; the caller proves all components again. If the copy is not
 *          exact, the component returns to its own states (tl_component_restore_copy()).
 * Bits:    no result depends on the choice, because both methods are exact. The number of states
 *          that fit may.
 * Thread:  the twin's. Allocates no memory of the twin.
 */

/* Rounds of each method; three if the method is very slow. One more round comes first and does not
 * count. */
enum { TL_ROLLBACK_TIMING_ROUNDS = 15 };

#define TL_ROLLBACK_TIMING_MARGIN 1.5

/* ---- Rollback proof: some FMUs declare saved states and do not restore them exactly.
 *
 * Purpose: runs before the first step of a synchronised twin, on all components together. It
 *          executes TL_PROOF_STEPS steps and saves a second state in between. Then it restores the
 *          first state, makes an excursion, restores the second state and continues from there.
 *          Then it makes all excursions from the first state, in two orders, and repeats the steps
 *          after each. An excursion moves one adjusted variable by 1 or 4 first steps of the
 *          search up or down, or sweeps all of them; so it crosses an event, if inputs can cause
 *          one. Every repeated output must have the same bits.
 *          One step is not enough: an internal solver that restarts after a restore shows a
 *          difference in the second step. One state is not enough: some FMUs can hold only one. One
 *          excursion is not enough: some states lack a mode that only some inputs enter.
 *          Finally the first state is saved again: an FMU may have done something in these steps
 *          that neither its states nor a copy undo, such as opening a file. The next save is
 *          refused because of that, and it must not be the first one of the run.
 * Fallback: a component whose states are wrong gets its next rollback method, if there is one
 *           (tl_fmi2_fallback), and all are proved again. If there is a full copy of it, the cause
 *           of the difference is determined (verifier.h). If a copy is as exact as its states, the
 *           component uses the copy unless it is far slower, and all are proved again. Own states
 *           that are kept for their speed must give the same excursions as copies.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */

/* Steps that are repeated. If an FMU rejects a later step, the proof ends there: that says nothing
 * about its rollback. */
enum { TL_PROOF_STEPS = 10, TL_PROOF_MIDST = 5, TL_PROOF_EXCURSIONS = 13 };

/* Constant inputs, or a sweep, for TL_PROOF_STEPS steps from the start. */
typedef struct tl_proof_excursion {
    size_t variable; /* adjusted variable that moves; TL_MAX_ADJUST: all */
    double value;    /* where it goes */
    int noted;       /* steps whose outputs are noted; an FMU may have rejected the next one */
    bool is_noted;
} tl_proof_excursion;

typedef struct tl_proof {
    uint64_t executions; /* of the proof; no other count includes them */
    bool stepped;        /* false: the first step failed, which says nothing about the rollback */
    bool holds;
    size_t culprit;  /* the component that caused a failure; SIZE_MAX: not known */
    double *outputs; /* private from here on: outputs of each port of the graph in each step of the start, */
                     /* then of each excursion */
    tl_proof_excursion excursions[TL_PROOF_EXCURSIONS];
    size_t excursion_count;
    double start[TL_MAX_ADJUST]; /* adjusted variables at the start */
    int noted;                   /* number of these steps that were executed from the true start */
    tl_snapshot midst;           /* the second state */
    bool has_midst;              /* it was saved */
    bool was_saved;              /* the first state was saved */
    size_t value_bytes;          /* largest size of one component's inputs or outputs of a step */
    unsigned char *inputs;       /* of the steps of one component */
    unsigned char *elsewhere;    /* inputs that lead it to another state */
    unsigned char *gave;
} tl_proof;

/* Returns false if memory is out. The exchange must be initialised. */
bool tl_proof_init(tl_proof *proof, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph);

/* Runs after initialisation and before tl_exchange_start(). Leaves everything as it was at the
 * start of step `first`, and counts executions in `proof` only. `now`: clock in ns to choose the
 * faster method; NULL: no choice. Returns TL_FMU_FAILED, and names the output, if the rollback is
 * not exact. */
tl_status tl_proof_of_rollback(tl_proof *proof, tl_synchroniser *synchroniser, const tl_graph *graph, int64_t first,
                               tl_time (*now)(void *clock), tl_error *error);

/* Frees the second state. Called after the size of a state was measured, because until then no room
 * may become free. May be called at any time. */
void tl_proof_end(tl_proof *proof);

#endif
