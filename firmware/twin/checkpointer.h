/* The checkpointer: saves the running twin now and then, so that a restart has little to run again.
 *
 * Purpose: after a tick, in the cycle's own thread, if the budget has time for it; the bytes go into the outbox, where a successor of this
 *          process finds them, and the recorder.
 *          Of FMUs whose saved states are of no use to another process nothing is saved.
 * When:    after the first tick, which also measures what it costs; from then on every 10 s of plant time, or 2000 ticks where
 *          that is less; and as soon as there is time after the FMUs have begun anew. If a checkpoint does not fit into the budget, or an
 *          FMU cannot be turned into bytes, an event says so, once; a restart then runs the newest inputs again, which the outbox
 *          keeps for that.
 * Shadow:  what it would take is found out while there is time; the first checkpoint is that with which its run begins.
 * Thread:  the cycle's. Memory: taken after the first tick.
 */
#ifndef TL_FIRMWARE_TWIN_CHECKPOINTER_H
#define TL_FIRMWARE_TWIN_CHECKPOINTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/record_queue.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/journal.h"

typedef struct tl_checkpointer {
    tl_twin *twin;
    tl_record_queue *queue;
    tl_journal *journal;
    int64_t interval; /* ticks */
    int64_t next;     /* tick after which one is due */
    tl_time cost;     /* ns, as measured last, */
    tl_time
        least; /* and at best, which is believed once one is late: that it took long once is no reason never to try again */
    bool is_ready;   /* there is room, and its cost is known */
    bool only_marks; /* nothing can be saved: what is kept of the inputs goes on */
    bool is_off;     /* nobody goes on with this run */
    bool has_told;
} tl_checkpointer;

/* What is reserved for each checkpoint of a twin that takes so many bytes now: it may grow. */
size_t tl_checkpointer_room(size_t size);

/* `readable`: false if states of these FMUs, as bytes, are of no use to another process. */
void tl_checkpointer_init(tl_checkpointer *self, const tl_assembly *assembly, tl_record_queue *queue,
                          tl_journal *journal, bool readable);

/* What was saved is of a twin that is no more, since its FMUs began anew: one is due after this tick. */
void tl_checkpointer_hurry(tl_checkpointer *self, int64_t tick);

/* After a tick that was computed within `budget`; NULL: it was made up, and there is no time for anything else. */
void tl_checkpointer_after(tl_checkpointer *self, int64_t tick, const tl_budget *budget);

/* ---- of a shadow, whose run begins in its middle ---- */

/* After a tick that was computed within `budget`, NULL as above: what a checkpoint takes is found out, once. Nothing is put. */
void tl_checkpointer_rehearse(tl_checkpointer *self, const tl_budget *budget);

/* Saves the twin, if that is expected to take less than `left` ns. False: it did not, or the twin cannot be saved (now). */
bool tl_checkpointer_save(tl_checkpointer *self, tl_time left, size_t *size);

/* What was saved last, which is the twin after this tick. The next one is due as after any. */
void tl_checkpointer_put(tl_checkpointer *self, int64_t tick, size_t size);

#endif
