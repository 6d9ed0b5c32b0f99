/* A run that is played to an activation: its twin, which takes a tuning or refuses it, its shadow, its restart.
 *
 * Twins:    what they do, and what their figures are, is in the fields below. Time beside a shadow is played, too.
 * Workers:  validators are real processes. A trial is one that says what the environment wants of it: TRIAL (an exit code, "crash", "hang", or "problem"
 *           or "problems", which are of TRIAL_PATH, the first one with a word of its own after them), TRIAL_ANSWERS, TRIAL_MEMORY (byte), TRIAL_LEAST (ns).
 * Use:      main() is tl_played_be() for a process with a title; else tl_played_open(), and tl_played_set() and tl_played_clear() around each test.
 * Owner:    there is one in a program.
 * Errors:   what does not go well fails the test.
 * Thread:   one.
 */
#ifndef TL_TESTS_SUPPORT_PLAYED_RUN_H
#define TL_TESTS_SUPPORT_PLAYED_RUN_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/retune/activation.h"
#include "tests/support/scratch.h"

enum { TL_PLAYED_SAID = 128, TL_PLAYED_TEXT = 2048 };

typedef struct tl_played {
    tl_scratch scratch;
    tl_scratch folder; /* of the versions */
    char path[PATH_MAX + 32];
    tl_versions versions;
    tl_refusals refusals;
    tl_activation activation;
    tl_error error;

    /* The run. */
    tl_activation_view view;
    char in_force[TL_SHA256_TEXT];
    char given[TL_SHA256_TEXT];    /* of the newest tuning; "": none */
    tl_lock_tolerances tolerances; /* that its lock is judged by as well */
    tl_activation_news answer;
    bool has_restarted;
    int events;
    char in_memory[TL_PLAYED_TEXT]; /* its configuration */
    bool are_others;                /* FMUs than those that its twin has loaded */

    /* The twin in the other place. */
    tl_activation_shadow shadow;
    char other[TL_SHA256_TEXT];     /* of what it is of; "": there is none */
    tl_live_needs needs;            /* that it was begun with */
    tl_activation_news handed_over; /* what comes of a flip */
    bool is_slow;                   /* nothing is ordered at once */
    tl_run_status each;             /* look: so much more is done by the shadow, */
    tl_run_status beside;           /* and by the run's twin */
    double off, off_beside;         /* what the one output that both match is off by, for each look */
    int handovers, ends;
    char allowed[PATH_MAX + 32]; /* where the administrator's list is */
    const char *step_s;          /* of configurations, */
    bool by_strokes;             /* which have an event horizon */
    tl_change_right right;       /* with which they are sent; with less than commission by the network */

    /* What was said to who has asked. */
    tl_control_reply said[TL_PLAYED_SAID];
    size_t count;
} tl_played;

/* The program's run, with a folder `parent`/`name`_XXXXXX. */
tl_played *tl_played_open(const char *parent, const char *name);

/* The last of main(): returns `failures`, what UNITY_END() said. */
int tl_played_close(int failures);

/* As in worker.h: the end of a process that has a title. */
int tl_played_be(const char *title, void *context);

/* Around each test: an activation of a run whose version 1, tolerance "1" and prediction 1, is in force. */
void tl_played_set(void);
void tl_played_clear(void);

/* Another activation at the same run, as after the death of the one before. */
void tl_played_begin(void);

/* The run from the beginning: its version 1 is what tl_played_write() writes now. */
void tl_played_begin_anew(void);

/* A configuration: returns its size. With an event horizon `prediction` is how long a stroke may last. */
size_t tl_played_write(char text[TL_PLAYED_TEXT], const char *tolerance, int prediction);

/* It is sent by ann; and, the second one, looked at until its end is said. */
void tl_played_offer(const char *tolerance, int prediction, unsigned flags);
tl_control_result tl_played_take(const char *tolerance, int prediction, unsigned flags);

/* Looks on until this is so. */
void tl_played_look_until(bool (*is_done)(void));
bool tl_played_is_ended(void);
bool tl_played_is_quiet(void);
bool tl_played_is_live(void);

/* The twin on probation fails, and the way back is gone. */
void tl_played_fail(void);

/* Whether this was said at this step; and what was said in the end. */
bool tl_played_was_said(tl_control_step step, const char *text);
const char *tl_played_last_word(void);

/* Refused: nothing of it is left, and the run goes on as it was. */
void tl_played_expect_refused(tl_control_result result, const char *why);

void tl_played_add(tl_run_status *sum, const tl_run_status *more);

#endif
