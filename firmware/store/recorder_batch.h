/* A batch: what is in the inbox, into the file, in one transaction.
 *
 * Purpose: forms batches, of one run each, and commits them. It is formed in `next`, a copy of the mark of what is committed: positions, totals and
 *          the run move on in it with each thing that is written, and become the mark when the transaction is committed. What fails is forgotten with it.
 * Samples: come by the ring, since a replay has to see what the twin has seen. One that does not is taken from what io has read: in front of a later one,
 *          at the end of the run, or before io's readings are overwritten. It is replaced if it comes after all.
 * Order:   the writer's own events, then entries, then the events that were put before the last of these.
 * Runs:    a START entry begins one, END ends it. Events that come before the first START wait for it; entries before it belong to no run, and are
 *          dropped. A START while a run is open means that that one was not ended cleanly.
 * Handing: an END with the settings' reason hands over: what follows it in the ring is of a later run than one in another ring, and is not read before
 *          that was. Nor is it ever if nobody may go on; but if the reason was said without cause, who knows that says so.
 * Touches: the marks of the writer's state; the inbox; the file, which is open (tl_recorder_file.database), and which it neither opens nor closes.
 * Errors:  SQLite's result codes; the file has the words (tl_recorder_file_keep_words()).
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_BATCH_H
#define TL_FIRMWARE_STORE_RECORDER_BATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/process/heartbeat.h"
#include "firmware/store/outbox.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/store/recorder_file.h"
#include "firmware/store/recorder_inbox.h"
#include "firmware/store/recorder_state.h"

/* All of these outlive the batches. */
typedef struct tl_recorder_batch_settings {
    tl_recorder_file *file;
    tl_recorder_inbox *inbox;
    tl_recorder_writer_state *state;
    unsigned char *checkpoint;      /* of the size of those of the outbox with the ring; NULL: it has none */
    tl_heart *heart;                /* of the caller's thread: beats with each batch; NULL: nobody's */
    const char *hand_over;          /* see above; NULL: no run does */
    bool (*goes_on)(void *context); /* after such an END there is no other ring */
    void *context;
    tl_recorder_plant plant;
} tl_recorder_batch_settings;

/* Private; begins with its settings, and zeros. */
typedef struct tl_recorder_batch {
    tl_recorder_batch_settings settings;
    tl_recorder_mark next;
    tl_recorder_entry entry; /* too large for a small stack */
    bool is_over;            /* the next entry is for another batch */
    bool ends;               /* the run does, with this batch */
    bool is_stray;           /* the newest sample was of a run whose beginning was not read */
    bool is_last;            /* the writer of samples has ended */
} tl_recorder_batch;

/* A run begins, without an entry. It gets its row with the next batch. */
void tl_recorder_batch_begin_run(tl_recorder_batch *batch, const tl_outbox_start *start);

/* One transaction, of entries up to `end` of the ring, or to where another run begins, and events as far as they fit. *more: it should be followed
 * by another one. */
int tl_recorder_batch_write(tl_recorder_batch *batch, uint64_t end, bool *more);

/* Those whose entries are written, in a transaction of its own each. */
int tl_recorder_batch_write_checkpoints(tl_recorder_batch *batch);

/* What was read of the ring so far is followed by what lies at this position; what is between is lost. Nothing if it is not ours to read. */
void tl_recorder_batch_skip(tl_recorder_batch *batch, uint64_t position);

/* A run begins with the next entry. */
bool tl_recorder_batch_has_beginning(tl_recorder_batch *batch);

/* All of the ring is written, up to where it hands over, and the events of that outbox. */
bool tl_recorder_batch_has_drained(tl_recorder_batch *batch);

/* Nothing is left that could be written. */
bool tl_recorder_batch_is_empty(tl_recorder_batch *batch);

/* Samples, steps and events that are not written. */
uint64_t tl_recorder_batch_count_left(tl_recorder_batch *batch);

#endif
