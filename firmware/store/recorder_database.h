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
    const char *path;
    tl_database_policy open_policy; /* at the opening; later each fault is handled */
    int64_t max_bytes;              /* 0: no bound; else at least 1,000,000 */
    tl_time commit;                 /* ns between commits, > 0, default 0.5 s */
    const char *verb;               /* "run", "hold", "replay" */
    const char *name;               /* of the configuration */
    const char *configuration;      /* its text */
    const tl_recorder_known *known; /* further configurations; they may change between two writes */
    size_t known_count;
    const char *fmus;   /* SHA-256 over the SHA-256 of the FMUs, or NULL */
    const char *boot;   /* id of the system's boot, or NULL */
    const char *format; /* of the checkpoints' bytes, or NULL */
    tl_time step;       /* T_S */
    tl_pairing measurements;
    const tl_recorder_signal *plant, *match, *adjust;
    size_t plant_count, match_count, adjust_count;
    size_t component_count;    /* number of components with counts */
    const tl_account *account; /* of a twin; only for a run that begins at the opening */
    tl_time patience;          /* ns, longest wait of a close or a put if the disk refuses; 0: 2 s */
} tl_recorder_settings;

/* Signal names that are made from a configuration. */
typedef struct tl_recorder_names {
    char plant_texts[TL_MAX_SIGNALS][TL_RECORDER_NAME];
    tl_recorder_signal plant[TL_MAX_SIGNALS];
    /* Without units and types, which come from the FMUs. */
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
} tl_recorder_names;

/* Sets all fields that a configuration defines: bound, interval, name, text, step, measurements,
 * signals. The settings are valid as long as `config` and `names`. */
void tl_recorder_settings_of(const tl_config *config, tl_recorder_names *names, tl_recorder_settings *settings);

/* For how long a file of the configured size holds all samples and steps, its minutes, and its
 * hours. About 10 %. */
typedef struct tl_recorder_span {
    double ticks_s, minutes_s, hours_s;
} tl_recorder_span;
tl_recorder_span tl_recorder_settings_span(const tl_config *config);

typedef struct tl_recorder_database tl_recorder_database;

/* Counts of a run, as in its row. */
typedef struct tl_recorder_totals {
    uint64_t samples;
    uint64_t steps;
    uint64_t events;
    uint64_t lost;
    char committed[TL_UTC_TEXT]; /* UTC */
} tl_recorder_totals;

/* Prepares the statements on a connection for writing. The settings must outlive `database`. Close
 * `database` also after a failure. */
int tl_recorder_database_open(sqlite3 *connection, const tl_recorder_settings *settings,
                              tl_recorder_database **database);

/* Call before closing the connection. NULL is allowed. */
void tl_recorder_database_close(tl_recorder_database *database);

/* Returns how many bytes of the ring a batch may contain. A single entry may be larger. */
size_t tl_recorder_database_batch(const tl_recorder_database *database);

/* Finds out whether the file has this run with exactly these totals. */
int tl_recorder_database_has(tl_recorder_database *database, int64_t run, const tl_recorder_totals *totals, bool *has);

/* ---- a batch, of one run ---- */

/* Removes old data until a batch of `bytes` has room, then begins the transaction. `run` 0: the
 * batch begins a run. If the system clock was set by half a second or more, the recorded instants
 * of all runs of this boot are moved by the same time. */
int tl_recorder_database_begin(tl_recorder_database *database, int64_t run, size_t bytes);

/* Returns the time in ms by which the last begin has moved instants; 0: none. */
int64_t tl_recorder_database_moved(const tl_recorder_database *database);

/* Writes the present UTC by the offset of this file. Call it after the first begin. */
void tl_recorder_database_now(const tl_recorder_database *database, char text[TL_UTC_TEXT]);

/* Begins a run and returns the id of its row. `timed`: it starts at the time in `start`; else it
 * starts now, and t_start is not recorded. */
int tl_recorder_database_begin_run(tl_recorder_database *database, const tl_record_queue_start *start, bool timed,
                                   int64_t *run);

/* Continues the run of this batch: removes an end "not ended cleanly" from its row. */
int tl_recorder_database_resume_run(tl_recorder_database *database);

/* Marks each run without an end as not ended cleanly. tl_recorder_database_resume_run() reverts it.
 */
int tl_recorder_database_end_killed(tl_recorder_database *database);

/* Records that this file has no ticks of the run before `tick`. */
int tl_recorder_database_begin_at(tl_recorder_database *database, int64_t tick);

/* Writes a sample, a step or a tuning. *impossible: the entry is not written, because its tick is
 * out of range or its configuration is unknown. */
int tl_recorder_database_entry(tl_recorder_database *database, const tl_recorder_entry *entry, bool *impossible);

/* The same for a tuning; the caller has checked the range of its tick. */
int tl_recorder_database_tuning(tl_recorder_database *database, const tl_run_tuning *tuning, bool *impossible);

/* Write a checkpoint or an event. A checkpoint is skipped if it is too large for the file's bound
 * or its tick is out of range. */
int tl_recorder_database_checkpoint(tl_recorder_database *database, int64_t tick, const unsigned char *bytes,
                                    size_t size);
int tl_recorder_database_event(tl_recorder_database *database, const tl_recorder_event_entry *event);

/* Writes the findings, the state of learning, and what was learnt. The latter is left out if it is
 * too large for the file's bound. */
int tl_recorder_database_changes(tl_recorder_database *database, const tl_run_changes *changes);

/* Reads what was learnt, and the largest number of a finding; outside of a batch. *bytes: malloc();
 * NULL: there is nothing, or, if *size is not 0, it is damaged. */
int tl_recorder_database_learned(tl_recorder_database *database, unsigned char **bytes, size_t *size,
                                 uint32_t *last_finding);

/* Finds out whether a user has removed what was learnt (finding_notes.h). */
int tl_recorder_database_is_removed(tl_recorder_database *database, bool *is_removed);

/* Finds the next finding after `number` that is normal; *next 0: there is none. */
int tl_recorder_database_next_normal(tl_recorder_database *database, uint32_t number, uint32_t *next);

/* Commits the batch; a `reason` ends the run. On success all is on the disk; else the caller must
 * roll back. */
int tl_recorder_database_commit(tl_recorder_database *database, const tl_recorder_totals *totals, const char *reason);
void tl_recorder_database_rollback(tl_recorder_database *database);

/* Call after a commit: writes the log back if it is long. A failure does not affect committed data.
 */
int tl_recorder_database_tidy(tl_recorder_database *database);

/* Returns how often the log was written back. Only writing back changes the database file itself;
 * commits go into the log. */
unsigned tl_recorder_database_writings_back(const tl_recorder_database *database);

#endif
