/* What a recording gives: a tick of the plant, and where its first one is.
 *
 * Purpose: shared by recordings and by what reads them from a database.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_PLANT_RECORDING_TICK_H
#define TL_FIRMWARE_PLANT_RECORDING_TICK_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/history.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"

/* One tick of a recording. */
typedef struct tl_recording_tick {
    tl_sample sample;
    bool made_up;            /* the run missed this tick */
    bool cut_short;          /* the run's search at this tick ran out of time: */
    uint32_t evaluations;    /* it had time for these, which may be none, */
    bool without_nominal;    /* and nominal's was not among them, */
    uint64_t executions;     /* and for so many executions */
    bool resets;             /* before its step the run's FMUs began anew */
    bool followed;           /* it is one of the run that this one goes on with, */
    double u[TL_MAX_ADJUST]; /* which committed this */
} tl_recording_tick;

/* A reading as it came, before anything was made of it: judged by nothing but its source. `signal` is one of the configuration's own. */
typedef void tl_recording_hear(void *context, size_t signal, const tl_reading *reading);

/* What a run took of other configurations while it ran. Lives as long as the recording. */
typedef struct tl_recording_tunings {
    size_t recorded; /* how many */
    /* With the run's own configuration they are followed, in the order of their ticks; with another they are not, and there are none: */
    const tl_run_tuning *list;
    const tl_recorder_known *known; /* whose configurations these are */
    size_t count;                   /* of both */
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

#endif
