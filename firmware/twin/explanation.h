/* Explanation: which cause explains a change that was found in a recorded run?
 *
 * Purpose: repeats the run up to a mark before the change, and collects what was measured from then
 *          on. Then it runs the twin again from the mark, without corrections, once for each
 *          candidate with a small change from the onset on, and lets the score test
 *          (monitor/score_test.h) decide.
 * Window:  R is the duration of a release (`release_s`), longer than the plant's reaction. The mark
 *          is 5 R before the onset. In the first R, errors of the state fade; the others show the
 *          noise. The window ends 10 R after the onset, with the record, or at the next finding.
 * Causes:  of each adjusted variable and each further input that a signal feeds: offset and gain.
 *          Of each tunable parameter: a relative change. Of the sensor of each matched or compared
 *          output: offset, gain, delay and, if its readings repeat, freeze. A fixed parameter
 *          cannot be changed after the start of an FMU; the number of these is given.
 * Where:   in the FMU process, because it executes FMUs. Its parent does not trust the result.
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
    int64_t onset;
    int64_t spread;    /* of the onset */
    int64_t least;     /* earlier steps belong to another change, or are not recorded */
    int64_t last;      /* as `least`; one after the last step */
    uint32_t foresees; /* 1: nothing has changed: only compute what would be noticed within R of the onset */
} tl_explanation_order;

typedef struct tl_explanation_window {
    int64_t mark, learn, onset, end; /* steps; `end` is one after the last */
} tl_explanation_window;

enum { TL_EXPLANATION_AFTER = 10 }; /* multiples of R after the onset */

/* R in steps, from `released_steps` of the configuration; 600 if that is 0. */
int64_t tl_explanation_reaction(uint32_t released_steps);

/* `released_steps`: of the configuration. `first`: first step of the twin. Errors: TL_BAD_DATA if
 * there are too few steps before or after the onset. */
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
    TL_EXPLAINED_RELATIVE, /* of a parameter, as a gain */
    TL_EXPLAINED_DELAY,    /* size in steps */
    TL_EXPLAINED_FREEZE,   /* size in `unit`: from the value before the onset */
    TL_EXPLAINED_CHANGES
} tl_explained_change;

/* A candidate. Steps of `test` count from the mark. */
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
    uint32_t fixed;    /* number of fixed parameters that differ from 0 */
    uint32_t left_out; /* candidates without room */
    tl_explained candidate[TL_EXPLANATION_MOST];
} tl_explanation;

/* Checks counts, indices, enumerations and texts; replaces characters that cannot be displayed. */
bool tl_explanation_is_sound(tl_explanation *explanation, size_t outputs);

typedef struct tl_explainer tl_explainer;

/* For an assembly whose twin was built with `may_rerun`, and has begun. Errors: those of
 * tl_explanation_plan(); TL_TRY_AGAIN. */
tl_status tl_explainer_create(const tl_assembly *assembly, const tl_explanation_order *order, tl_explainer **explainer,
                              tl_error *error);

/* NULL is allowed. */
void tl_explainer_free(tl_explainer *explainer);

/* Call after each executed tick. Errors: those of tl_twin_mark(). */
tl_status tl_explainer_take(tl_explainer *explainer, const tl_twin_result *result, tl_error *error);

/* Call when all ticks are executed; the twin then cannot continue. `explanation` must be zeroed.
 * `is_stopped`: true: end soon. `advance` is called after each re-run.
 * Errors: TL_INTERRUPTED; TL_BAD_DATA: the record ended too soon; those of tl_twin_rerun(). */
tl_status tl_explainer_run(tl_explainer *explainer, bool (*is_stopped)(void *context), void (*advance)(void *context),
                           void *context, tl_explanation *explanation, tl_error *error);

#endif
