/* Worker: a short-lived process that reads an untrusted configuration, or tests its FMUs, and returns a result.
 *
 * Purpose: a crash, a hang or a lie in it fails the request only. A validator is confined and has no file; FMUs run in a further process below a trial.
 * Input:   a tl_worker_job, in memory that nobody can change.
 * Result:  a tl_worker_result, in a block that the worker writes. The reader copies it, checks sizes and ranges, and cleans its texts. A lie can do no more than
 *          call a bad candidate good: the twin refuses a tuning that does not fit, and all else runs beside the plant's twin first.
 * Waiting: tl_worker_start() waits for a fork; tl_worker_poll() does not wait, and kills a worker that is late.
 * Owner:   the caller places a worker; a zeroed one is none.
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

/* Titles of the process begin with it. */
#define TL_WORKER "worker"

typedef enum tl_worker_kind {
    TL_WORKER_VALIDATOR, /* reads the candidate and finds the change: a verdict. Confined; no FMU */
    TL_WORKER_TRIAL, /* loads and starts the FMUs, runs some steps and restores them, as `check` does: a trial answer */
    TL_WORKER_STATES, /* tests whether another process can load the states that the FMUs save: `why` */
    TL_WORKERS
} tl_worker_kind;

typedef enum tl_worker_text {
    TL_WORKER_PATH, /* of the configuration: relative names start at its folder */
    TL_WORKER_CANDIDATE,
    TL_WORKER_IN_FORCE,     /* "": there is none */
    TL_WORKER_KEPT,         /* the version that a probation would return to; "": that in force */
    TL_WORKER_COMMISSIONED, /* the version that was commissioned last; "": that in force */
    TL_WORKER_ON_THE_BOX,   /* the configuration's file as it is now; "": not known */
    TL_WORKER_LIST,         /* the administrator's list of allowed names (config_change.h); "": there is none, */
    TL_WORKER_LIST_PATH,    /* and its path */
    TL_WORKER_TEXTS
} tl_worker_text;

typedef struct tl_worker_job {
    tl_worker_kind kind;
    const char *text[TL_WORKER_TEXTS]; /* NULL: "" */
    uint64_t memory_limit;             /* bytes that the process of the FMUs may take; 0: as usual */
    bool unconfined;                   /* FMUs may do what the user can */
} tl_worker_job;

typedef struct tl_worker_settings {
    const char *plant;                           /* for the title */
    tl_worker_job job;                           /* texts live during the start only */
    tl_time limit;                               /* ns until it is killed */
    int (*be)(const char *title, void *context); /* if the program cannot be executed (role.h) */
    tl_relay_line *hear;                         /* gets each line that it prints; NULL: they are dropped */
    void *context;                               /* of both */
} tl_worker_settings;

/* ---- results ---- */

enum { TL_VERDICT_PROBLEMS = 32, TL_VERDICT_CHANGES = 32, TL_VERDICT_WIDENED = 128 };

/* Of a window: more than any configuration can have. */
#define TL_VERDICT_LONGEST (1000000000 * TL_SECOND)

/* By how much the right to retune may widen what is called in lock, against the version that was commissioned last. */
enum { TL_VERDICT_WIDEST = 3 };

/* What a validator finds. */
typedef struct tl_verdict {
    uint32_t is_valid; /* 1: the candidate can be read without a problem, and `kind` … `tuning` mean something */
    uint32_t kind;     /* tl_change_kind */
    uint32_t right;    /* tl_change_right */
    uint32_t
        problems; /* that were found; of one that is valid: values that its sender may lack the right to; the first ones are listed */
    uint32_t changes; /* the same */
    uint32_t strokes; /* that must have ended before its lock is judged (lock_monitor.h); 0: steps, */
    tl_time window;   /* ns that those take */
    tl_control_problem problem[TL_VERDICT_PROBLEMS];
    tl_control_change change[TL_VERDICT_CHANGES];
    tl_tuning tuning; /* the candidate's */
    tl_lock_tolerances
        tolerances; /* of the version that a probation would return to, in the order of the candidate's outputs; zeroed: there is none */
    char widened[TL_VERDICT_WIDENED]; /* the first output that the candidate judges less strictly, and how; "": none */
} tl_verdict;

/* What a trial finds. */
typedef struct tl_trial_answer {
    tl_live_needs needs;
    uint64_t memory; /* bytes that its twin will take, FMUs and all */
    tl_time step;    /* ns: T_S, */
    tl_time budget;  /* of a step's time by the configuration, */
    tl_time least;   /* of a free step as measured, 0: not known; */
    tl_time worst;   /* of one with all its evaluations, 0: not known, or nothing is searched */
} tl_trial_answer;

/* One part is filled, by the kind of the worker. */
typedef struct tl_worker_result {
    uint32_t is_complete; /* 1; written last */
    tl_verdict verdict;
    tl_trial_answer trial;
    char why[TL_TWIN_CHECK_WHY]; /* another process cannot use the states; "": nothing was found against them */
} tl_worker_result;

/* Copy, check and clean a part of an untrusted result. False: it is incomplete, or a value is out of range; a verdict is zeroed then. */
bool tl_verdict_take(const tl_worker_result *from, tl_verdict *verdict);
bool tl_trial_answer_take(const tl_worker_result *from, tl_trial_answer *answer);
bool tl_worker_take_why(const tl_worker_result *from, char why[TL_TWIN_CHECK_WHY]);

/* ---- in the parent ---- */

enum { TL_WORKER_REASON = 128 };

typedef struct tl_worker {
    tl_block result; /* a tl_worker_result: untrusted */
    bool is_started;
    bool is_late;                  /* and was killed */
    char reason[TL_WORKER_REASON]; /* why it failed: "its process died of signal 11 (…)"; "": it did not */
    /* private */
    tl_role role;
    tl_relay relay;
    tl_time until;
} tl_worker;

typedef enum tl_worker_state {
    TL_WORKER_RUNNING,
    TL_WORKER_DONE,  /* it ended with exit code 0 */
    TL_WORKER_FAILED /* `reason` says how */
} tl_worker_state;

/* Errors: TL_TRY_AGAIN; then there is no worker. */
tl_status tl_worker_start(tl_worker *worker, const tl_worker_settings *settings, tl_error *error);

/* Passes on what it has printed. */
tl_worker_state tl_worker_poll(tl_worker *worker);

/* Kills it if it has not ended. None is allowed. */
void tl_worker_close(tl_worker *worker);

/* ---- in the process ---- */

/* First in it. Texts live as long as the process. Errors: TL_BAD_DATA. */
tl_status tl_worker_begin(tl_worker_job *job, tl_error *error);

/* Its block, zeroed. A trial maps it after its FMUs have ended. Errors: TL_BAD_DATA. */
tl_status tl_worker_open_result(tl_worker_result **result, tl_error *error);

/* What main() becomes in a process with such a title: the exit code. `tasks`: as in main(). A validator needs none. */
int tl_worker_role_run(const tl_twin_role_tasks *tasks);

#endif
