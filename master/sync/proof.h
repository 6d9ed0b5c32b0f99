/* The proof of rollback before a run, and the choice of the faster of two exact methods.
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
#include "master/sync/lock.h"

/* ---- Of two exact ways to lead a component back, the one that is faster on this machine.
 *
 * Purpose: an FMU may take far longer to save and restore its own state than a copy of its memory takes: some rebuild a solver each time. A search does hardly anything else, so
 *          what it costs is timed, and not guessed: saved, stepped and led back, again and again, by its own states and by copies.
 * Choice:  a copy, if by own states a round takes TL_FASTER_WAY_MARGIN times as long, and what is won is worth it. Else an FMU's own states are its own affair, and stay.
 * Exact:   by copies nothing is proved yet; who makes use of this proves all again. One that is not exact so goes back to its own states (tl_component_come_back()).
 * Bits:    no result depends on the choice, since both ways lead to where the component was. How many states find room may.
 * Thread:  the twin's. Takes no memory of the twin's.
 */

/* Of each way at most that count; of one that takes very long three. One more comes before them. */
enum { TL_FASTER_WAY_ROUNDS = 15 };

#define TL_FASTER_WAY_MARGIN 1.5

/* ---- A rollback is tested, not believed: there are FMUs that declare saved states and do not honour them.
 *
 * Purpose: before the first step of a synchronised twin, all its components interleaved: TL_PROOF_STEPS steps, with a second state saved in the midst of them. Then back to the
 *          first state, elsewhere with other inputs, to the second, on from there; back to the first, elsewhere across as far as a search may soon go (and so across
 *          an event, if inputs lead to one), back, and all steps again. Whatever is repeated must give the same bits at every output that is exchanged.
 *          One step is not enough: a solver inside of an FMU that begins anew after a restore shows it in the second. Nor is one state: some FMUs have room for one only.
 *          At last the first state is saved once more: an FMU may have done in these steps what its states, or a copy of its memory, do not take back, such as to open a
 *          file; the next save is refused for that, and shall not be the first one of the run.
 * Other:   one whose states turn out to be wrong is led back by another way from then on, if there is one (tl_fmi2_aside), and all are proved again. If there is a copy of
 *          all that it knows, it is found out in which way they are wrong (verifier.h). If a copy does what its states do, and faster, it is led back by that (proof.h), and
 *          all are proved once more, too.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */

/* That are repeated. An FMU that refuses a later one ends the proof there: that says nothing about its rollback. */
enum { TL_PROOF_STEPS = 10, TL_PROOF_MIDST = 5 };

typedef struct tl_proof {
    uint64_t executions; /* that it took, which no other count has */
    bool stepped;        /* false: what failed was the first step, which says nothing about the rollback */
    bool holds;
    size_t culprit;           /* the component that is to blame for a failure; SIZE_MAX: nobody is known to be */
    double *outputs;          /* private, from here on: for each port of the graph and each of the steps, */
    int noted;                /* of which so many were made from where the FMUs truly began */
    tl_snapshot midst;        /* the second state, */
    bool has_midst;           /* if so many steps could be made */
    bool was_saved;           /* the first one */
    size_t value_bytes;       /* the most that one component is given in a step, or gives */
    unsigned char *inputs;    /* of the steps of one component, */
    unsigned char *elsewhere; /* and of those that lead it elsewhere */
    unsigned char *gave;
} tl_proof;

/* False: there is no memory. The exchange has its values. */
bool tl_proof_init(tl_proof *proof, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph);

/* After initialisation, before tl_exchange_start(); leaves everything where it was, at the beginning of step `first`, and
 * no executions counted but in `proof`. `now`: ns, to see what is faster; NULL: nobody looks. TL_FMU_FAILED, and which output it is, if the rollback does not hold. */
tl_status tl_proof_of_rollback(tl_proof *proof, tl_lock *lock, const tl_graph *graph, int64_t first,
                               tl_time (*now)(void *clock), tl_error *error);

/* After that, and after it is measured what a state takes: until then no room is free that one had. Gives the second state back; may be called at any time. */
void tl_proof_end(tl_proof *proof);

#endif
