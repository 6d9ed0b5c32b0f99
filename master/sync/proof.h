/* A rollback is tested, not believed: there are FMUs that declare saved states and do not honour them.
 *
 * Purpose: before the first step of a synchronised twin: some steps, back, other steps with other inputs, back, and the first steps
 *          again must give the same bits at every output that is exchanged. One step is not enough: a solver inside of an FMU that begins
 *          anew after a restore shows it in the second.
 *          Then the state is saved once more: an FMU may have done in these steps what its states, or a copy of its memory, do not take back, such as to open a
 *          file; the next save is refused for that, and shall not be the first one of the run.
 * Other:   one whose states turn out to be wrong is led back by another way from then on, if there is one (tl_fmi2_aside), and all are proved again.
 * Thread:  the twin's.
 */
#ifndef TL_MASTER_SYNC_PROOF_H
#define TL_MASTER_SYNC_PROOF_H

#include <stdbool.h>

#include "master/base/status.h"
#include "master/graph/graph.h"
#include "master/sync/lock.h"

/* That are repeated. An FMU that refuses a later one ends the proof there: that says nothing about its rollback. */
enum { TL_PROOF_STEPS = 10 };

/* Where a proof puts what it finds. */
typedef struct tl_proof_place {
    double *outputs; /* scratch: for each port of the graph and each of the steps */
    bool *stepped;   /* false: what failed was the first step, which says nothing about the rollback */
} tl_proof_place;

/* After initialisation, before tl_exchange_start(); leaves everything where it was, at the beginning of step `first`, and
 * no executions counted. TL_FMU_FAILED, and which output it is, if the rollback does not hold. */
tl_status tl_proof_of_rollback(tl_lock *lock, const tl_graph *graph, int64_t first, const tl_proof_place *place,
                               tl_error *error);

#endif
