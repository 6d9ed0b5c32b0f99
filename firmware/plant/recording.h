/* Recordings of a plant as CSV, tick by tick.
 *
 * Thread:  one.
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

/* ---- What a recording gives: a tick of the plant, and where its first one is.
 *
 * Purpose: shared by recordings and by what reads them from a database.
 * Thread:  plain data.
 */

/* One tick of a recording. */
typedef struct tl_recording_tick {
    tl_sample sample;
    uint64_t executions;     /* if it was cut short: the executions that the run's search had time for, */
    uint32_t evaluations;    /* and the evaluations, which may be none */
    bool cut_short;          /* the run's search at this tick ran out of time, */
    bool without_nominal;    /* before it evaluated nominal */
    bool made_up;            /* the run missed this tick */
    bool resets;             /* the FMUs were reset before its step */
    bool followed;           /* it is one of the run that this one resumes, */
    double u[TL_MAX_ADJUST]; /* which committed this */
} tl_recording_tick;

/* A reading as it came, before anything was made of it: judged by nothing but its source. `signal` is one of the configuration's own. */
typedef void tl_recording_hear(void *context, size_t signal, const tl_reading *reading);

/* What a run took of other configurations while it ran. Lives as long as the recording. */
typedef struct tl_recording_tunings {
    size_t recorded; /* how many */
    /* With the run's own configuration they are followed, in the order of their ticks; with another they are not, and there are none: */
    tl_run_tuning *list;
    tl_recorder_known *known; /* whose configurations these are */
    size_t count;             /* of both */
} tl_recording_tunings;

/* More are not followed. */
enum { TL_RECORDING_TUNINGS = 4096 };

/* Of a run that does not begin at tick 0 with the FMUs' start values. Lives as long as the recording. */
typedef struct tl_recording_beginning {
    int64_t run;                             /* of the database */
    int64_t tick;                            /* its first */
    bool follows;                            /* false: with another configuration its steps are made anew from there */
    tl_resumption resumption;                /* how it went on with an earlier one, */
    const char *fmus;                        /* with which FMUs (tl_twin_recorder_identify()), */
    const tl_history_checkpoint *checkpoint; /* and from where; NULL: from start values */
} tl_recording_beginning;

/* ---- Recordings: the plant as it was, tick by tick; from a CSV file or from a database that `run` wrote.
 *
 * Purpose: gives replay and the emulated plant their samples. From CSV: rows are posted into a plant input at their own
 *          time and a sample is taken at each tick, as live would; tick 0 is at the first row. From a database: the
 *          samples as they were seen, qualities included, and per tick what the run could spend on it, so that the
 *          same u come out.
 * Thread:  one thread.
 */

typedef struct tl_recording tl_recording;

/* A CSV recording has at most so many ticks, and between two rows at most so many: a time that is wrong, such as that of a clock
 * that was not yet set, would be replayed for days. */
#define TL_RECORDING_TICKS ((int64_t)10000000000)
#define TL_RECORDING_GAP ((int64_t)100000000)

/* `path` is a CSV file, or a SQLite database (recognised by its first bytes), whose run `config->recording_run` is taken, or the last one. The database's
 * signal names, step and horizon must agree with the configuration's. A CSV file is checked completely here, the limits above too. */
tl_status tl_recording_open(const char *path, const tl_config *config, tl_recording **recording, tl_error *error);

/* NULL: it begins at tick 0, as any twin does. */
const tl_recording_beginning *tl_recording_get_beginning(const tl_recording *recording);

/* None in most. */
tl_recording_tunings tl_recording_get_tunings(const tl_recording *recording);

/* The next tick, from 0, or where it begins. *end where the recording does not reach the tick's instant. */
tl_status tl_recording_next(tl_recording *recording, tl_recording_tick *tick, bool *end, tl_error *error);

/* Who hears each reading once, as ticks go by, until the recording is closed. A CSV file has all of them; a database one a tick, and of a signal that
 * fed an input on a line what lay on that. */
void tl_recording_listen(tl_recording *recording, tl_recording_hear *hear, void *context);

/* Ticks the recording holds, for progress. */
int64_t tl_recording_ticks(const tl_recording *recording);

void tl_recording_close(tl_recording *recording);

#endif
