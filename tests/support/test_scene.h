/* Scenes: twins of two test FMUs in every mode that a twin has, before a plant that shows the same at the same tick.
 *
 * Purpose: what is said of a twin's life (to save it, to go on with it, to begin anew) is said in each of them.
 * Twin:    "a" passes the plant's u on to "b", whose y0 is matched by its offset, or by its flag; both tell all their inputs apart.
 *          "strokes" has an event horizon: of the plant's move, y says when it has arrived.
 * Use:     tl_test_scene_build(), then ticks by the run: tl_test_scene_show() before each; tl_test_scene_end(), also in tearDown().
 * Owner:   the caller places it (it is large: make it static), zero at first.
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
    TL_SCENE_AHEAD_OF_TIME, /* samples from before the instant are looked up */
    TL_SCENE_LONG,          /* a dynamic horizon; nothing but outputs is kept in its cache */
    TL_SCENE_PLAIN,         /* nothing is saved of executions */
    TL_SCENE_FLAG,          /* a Boolean is adjusted */
    TL_SCENE_MEASURED,
    TL_SCENE_FREE, /* nothing is adjusted */
    TL_SCENE_STROKES,
    TL_SCENES /* how many there are */
} tl_test_scene_kind;

enum { TL_SCENE_FMUS = 2, TL_SCENE_MATCHES = 1, TL_SCENE_PERIOD = 80 /* ticks, of strokes */ };

typedef struct tl_test_scene {
    tl_test_scene_kind kind;
    bool forgetful; /* to be set before: no solver that remembers */
    bool unsaved;   /* to be set before: no executions are saved */
    bool good;      /* to be set before: the plant's signals are always good, */
    bool still;     /* and what is matched stands still, but in strokes: there is no noise to be measured */
    bool shortest;  /* to be set before: T_P is T_D */
    void (*change)(tl_test_plan *plan); /* to be set before: what else is other in the plan; NULL: nothing */
    tl_test_log log;
    tl_test_fmu fmus[TL_SCENE_FMUS];
    tl_test_plan plan;
    tl_test_run run;
} tl_test_scene;

/* "lag" …, for messages. */
const char *tl_test_scene_name(tl_test_scene_kind kind);

/* Ticks by which what is looked up may be older than the instant it is for. */
int64_t tl_test_scene_age(tl_test_scene_kind kind);

/* The twin, whose next tick is 0. */
void tl_test_scene_build(tl_test_scene *scene, tl_test_scene_kind kind);

/* The next tick will be this one. */
void tl_test_scene_move(tl_test_scene *scene, int64_t tick);

/* What the plant shows at the next tick: now and then not good, also for longer than any horizon. */
void tl_test_scene_show(tl_test_scene *scene);

/* As tl_test_run_end(). */
void tl_test_scene_end(tl_test_scene *scene);

#endif
