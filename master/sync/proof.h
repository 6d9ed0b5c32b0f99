/* Rollback proof: tests before a run that each rollback is exact, and chooses the faster of two
 * exact rollback methods.
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
 * Purpose: a copy of the memory contains all data that the FMU has in its memory. Own states are
 *          only as exact as the FMU's exporter made them: some lack an internal variable that
 *          changes only under the inputs of a candidate. But if the FMU has much memory, its own
 *          states may be far faster, and a search mostly saves and restores. So both are measured
 *          in repeated rounds of save, step and restore.
 * Choice:  copies of the memory, unless a round with them takes TL_ROLLBACK_TIMING_MARGIN times as
 *          long as with own states, and at least 10 µs longer. Then each restore of the own state
 *          after an excursion must give the memory the same bits as before, else copies are chosen.
 *          If copies take TL_ROLLBACK_TIMING_LIMIT times as long, the bits are only compared one
 *          step after the restore.
 * Exact:   at the time of the choice, only own states are proved. If copies are chosen,
 *          tl_proof_of_rollback() proves all components again. If a copy is not exact, its
 *          component returns to own states.
 * Bits:    results have the same bits with both methods. Only the number of states that a cache can
 *          keep within its memory limit can differ, and so the number of executions.
 * Thread:  the twin's. Allocates nothing from the arena.
 */

/* Maximum number of measured rounds of each method. A round that may allocate memory comes before
 * and is not measured. After three measured rounds, another one starts only within 20 ms of the
 * first. */
enum { TL_ROLLBACK_TIMING_ROUNDS = 15 };

#define TL_ROLLBACK_TIMING_MARGIN 1.5
#define TL_ROLLBACK_TIMING_LIMIT 30.0

/* ---- Rollback proof: some FMUs declare that they can save states, but do not restore them
 * exactly.
 *
 * Excursion: TL_PROOF_STEPS steps with other inputs, to trigger events inside the FMUs. It moves
 *          one adjusted variable up or down by 1 or 4 times its `step` (a Boolean: to the other
 *          value), or moves all of them up and down by 4 times their `step`.
 * Purpose: runs before the first step of a synchronised twin, on all components together:
 *          1. saves the first state, executes TL_PROOF_STEPS steps, and saves the second state
 *             before step TL_PROOF_MIDST;
 *          2. restores the first state, makes an excursion, restores the second state, and repeats
 *             the steps after it;
 *          3. makes each excursion from the first state, and then repeats all steps from there;
 *          4. makes the excursions in reverse order, each with a save and a restore in its middle;
 *          5. saves the first state again. This fails if an FMU has done something that no rollback
 *             undoes, such as opening a file: here and not later in the run.
 *          Every repeated output must have the same bits. After the last step, the internal
 *          variables must have the same bits too if the FMU is rolled back by its own states: an
 *          output at a limit may hide a difference for long.
 * Reasons: several steps, because an internal solver that restarts after a restore shows a
 *          difference only in the second step. Two states, because some FMUs overwrite the first
 *          when they save the second. Several excursions, because some FMUs have a mode that only
 *          certain inputs start, and that their states do not contain.
 * Wrong states: the component gets its next rollback method, if there is one (tl_fmi2_fallback).
 *          Then all components are proved again. If there is a full copy of the component's memory,
 *          the cause of the difference is determined (verifier.h).
 * Exact states: if the component can be copied too, the faster method is chosen as above. If it
 *          keeps its own states, all excursions must give the same outputs with them as with
 *          copies.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */

/* Number of steps that are repeated, step before which the second state is saved, and largest
 * number of excursions. If an FMU rejects a step after the first, only the steps before it are
 * repeated, because this is no fault of its rollback. */
enum { TL_PROOF_STEPS = 10, TL_PROOF_MIDST = 5, TL_PROOF_EXCURSIONS = 13 };

/* An excursion: TL_PROOF_STEPS steps from the start, with constant inputs or a sweep. */
typedef struct tl_proof_excursion {
    size_t variable; /* adjusted variable that moves; TL_MAX_ADJUST: all */
    double value;    /* new value of the variable */
    int noted;       /* number of steps whose outputs are stored; an FMU may have rejected the next one */
    bool is_noted;   /* the excursion was made once: later ones are compared with its outputs */
    bool is_hashed;  /* the hashes after its last step are stored */
} tl_proof_excursion;

typedef struct tl_proof {
    uint64_t executions; /* of the proof; no other count includes them */
    bool stepped;        /* false: the first step failed, which is no fault of the rollback */
    bool holds;          /* the rollback of all components is exact */
    size_t culprit;      /* the component that caused a failure; SIZE_MAX: not known */
    /* private: */
    double *outputs;  /* values of each port in each step from the start, then in each step of each excursion */
    uint64_t *hashes; /* tl_component_hash() of each component after the steps from the start, */
                      /* then after each excursion */
    tl_proof_excursion excursions[TL_PROOF_EXCURSIONS];
    size_t excursion_count;
    double start[TL_MAX_ADJUST];     /* adjusted variables at the start */
    int noted;                       /* number of steps from the start whose outputs are stored */
    bool is_hashed;                  /* the hashes after these steps are stored */
    tl_snapshot midst;               /* the second state */
    bool has_midst;                  /* the second state was saved */
    bool was_saved;                  /* the first state was saved */
    size_t value_bytes;              /* largest size of one component's inputs or outputs of a step */
    unsigned char *inputs;           /* to find the cause: inputs of one component in its steps */
    unsigned char *distant_inputs;   /* inputs that lead it to a state different from the saved one */
    unsigned char *repeated_outputs; /* buffer for its outputs when steps are repeated */
} tl_proof;

/* Allocates the buffers. The exchange must be initialised. Returns false if memory is out. */
bool tl_proof_init(tl_proof *proof, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph);

/* Executes the proof, after initialisation and before tl_exchange_start(). Afterwards values and
 * FMUs are as they were at the start of step `first`. Counts its executions in `proof` only. `now`:
 * clock in ns to choose the faster method, called with NULL; NULL: no choice. Returns TL_FMU_FAILED
 * if the rollback is not exact (the text names the output), or if the first step fails (`stepped`
 * is then false). Returns TL_FMU_FATAL if an FMU ends with fmi2Fatal. */
tl_status tl_proof_of_rollback(tl_proof *proof, tl_synchroniser *synchroniser, const tl_graph *graph, int64_t first,
                               tl_time (*now)(void *clock), tl_error *error);

/* Frees the second state. Call it only after the size of a state was measured at the start of a
 * run, because freed memory would falsify that measurement. May be called again. */
void tl_proof_end(tl_proof *proof);

#endif
