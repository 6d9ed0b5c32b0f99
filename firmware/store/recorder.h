/* The recorder of a replay: writes everything a run saw, did and decided into SQLite.
 *
 * Purpose: for a process that both computes and records: an outbox (record_queue.h) in its memory, and a thread that runs a writer
 *          (recorder_writer.h) every `commit` interval, or earlier if the ring is half full. Schema: config/SPEC.md, "Database".
 * Loss:    synchronous=FULL: what is committed survives a power cut. A power cut and a kill lose what was not yet
 *          committed: at most the last `commit` interval, while the disk keeps up.
 * Bound:   `max_bytes`, database and write-ahead log together: the oldest runs go first, then the oldest ticks of the
 *          running one.
 * Faults:  a full disk or a locked database is said once, in the log and as an event; entries are kept while the
 *          outbox has room (30 s of steps, or 16 MiB), then a put waits, then they are counted as lost; writing is tried again every
 *          `commit` interval. That it works again, and what was lost, is an event too. A file that shows damage, is removed or is moved away
 *          is made anew.
 * Writers: one per database, by a lock file beside it; any number of readers.
 * Thread:  put_* from one producer thread; event() and counts from any thread; open and close
 *          from one, close when nobody uses the recorder any more. The recorder's own thread runs at ordinary priority.
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

/* What became of what was put: samples, steps and events alike. What the recorder itself says is not counted. */
typedef struct tl_recorder_counts {
    uint64_t written; /* entries committed */
    uint64_t lost;    /* entries for which there was no room, or that were removed with the file they were in */
    int64_t run;      /* id of this run in the database */
} tl_recorder_counts;

/* The run begins now. Errors: TL_TRY_AGAIN (cannot create, another recorder has it, locked for 2 s, full), TL_BAD_DATA (the file is no
 * database of ours; nothing of it is changed). The account is copied; all other texts and arrays outlive the recorder. */
tl_status tl_recorder_open(const tl_recorder_settings *settings, tl_recorder **recorder, tl_error *error);

/* Producer. Stamps count from t_start. Waits for room if the ring is full, but not if the disk has refused for settings.patience:
 * then the entry is lost. `ledger` has an entry for each of settings.components, as of this step: so that what is committed of both belongs
 * together, whatever comes next. */
void tl_recorder_put_sample(tl_recorder *recorder, const tl_sample *sample);
void tl_recorder_put_step(tl_recorder *recorder, const tl_record *record, const tl_recorder_component *ledger);

/* The twin has this from its tick on: before that tick's sample. Its configuration is one of settings.known, or that of the settings. */
void tl_recorder_put_tuning(tl_recorder *recorder, const tl_run_tuning *tuning);

/* Any thread, wait-free, the cycle's too. `source` is one word ("plant", "cycle", "twin"); `tick` −1 where it belongs to
 * none. Both texts are copied and cut to what an entry holds (31 and 223 bytes). */
void tl_recorder_event(tl_recorder *recorder, int64_t tick, tl_severity severity, const char *source, const char *text);

tl_recorder_counts tl_recorder_get_counts(const tl_recorder *recorder);

/* Writes what is left, ends the run with `reason` ("end of recording", "SIGTERM", …) and closes. Tries for at most
 * settings.patience where the disk refuses, then counts what is left as lost and fails with TL_TRY_AGAIN; the run then has no end, and
 * the next recorder marks it as not ended cleanly. `counts` may be NULL, and so may `recorder`. */
tl_status tl_recorder_close(tl_recorder *recorder, const char *reason, tl_recorder_counts *counts, tl_error *error);

#endif
