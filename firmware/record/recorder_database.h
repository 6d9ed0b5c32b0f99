/* One run in the recorder's database: its row, its batches, its end.
 *
 * Purpose: all SQL of writing. A batch is one transaction; what fails leaves nothing behind and is written again.
 * Errors:  opening as recorder.h says; everything after it gives SQLite's result code, and tl_recorder_database_text()
 *          the words.
 * Thread:  one at a time: opened by the recorder's owner, then its writer thread's.
 */
#ifndef TL_FIRMWARE_RECORD_RECORDER_DATABASE_H
#define TL_FIRMWARE_RECORD_RECORDER_DATABASE_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/record/recorder_entry.h"
#include "firmware/record/recorder_events.h"
#include "firmware/record/recorder_settings.h"

typedef struct tl_recorder_database tl_recorder_database;

/* The twin after a tick, as bytes; whoever has it frees them. */
typedef struct tl_recorder_checkpoint {
    unsigned char *bytes;
    size_t capacity;
    size_t size;
    int64_t tick;
} tl_recorder_checkpoint;

/* What a run has brought so far, committed and in this batch. */
typedef struct tl_recorder_totals {
    uint64_t samples;
    uint64_t steps;
    uint64_t events;
    uint64_t lost;
} tl_recorder_totals;

/* Takes the writer's lock, makes the file where there is none, ends runs that were left open, and begins this one. */
tl_status tl_recorder_database_open(const tl_recorder_settings *settings, tl_recorder_database **database,
                                    tl_error *error);

void tl_recorder_database_close(tl_recorder_database *database);

int64_t tl_recorder_database_run(const tl_recorder_database *database);

/* Bytes that a checkpoint may have, so that the file stays within its bound. Any thread. */
size_t tl_recorder_database_most(const tl_recorder_database *database);

/* Bytes of ring that a batch should not exceed by more than one entry. */
size_t tl_recorder_database_batch(const tl_recorder_database *database);

/* Makes room for a batch of `bytes`, then begins it. */
int tl_recorder_database_begin(tl_recorder_database *database, size_t bytes);

/* Within a batch. Entries: TL_ENTRY_START sets when the run began. */
int tl_recorder_database_entry(tl_recorder_database *database, const tl_recorder_entry *entry);
int tl_recorder_database_checkpoint(tl_recorder_database *database, const tl_recorder_checkpoint *checkpoint);
int tl_recorder_database_event(tl_recorder_database *database, const tl_recorder_event_entry *event);

/* Ends a batch: all of it is on disk, or the caller must roll back. */
int tl_recorder_database_commit(tl_recorder_database *database, const tl_recorder_totals *totals);
void tl_recorder_database_rollback(tl_recorder_database *database);

/* After a commit: work that may fail without harm to what was committed. */
int tl_recorder_database_tidy(tl_recorder_database *database);

/* Ends the run, in a transaction of its own. */
int tl_recorder_database_end(tl_recorder_database *database, const char *reason, const tl_recorder_totals *totals);

/* The words for the last failure. */
void tl_recorder_database_text(const tl_recorder_database *database, int code, char *text, size_t size);

#endif
