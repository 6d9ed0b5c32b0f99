/* See test_scene.h. */
#include "tests/support/test_scene.h"

#include <math.h>

#include <unity.h>

#include "tests/support/random_numbers.h"

const char *tl_test_scene_name(tl_test_scene_kind kind) {
    static const char *const names[TL_SCENES] = {"lag",   "hold", "ahead",    "delays", "ahead of time", "long",
                                                 "plain", "flag", "measured", "free",   "strokes"};
    return names[kind];
}

int64_t tl_test_scene_age(tl_test_scene_kind kind) {
    return kind == TL_SCENE_AHEAD_OF_TIME ? 3 : kind == TL_SCENE_MEASURED ? 4 : 0;
}

static void vary_timing(tl_test_scene *scene) {
    tl_plan *plan = &scene->plan.plan;
    tl_test_scene_kind kind = scene->kind;
    plan->measurements = kind == TL_SCENE_HOLD ? TL_HOLD : kind == TL_SCENE_AHEAD ? TL_AHEAD : TL_LAG;
    plan->input_ticks = kind == TL_SCENE_DELAYS ? 2 : kind == TL_SCENE_AHEAD_OF_TIME ? -3 : 0;
    plan->output_ticks = kind == TL_SCENE_DELAYS ? 4 : kind == TL_SCENE_AHEAD_OF_TIME ? -2 : 0;
    if (kind == TL_SCENE_MEASURED) {
        plan->measure = (tl_plan_measure){.lags = 5, .range = 4 * plan->step};
    }
}

static void vary_search(tl_test_scene *scene) {
    tl_plan *plan = &scene->plan.plan;
    tl_test_scene_kind kind = scene->kind;
    bool saved = kind != TL_SCENE_PLAIN && !scene->unsaved;
    bool black_box = scene->forgetful || kind == TL_SCENE_STROKES || kind == TL_SCENE_PLAIN;
    plan->saving = (tl_plan_saving){.structure = saved, .sequences = saved};
    plan->algorithm = kind == TL_SCENE_FLAG ? "boolean" : black_box ? "nelder-mead" : "secant";
    plan->prediction = kind == TL_SCENE_STROKES || scene->shortest ? 0 : kind == TL_SCENE_LONG ? 6 : 3;
    plan->shape = kind == TL_SCENE_LONG ? TL_DYNAMIC : TL_STATIC;
    plan->free_twin = kind == TL_SCENE_HOLD || kind == TL_SCENE_AHEAD || kind == TL_SCENE_PLAIN ? 3 : 0;
    scene->plan.components[0].keep = kind == TL_SCENE_LONG ? TL_KEEP_OUTPUTS : TL_KEEP_STATES;
}

static void add_fmu(tl_test_scene *scene, size_t i) {
    bool strokes = scene->kind == TL_SCENE_STROKES;
    tl_test_fmu *fmu = &scene->fmus[i];
    tl_test_fmu_init(fmu, 1, true, &scene->log);
    fmu->model.capabilities.can_serialize_state = true;
    fmu->control.ends = strokes && i == 1;
    fmu->control.telling = !strokes;
    tl_test_plan_component(&scene->plan, i == 0 ? "a" : "b", fmu);
    tl_test_plan_set(&scene->plan, "lag", strokes && i == 1 ? 1.0 : 0.3);
    tl_test_plan_set(&scene->plan, "count", 0.0);
    tl_test_plan_set(&scene->plan, "mode", 0.0);
    if (i == 0 || scene->kind != TL_SCENE_FLAG) {
        tl_test_plan_set_value(&scene->plan, "flag", (tl_value){.type = TL_BOOLEAN});
    }
}

static void add_strokes(tl_test_plan *plan) {
    plan->adjust[0].lower = 0.1;
    plan->adjust[0].upper = 20.0;
    plan->plan.event = (tl_plan_event){.where = "event",
                                       .start = {"plant.move", false},
                                       .end = {"plant.y", false},
                                       .window = 8 * plan->plan.step,
                                       .longest = 60 * plan->plan.step};
}

static void make(tl_test_scene *scene) {
    tl_test_plan *plan = &scene->plan;
    tl_test_scene_kind kind = scene->kind;
    bool strokes = kind == TL_SCENE_STROKES;
    tl_test_plan_init(plan, TL_SECOND / 10);
    for (size_t i = 0; i < TL_SCENE_FMUS; i++) {
        add_fmu(scene, i);
    }
    tl_test_plan_signal(plan, "u", TL_REAL, "");
    tl_test_plan_signal(plan, "y", strokes ? TL_BOOLEAN : TL_REAL, "");
    tl_test_plan_signal(plan, "move", TL_BOOLEAN, "");
    tl_test_plan_connect(plan, "plant.u", "a.u0");
    tl_test_plan_connect(plan, "a.y0", "b.u0");
    tl_test_plan_match(plan, strokes ? "b.flag_out" : "b.y0", "plant.y", strokes ? 1.0 : 0.01);
    if (kind != TL_SCENE_FREE && kind != TL_SCENE_MEASURED) {
        bool flag = kind == TL_SCENE_FLAG;
        tl_test_plan_adjust(plan, strokes ? "b.gain" : flag ? "b.flag" : "b.offset", flag ? 0.0 : 0.5);
    }
    if (strokes) {
        add_strokes(plan);
    }
    vary_timing(scene);
    vary_search(scene);
}

void tl_test_scene_build(tl_test_scene *scene, tl_test_scene_kind kind) {
    scene->kind = kind;
    make(scene);
    if (scene->change != NULL) {
        scene->change(&scene->plan);
    }
    tl_twin *twin = tl_test_plan_build(&scene->plan);
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", scene->plan.problems[0].text, tl_test_scene_name(kind));
    tl_test_run_init(&scene->run, twin);
    scene->run.budget.evaluations = 20;
}

void tl_test_scene_move(tl_test_scene *scene, int64_t tick) {
    scene->run.sample.tick = tick;
    scene->run.sample.instant = tick * scene->plan.plan.step;
}

/* A signal that does not repeat itself. */
static double wave(double at) {
    return sin(0.31 * at) + sin(0.173 * at + 1.0) + sin(0.057 * at);
}

static void show_qualities(const tl_test_scene *scene, tl_sample *sample) {
    int64_t tick = sample->tick;
    uint64_t bits = tl_test_mix((uint64_t)tick);
    bool measured = scene->kind == TL_SCENE_MEASURED || scene->good;
    bool stale = !measured && (bits % 7 == 0 || (tick > 50 && tick < 75));
    bool unlinked = !measured && scene->kind != TL_SCENE_STROKES && bits % 11 == 0;
    sample->quality[0] = (uint8_t)(stale ? TL_STALE : TL_GOOD);
    sample->quality[1] = (uint8_t)(unlinked ? TL_NO_LINK : TL_GOOD);
}

void tl_test_scene_show(tl_test_scene *scene) {
    tl_sample *sample = &scene->run.sample;
    int64_t phase = sample->tick % TL_SCENE_PERIOD;
    double at = (double)sample->tick;
    bool strokes = scene->kind == TL_SCENE_STROKES;
    bool measured = scene->kind == TL_SCENE_MEASURED;
    bool moves = phase >= 10 && phase < 60;
    sample->values[0] = strokes ? (double)moves : measured ? wave(at) : sin(0.9 * at);
    sample->values[1] = strokes ? (double)(moves && phase >= 22) : measured ? wave(at - 7.0) : 2.0 * cos(0.13 * at);
    sample->values[1] = scene->still && !strokes ? 0.75 : sample->values[1];
    sample->values[2] = (double)moves;
    show_qualities(scene, sample);
    for (size_t i = 0; i < 3; i++) {
        sample->stamps[i] = sample->instant;
    }
}

void tl_test_scene_end(tl_test_scene *scene) {
    tl_test_run_end(&scene->run, &scene->plan);
}
