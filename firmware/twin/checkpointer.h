/* Checkpointer: saves the running twin at intervals, so that a restarted twin has few ticks to
 *               repeat.
 *
 * Purpose: saves after a tick, in the cycle's thread, if enough of the tick's time budget is left.
 *          The bytes go into the record queue, from which the next twin process and the recorder
 *          read them. If another process cannot load the saved states of an FMU, nothing is saved.
 * When:    after the first tick, which also measures the cost. Then every 10 s of plant time, or
 *          every 2000 ticks if that is shorter. After a reset of the FMUs, as soon as there is
 *          time. If a due checkpoint does not fit into the budget, the next tick tries again. After
 *          three more intervals an event reports this once.
 * Off:     nothing is saved any more if an FMU cannot serialise its state, if the first save takes
 *          longer than the budget of a step, or if the state becomes too large. An event reports
 *          it. A restart then repeats the newest inputs, which the record queue keeps for this.
 * Shadow:  a shadow first measures the cost, after one of its ticks. The run of a shadow begins
 *          with its first checkpoint.
 * Thread:  the cycle's.
 * Memory:  in the record queue; reserved after the first tick.
 * Errors:  none are returned; a failure is an event.
 */
#ifndef TL_FIRMWARE_TWIN_CHECKPOINTER_H
#define TL_FIRMWARE_TWIN_CHECKPOINTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/report/journal.h"
#include "firmware/store/record_queue.h"
#include "firmware/twin/assembly.h"

typedef struct tl_checkpointer {
    tl_twin *twin;
    tl_record_queue *queue;
    tl_journal *journal;
    int64_t interval;  /* ticks */
    int64_t next;      /* tick after which the next checkpoint is due */
    tl_time cost;      /* ns, as measured last */
    tl_time least;     /* ns, lowest cost: expected once a checkpoint is late, so that one slow save blocks no others */
    bool is_ready;     /* memory is allocated and the cost is known */
    bool only_marks;   /* nothing can be saved: enqueues empty checkpoints; the queue keeps the inputs from there on */
    bool is_off;       /* record.resume_s is 0: this run is never resumed */
    bool has_reported; /* the event about a late checkpoint */
} tl_checkpointer;

/* Bytes to reserve for each checkpoint of a twin that takes `size` bytes now: twice that, because
 * its state may grow. */
size_t tl_checkpointer_room(size_t size);

/* `readable`: false if another process cannot load the serialised states of these FMUs. The twin of
 * the assembly, the queue and the journal must outlive the checkpointer. */
void tl_checkpointer_init(tl_checkpointer *self, const tl_assembly *assembly, tl_record_queue *queue,
                          tl_journal *journal, bool readable);

/* Requests a checkpoint after this tick, because the FMUs were reset and the older ones are
 * obsolete. */
void tl_checkpointer_request(tl_checkpointer *self, int64_t tick);

/* Saves if a checkpoint is due and there is time. Call it after each tick. `budget`: that of the
 * tick; NULL: a missed tick was caught up, so there is no time to save. */
void tl_checkpointer_after(tl_checkpointer *self, int64_t tick, const tl_budget *budget);

/* ---- of a shadow, whose run begins after its first ticks ---- */

/* Measures once what a checkpoint costs, and enqueues nothing. Call it after a tick. `budget` as in
 * tl_checkpointer_after(). */
void tl_checkpointer_rehearse(tl_checkpointer *self, const tl_budget *budget);

/* Saves the twin into the record queue's memory if that is expected to take less than `left` ns;
 * tl_checkpointer_put() must follow. *size: bytes. Returns false if nothing was saved: no time, the
 * cost is not measured yet, or saving is not possible at this tick. */
bool tl_checkpointer_save(tl_checkpointer *self, tl_time left, size_t *size);

/* Enqueues the bytes of the last tl_checkpointer_save() as a checkpoint: the state of the twin
 * after `tick`. The next checkpoint is due as usual. */
void tl_checkpointer_put(tl_checkpointer *self, int64_t tick, size_t size);

#endif
