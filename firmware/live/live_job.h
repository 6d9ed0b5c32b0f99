/* The job of a process of a run: what it is told at its start, besides the shared memory that it gets.
 *
 * Purpose: no process but the supervisor reads the configuration's file or the command line. A process that is begun again is told the same
 *          text, whatever the file says by then.
 * Trust:   the supervisor's word, in memory that nobody can change.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_JOB_H
#define TL_FIRMWARE_LIVE_LIVE_JOB_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/live/restarts.h"
#include "firmware/process/block.h"
#include "firmware/twin/live_stage.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* The same for all of them, but what is said of a start. No pointers. */
typedef struct tl_live_job {
    bool alone;              /* nobody supervises the run */
    bool unconfined;         /* FMUs may do what the user can */
    tl_time duration;        /* that was asked for; 0: as configured */
    char database[PATH_MAX]; /* "": nothing is recorded */
    char state[PATH_MAX];    /* of the activator: where versions are kept; "": there is none */
    char allowed[PATH_MAX];  /* the same: the administrator's list of names */
    uint64_t memory_limit;   /* the same: bytes that a process of FMUs may take; 0: as usual */
    uint32_t place; /* of the twin; of the twin that the recorder reads; of the run's twin when the activator begins */
    char hash[TL_LIVE_PLACES][TL_SHA256_TEXT]; /* of the activator: of the configuration in each place; "": none is */
    /* of the twin's start */
    uint32_t number; /* of this start, from 1 on */
    bool is_shadow;  /* it is not the run's twin, until a flip makes it that, */
    tl_time start;   /* and t_start of the run beside which it runs (CLOCK_MONOTONIC), */
    int64_t started; /* and UTC, ms */
    uint32_t flips;  /* the newest flip that was announced before; of the recorder: by which the run came here */
    tl_start how;    /* if it waits in safe hold `start` is when that began, and samples are recorded from then on */
} tl_live_job;

/* For all but the twin: with path and text of the configuration behind it. Errors: TL_TRY_AGAIN. */
tl_status tl_live_job_make(const tl_live_job *job, const char *path, const char *text, tl_block *block,
                           tl_error *error);

/* Of a twin: what tl_twin_job.live holds. With the text of the run's configuration, for a shadow; else "". To free(); NULL: memory is out. */
unsigned char *tl_live_job_pack(const tl_live_job *job, const char *of_run, size_t *size);

/* There: the text lies in `bytes`. Errors: TL_BAD_DATA. */
tl_status tl_live_job_unpack(const unsigned char *bytes, size_t size, tl_live_job *job, const char **of_run,
                             tl_error *error);

/* There: takes it, and reads the configuration as all the others do. `block` must stay. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_take(int descriptor, tl_block *block, tl_live_job *job, tl_config *config, tl_error *error);

/* A configuration that was read before, as this process has it. To be freed. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_job_read(const tl_live_job *job, const char *path, const char *text, tl_config *config,
                           tl_error *error);

/* What changes the configuration by the command line; look-ups are in use then. */
void tl_live_job_apply(const tl_live_job *job, tl_config *config);

#endif
