/* FMU process: what the program does if it was started as "twinlock: twin [NAME]".
 *
 * Purpose: reads its job, opens the FMU files, drops all access rights that FMUs do not need
 *          (confine.h), and only then loads the FMUs. It builds the twin. Then it does its task
 *          (tl_twin_task), for example a check or a live run. It has no file of the user, no
 *          terminal and no socket; it writes to pipes and blocks of shared memory.
 * Order:   sets up the log and the process; installs signal handlers; reads the job; opens the FMU
 *          files; confines itself. Then it reports that it is ready, or starts the live run.
 * Live:    the live run is code of a higher layer, so the caller passes it in (tl_twin_live). It
 *          has no channel; its blocks have other descriptors (live_blocks.h). If an FMU tries to
 *          reach another process, the call is denied and the twin continues. In all other tasks the
 *          kernel kills the process. A live process may lock its memory. Its parent may give it the
 *          configured priority, although the process has no capability.
 * Thread:  the main thread waits; the FMUs have their own (fmu_thread.h).
 * Errors:  logged, and the exit code is set, until the process is ready; later sent to the parent.
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
#include "firmware/twin/explanation.h"
#include "firmware/twin/read_back.h"
#include "firmware/twin/twin_step.h"
#include "firmware/twin/twin_trial.h"
#include "master/twin/account.h"

/* ---- Job of a process with a twin: all its input at the start, in one sealed block of memory.
 *
 * Purpose: the process reads no configuration file and no database. It gets the configuration text
 *          that its parent has read, and the checkpoint that the parent has read from the database.
 * Trust:   the block is sealed by the parent, which is trusted: only its length is checked.
 * Thread:  any: plain data.
 */

typedef enum tl_twin_task {
    TL_TASK_CHECK,   /* build, print the page (what `twinlock check` prints), end */
    TL_TASK_READ,    /* build, load states that another process has saved (read_back.h), end */
    TL_TASK_PAIR,    /* build two twins and compare them (twin_trial.h) */
    TL_TASK_METHODS, /* build, test the rollback methods that the job names, and measure their cost (twin_trial.h) */
    TL_TASK_STEP,    /* build, then compute a result for each tick */
    TL_TASK_EXPLAIN, /* as TL_TASK_STEP; at the end of the ticks, explain a change (explanation.h) */
    TL_TASK_LIVE     /* live run, by code of a higher layer */
} tl_twin_task;

typedef struct tl_twin_job {
    tl_twin_task task;
    tl_twin_attached attached;       /* content of each result */
    int64_t tick;                    /* first tick (tl_twin_begin_at()), or that of the checkpoint */
    const unsigned char *checkpoint; /* saved twin to start from (tl_twin_load()); NULL: none */
    size_t checkpoint_size;
    const unsigned char *tunings; /* tl_run_tuning, in order of ticks, each applied at its tick; may be unaligned */
    size_t tunings_size;          /* bytes */
    const char *path;             /* of the configuration, as given: relative names start at its folder */
    const char *text;             /* the configuration */
    const char *folder;           /* private, absolute, for files that FMUs write; "": none */
    uint64_t memory;              /* bytes that the process may use; 0: no limit */
    uint32_t user;                /* user ID to switch to; 0: no change */
    tl_recording_time time;       /* times of the replayed recording; zeroed: unknown */
    tl_recording_keep keep;       /* what components with "keep": "auto" kept in the recorded run */
    tl_explanation_order explain; /* for TL_TASK_EXPLAIN */
    bool plain;       /* reuse no executions: no sequence cache, and every component executes in every candidate */
    bool json;        /* the page is a JSON object (check_json.h) */
    bool variables;   /* the page lists the variables */
    bool reactions;   /* a check prints only the reactions to the adjusted variables, a line each (check_page.h) */
    bool brief;       /* a check without the late verification (twin_trial.h) */
    bool states_only; /* only test if another process can use the FMUs' states (tl_twin_check.why) */
    bool reads_back;  /* has a block for the read-back test: optional for TL_TASK_CHECK, always for TL_TASK_READ */
    bool alone;       /* for TL_TASK_PAIR: run only the first twin */
    unsigned char rollback[TL_RECORDER_COMPONENTS]; /* tl_rollback of each component; TL_ROLLBACK_NONE: as configured */
    bool unconfined;                                /* FMUs run without confinement, with the user's rights */
    bool holds;                                     /* safe hold: no FMU is loaded */
    const unsigned char *live; /* private data of the live run; unaligned after tl_twin_job_read() */
    size_t live_size;
} tl_twin_job;

enum { TL_TWIN_CHECK_WHY = 400 };

/* Results of a check, in addition to its page. */
typedef struct tl_twin_check {
    uint32_t warnings; /* number of warnings on the page */
    tl_time least;     /* ns of a step without a search; 0: unknown */
    tl_time worst;     /* ns of a step that uses all evaluations of its budget; 0: unknown, or there is no search */
    uint64_t memory;   /* bytes that the twin will need, in addition to the memory of the process before it steps */
    char why[TL_TWIN_CHECK_WHY]; /* with states_only: why another process cannot use the states; "": no fault found */
} tl_twin_check;

/* Writes a job to a new sealed block, which the caller closes. Errors: TL_TRY_AGAIN. */
tl_status tl_twin_job_make(const tl_twin_job *job, tl_block *block, tl_error *error);

/* Reads a job. Its pointers refer to the block, which must outlive it. Errors: TL_BAD_DATA. */
tl_status tl_twin_job_read(const tl_block *block, tl_twin_job *job, tl_error *error);

/* ---- The role. ---- */

/* Prints the results of a check to `page`, fills `found`, and logs the problems of the assembly.
 * `status`: result of its build. `host`: see tl_read_back_run(). Returns the status of the check.
 */
typedef tl_status tl_twin_page(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                               const tl_read_back_host *host, FILE *page, tl_twin_check *found);

/* Runs TL_TASK_LIVE to its end and returns the exit code. Called in the main thread, while it is
 * the only one. The configuration of the assembly is read; its files are open unless job->holds is
 * set. The function must free the assembly in the thread that has built it. */
typedef int tl_twin_live(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts);

/* Functions of higher layers that this process calls. */
typedef struct tl_twin_role_tasks {
    tl_twin_page *print_page;
    tl_twin_live *live;
} tl_twin_role_tasks;

/* Runs the FMU process from its start to its end. Returns the exit code. */
int tl_twin_role_run(const tl_twin_role_tasks *tasks);

/* ---- Interface between both ends of a twin in a child process: sizes of messages, layout of the
 * block beside them, descriptors.
 *
 * Purpose: shared by twin_role.c (the end with the FMUs), twin_process.c and twin_child.c (the
 *          other end). The blocks of a live twin are defined by the live run.
 */

/* Descriptors of the FMU process. Every role has 0 to 2, the job and the start socket. */
enum {
    TL_TWIN_OUTPUT = 1,        /* 1 and 2 (stdout and stderr): log and output of FMUs */
    TL_TWIN_PAGE = 3,          /* receives the page of a check */
    TL_TWIN_JOB = 4,           /* block of tl_twin_job_make() */
    TL_TWIN_PARENTS_BLOCK = 5, /* written by the parent, read by this process */
    TL_TWIN_OWN_BLOCK = 6,     /* written by this process, read by the parent */
    TL_TWIN_START_SOCKET =
        7,                /* to send the descriptor that reports denied system calls; closed before an FMU is loaded */
    TL_TWIN_READ_BACK = 8 /* written by this process and its readers (read_back.h) */
};

/* In the block of the FMU process, beside its messages. There are two accounts, because the process
 * may be asked to end early: then it writes the last one while its parent still reads the first. */
typedef struct tl_twin_extra {
    tl_fmu_calls calls;         /* FMI call in progress */
    tl_account built;           /* account of the twin when TL_MESSAGE_BUILT was sent */
    tl_account ended;           /* the same for TL_MESSAGE_ENDED */
    tl_twin_check check;        /* for a check */
    tl_twin_pair_account pair;  /* for a comparison of two twins */
    tl_explanation explanation; /* for TL_TASK_EXPLAIN */
    tl_component_methods ways;  /* for a check and a trial of rollback methods */
    char error
        [TL_ERROR_TEXT]; /* of a failed BUILT, RESULT or ENDED ("": logged); how twins differ or a rollback is inexact */
} tl_twin_extra;

/* In the block of the parent, beside its messages. */
typedef struct tl_twin_orders {
    uint32_t stop; /* 1: compute nothing more. This is not a signal, because FMUs could send that to themselves */
    char error[TL_ERROR_TEXT]; /* cause, if TL_MESSAGE_SEEN reports a failure */
} tl_twin_orders;

/* Settings of the channel between parent and FMU process; both ends must use the same values. */
static inline tl_channel_settings tl_twin_wire(const tl_config *config, tl_twin_attached attached) {
    return (tl_channel_settings){
        .sizes.bytes =
            {
                [TL_MESSAGE_TICK] = sizeof(tl_recording_tick),
                [TL_MESSAGE_FINISH] = sizeof(tl_recording_tick),
                /* int32_t: a tl_status. Its cause is in `error` of the sender's block. */
                [TL_MESSAGE_SEEN] = sizeof(int32_t),
                [TL_MESSAGE_READY] = sizeof(tl_confine_facts),
                [TL_MESSAGE_BUILT] = sizeof(int32_t),
                [TL_MESSAGE_RESULT] = (uint32_t)tl_twin_result_size(config, attached),
                [TL_MESSAGE_ENDED] = sizeof(int32_t),
            },
        .extra = {[TL_PARENT] = sizeof(tl_twin_orders), [TL_CHILD] = sizeof(tl_twin_extra)},
    };
}

#endif
