/* What a recorder is made with (the file, the run's facts, how patient it is), and its database: tables, statements, the beginning of a run.
 *
 * Owner:   all texts and arrays of the settings are the caller's, and outlive the recorder.
 * Thread:  the settings are plain data; the rest is the recorder's.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_DATABASE_H
#define TL_FIRMWARE_STORE_RECORDER_DATABASE_H

#include <sqlite3.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/store/database_file.h"
#include "firmware/store/record_queue.h"
#include "master/plan/plan.h"

typedef struct tl_recorder_settings {
    const char *path;
    tl_database_insistence insistence; /* at the opening; once it is open, whatever happens is coped with */
    int64_t max_bytes;                 /* 0: no bound; else at least 1,000,000 */
    tl_time commit;                    /* ns between commits, > 0, default 0.5 s */
    const char *verb;                  /* "run", "hold", "replay" */
    const char *name;                  /* of the configuration */
    const char *configuration;         /* its text, */
    const tl_recorder_known *known;    /* and others: they may change between two writes */
    size_t known_count;
    const char *fmus;   /* SHA-256 over those of the FMUs, */
    const char *boot;   /* of the system, */
    const char *format; /* and of the bytes of checkpoints; each may be NULL */
    tl_time step;       /* T_S */
    tl_pairing measurements;
    const tl_recorder_signal *plant, *match, *adjust;
    size_t plant_count, match_count, adjust_count;
    size_t component_count;    /* in the ledger */
    const tl_account *account; /* of a twin whose run begins when the recorder is opened: needed only then */
    tl_time patience;          /* ns, with a disk that refuses: of close, and of a put that waits for room; 0: 2 s */
} tl_recorder_settings;

/* Names as the recorder makes them of a configuration. */
typedef struct tl_recorder_names {
    char plant_texts[TL_MAX_SIGNALS][TL_RECORDER_NAME];
    tl_recorder_signal plant[TL_MAX_SIGNALS];
    tl_recorder_signal match[TL_MAX_MATCH]; /* without units and types, which the FMUs tell */
    tl_recorder_signal adjust[TL_MAX_ADJUST];
} tl_recorder_names;

/* Sets all that a configuration says: bound, interval, name, text, step, measurements, signals. Lives as long as both. */
void tl_recorder_settings_of(const tl_config *config, tl_recorder_names *names, tl_recorder_settings *settings);

typedef struct tl_recorder_database tl_recorder_database;

/* What a run has brought so far: what its row says. */
typedef struct tl_recorder_totals {
    uint64_t samples;
    uint64_t steps;
    uint64_t events;
    uint64_t lost;
    char committed[TL_UTC_TEXT]; /* when */
} tl_recorder_totals;

/* On a connection that writes. The settings must outlive it. It is to be closed after a failure too. */
int tl_recorder_database_open(sqlite3 *connection, const tl_recorder_settings *settings,
                              tl_recorder_database **database);

/* Before its connection. NULL is allowed. */
void tl_recorder_database_close(tl_recorder_database *database);

/* Bytes of ring that a batch should not exceed by more than one entry. */
size_t tl_recorder_database_batch(const tl_recorder_database *database);

/* Whether the file has this run, and that has these totals. */
int tl_recorder_database_has(tl_recorder_database *database, int64_t run, const tl_recorder_totals *totals, bool *has);

/* ---- a batch, of one run ---- */

/* Makes room for a batch of `bytes`, then begins it. `run` 0: it begins one. */
int tl_recorder_database_begin(tl_recorder_database *database, int64_t run, size_t bytes);

/* Begins a run; `timed`: its start is when it says; else it is now, and on no clock. Gives the id of its row. */
int tl_recorder_database_begin_run(tl_recorder_database *database, const tl_record_queue_start *start, bool timed,
                                   int64_t *run);

/* The run goes on: an end that somebody has found for it is none. */
int tl_recorder_database_go_on(tl_recorder_database *database);

/* Whoever was to end the run will not: it was not ended cleanly, unless it goes on all the same. */
int tl_recorder_database_give_up(tl_recorder_database *database);

/* What comes is not the run's beginning, which is not in this file. */
int tl_recorder_database_begin_at(tl_recorder_database *database, int64_t tick);

/* A sample, a step or a tuning. *impossible: its tick is none, or it is of a configuration that nobody knows, and it is not written. */
int tl_recorder_database_entry(tl_recorder_database *database, const tl_recorder_entry *entry, bool *impossible);

/* Its tick is one. */
int tl_recorder_database_tuning(tl_recorder_database *database, const tl_run_tuning *tuning, bool *impossible);

/* One that is larger than a file with this bound bears, or of a tick that is none, is left out. */
int tl_recorder_database_checkpoint(tl_recorder_database *database, int64_t tick, const unsigned char *bytes,
                                    size_t size);
int tl_recorder_database_event(tl_recorder_database *database, const tl_recorder_event_entry *event);

/* Ends a batch, and with a reason the run: all of it is on disk, or the caller must roll back. */
int tl_recorder_database_commit(tl_recorder_database *database, const tl_recorder_totals *totals, const char *reason);
void tl_recorder_database_rollback(tl_recorder_database *database);

/* After a commit: work that may fail without harm to what was committed. */
int tl_recorder_database_tidy(tl_recorder_database *database);

/* How often the log was written back, which alone changes the file itself. */
unsigned tl_recorder_database_writings_back(const tl_recorder_database *database);

#endif
