/* Recorder's settings and its database statements: begins runs, writes batches, removes old data.
 *
 * Owner:   the caller owns all texts and arrays of the settings; they must outlive the recorder.
 * Errors:  functions that return int return SQLite's result code.
 * Thread:  the settings are plain data; all functions: the recorder's thread.
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
    const char *path;               /* of the database */
    tl_database_policy open_policy; /* faults that make the opening fail; later faults are handled */
    int64_t max_bytes;              /* bound of file and log; 0: no bound; else at least 1,000,000 */
    tl_time commit;                 /* ns between commits, > 0; configuration: default 0.5 s */
    const char *verb;               /* "run" or "replay"; in safe hold "hold" is recorded instead */
    const char *name;               /* of the configuration */
    const char *configuration;      /* its text */
    const tl_recorder_known *known; /* further configurations; they may change between two writes */
    size_t known_count;
    const char *fmus;   /* SHA-256 over the SHA-256 of the FMUs, or NULL */
    const char *boot;   /* id of the system's boot, or NULL */
    const char *format; /* of the checkpoints' bytes (tl_identity_format()), or NULL */
    tl_time step;       /* T_S, ns */
    tl_pairing measurements;
    const tl_recorder_signal *plant, *match, *adjust;
    size_t plant_count, match_count, adjust_count;
    size_t component_count;    /* number of components with counts */
    const tl_account *account; /* of the twin; only tl_recorder_open() reads it */
    tl_time patience;          /* longest wait of recorder.h if writing fails, ns; 0: 2 s */
} tl_recorder_settings;

/* Signal names that are made from a configuration. */
typedef struct tl_recorder_names {
    char plant_texts[TL_MAX_SIGNALS][TL_RECORDER_NAME];
    tl_recorder_signal plant[TL_MAX_SIGNALS];
    /* Without units and types, which come from the FMUs. */
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
} tl_recorder_names;

/* Sets the fields that a configuration defines: max_bytes, commit, name, configuration, step,
 * measurements and the signals. They point into `config` and `names`. */
void tl_recorder_settings_of(const tl_config *config, tl_recorder_names *names, tl_recorder_settings *settings);

/* How much time a file of the configured size covers, s: with all samples and steps, with minutes,
 * and with hours (periods.h). Estimates, about ±10 %. */
typedef struct tl_recorder_span {
    double ticks_s, minutes_s, hours_s;
} tl_recorder_span;

/* Estimates the span. The configuration must have a bound, record_max_bytes > 0. */
tl_recorder_span tl_recorder_settings_span(const tl_config *config);

typedef struct tl_recorder_database tl_recorder_database;

/* Counts of a run, as in its row. */
typedef struct tl_recorder_totals {
    uint64_t samples;
    uint64_t steps;
    uint64_t events;
    uint64_t lost;               /* samples, steps and events that are not in the file */
    char committed[TL_UTC_TEXT]; /* UTC of the commit */
} tl_recorder_totals;

/* Prepares the statements on a connection for writing. The settings must outlive `database`. Close
 * `database` also after a failure. */
int tl_recorder_database_open(sqlite3 *connection, const tl_recorder_settings *settings,
                              tl_recorder_database **database);

/* Call before closing the connection. NULL is allowed. */
void tl_recorder_database_close(tl_recorder_database *database);

/* Returns how many bytes of the ring a batch may contain, unless its only entry is larger. */
size_t tl_recorder_database_batch(const tl_recorder_database *database);

/* Finds out whether the file has this run with exactly these totals. */
int tl_recorder_database_has(tl_recorder_database *database, int64_t run, const tl_recorder_totals *totals, bool *has);

/* ---- a batch, of one run ---- */

/* Removes old data until a batch of `bytes` has room, then begins the transaction. `run`: id of its
 * row; 0: the batch begins a run. If the system clock was set by 0.5 s or more, moves the recorded
 * instants of all runs of this boot likewise. Returns SQLITE_BUSY if a reader prevents writing the
 * log back, and the batch would exceed max_bytes. */
int tl_recorder_database_begin(tl_recorder_database *database, int64_t run, size_t bytes);

/* Returns by how many ms the last begin has moved instants; 0: not at all, or on the first begin.
 */
int64_t tl_recorder_database_moved(const tl_recorder_database *database);

/* Writes the present UTC, which jumps only when a begin moves instants. Call it after a begin. */
void tl_recorder_database_now(const tl_recorder_database *database, char text[TL_UTC_TEXT]);

/* Begins a run and returns the id of its row. `timed`: the run starts at the time in `start`; else
 * now, and t_start is not recorded. Marks other runs without an end as not ended cleanly. */
int tl_recorder_database_begin_run(tl_recorder_database *database, const tl_record_queue_start *start, bool timed,
                                   int64_t *run);

/* Continues the run of this batch: removes an end "not ended cleanly" from its row. */
int tl_recorder_database_resume_run(tl_recorder_database *database);

/* Marks each run without an end as not ended cleanly, in a batch or outside. */
int tl_recorder_database_end_killed(tl_recorder_database *database);

/* Records that this file has no ticks of the run before `tick`. */
int tl_recorder_database_begin_at(tl_recorder_database *database, int64_t tick);

/* Writes a sample, a step or a tuning. *impossible: the entry is not written, because its tick is
 * out of range or its configuration is unknown. */
int tl_recorder_database_entry(tl_recorder_database *database, const tl_recorder_entry *entry, bool *impossible);

/* The same for a tuning; the caller has checked the range of its tick. */
int tl_recorder_database_tuning(tl_recorder_database *database, const tl_run_tuning *tuning, bool *impossible);

/* Write a checkpoint or an event. A checkpoint is skipped (SQLITE_OK) if its tick is out of range,
 * or if it is larger than 4 MiB or a sixteenth of max_bytes. */
int tl_recorder_database_checkpoint(tl_recorder_database *database, int64_t tick, const unsigned char *bytes,
                                    size_t size);
int tl_recorder_database_event(tl_recorder_database *database, const tl_recorder_event_entry *event);

/* Writes the findings, the state of learning, and what was learnt, unless that is larger than a
 * checkpoint may be. If a user has removed what was learnt, a live run writes nothing until
 * `is_new` is set. */
int tl_recorder_database_changes(tl_recorder_database *database, const tl_run_changes *changes);

/* Reads what was learnt, and the largest number of a finding (0: none); outside of a batch. The
 * caller frees *bytes. NULL: nothing is stored, or, if *size is not 0, it is damaged. */
int tl_recorder_database_learned(tl_recorder_database *database, unsigned char **bytes, size_t *size,
                                 uint32_t *last_finding);

/* Finds out whether a user has removed what was learnt (finding_notes.h). */
int tl_recorder_database_is_removed(tl_recorder_database *database, bool *is_removed);

/* Finds the next finding after `number` whose state is "normal"; *next 0: there is none. */
int tl_recorder_database_next_normal(tl_recorder_database *database, uint32_t number, uint32_t *next);

/* Commits the batch. `reason`: why the run ends, or NULL. After a failure call rollback(). */
int tl_recorder_database_commit(tl_recorder_database *database, const tl_recorder_totals *totals, const char *reason);
void tl_recorder_database_rollback(tl_recorder_database *database);

/* Call after a commit: writes a long log (FILE-wal) back. Committed data is safe if this fails. */
int tl_recorder_database_tidy(tl_recorder_database *database);

/* Returns how often the log was written back. Only this changes the database file itself. */
unsigned tl_recorder_database_writings_back(const tl_recorder_database *database);

#endif
