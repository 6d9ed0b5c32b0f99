/* Activation: changes the configuration of a run, from the receipt of the candidate configuration
 * to the end of its probation.
 *
 * Steps:   rows of a table in activation.c. A row names the functions that begin and poll the step,
 *          its time limit, and its messages. tl_activation_poll() executes the rows in their order,
 *          skips rows that a change does not need, enforces the limits and ends a change that
 *          fails.
 * Disk:    a new version becomes active on disk before the run gets it. When the config manager
 *          starts, it compares the active version on disk with the configuration of the run. If
 *          they differ, a change was interrupted, and the run gets the version on disk. The
 *          progress of a probation is saved every 10 s.
 * Waiting: calls block only for the disk and for fork(), never for a worker, a twin or a client.
 * Thread:  the main thread of the config manager.
 */
#ifndef TL_FIRMWARE_RETUNE_ACTIVATION_H
#define TL_FIRMWARE_RETUNE_ACTIVATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/monitor/run_status.h"
#include "firmware/retune/comparison.h"
#include "firmware/retune/control.h"
#include "firmware/retune/versions.h"
#include "firmware/retune/worker.h"
#include "firmware/store/run_types.h"

/* ---- Host: the operations on the run (twin, shadow, recorder) that an activation needs.
 *
 * Purpose: the activation decides when an operation is due. The host (live_host.h) executes the
 *          operation through the run's shared memory.
 * Thread:  all calls are made in the thread of the activation. No call blocks.
 */

enum { TL_ACTIVATION_WHY = 192, TL_ACTIVATION_LINE = 512 };

/* State of the run, which the host reads from shared memory. */
typedef struct tl_activation_view {
    tl_run_status figures;         /* of the run's twin; its counts restart at 0 with each run, also after a handover */
    double step_s;                 /* T_S, s */
    bool holds;                    /* safe hold: there is no twin */
    bool waits;                    /* safe hold until the first twin may start; meanwhile a probation's time stops */
    char line[TL_ACTIVATION_LINE]; /* the status line */
} tl_activation_view;

/* Fills the members of `state` from `lock` on, from the view. */
void tl_activation_view_write(const tl_activation_view *view, tl_control_state *state);

/* Result of a tuning or of a handover. */
typedef enum tl_activation_answer {
    TL_ACTIVATION_WAITS,   /* no result yet: the twin has not answered, or the handover is not finished */
    TL_ACTIVATION_STARTED, /* the twin and its successors use the tuning, or the new twin has taken over */
    TL_ACTIVATION_REFUSED  /* the twin rejected the tuning, or the handover was not possible */
} tl_activation_answer;

/* A candidate whose twin is to run as a shadow. The pointers are valid during the call only. */
typedef struct tl_activation_candidate {
    const char *text;                     /* of the configuration */
    size_t size;                          /* bytes of the text */
    const char *hash;                     /* of the text */
    tl_live_needs needs;                  /* resources that its twin may use; from the trial (worker.h) */
    const tl_lock_tolerances *tolerances; /* second set by which the shadow also evaluates its lock; zeroed: none */
} tl_activation_candidate;

typedef enum tl_activation_phase {
    TL_ACTIVATION_NO_SHADOW,
    TL_ACTIVATION_SHADOW_BEGINS,   /* the FMUs are being loaded */
    TL_ACTIVATION_SHADOW_RECORDED, /* the shadow simulates recorded samples */
    TL_ACTIVATION_SHADOW_LIVE,     /* the shadow steps at the plant's ticks */
    TL_ACTIVATION_SHADOW_FAILED    /* the shadow could not be started, or has ended: see `why` */
} tl_activation_phase;

/* State of the shadow, and of the run's twin at the same moment. */
typedef struct tl_activation_shadow {
    tl_activation_phase phase;
    char hash[TL_SHA256_TEXT]; /* of the shadow's configuration; "": unknown */
    char why[TL_ACTIVATION_WHY];
    tl_run_status work;   /* of the shadow */
    tl_run_status beside; /* of the run's twin */
} tl_activation_shadow;

/* Functions of the host; each gets `context`. */
typedef struct tl_activation_host {
    void *context;

    /* Reads the present state of the run. */
    void (*read_view)(void *context, tl_activation_view *view);

    /* Writes the hash of the configuration that the run uses now, or will use from its next tick
     * on. */
    void (*active_hash)(void *context, char hash[TL_SHA256_TEXT]);

    /* Copies the text of the configuration with this hash from the run's memory, with a final NUL.
     * `text` has TL_CONTROL_MOST + 1 bytes. Returns false if the memory does not contain it. */
    bool (*text)(void *context, const char *hash, char *text, size_t *size);

    /* `text`: the active configuration. Returns true if the FMU files that it names now differ in
     * content from those that the run's twin has loaded. Returns false if they are equal, or if
     * this is unknown. Reads all these files. */
    bool (*has_other_fmus)(void *context, const char *text, size_t size);

    /* Passes a second set of tolerances to the run's twin. From one of its next ticks on, the twin
     * also evaluates its lock by them (run status: lock_before). Zeroed: no second evaluation. */
    void (*use_tolerances)(void *context, const tl_lock_tolerances *tolerances);

    /* Sends a version's tuning, and the version's text with a final NUL, to the run's twin. Returns
     * false if the recorder has not recorded the previous tuning yet; then the caller retries. */
    bool (*tune)(void *context, const tl_version *version, const char *why, const char *text, const tl_tuning *tuning);

    /* Returns the result of the newest tuning. `why`: the reason of a rejection. */
    tl_activation_answer (*tuning_result)(void *context, char why[TL_ACTIVATION_WHY]);

    /* Orders a shadow with this candidate; it replaces any other shadow. Returns false while an
     * earlier order is pending; then the caller retries. */
    bool (*begin_shadow)(void *context, const tl_activation_candidate *candidate);

    /* Reads the present state of the shadow. */
    void (*read_shadow)(void *context, tl_activation_shadow *shadow);

    /* Orders the end of the shadow. It may end later. */
    void (*end_shadow)(void *context);

    /* Orders a handover between two ticks: the shadow continues as a new run, and the run's twin
     * becomes its shadow. Returns false while an earlier order is pending. */
    bool (*handover)(void *context);

    /* Returns the result of the handover. If no shadow can take over, the handover is refused, and
     * `why` is the reason. After a handover, active_hash() and tune() refer to the new twin. */
    tl_activation_answer (*handover_result)(void *context, char why[TL_ACTIVATION_WHY]);

    /* Ends the run. A new run starts with the version that is active on disk. */
    void (*restart)(void *context);

    /* Records an event and logs it. */
    void (*report)(void *context, tl_severity severity, const char *text);
} tl_activation_host;

/* ---- Activation. */

/* How a change is applied to the run. */
typedef enum tl_activation_method {
    TL_ACTIVATION_IN_PLACE,    /* the running twin changes its tuning */
    TL_ACTIVATION_BY_HANDOVER, /* another twin takes over between two ticks */
    TL_ACTIVATION_BY_RESTART   /* the run ends, and the next one uses the new version */
} tl_activation_method;

/* Defaults of a probation: duration, s; percent of its steps that must be in lock. */
enum { TL_ACTIVATION_PROBATION_S = 300, TL_ACTIVATION_LOCK_PERCENT = 95 };

/* Seconds of live samples during which a new twin runs as a shadow: default and maximum. The first
 * quarter, at most 10 s, is not compared. */
enum { TL_ACTIVATION_SHADOW_S = 60, TL_ACTIVATION_SHADOW_LONGEST_S = 3600 };

/* All pointers must outlive the activation. */
typedef struct tl_activation_settings {
    const tl_activation_host *host;
    tl_versions *versions;
    tl_refused_changes *refusals;
    const char *plant;     /* name of the plant, for process titles */
    const char *path;      /* path of the configuration file; relative file names start at its folder */
    const char *allowed;   /* path of the administrator's list of allowed names (box_texts.h); NULL: no list */
    uint64_t memory_limit; /* bytes for an FMU process; 0: the default */
    bool unconfined;       /* FMUs run without a sandbox */
    int (*run_role)(const char *title, void *context); /* as in worker.h */

    /* Sends a reply to the client that requested the change, if it is still connected.
     * TL_CONTROL_END is the last reply. */
    void (*reply)(void *listener, const tl_control_reply *reply);
    void *listener;
} tl_activation_settings;

/* The shadow of a candidate. Fields are private. */
typedef struct tl_rehearsal {
    bool is_begun;          /* the host has accepted the order for the shadow */
    bool has_run;           /* the shadow has executed steps */
    bool is_compared;       /* the comparison has begun */
    tl_time live;           /* how long the shadow has stepped at the plant's ticks, ns */
    tl_run_status recorded; /* newest state of the shadow while it simulated recorded samples */
    tl_comparison comparison;
} tl_rehearsal;

/* Cause of a change. */
typedef enum tl_activation_cause {
    TL_ACTIVATION_CANDIDATE, /* a client sent a candidate */
    TL_ACTIVATION_RETURN,    /* rollback from the version on probation to the one before */
    TL_ACTIVATION_SETTLES    /* completes an interrupted change: the run gets the version that is active on disk */
} tl_activation_cause;

/* The rows of the table, in their order. Clients see some of them as one step (tl_control_step).
 * Private. */
typedef enum tl_activation_row {
    TL_ACTIVATION_ROW_IDLE,
    TL_ACTIVATION_ROW_AUTHORISE,
    TL_ACTIVATION_ROW_VALIDATE,
    TL_ACTIVATION_ROW_TRY,
    TL_ACTIVATION_ROW_PREDICT,
    TL_ACTIVATION_ROW_ORDER, /* orders the shadow */
    TL_ACTIVATION_ROW_LOAD,
    TL_ACTIVATION_ROW_LIVE,
    TL_ACTIVATION_ROW_COMPARE,
    TL_ACTIVATION_ROW_ACTIVATE, /* the active version on disk is changed */
    TL_ACTIVATION_ROW_HAND_OVER,
    TL_ACTIVATION_ROW_ANSWER, /* waits until the twin has applied the change */
    TL_ACTIVATION_ROW_PROBATION,
    TL_ACTIVATION_ROWS
} tl_activation_row;

/* Fields are private, except that the config manager reads `settings` and `step`. */
typedef struct tl_activation {
    tl_activation_settings settings;
    tl_activation_row row;
    tl_control_step step; /* of `row`, as clients see it */
    tl_activation_method way;
    tl_activation_cause cause;
    bool is_wanted;      /* with TL_ACTIVATION_RETURN: a client requested the rollback */
    bool has_other_fmus; /* the text is the active one, but an FMU's file differs from the loaded one */
    bool is_measured;    /* the trial has answered */
    tl_control_request request;
    char *text;                  /* text of the candidate, with a final NUL; NULL: none */
    size_t size;                 /* bytes of `text` */
    char reason[TL_VERSION_WHY]; /* of a rollback */
    tl_worker worker;
    tl_verdict verdict;     /* of the validator */
    tl_trial_answer answer; /* of the trial; valid if is_measured */
    char first_error
        [TL_CONTROL_TEXT]; /* the trial's first error, except problems of the configuration's text; "": none */
    uint32_t problems;     /* number of problems of the configuration's text that the trial logged */
    tl_rehearsal rehearsal;
    char leaving[TL_SHA256_TEXT]; /* hash of the run's configuration before a handover */
    tl_time passed;               /* ns from the previous poll to this one */
    tl_time waited;               /* ns since the step began */
    tl_time reported_at;          /* value of `waited` at the step's last message */
    tl_probation probation;
    tl_time unsaved;   /* ns since the probation was saved */
    tl_time pause;     /* ns until the next attempt to end the probation, after a failed attempt; else 0 */
    bool is_unwritten; /* the probation could not be saved, and that was logged */
    tl_time polled_at; /* CLOCK_MONOTONIC: time of the previous poll */
} tl_activation;

/* Starts from the state on disk: resumes a probation and completes an interrupted change. */
void tl_activation_begin(tl_activation *activation, const tl_activation_settings *settings);

/* Returns true if no change is in progress and no version is on probation. */
bool tl_activation_is_idle(const tl_activation *activation);

/* Returns true if a change is in progress, so that no other can begin; false on probation. */
bool tl_activation_is_busy(const tl_activation *activation);

/* Returns the seconds that remain of the probation, rounded up; 0: no probation. */
uint32_t tl_activation_remaining_s(const tl_activation *activation);

/* Begins a change to a candidate: `size` bytes of `text`, which are copied. Progress and result are
 * sent by settings.reply. The activation must not be busy. */
void tl_activation_start(tl_activation *activation, const tl_control_request *request, const char *text, size_t size);

/* Cancels the change to a candidate; its client gets TL_CONTROL_CANCELLED. `who`: name of the user.
 * Returns false if there is no candidate, or if its activation has begun. */
bool tl_activation_cancel(tl_activation *activation, const char *who);

/* Returns true if a version on probation has lost the lock by the tolerances of the version that a
 * rollback would restore. Then only a client with the right to commission may confirm the new
 * version. */
bool tl_activation_was_lost_before(const tl_activation *activation);

/* Keeps the version on probation. Returns false if there is none, or if the activation of another
 * version has begun. Else returns true and sets *is_done: true if the decision is saved on disk. */
bool tl_activation_confirm(tl_activation *activation, const char *who, bool *is_done);

/* Begins to roll back the version on probation; only during the step TL_CONTROL_PROBATION. The
 * result is sent by settings.reply. */
void tl_activation_roll_back(tl_activation *activation, const char *who);

/* Polls the current step and begins the next one. May be called at any rate. */
void tl_activation_poll(tl_activation *activation);

/* Kills a running worker and frees the candidate. Saves the progress of the probation, unless a
 * change is in progress. The next config manager continues from the state on disk. */
void tl_activation_end(tl_activation *activation);

#endif
