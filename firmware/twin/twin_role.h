/* The process with the FMUs: what the program does if it was started as "twinlock: twin [NAME]".
 *
 * Purpose: it reads its job, opens the FMU files, gives up every right that FMUs have no business with (confine.h), and only then loads them.
 *          It builds the twin, and answers each tick with a result, prints the page of a check, or lives beside a plant. It has no file of the
 *          user's, no terminal and no socket; what it says goes through pipes and blocks of shared memory.
 * Order:   log, parent, title; signals; job; files; confinement; then it says that it is ready, or lives.
 * Live:    the room that does it is above this one, so it is handed in. It has no channel; its blocks have the numbers that are said below. An FMU
 *          that reaches for another process is refused that, and the twin goes on, as the plant's data do. The process may lock its memory, and
 *          who has started it may give it the configured priority, though it has no capability.
 * Thread:  main waits; the FMUs have theirs (fmu_thread.h).
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_ROLE_H
#define TL_FIRMWARE_TWIN_TWIN_ROLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/process/block.h"
#include "firmware/process/channel.h"
#include "firmware/process/confine.h"
#include "firmware/process/fmu_call.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/read_back.h"
#include "firmware/twin/twin_step.h"
#include "firmware/twin/twin_trial.h"
#include "master/twin/account.h"

/* ---- The job of a process with a twin: all that it is told at its start, in one piece of memory that nobody can change.
 *
 * Purpose: the process reads no configuration file and no database: it gets the text of the one that its parent has read, and the
 *          checkpoint that the parent has taken out of the database.
 * Trust:   it is a sealed block of the parent, which is trusted: only its length is checked.
 * Thread:  plain data.
 */

typedef enum tl_twin_task {
    TL_TASK_CHECK, /* build, print the page, end */
    TL_TASK_READ,  /* build, read states that another process has told (read_back.h), end */
    TL_TASK_PAIR,  /* build, and a second one beside it, and compare both (twin_trial.h) */
    TL_TASK_WAYS, /* build, and tell whether the components come back by the ways that the job names, and what that costs (twin_trial.h) */
    TL_TASK_STEP, /* build, then a result for each tick */
    TL_TASK_LIVE  /* what another room makes of it */
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

/* ---- The role. ---- */

/* Prints what a check tells of an assembly, which was built if `status` is TL_OK, and says on the log what is wrong with it. Returns the status
 * of the whole. `host` as in tl_read_back_take(). */
typedef tl_status tl_twin_page(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                               const tl_read_back_host *host, FILE *page, tl_twin_check *found);

/* In the process of that role, for TL_TASK_LIVE, in the main thread, which is the only one so far: to its end; the exit code. The assembly's
 * configuration was read, and its files are open, but not if the job holds; it is freed in the thread that builds it. */
typedef int tl_twin_live(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts);

/* What other rooms do in this one. */
typedef struct tl_twin_role_tasks {
    tl_twin_page *print_page;
    tl_twin_live *live;
} tl_twin_role_tasks;

/* In the process of that role: to its end; the exit code. */
int tl_twin_role_run(const tl_twin_role_tasks *tasks);

/* ---- What crosses between the two ends of a twin in a process of its own: sizes of messages, what lies in the block beside them, descriptors.
 *
 * Purpose: what twin_role.c (the end with the FMUs), twin_process.c and twin_child.c (the end with everything else) must mean the
 *          same by; the blocks of a live twin are its own room's.
 */

/* Descriptors of the process with the FMUs. The first three, the job and the start socket are those of every such process. */
enum {
    TL_TWIN_OUTPUT = 1,        /* what is logged and printed: 1 and 2 */
    TL_TWIN_PAGE = 3,          /* the page of a check */
    TL_TWIN_JOB = 4,           /* tl_twin_job_make() */
    TL_TWIN_PARENTS_BLOCK = 5, /* read here */
    TL_TWIN_OWN_BLOCK = 6,     /* written here */
    TL_TWIN_START_SOCKET = 7,  /* for the descriptor that tells of refused calls; closed before an FMU is loaded */
    TL_TWIN_READ_BACK = 8      /* written by this and others of its kind (read_back.h) */
};

/* In the block of the process with the FMUs, beside its messages. The two accounts are apart: told to end early it writes the last one while its parent
 * still reads the first. */
typedef struct tl_twin_extra {
    tl_fmu_calls calls;        /* the call that is under way */
    tl_account built;          /* as of TL_MESSAGE_BUILT */
    tl_account ended;          /* as of TL_MESSAGE_ENDED */
    tl_twin_check check;       /* of a check, */
    tl_twin_pair_account pair; /* of a pair, */
    tl_twin_ways ways;         /* and of a check and of what tries ways */
    char error
        [TL_ERROR_TEXT]; /* of the message that tells of a failure: BUILT, RESULT or ENDED; also of how a pair differs, or one does not come back */
} tl_twin_extra;

/* In the block of the parent, beside its messages. */
typedef struct tl_twin_orders {
    uint32_t
        stop; /* 1: compute nothing more of what was asked for. A signal says nothing: FMUs can send one to themselves */
    char error[TL_ERROR_TEXT]; /* of TL_MESSAGE_SEEN */
} tl_twin_orders;

/* For a channel of this configuration. */
static inline tl_channel_settings tl_twin_wire(const tl_config *config, tl_twin_tells tells) {
    return (tl_channel_settings){
        .sizes.bytes =
            {
                [TL_MESSAGE_TICK] = sizeof(tl_recording_tick),
                [TL_MESSAGE_FINISH] = sizeof(tl_recording_tick),
                /* A tl_status. Why it failed is in the block; "": it was said on the log. */
                [TL_MESSAGE_SEEN] = sizeof(int32_t),
                [TL_MESSAGE_READY] = sizeof(tl_confine_facts),
                [TL_MESSAGE_BUILT] = sizeof(int32_t),
                [TL_MESSAGE_RESULT] = (uint32_t)tl_twin_result_size(config, tells),
                [TL_MESSAGE_ENDED] = sizeof(int32_t),
            },
        .extra = {[TL_PARENT] = sizeof(tl_twin_orders), [TL_CHILD] = sizeof(tl_twin_extra)},
    };
}

#endif
