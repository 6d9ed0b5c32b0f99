/* Explanation: finds the most likely cause of a change that was detected in a recorded run.
 *
 * Purpose: repeats the run up to a *mark* before the change, and collects the measurements from
 *          there on. Then it runs the twin again from the mark, without corrections, for each
 *          candidate (here a possible cause), with small changes from the onset on. The score test
 *          (monitor/score_test.h) compares these runs with the measurements.
 * Window:  R is the duration of a release (`release_s`), longer than the plant's reaction. The mark
 *          is 5 R before the earliest possible onset, or at the start of a shorter record. In the
 *          first R (at most a third of these steps) errors of the state fade; the others show the
 *          noise. The window ends 10 R after the onset, with the record, or at the next finding.
 * Causes:  of each adjusted input and each further input that a signal feeds: offset and gain, but
 *          no gain if its nominal value is constant. Of each tunable parameter, adjusted or not,
 *          that is not 0: a relative change. Of the sensor of each matched or compared output:
 *          offset, gain, delay and, if its readings repeat, freeze. Fixed parameters are only
 *          counted, because they cannot be changed after the start of an FMU.
 * Where:   in the FMU process, because FMUs are executed. Its parent does not trust the result.
 * Memory:  malloc(). Thread: the FMU thread.
 */
#ifndef TL_FIRMWARE_TWIN_EXPLANATION_H
#define TL_FIRMWARE_TWIN_EXPLANATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/monitor/score_test.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_step.h"
#include "master/twin/account.h"

/* The change to explain. Steps count from t_start. */
typedef struct tl_explanation_order {
    int64_t onset;     /* step at which the change began */
    int64_t spread;    /* the change began within onset ± spread steps */
    int64_t least;     /* first usable step: earlier ones belong to another change, or are not recorded */
    int64_t last;      /* one after the last usable step */
    uint32_t foresees; /* 1: there is no change: only compute which changes would be noticed within R of `onset` */
} tl_explanation_order;

typedef struct tl_explanation_window {
    int64_t mark, learn, onset, end; /* first step; start of learning the noise; onset; one after the last step */
} tl_explanation_window;

enum { TL_EXPLANATION_AFTER = 10 }; /* end of the window after the onset, in R */

/* R in steps, from `released_steps` of the configuration; 600 if that is 0. */
int64_t tl_explanation_reaction(uint32_t released_steps);

/* Computes the window. `released_steps`: of the configuration. `first`: first step of the twin.
 * Errors: TL_BAD_DATA: fewer than 60 steps before the earliest onset, or 10 after the onset. */
tl_status tl_explanation_plan(const tl_explanation_order *order, uint32_t released_steps, int64_t first,
                              tl_explanation_window *window, tl_error *error);

enum { TL_EXPLANATION_MOST = 192 }; /* candidates; further ones are left out */

typedef enum tl_explained_origin {
    TL_EXPLAINED_ADJUSTED,
    TL_EXPLAINED_INPUT,
    TL_EXPLAINED_PARAMETER,
    TL_EXPLAINED_SENSOR,
    TL_EXPLAINED_ORIGINS
} tl_explained_origin;

typedef enum tl_explained_change {
    TL_EXPLAINED_OFFSET,   /* size in `unit` */
    TL_EXPLAINED_GAIN,     /* size relative: −0.1 is 10 % less */
    TL_EXPLAINED_RELATIVE, /* of a parameter; size as of a gain */
    TL_EXPLAINED_DELAY,    /* size in steps */
    TL_EXPLAINED_FREEZE,   /* size in `unit`: frozen value minus the simulated value before the onset */
    TL_EXPLAINED_CHANGES
} tl_explained_change;

/* A candidate: a possible cause. Steps of `test` count from the mark. */
typedef struct tl_explained {
    char name[TL_ACCOUNT_TEXT]; /* "component.variable" or "plant.signal" */
    char unit[TL_ACCOUNT_TEXT]; /* "": none */
    uint32_t origin;            /* tl_explained_origin */
    uint32_t change;            /* tl_explained_change */
    tl_score_candidate test;
} tl_explained;

/* Plain data: the FMU process writes it to shared memory. */
typedef struct tl_explanation {
    tl_explanation_window window;
    tl_score_result result;
    uint32_t count;
    uint32_t fixed;    /* number of fixed Real parameters whose start value is not 0 */
    uint32_t left_out; /* number of candidates beyond TL_EXPLANATION_MOST, which were not tested */
    tl_explained candidate[TL_EXPLANATION_MOST];
} tl_explanation;

/* Validates counts, indices, enumerations and the window; replaces characters of texts that cannot
 * be displayed. `outputs`: number of matched outputs. */
bool tl_explanation_is_sound(tl_explanation *explanation, size_t outputs);

typedef struct tl_explainer tl_explainer;

/* Creates an explainer. The twin of the assembly must be built with `may_rerun`, and have begun.
 * The assembly must outlive the explainer. Errors: those of tl_explanation_plan(); TL_TRY_AGAIN. */
tl_status tl_explainer_create(const tl_assembly *assembly, const tl_explanation_order *order, tl_explainer **explainer,
                              tl_error *error);

/* NULL is allowed. */
void tl_explainer_free(tl_explainer *explainer);

/* Call after each executed tick. Errors: those of tl_twin_mark(). */
tl_status tl_explainer_take(tl_explainer *explainer, const tl_twin_result *result, tl_error *error);

/* Tests the candidates, after all ticks; the twin then cannot continue. `explanation` must be
 * zeroed. `is_stopped` returns true to end the test. `advance` is called after each re-run.
 * Errors: TL_INTERRUPTED; TL_TRY_AGAIN; TL_BAD_DATA: record too short; those of tl_twin_rerun(). */
tl_status tl_explainer_run(tl_explainer *explainer, bool (*is_stopped)(void *context), void (*advance)(void *context),
                           void *context, tl_explanation *explanation, tl_error *error);

#endif
