/* Worker: a short-lived process that validates an untrusted configuration or tests its FMUs, and
 * returns a result.
 *
 * Purpose: a crash, a hang or a false result fails only the request. A validator is sandboxed and
 *          opens no file. A trial runs FMUs in a further process.
 * Input:   a tl_worker_job and its texts, in a block that no process can change.
 * Result:  a tl_worker_result, in a block that the worker writes. The reader copies it, checks
 *          sizes and ranges, and cleans its texts. In the worst case, a false result accepts a bad
 *          candidate. Even then, the twin rejects a tuning that does not fit, and a candidate that
 *          needs a new twin first runs as a shadow, or on probation after a restart.
 * Waiting: tl_worker_start() waits for fork(). tl_worker_poll() does not wait; it kills a worker
 *          that has exceeded its time limit.
 * Owner:   the caller provides the memory of a worker; zeroed means not started.
 * Thread:  the main thread (role.h).
 */
#ifndef TL_FIRMWARE_RETUNE_WORKER_H
#define TL_FIRMWARE_RETUNE_WORKER_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/relay.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/process/block.h"
#include "firmware/process/role.h"
#include "firmware/retune/control.h"
#include "firmware/twin/handover.h"
#include "firmware/twin/twin_role.h"
#include "master/base/simtime.h"
#include "master/plan/tuning.h"

/* Prefix of the titles of worker processes. */
#define TL_WORKER "worker"

typedef enum tl_worker_kind {
    TL_WORKER_VALIDATOR, /* parses the candidate, finds its changes; result: tl_verdict. Sandboxed */
    TL_WORKER_TRIAL,     /* starts the FMUs, executes and rolls back some steps, as `check`; result: tl_trial_answer */
    TL_WORKER_STATES,    /* tests whether another process can load the FMUs' saved states; result: `why` */
    TL_WORKERS
} tl_worker_kind;

/* Texts of a job. */
typedef enum tl_worker_text {
    TL_WORKER_PATH,         /* path of the configuration file; relative file names start at its folder */
    TL_WORKER_CANDIDATE,    /* the configuration to validate or test */
    TL_WORKER_ACTIVE,       /* the active version; "": none */
    TL_WORKER_KEPT,         /* the version to which a probation would roll back; "": the active one */
    TL_WORKER_COMMISSIONED, /* the newest commissioned version (versions.h); "": the active one */
    TL_WORKER_BOX_FILE,     /* text of the configuration file on the box, whose names are allowed too; "": unknown */
    TL_WORKER_LIST,         /* text of the administrator's list of allowed names (config_change.h); "": none */
    TL_WORKER_LIST_PATH,    /* path of that list, for messages */
    TL_WORKER_TEXTS
} tl_worker_text;

typedef struct tl_worker_job {
    tl_worker_kind kind;
    const char *text[TL_WORKER_TEXTS]; /* NULL: "" */
    uint64_t memory_limit;             /* bytes for the FMU process; 0: the default */
    bool unconfined;                   /* FMUs run without a sandbox */
} tl_worker_job;

typedef struct tl_worker_settings {
    const char *plant;                                 /* name for the process title */
    tl_worker_job job;                                 /* its texts must be valid only during tl_worker_start() */
    tl_time limit;                                     /* ns until the worker is killed */
    int (*run_role)(const char *title, void *context); /* called in a forked copy if exec fails (role.h) */
    tl_relay_line *on_event; /* called with each line that the worker prints; NULL: lines are dropped */
    void *context;           /* of run_role() and on_event() */
} tl_worker_settings;

/* ---- results ---- */

enum { TL_VERDICT_PROBLEMS = 32, TL_VERDICT_CHANGES = 32, TL_VERDICT_WIDENED = 128 };

/* Upper limit of tl_verdict.window, ns. It is longer than any configuration can require. */
#define TL_VERDICT_LONGEST (1000000000 * TL_SECOND)

/* Widening by a larger factor needs the right to commission. Factor: largest error of an output
 * that is still in lock with the candidate, divided by that with the newest commissioned version.
 * Compared with the version before, a user could widen it step by step without limit. */
enum { TL_VERDICT_WIDEST = 3 };

/* Result of a validator. */
typedef struct tl_verdict {
    uint32_t is_valid; /* 1: the candidate has no error, and `kind` … `tuning` are valid */
    uint32_t kind;     /* tl_change_kind */
    uint32_t right;    /* tl_change_right */
    uint32_t
        problems; /* number found; the first are listed. If is_valid: values for which the sender may lack the right */
    uint32_t changes; /* number found; the first are listed */
    uint32_t
        strokes; /* number of strokes after which the lock monitor evaluates the lock (lock_monitor.h); 0: after steps */
    tl_time window;                                  /* longest duration of these strokes or steps, ns */
    tl_control_problem problem[TL_VERDICT_PROBLEMS]; /* the first problems */
    tl_control_change change[TL_VERDICT_CHANGES];    /* the first changes */
    tl_tuning tuning;                                /* of the candidate */
    tl_lock_tolerances
        tolerances; /* of the version that a probation would return to, in the order of the candidate's outputs; zeroed: none */
    char widened[TL_VERDICT_WIDENED]; /* the first output whose tolerance the candidate widens, and how; "": none */
} tl_verdict;

/* Result of a trial. */
typedef struct tl_trial_answer {
    tl_live_needs needs; /* resources that the candidate's twin needs (handover.h) */
    uint64_t memory;     /* bytes that this twin will need, including the FMUs */
    tl_time step;        /* T_S, ns */
    tl_time budget;      /* configured limit of a step's search time, ns */
    tl_time least;       /* measured time of a step without search, ns; 0: unknown */
    tl_time worst;       /* the same with a complete search, ns; 0: unknown, or there is no search */
} tl_trial_answer;

/* Result of a worker; only the part for its kind is set. */
typedef struct tl_worker_result {
    uint32_t is_complete; /* 1; written last */
    tl_verdict verdict;
    tl_trial_answer trial;
    char why[TL_TWIN_CHECK_WHY]; /* why another process cannot load the states; "": no fault was found */
} tl_worker_result;

/* Copy, check and clean a part of an untrusted result. Return false if the result is incomplete, or
 * if a value is out of range; then a verdict is zeroed, and the other parts must not be used. */
bool tl_verdict_take(const tl_worker_result *from, tl_verdict *verdict);
bool tl_trial_answer_take(const tl_worker_result *from, tl_trial_answer *answer);
bool tl_worker_read_reason(const tl_worker_result *from, char why[TL_TWIN_CHECK_WHY]);

/* ---- in the parent ---- */

enum { TL_WORKER_REASON = 128 };

typedef struct tl_worker {
    tl_block result; /* a tl_worker_result: untrusted */
    bool is_started;
    bool is_late;                  /* the worker exceeded its time limit and was killed */
    char reason[TL_WORKER_REASON]; /* why it failed: "its process was ended by signal 11 (…)"; "": no failure */
    /* private */
    tl_role role;
    tl_relay relay;
    tl_time until;
} tl_worker;

typedef enum tl_worker_state {
    TL_WORKER_RUNNING,
    TL_WORKER_DONE,  /* the process ended with exit code 0 */
    TL_WORKER_FAILED /* see `reason` */
} tl_worker_state;

/* Starts a worker; initialises *worker. Errors: TL_TRY_AGAIN; then the worker is not started. */
tl_status tl_worker_start(tl_worker *worker, const tl_worker_settings *settings, tl_error *error);

/* Polls the worker without blocking, and forwards its output. */
tl_worker_state tl_worker_poll(tl_worker *worker);

/* Kills the worker if it has not ended, and unmaps its result. A worker that was not started is
 * allowed. */
void tl_worker_close(tl_worker *worker);

/* ---- in the worker process ---- */

/* Reads the job. This must be the first call in the process. The job's texts stay valid until the
 * process ends. Errors: TL_BAD_DATA. */
tl_status tl_worker_begin(tl_worker_job *job, tl_error *error);

/* Maps the result block, which is zeroed. A trial must not map it before its FMU process has
 * ended. Errors: TL_BAD_DATA. */
tl_status tl_worker_open_result(tl_worker_result **result, tl_error *error);

/* Runs the worker; main() calls it in a process whose title begins with TL_WORKER. Returns the exit
 * code. `tasks`: tasks of an FMU process, as main() has them; a validator uses none. */
int tl_worker_role_run(const tl_twin_role_tasks *tasks);

#endif
