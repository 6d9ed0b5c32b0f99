/* Recordings of a plant, read tick by tick from CSV or from a database.
 *
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_PLANT_RECORDING_H
#define TL_FIRMWARE_PLANT_RECORDING_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/store/history.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"
#include "master/base/status.h"

/* ---- A tick of a recording, and the start of a recording.
 *
 * Purpose: shared by recordings and by the code that reads them from a database.
 * Thread:  plain data.
 */

/* One tick of a recording. All fields after the sample are 0 for a CSV file, and, except `u`, if
 * the run is replayed with another configuration. */
typedef struct tl_recording_tick {
    tl_sample sample;
    uint64_t executions;     /* if cut_short: component executions that the run's search completed */
    uint32_t evaluations;    /* if cut_short: its evaluations; may be 0 */
    bool cut_short;          /* the run's search at this tick timed out */
    bool without_nominal;    /* if cut_short: the search ended before it evaluated nominal u */
    bool caught_up;          /* the run missed this tick and caught up */
    bool resets;             /* the FMUs were reset before its step */
    bool rests;              /* u rested at nominal */
    bool ends_released;      /* after its step the released twins ended, because they were too slow */
    bool is_decided;         /* the run had this configuration: its qualities (also TL_FROZEN) and flags apply */
    bool followed;           /* the step is computed with `u`, without a search; usually of a run that was resumed */
    double u[TL_MAX_ADJUST]; /* if followed: u that was committed */
} tl_recording_tick;

/* Receives a reading before any conditioning. Its quality is that of the CSV file, or the recorded
 * one of a database; but outliers and frozen readings count as good. `signal`: index of one of the
 * configuration's own signals, not of a further look-up. */
typedef void tl_recording_on_reading(void *context, size_t signal, const tl_reading *reading);

/* Tunings that were applied during a run. Valid as long as the recording. */
typedef struct tl_recording_tunings {
    size_t recorded; /* number of tunings in the recording */
    /* Both lists are filled only if the run is replayed with its own configuration, in the order of
     * the ticks; otherwise they are empty. */
    tl_run_tuning *list;
    tl_recorder_known *known; /* configurations of these tunings */
    size_t count;             /* length of both lists */
} tl_recording_tunings;

/* Largest number of tunings of a run that a replay can apply. */
enum { TL_RECORDING_TUNINGS = 4096 };

/* Start of a replay that does not start at tick 0 with the FMUs' start values: of a resumed run, or
 * from a checkpoint of the run (config->recording_follow). Valid as long as the recording. */
typedef struct tl_recording_beginning {
    int64_t run;              /* number in the database */
    int64_t tick;             /* first tick of the replay */
    bool follows;             /* the replay repeats the resumption; false: it starts at `tick` with start values */
    tl_resumption resumption; /* how the run, or this replay, resumes */
    const char *fmus;         /* identity of its FMUs (tl_twin_recorder_identify()) */
    const tl_history_checkpoint *checkpoint; /* checkpoint that it loaded; NULL: it started from start values */
} tl_recording_beginning;

/* Simulation time of the FMUs, as the recording states it. Zeroed: unknown. */
typedef struct tl_recording_time {
    bool has_start;           /* `experiment` is known: of a database, but not of a run in safe hold */
    tl_experiment experiment; /* if stop_s is not recorded, it is not above start_s */
    tl_time length;           /* from tick 0 to the last tick, ns */
} tl_recording_time;

/* What the run's components with "keep": "auto" kept between candidates. Known only if the run is
 * replayed with its own configuration. */
typedef struct tl_recording_keep {
    bool is_known;
    uint64_t unsaved; /* as tl_twin_unsaved() */
} tl_recording_keep;

/* ---- Recordings: samples of the plant tick by tick, from a CSV file or a database that `run`
 * wrote.
 *
 * Purpose: delivers samples to replay and to the emulated plant. CSV: as in a live run, each row is
 *          posted into a plant input at its own time, and a sample is taken at each tick. Tick 0 is
 *          at the first row. Database: delivers the samples that the run saw, with qualities, and
 *          the effort of each search, so that a replay computes the same u.
 * Owner:   the recording owns all that it returns pointers to, until tl_recording_close().
 * Thread:  one thread.
 */

typedef struct tl_recording tl_recording;

/* Largest number of ticks of a CSV recording, and largest number of ticks between two rows. Without
 * these limits, a wrong time of a clock that was not yet set would be replayed for days. */
#define TL_RECORDING_TICKS ((int64_t)10000000000)
#define TL_RECORDING_GAP ((int64_t)100000000)

/* Opens a CSV file or a SQLite database (recognised by its first bytes). Of a database, run
 * `config->recording_run` is used, or the last one if that is 0. The names and order of its signals
 * and its step must agree with the configuration. A CSV file is checked completely, including the
 * limits above and, by the distance of its rows, the unit of its time. `config` must outlive the
 * recording. Errors: TL_BAD_DATA; TL_TRY_AGAIN; TL_BAD_USAGE: a run of a CSV file was requested. */
tl_status tl_recording_open(const char *path, const tl_config *config, tl_recording **recording, tl_error *error);

/* Logs how a CSV file is read if its cells are not separated by commas or its times are no seconds,
 * because both are recognised, not configured; and how many rows had the time of the row before. */
void tl_recording_log_form(const tl_recording *recording);

/* Returns the start of the replay; NULL: at tick 0 with start values. */
const tl_recording_beginning *tl_recording_get_beginning(const tl_recording *recording);

/* Returns the tunings; most recordings have none. */
tl_recording_tunings tl_recording_get_tunings(const tl_recording *recording);

/* Applies the limits of the configuration again. Call it before the first tick, after
 * tl_config_use_bounds(): the limits that FMUs declare apply to recorded values too. */
void tl_recording_use_limits(tl_recording *recording);

tl_recording_time tl_recording_get_time(const tl_recording *recording);
tl_recording_keep tl_recording_get_keep(const tl_recording *recording);

/* Reads the next tick. The first call reads tick 0, or that of tl_recording_beginning. *end: the
 * recording ended before this tick. Errors: TL_BAD_DATA: invalid, or a tick of a run is missing. */
tl_status tl_recording_next(tl_recording *recording, tl_recording_tick *tick, bool *end, tl_error *error);

/* Sets a callback that is called once for each reading while ticks are read. A CSV file delivers
 * all readings. A database delivers at most one per tick and signal. If an input used interpolated
 * values of a signal ("between": "line"), the database delivers these. */
void tl_recording_listen(tl_recording *recording, tl_recording_on_reading *on_event, void *context);

/* Returns the number of ticks from tick 0 to the end of the recording, to show progress. */
int64_t tl_recording_ticks(const tl_recording *recording);

void tl_recording_close(tl_recording *recording);

#endif
