/* Scenes: one twin of two test FMUs for each mode of a twin, with a plant whose sample depends only
 * on the tick.
 *
 * Purpose: tests of saving, resuming and resetting a twin run in each mode.
 * Twin:    plant.u drives "a", whose y0 drives "b". The y0 of "b" is matched, and its offset or its
 *          flag is adjusted. Both FMUs are `telling` (test_fmu.h).
 *          TL_SCENE_STROKES has an event horizon: plant.move is true during a stroke, and plant.y
 *          is true at its end position.
 * Use:     tl_test_scene_build(); before each tick of the run tl_test_scene_show(); at the end and
 *          in tearDown() tl_test_scene_end().
 * Owner:   the caller provides the memory, zeroed at first; it is large, so make it static.
 * Thread:  one at a time.
 */
#ifndef TL_TESTS_SUPPORT_TEST_SCENE_H
#define TL_TESTS_SUPPORT_TEST_SCENE_H

#include <stdbool.h>
#include <stdint.h>

#include "tests/support/test_plan.h"

typedef enum tl_test_scene_kind {
    TL_SCENE_LAG,
    TL_SCENE_HOLD,
    TL_SCENE_AHEAD,
    TL_SCENE_DELAYS,
    TL_SCENE_AHEAD_OF_TIME, /* inputs and measured values come from samples of earlier ticks */
    TL_SCENE_LONG,          /* a dynamic horizon; the cache of "a" keeps only outputs */
    TL_SCENE_PLAIN,         /* no execution is reused */
    TL_SCENE_FLAG,          /* a Boolean is adjusted */
    TL_SCENE_MEASURED,      /* the delay is measured, and nothing is adjusted */
    TL_SCENE_FREE,          /* nothing is adjusted */
    TL_SCENE_STROKES,
    TL_SCENES /* number of scenes */
} tl_test_scene_kind;

enum { TL_SCENE_FMUS = 2, TL_SCENE_MATCHES = 1, TL_SCENE_PERIOD = 80 /* ticks, of strokes */ };

typedef struct tl_test_scene {
    tl_test_scene_kind kind;
    /* Set before the build: */
    bool forgetful;                     /* a solver that remembers nothing between two searches */
    bool unsaved;                       /* no execution is reused */
    bool good;                          /* the plant's signals are always good */
    bool still;                         /* the matched signal is constant, except in strokes: it has no noise */
    bool shortest;                      /* T_P is T_D */
    void (*change)(tl_test_plan *plan); /* makes further changes to the plan; NULL: none */
    /* Set by the build: */
    tl_test_log log;
    tl_test_fmu fmus[TL_SCENE_FMUS];
    tl_test_plan plan;
    tl_test_run run;
} tl_test_scene;

/* Returns "lag" …, for messages. */
const char *tl_test_scene_name(tl_test_scene_kind kind);

/* Returns the largest age of a sample that a step uses, in ticks. The first step comes that many
 * ticks after the start. */
int64_t tl_test_scene_age(tl_test_scene_kind kind);

/* Builds the twin; its next tick is 0. */
void tl_test_scene_build(tl_test_scene *scene, tl_test_scene_kind kind);

/* Makes this the next tick. */
void tl_test_scene_move(tl_test_scene *scene, int64_t tick);

/* Sets the sample of the next tick. Some values are not good, some for longer than any horizon. */
void tl_test_scene_show(tl_test_scene *scene);

/* As tl_test_run_end(). */
void tl_test_scene_end(tl_test_scene *scene);

#endif
