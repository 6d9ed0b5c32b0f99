/* A twin that forgets all that a checkpoint does not contain: from then on it is bit-identical to
 * one that has loaded the checkpoint. */
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "master/twin/account.h"
#include "tests/support/test_scene.h"

enum { TICKS = 240 };

static tl_test_scene scene;
static tl_test_run *const run = &scene.run;

/* By step. */
typedef struct course {
    tl_record record[TICKS];
    bool there[TICKS];
    tl_account account; /* at the end */
} course;

static course forgotten, loaded;

static unsigned char *bytes;
static size_t size;

void setUp(void) {
    scene.unsaved = false;
    scene.change = NULL;
}

void tearDown(void) {
    tl_test_scene_end(&scene);
    free(bytes);
    bytes = NULL;
}

/* Every thirteenth tick is missed. */
static void search_to(int64_t to, course *into) {
    while (run->sample.tick <= to) {
        tl_test_scene_show(&scene);
        if (run->sample.tick % 13 == 12) {
            tl_test_run_catch_up(run);
        } else {
            tl_test_run_step(run);
        }
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run->status, run->error.text);
        if (run->ready && run->record.step < TICKS) {
            into->record[run->record.step] = run->record;
            into->there[run->record.step] = true;
        }
    }
}

static void save(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run->twin, NULL, 0, &size, &run->error));
    free(bytes);
    bytes = malloc(size + 1);
    TEST_ASSERT_NOT_NULL(bytes);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run->twin, bytes, size, &size, &run->error));
}

static void expect_same(const course *wanted, const course *found, const char *what) {
    size_t compared = 0;
    for (int64_t step = 0; step < TICKS; step++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(wanted->there[step], found->there[step], what);
        if (wanted->there[step]) {
            const tl_record *a = &wanted->record[step];
            const tl_record *b = &found->record[step];
            compared++;
            TEST_ASSERT_EQUAL_MEMORY_MESSAGE(a->y, b->y, TL_SCENE_MATCHES * sizeof a->y[0], what);
            TEST_ASSERT_EQUAL_MEMORY_MESSAGE(a->measured, b->measured, TL_SCENE_MATCHES * sizeof a->measured[0], what);
            size_t adjusted = scene.plan.plan.adjust_count * sizeof a->u[0];
            TEST_ASSERT_TRUE_MESSAGE(memcmp(a->u, b->u, adjusted) == 0, what);
            TEST_ASSERT_TRUE_MESSAGE(memcmp(a->nominal, b->nominal, adjusted) == 0, what);
            TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&a->objective, &b->objective, sizeof a->objective, what);
            TEST_ASSERT_EQUAL_INT_MESSAGE(a->outcome, b->outcome, what);
            TEST_ASSERT_EQUAL_INT_MESSAGE(a->stop, b->stop, what);
            TEST_ASSERT_EQUAL_UINT32_MESSAGE(a->evaluations, b->evaluations, what);
            TEST_ASSERT_EQUAL_UINT32_MESSAGE(a->executions, b->executions, what);
            TEST_ASSERT_EQUAL_UINT32_MESSAGE(a->predicted, b->predicted, what);
            TEST_ASSERT_EQUAL_UINT32_MESSAGE(a->flags, b->flags, what);
            TEST_ASSERT_EQUAL_UINT32_MESSAGE(a->held, b->held, what);
            TEST_ASSERT_EQUAL_INT64_MESSAGE(a->delay, b->delay, what);
        }
    }
    TEST_ASSERT_GREATER_THAN_size_t_MESSAGE(20, compared, what);
}

/* Counts since then are equal. */
static void expect_same_account(const tl_account *wanted, const tl_account *found, const char *what) {
    for (size_t k = 0; k < wanted->components; k++) {
        const tl_account_component *a = &wanted->component[k];
        const tl_account_component *b = &found->component[k];
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(a->plain, b->plain, what);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(a->predicted, b->predicted, what);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(a->executions, b->executions, what);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(a->repeated, b->repeated, what);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(a->uncached, b->uncached, what);
    }
    TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&wanted->match[0].metrics, &found->match[0].metrics,
                                     sizeof found->match[0].metrics, what);
}

/* Runs to `tick`, forgets, and continues. `saved_first`: saves before forgetting, not after.
 * Returns false if forgetting was not possible. */
static bool go_on(tl_test_scene_kind of, int64_t tick, bool saved_first) {
    bool done = false;
    memset(&forgotten, 0, sizeof forgotten);
    tl_test_scene_build(&scene, of);
    search_to(tick, &forgotten);
    memset(&forgotten, 0, sizeof forgotten);
    if (saved_first) {
        save();
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_forget(run->twin, &done, &run->error), run->error.text);
    if (!saved_first) {
        save();
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(size != 0, done, tl_test_scene_name(of));
    search_to(TICKS - 1, &forgotten);
    tl_account_take(run->twin, &forgotten.account);
    tl_test_scene_end(&scene);
    return done;
}

static void load(tl_test_scene_kind of, int64_t tick) {
    memset(&loaded, 0, sizeof loaded);
    tl_test_scene_build(&scene, of);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_load(run->twin, tick, bytes, size, &run->error), run->error.text);
    tl_test_scene_move(&scene, tick + 1);
    search_to(TICKS - 1, &loaded);
    tl_account_take(run->twin, &loaded.account);
    tl_test_scene_end(&scene);
}

static void compare_all(void) {
    static const int64_t ticks[] = {8, 9, 25, 30, 60, 77, 100, 131, 158, 199};
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
            if (go_on(of, ticks[i], i % 2 == 0)) {
                load(of, ticks[i]);
                expect_same(&loaded, &forgotten, tl_test_scene_name(of));
                expect_same_account(&loaded.account, &forgotten.account, tl_test_scene_name(of));
            } else {
                TEST_ASSERT_EQUAL_INT(TL_SCENE_LONG, of); /* an FMU would have to repeat steps */
            }
        }
    }
}

static void test_the_same_as_one_that_was_loaded(void) {
    compare_all();
}

static void test_the_same_where_no_executions_are_saved(void) {
    scene.unsaved = true;
    compare_all();
}

static void measure_in_lock(tl_test_plan *test) {
    tl_test_plan_adjust(test, "b.offset", 0.5);
    test->plan.released_steps = 40;
    test->plan.measure.has_start = true;
}

static void test_the_same_delay_by_released_twins(void) {
    bool is_known = false;
    scene.change = measure_in_lock;
    for (int64_t tick = 41; tick < 200; tick += 23) {
        TEST_ASSERT_TRUE(go_on(TL_SCENE_MEASURED, tick, tick % 2 == 0));
        load(TL_SCENE_MEASURED, tick);
        expect_same(&loaded, &forgotten, "released twins");
        is_known = is_known || loaded.record[TICKS - 10].delay_state == TL_DELAY_KNOWN;
    }
    TEST_ASSERT_TRUE(is_known);
}

/* A second call without a step between has no effect. */
static void test_twice_is_once(void) {
    static course once;
    bool done = false;
    TEST_ASSERT_TRUE(go_on(TL_SCENE_HOLD, 60, true));
    once = forgotten;
    tl_test_scene_build(&scene, TL_SCENE_HOLD);
    search_to(60, &forgotten);
    memset(&forgotten, 0, sizeof forgotten);
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_forget(run->twin, &done, &run->error));
        TEST_ASSERT_TRUE(done);
    }
    search_to(TICKS - 1, &forgotten);
    tl_test_scene_end(&scene);
    expect_same(&once, &forgotten, "twice");
}

/* Before the first tick there is nothing to forget. */
static void test_before_the_first_tick(void) {
    bool done = true;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_forget(run->twin, &done, &run->error));
    TEST_ASSERT_FALSE(done);
}

/* A requested reset that has not happened is not in the bytes either. */
static void test_a_reset_that_waits(void) {
    bool done = false;
    memset(&forgotten, 0, sizeof forgotten);
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    search_to(60, &forgotten);
    tl_twin_reset(run->twin);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_forget(run->twin, &done, &run->error));
    search_to(80, &forgotten);
    for (int64_t step = 0; step < 80; step++) {
        TEST_ASSERT_EQUAL_UINT32(0, forgotten.record[step].flags & TL_FLAG_RESET);
    }
}

static void fail_to_return(bool fails) {
    for (size_t i = 0; i < TL_SCENE_FMUS; i++) {
        uint64_t next = fails ? scene.fmus[i].calls[TL_TEST_SET_STATE] + 1 : UINT64_MAX;
        tl_test_fmu_fail(&scene.fmus[i], TL_TEST_SET_STATE, TL_TEST_ERROR, next, next);
    }
}

/* The FMU is in a candidate's state and cannot be restored: the twin must not continue. */
static void test_an_fmu_that_refuses(void) {
    bool done = true;
    int64_t tick = 20;
    tl_status status = TL_OK;
    tl_test_scene_build(&scene, TL_SCENE_AHEAD);
    while (status == TL_OK && tick < TICKS) {
        search_to(tick++, &forgotten);
        fail_to_return(true);
        status = tl_twin_forget(run->twin, &done, &run->error);
        fail_to_return(false);
    }
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, status);
    tl_test_scene_show(&scene);
    tl_test_run_step(run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run->status);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_same_as_one_that_was_loaded);
    RUN_TEST(test_the_same_where_no_executions_are_saved);
    RUN_TEST(test_the_same_delay_by_released_twins);
    RUN_TEST(test_twice_is_once);
    RUN_TEST(test_before_the_first_tick);
    RUN_TEST(test_a_reset_that_waits);
    RUN_TEST(test_an_fmu_that_refuses);
    return UNITY_END();
}
