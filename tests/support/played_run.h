/* Simulated run for tests of an activation: its twin, which accepts or refuses a tuning, its shadow
 * and its restart.
 *
 * Twins:    the fields below set what they do and their run status. Time beside a shadow is
 *           simulated, too.
 * Workers:  validators are real processes. A trial process answers as the environment says: TRIAL
 *           is an exit code, "crash", "hang", "problem" or "problems". The last two print problems
 *           of TRIAL_PATH; "problem" prints one more line after them. TRIAL_ANSWERS,
 *           TRIAL_MEMORY (byte) and TRIAL_LEAST (ns) set its result.
 * Use:      main() calls tl_played_be() in a process with a title, otherwise tl_played_open().
 *           tl_played_set() and tl_played_clear() surround each test.
 * Owner:    a program has one simulated run.
 * Errors:   an unexpected error fails the test.
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
    tl_scratch folder; /* contains the versions */
    char path[PATH_MAX + 32];
    tl_versions versions;
    tl_refused_changes refusals;
    tl_activation activation;
    tl_error error;

    /* The run. */
    tl_activation_view view;
    char active_hash[TL_SHA256_TEXT];
    char given[TL_SHA256_TEXT];    /* hash of the newest tuning; "": none */
    tl_lock_tolerances tolerances; /* of the version before, which also judge the lock */
    tl_activation_answer answer;
    bool has_restarted;
    int events;
    char in_memory[TL_PLAYED_TEXT]; /* the configuration in the run's memory */
    bool are_others;                /* FMU files differ from those that the twin has loaded */

    /* The second twin: the shadow, or the twin before a handover. */
    tl_activation_shadow shadow;
    char other[TL_SHA256_TEXT];       /* hash of its configuration; "": there is no second twin */
    tl_live_needs needs;              /* with which it was started */
    tl_activation_answer handed_over; /* result of a handover */
    bool is_slow;                     /* the first order of a shadow is not accepted yet */
    tl_run_status each;               /* added to the shadow's status at each poll */
    tl_run_status beside;             /* added to the status of the run's twin at each poll */
    double off, off_beside;           /* error of motor.omega at each poll: shadow, run's twin */
    int handovers, ends;
    char allowed[PATH_MAX + 32]; /* path of the administrator's list */
    const char *step_s;          /* in each configuration */
    bool by_strokes;             /* configurations have an event horizon */
    tl_change_right right;       /* of the sender; less than commission: sent by network */

    /* Replies to the client. */
    tl_control_reply said[TL_PLAYED_SAID];
    size_t count;
} tl_played;

/* Creates the program's simulated run, with a folder `parent`/`name`_XXXXXX. */
tl_played *tl_played_open(const char *parent, const char *name);

/* Last call of main(): returns `failures`, the result of UNITY_END(). */
int tl_played_close(int failures);

/* Body of a worker process with this title, see worker.h. Returns its exit code. */
int tl_played_be(const char *title, void *context);

/* Set-up and clean-up of a test: version 1, tolerance "1" and prediction 1, is active. */
void tl_played_set(void);
void tl_played_clear(void);

/* Starts another activation for the same run, as after a crash of the activation process. */
void tl_played_begin(void);

/* Restarts the run. Its version 1 is what tl_played_write() writes now. */
void tl_played_begin_anew(void);

/* Writes a configuration and returns its size. With an event horizon, `prediction` is the longest
 * duration of a stroke in s. */
size_t tl_played_write(char text[TL_PLAYED_TEXT], const char *tolerance, int prediction);

/* Sends a configuration as user ann. tl_played_take() also polls until the final reply. */
void tl_played_offer(const char *tolerance, int prediction, unsigned flags);
tl_control_result tl_played_take(const char *tolerance, int prediction, unsigned flags);

/* Polls the activation until the condition is true; fails the test after 60 s. */
void tl_played_poll_until(bool (*is_done)(void));
bool tl_played_is_ended(void);
bool tl_played_is_quiet(void);
bool tl_played_is_live(void);

/* The twin on probation fails. Polls until the activation has returned to the version before. */
void tl_played_fail(void);

/* True if a reply at this step has all parts (message.h). */
bool tl_played_was_said(tl_control_step step, const char *parts);

/* Text of the final reply. */
const char *tl_played_last_word(void);

/* The final reply has this result and all parts, and the run is unchanged. */
void tl_played_expect_refused(tl_control_result result, const char *parts);

void tl_played_add(tl_run_status *sum, const tl_run_status *more);

#endif
