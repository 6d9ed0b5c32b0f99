/* The job of a process with a twin: all that it is told at its start, in one piece of memory that nobody can change.
 *
 * Purpose: the process reads no configuration file and no database: it gets the text of the one that its parent has read, and the
 *          checkpoint that the parent has taken out of the database.
 * Trust:   it is a sealed block of the parent, which is trusted: only its length is checked.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_JOB_H
#define TL_FIRMWARE_TWIN_TWIN_JOB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/block.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/twin_step.h"

typedef enum tl_twin_task {
    TL_TASK_CHECK, /* build, print the page, end */
    TL_TASK_READ,  /* build, read states that another process has told (read_back.h), end */
    TL_TASK_PAIR,  /* build, and a second one beside it, and compare both (twin_trial.h) */
    TL_TASK_WAYS, /* build, and tell whether the components come back by the ways that the job names, and what that costs (twin_trial.h) */
    TL_TASK_STEP, /* build, then a result for each tick */
    TL_TASK_LIVE  /* what another room makes of it (twin_role.h) */
} tl_twin_task;

typedef struct tl_twin_job {
    tl_twin_task task;
    tl_twin_tells tells;
    int64_t tick;                    /* where it begins (tl_twin_begin_at()), */
    const unsigned char *checkpoint; /* or of this saved twin, with which it begins (tl_twin_load()) */
    size_t checkpoint_size;
    const unsigned char *
        tunings; /* that are taken at their ticks, in that order: tl_run_tuning, at no aligned place when it was read */
    size_t tunings_size; /* bytes */
    const char *path;    /* of the configuration, as given: relative names start at its folder */
    const char *text;    /* what it says */
    const char *folder;  /* private, absolute: for what FMUs write; "": none */
    uint64_t memory;     /* that the process may take; 0: no limit */
    uint32_t user;       /* to become; 0: stay */
    bool plain;          /* save no executions */
    bool variables;      /* the page lists them */
    bool brief;          /* a check without a far look */
    bool
        states_only; /* a check finds only whether another process can use the FMUs' states (tl_twin_check.why); nothing else is heard */
    bool reads_back; /* the process has a block for it: of TL_TASK_CHECK; of TL_TASK_READ, always */
    bool alone;      /* of a pair, only the first */
    unsigned char
        rollback[TL_RECORDER_COMPONENTS]; /* tl_rollback of each component; TL_ROLLBACK_NONE: as it is configured */
    bool unconfined;
    bool holds;                /* safe hold: no FMU is touched */
    const unsigned char *live; /* for the live room, which knows what it is; at no aligned place when it was read */
    size_t live_size;
} tl_twin_job;

enum { TL_TWIN_CHECK_WHY = 400 };

/* What a check finds besides its page. */
typedef struct tl_twin_check {
    uint32_t warnings; /* on the page */
    tl_time least;     /* ns of a free step; 0: not known */
    tl_time worst;     /* ns of a step that uses all its evaluations; 0: not known, or nothing is searched */
    uint64_t memory;   /* bytes that the twin will have beside what the process has before it steps */
    char why
        [TL_TWIN_CHECK_WHY]; /* of a job with states_only: another process cannot use them; "": nothing was found against them */
} tl_twin_check;

/* Errors: TL_TRY_AGAIN. */
tl_status tl_twin_job_make(const tl_twin_job *job, tl_block *block, tl_error *error);

/* Texts and bytes are in the block. Errors: TL_BAD_DATA. */
tl_status tl_twin_job_read(const tl_block *block, tl_twin_job *job, tl_error *error);

#endif
