/* A change of the configuration, from the candidate to the end of its probation.
 *
 * Steps:   rows of a table: what begins the step, what polls it, its time limit, what is said while it waits. One driver goes through the rows in their order,
 *          skips those that a change does not need, enforces the limits and ends what fails.
 * Disk:    the new version is active on disk before the run gets it. A process that begins compares the two: an unfinished change is completed, or rolled back if
 *          the disk still has the version before. What a probation has come to is saved every 10 s.
 * Waiting: for the disk, and for a fork. Not for a worker process, a twin or a client.
 * Thread:  the activator's.
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

/* ---- The host: what a change of the configuration can do to the running plant, and see of it.
 *
 * Purpose: the activation decides when; the host, in the process that has the run's shared memory, knows how.
 * Thread:  all calls are in the thread of the activation, and none waits.
 */

enum { TL_ACTIVATION_WHY = 192, TL_ACTIVATION_LINE = 512 };

/* How the run is. */
typedef struct tl_activation_view {
    tl_run_status figures;         /* of the run: all begin at 0 with another one, also by a flip */
    double step_s;                 /* T_S */
    bool holds;                    /* safe hold: there is no twin, */
    bool waits;                    /* because it may not begin yet: this is no time of a probation */
    char line[TL_ACTIVATION_LINE]; /* the status line */
} tl_activation_view;

typedef enum tl_activation_news {
    TL_ACTIVATION_WAITS,  /* for the twin, or for the recorder to have kept the one before */
    TL_ACTIVATION_TAKEN,  /* it is in force since a tick, and will be for each twin that follows */
    TL_ACTIVATION_REFUSED /* by the twin */
} tl_activation_news;

/* A candidate whose twin shall run beside the run's. */
typedef struct tl_activation_candidate {
    const char *text;
    size_t size;
    const char *hash;
    tl_live_needs needs;                  /* found by a trial, and bounded */
    const tl_lock_tolerances *tolerances; /* what its twin's lock is judged by as well; zeroed: nothing else */
} tl_activation_candidate;

typedef enum tl_activation_phase {
    TL_ACTIVATION_NO_SHADOW,
    TL_ACTIVATION_SHADOW_BEGINS,   /* FMUs are loaded */
    TL_ACTIVATION_SHADOW_RECORDED, /* over recorded samples */
    TL_ACTIVATION_SHADOW_LIVE,     /* at the plant's ticks */
    TL_ACTIVATION_SHADOW_FAILED    /* it could not be begun, or is no more: `why` */
} tl_activation_phase;

/* The twin in the other place, and the run's beside it. */
typedef struct tl_activation_shadow {
    tl_activation_phase phase;
    char hash[TL_SHA256_TEXT]; /* of the configuration that it is of; "": not known */
    char why[TL_ACTIVATION_WHY];
    tl_run_status work;
    tl_run_status beside; /* the run's twin, at the same moment */
} tl_activation_shadow;

typedef struct tl_activation_host {
    void *context;
    void (*look)(void *context, tl_activation_view *view);

    /* The hash of the configuration that the run is of now, or will be from its next tick on. */
    void (*in_force)(void *context, char hash[TL_SHA256_TEXT]);

    /* The text of a configuration with this hash that is in the run's memory, with a NUL behind it; room for TL_CONTROL_MOST + 1 bytes. False: none is. */
    bool (*text)(void *context, const char *hash, char *text, size_t *size);

    /* The files of the FMUs that this text names, which is in force, are others than those that the run's twin has loaded. False: they are the same, or nobody can
     * say. Reads them all. */
    bool (*has_other_fmus)(void *context, const char *text, size_t size);

    /* The lock of the run's twin is judged by this yardstick as well (lock_before), from one of its next ticks on; zeroed: by none. */
    void (*judge_by)(void *context, const tl_lock_tolerances *tolerances);

    /* Hands a version's tuning and text, with a NUL behind it, to the run's twin. False: not yet, since the recorder has not kept the one before. */
    bool (*tune)(void *context, const tl_version *version, const char *why, const char *text, const tl_tuning *tuning);

    /* What came of the newest one. */
    tl_activation_news (*was_taken)(void *context, char why[TL_ACTIVATION_WHY]);

    /* A twin of this shall run as a shadow, in place of any other shadow. False: not yet, since what was ordered before is not obeyed. */
    bool (*begin_shadow)(void *context, const tl_activation_candidate *candidate);
    void (*look_at_shadow)(void *context, tl_activation_shadow *shadow);

    /* There shall be none, from now on, or soon. */
    void (*end_shadow)(void *context);

    /* Shadow and run change places between two ticks: the shadow goes on as a new run, and the run's twin as its shadow. False: not yet, as above. */
    bool (*handover)(void *context);

    /* What came of it: taken, or refused since there was no shadow, with the reason. From then on in_force() is of the new twin, and tunings are its. */
    tl_activation_news (*has_handed_over)(void *context, char why[TL_ACTIVATION_WHY]);

    /* The run ends, and another one begins with the version that is active on disk. */
    void (*restart)(void *context);

    /* An event, and a line of the log. */
    void (*tell)(void *context, tl_severity severity, const char *text);
} tl_activation_host;

/* ---- The activation. */

/* How a change comes into the run. */
typedef enum tl_activation_way {
    TL_ACTIVATION_IN_PLACE,    /* the running twin takes it */
    TL_ACTIVATION_BY_HANDOVER, /* another twin takes over between two ticks */
    TL_ACTIVATION_BY_RESTART
} tl_activation_way;

/* What a probation is if nobody says otherwise. */
enum { TL_ACTIVATION_PROBATION_S = 300, TL_ACTIVATION_LOCK_PERCENT = 95 };

/* For how long a new twin runs beside the run's over live samples if nobody says otherwise, and at most. */
enum { TL_ACTIVATION_SHADOW_S = 60, TL_ACTIVATION_SHADOW_LONGEST_S = 3600 };

typedef struct tl_activation_settings {
    const tl_activation_host *host;
    tl_versions *versions;
    tl_refusals *refusals;
    const char *plant;     /* its name, for titles */
    const char *path;      /* of its configuration: relative names start at its folder */
    const char *allowed;   /* where the administrator's list of names is (box_texts.h); NULL: there is none */
    uint64_t memory_limit; /* as in worker.h */
    bool unconfined;
    int (*be)(const char *title, void *context); /* as in worker.h */

    /* Says something to who has asked for the change; nobody may listen any more. TL_CONTROL_END is the last. */
    void (*say)(void *listener, const tl_control_reply *reply);
    void *listener;
} tl_activation_settings;

/* A candidate's twin beside the run's. Fields are private. */
typedef struct tl_rehearsal {
    bool is_begun;    /* the host knows of it */
    bool has_run;     /* it was seen to compute */
    bool is_compared; /* the window has begun */
    tl_time live;
    tl_run_status recorded; /* the shadow, as it was seen last over recorded samples */
    tl_comparison comparison;
} tl_rehearsal;

/* Why the run changes. */
typedef enum tl_activation_cause {
    TL_ACTIVATION_CANDIDATE, /* it was sent */
    TL_ACTIVATION_RETURN,    /* from the version on probation to the one before */
    TL_ACTIVATION_SETTLES    /* nothing changes on disk: the run is brought to what is there */
} tl_activation_cause;

/* The steps, in their order. Several are one step for clients (tl_control_step). Private. */
typedef enum tl_activation_row {
    TL_ACTIVATION_ROW_IDLE,
    TL_ACTIVATION_ROW_AUTHORISE,
    TL_ACTIVATION_ROW_VALIDATE,
    TL_ACTIVATION_ROW_TRY,
    TL_ACTIVATION_ROW_PREDICT,
    TL_ACTIVATION_ROW_ORDER, /* the shadow: */
    TL_ACTIVATION_ROW_LOAD,
    TL_ACTIVATION_ROW_LIVE,
    TL_ACTIVATION_ROW_COMPARE,
    TL_ACTIVATION_ROW_ACTIVATE, /* the disk, */
    TL_ACTIVATION_ROW_HAND_OVER,
    TL_ACTIVATION_ROW_ANSWER, /* the twin has it */
    TL_ACTIVATION_ROW_PROBATION,
    TL_ACTIVATION_ROWS
} tl_activation_row;

/* Fields are private. */
typedef struct tl_activation {
    tl_activation_settings settings;
    tl_activation_row row;
    tl_control_step step; /* of that row */
    tl_activation_way way;
    tl_activation_cause cause;
    bool is_wanted;      /* of a return: somebody has asked for it */
    bool has_other_fmus; /* the text is that of the active one, and an FMU's file is not */
    bool is_measured;    /* the trial has answered */
    tl_control_request request;
    char *text; /* the candidate's, with a NUL; NULL: there is none */
    size_t size;
    char reason[TL_VERSION_WHY]; /* of a return */
    tl_worker worker;
    tl_verdict verdict;
    tl_trial_answer answer;
    char heard
        [TL_CONTROL_TEXT]; /* the first error that the trial has told and that is no problem of a value; "": none */
    uint32_t problems;     /* of values, that it has told */
    tl_rehearsal rehearsal;
    char leaving[TL_SHA256_TEXT]; /* of what the run was of before a flip */
    tl_time passed;               /* since the last look, */
    tl_time waited;               /* since the step began, */
    tl_time told;                 /* and until something was said of it last */
    tl_probation probation;
    tl_time unsaved;   /* since the probation was written */
    tl_time pause;     /* before its end is tried again */
    bool is_unwritten; /* the disk refuses what comes of the probation, and that was told */
    tl_time looked;
} tl_activation;

/* Goes on with what is on disk: a probation that was under way, a change that was not finished. */
void tl_activation_begin(tl_activation *activation, const tl_activation_settings *settings);

/* Nothing is under way, nor on probation. */
bool tl_activation_is_idle(const tl_activation *activation);

/* A step is under way in which no other change can begin. */
bool tl_activation_is_busy(const tl_activation *activation);

/* Of the probation; 0: there is none. */
uint32_t tl_activation_left_s(const tl_activation *activation);

/* A candidate: `size` bytes of `text`, copied. Whatever comes of it is said. Must not be busy. */
void tl_activation_take(tl_activation *activation, const tl_control_request *request, const char *text, size_t size);

/* A candidate that is not active yet is given up. False: there is none. */
bool tl_activation_cancel(tl_activation *activation, const char *who);

/* By the tolerances of the version that the probation would return to, the lock is lost: to confirm then takes the right to commission. */
bool tl_activation_is_lost_before(const tl_activation *activation);

/* The version on probation is kept. False: there is none. *is_done: that is on disk. */
bool tl_activation_confirm(tl_activation *activation, const char *who, bool *is_done);

/* The version on probation, at the step TL_CONTROL_PROBATION, is returned from. What comes of that is said. */
void tl_activation_refuse(tl_activation *activation, const char *who);

/* Goes on; as often as wanted. */
void tl_activation_look(tl_activation *activation);

/* Ends the worker that is under way. What is on disk is gone on with by the next one. */
void tl_activation_end(tl_activation *activation);

#endif
