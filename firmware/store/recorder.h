/* Recorder of a replay, in the same process: writes the samples, steps, tunings and events of a run
 * into an SQLite database. A live run has a recorder process instead (recorder_writer.h).
 *
 * Purpose: has a record queue (record_queue.h) in the memory of the process. A thread runs the
 *          writer (recorder_writer.h) every settings.commit, or earlier if the queue is half full.
 *          Tables: docs/reference/database.md.
 * Loss:    committed data survives a power cut (SQLite's synchronous=FULL). A power cut or a kill
 *          loses uncommitted data: that of the last `commit` interval; more if the disk is slow.
 * Bound:   `max_bytes` for database and write-ahead log together. If it is reached, the oldest
 *          ticks of all runs are removed. Summaries of minutes and hours remain (periods.h).
 * Faults:  a full disk or a locked database is reported once, in the log and as an event. Entries
 *          wait in the record queue, which has room for 30 s of steps, at most 16 MiB. If it is
 *          full, a put waits for room. If writing has failed for settings.patience (default 2 s), a
 *          put without room loses its entry. Writing is retried every `commit` interval. Success
 *          and the number of lost entries are events too. A damaged, removed or moved file is
 *          replaced by a new one.
 * Writers: one per database, enforced by a lock file; any number of readers.
 * Owner:   tl_recorder_open() allocates, tl_recorder_close() frees.
 * Thread:  put_*: one producer thread. event() and counts: any thread. open and close: one thread;
 *          close after the last use by other threads. The recorder's own thread has ordinary
 *          priority.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_H
#define TL_FIRMWARE_STORE_RECORDER_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/recorder_database.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/twin/twin.h"

typedef struct tl_recorder tl_recorder;

/* Counts of samples, steps and events that were put. The recorder's own events are not included. */
typedef struct tl_recorder_counts {
    uint64_t written; /* committed */
    uint64_t lost;    /* the queue was full, or the file with them was removed or overwritten */
    int64_t run;      /* id of this run in the database */
} tl_recorder_counts;

/* Opens the database; the run begins now. Errors, unless settings->open_policy handles the fault:
 * TL_TRY_AGAIN (cannot create, another recorder writes it, locked for 2 s, disk full), TL_BAD_DATA
 * (not a twinlock database; it is not changed). settings->account is copied; all other texts and
 * arrays in `settings` must outlive the recorder. */
tl_status tl_recorder_open(const tl_recorder_settings *settings, tl_recorder **recorder, tl_error *error);

/* Put an entry; producer thread only. Stamps are relative to t_start. If the queue is full, the
 * calls wait or lose the entry: see Faults. `ledger` has the counts of all
 * settings.component_count components after this step; step and counts are committed together. */
void tl_recorder_put_sample(tl_recorder *recorder, const tl_sample *sample);
void tl_recorder_put_step(tl_recorder *recorder, const tl_record *record, const tl_execution_counts *ledger);

/* Records the tuning that the twin uses from tuning->tick on; call before that tick's sample. Its
 * configuration must be in settings.known, or be settings.configuration. */
void tl_recorder_put_tuning(tl_recorder *recorder, const tl_run_tuning *tuning);

/* Puts an event; any thread, because the call never blocks. `source` is one word
 * ("plant", "cycle", "twin"); `tick` −1: no tick. Both texts are copied and truncated (31 and 223
 * bytes). */
void tl_recorder_event(tl_recorder *recorder, int64_t tick, tl_severity severity, const char *source, const char *text);

tl_recorder_counts tl_recorder_get_counts(const tl_recorder *recorder);

/* Returns the highest number of a finding that the database had when it was opened; 0: none. */
uint32_t tl_recorder_last_finding(const tl_recorder *recorder);

/* Writes findings and learnt state of the change detector after all entries so far. Call it last,
 * before close: it ends the recorder's thread. A failure is only logged. */
void tl_recorder_put_changes(tl_recorder *recorder, const tl_run_changes *changes);

/* Writes the remaining entries, ends the run with `reason` ("end of recording", "SIGTERM", …) and
 * closes. If entries remain after settings.patience, counts them as lost and fails with
 * TL_TRY_AGAIN; the next recorder marks the run as not ended cleanly. `counts` and `recorder` may
 * be NULL. */
tl_status tl_recorder_close(tl_recorder *recorder, const char *reason, tl_recorder_counts *counts, tl_error *error);

#endif
