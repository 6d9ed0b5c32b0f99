/* Saved states within a memory limit: how components share it, that the states stay within it, that
 * the twin reports their size, and that a limit changes no result. */
#include <math.h>
#include <stdlib.h>
#include <unity.h>

#include "firmware/base/os.h"
#include "master/graph/snapshot.h"
#include "tests/support/message.h"
#include "tests/support/test_plan.h"

enum { FMUS = 3, TICKS = 80, EVALUATIONS = 20, SOLVERS = 5, MEGABYTE = 1 << 20 };

static const char *const solvers[SOLVERS] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"};

static tl_test_log call_log;
static tl_test_fmu fmus[FMUS];
static tl_test_plan plan;
static tl_test_run run;

void setUp(void) {}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* ---- sharing out ---- */

static void each_component_gets_all_it_needs_if_it_fits(void) {
    tl_state_room rooms[] = {{100, 10, 0}, {0, 4096, 0}, {1, 7, 0}};
    tl_state_room_share(rooms, 3, 1007);
    TEST_ASSERT_EQUAL_UINT32(10, rooms[0].kept);
    TEST_ASSERT_EQUAL_UINT32(4096, rooms[1].kept);
    TEST_ASSERT_EQUAL_UINT32(7, rooms[2].kept);
    TEST_ASSERT_EQUAL_UINT64(1007, tl_state_room_bytes(rooms, 3));
}

static void zero_bytes_mean_no_limit(void) {
    tl_state_room rooms[] = {{SIZE_MAX / 8192, 4096, 0}};
    tl_state_room_share(rooms, 1, 0);
    TEST_ASSERT_EQUAL_UINT32(4096, rooms[0].kept);
}

static void large_needs_share_what_small_ones_leave(void) {
    tl_state_room rooms[] = {{10, 100, 0}, {1, 50, 0}, {100, 100, 0}, {10, 12, 0}};
    tl_state_room_share(rooms, 4, 1050);
    TEST_ASSERT_EQUAL_UINT32(44, rooms[0].kept); /* (1050 − 50 − 120) / 2 bytes, at 10 bytes each */
    TEST_ASSERT_EQUAL_UINT32(50, rooms[1].kept);
    TEST_ASSERT_EQUAL_UINT32(4, rooms[2].kept);
    TEST_ASSERT_EQUAL_UINT32(12, rooms[3].kept);
    TEST_ASSERT_TRUE(tl_state_room_bytes(rooms, 4) <= 1050);
}

static void each_component_keeps_at_least_two_states(void) {
    tl_state_room rooms[] = {{1000, 100, 0}, {10, 100, 0}};
    tl_state_room_share(rooms, 2, 1);
    TEST_ASSERT_EQUAL_UINT32(TL_STATES_LEAST, rooms[0].kept);
    TEST_ASSERT_EQUAL_UINT32(TL_STATES_LEAST, rooms[1].kept);
}

static void no_components_share_nothing(void) {
    tl_state_room_share(NULL, 0, 1000);
    TEST_ASSERT_EQUAL_UINT64(0, tl_state_room_bytes(NULL, 0));
}

/* ---- a twin ---- */

typedef struct setting {
    const char *solver;
    uint32_t prediction;
    tl_shape shape;
    tl_pairing measurements;
    tl_keep keep;
    uint64_t bytes;
    size_t (*heap)(void);
} setting;

/* cmd → first → second → third; the states of "second" are large. */
static void build(const setting *set, size_t ballast) {
    static const char *const names[FMUS] = {"first", "second", "third"};
    tl_test_run_end(&run, &plan);
    tl_test_plan_init(&plan, TL_SECOND / 10);
    for (size_t i = 0; i < FMUS; i++) {
        tl_test_fmu_init(&fmus[i], 1, false, &call_log);
        fmus[i].control.telling = true;
        tl_test_plan_component(&plan, names[i], &fmus[i])->keep = set->keep;
        tl_test_plan_set(&plan, "lag", 0.2);
    }
    fmus[1].control.ballast = ballast;
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y0", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "first.u0");
    tl_test_plan_connect(&plan, "first.y0", "second.u0");
    tl_test_plan_connect(&plan, "second.y0", "third.u0");
    tl_test_plan_adjust(&plan, "first.u0", 0.1);
    tl_test_plan_adjust(&plan, "third.gain", 0.05)->lower = 0.2;
    tl_test_plan_match(&plan, "third.y0", "plant.y0", 0.001);
    plan.plan.algorithm = set->solver;
    plan.plan.prediction = set->prediction;
    plan.plan.shape = set->shape;
    plan.plan.measurements = set->measurements;
    plan.plan.saving = (tl_plan_saving){true, true, 0};
    plan.plan.margin = 0.01;
    plan.plan.evaluations = EVALUATIONS;
    plan.plan.state_bytes = set->bytes;
    plan.plan.heap = set->heap;
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = EVALUATIONS;
}

static void step(void) {
    double t = (double)run.sample.tick;
    run.sample.values[0] = sin(0.2 * t);
    run.sample.values[1] = 0.5 * sin(0.2 * t - 0.6) + 0.3 * sin(1.7 * t);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
}

/* A heap with states of 200 bytes. */
static size_t heap_of_states(void) {
    size_t bytes = 0;
    for (size_t i = 0; i < FMUS; i++) {
        bytes += 200 * fmus[i].states;
    }
    return bytes;
}

/* Each FMU has the states of its cache, and one where candidates begin. */
static void assert_within_room(void) {
    for (size_t i = 0; i < FMUS; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(run.twin, i);
        TEST_ASSERT_TRUE(entry.states == 0 || fmus[i].states <= entry.states + 1);
    }
}

/* Each solver, horizon and mode: the same bits with all states and with very few. */
static void room_for_few_states_changes_no_bit(void) {
    static tl_record plain[TICKS];
    uint64_t repeated = 0;
    for (uint32_t number = 0; number < 60; number++) {
        setting set = {.solver = solvers[number % SOLVERS],
                       .prediction = 3 + number % 4,
                       .shape = number % 2 != 0 ? TL_DYNAMIC : TL_STATIC,
                       .measurements = (tl_pairing)(number / 4 % 3),
                       .keep = number % 3 == 0 ? TL_KEEP_OUTPUTS : TL_KEEP_STATES};
        setUp();
        build(&set, 0);
        for (int64_t tick = 0; tick < TICKS; tick++) {
            step();
            plain[tick] = run.record;
        }
        set.heap = heap_of_states;
        set.bytes = 1 + number % 7 * (number % 7) * 2000;
        build(&set, 0);
        for (int64_t tick = 0; tick < TICKS; tick++) {
            step();
            if (run.ready) {
                TEST_ASSERT_EQUAL_MEMORY(plain[tick].u, run.record.u, 2 * sizeof plain[tick].u[0]);
                TEST_ASSERT_EQUAL_MEMORY(plain[tick].y, run.record.y, sizeof plain[tick].y[0]);
                TEST_ASSERT_EQUAL_UINT32(plain[tick].evaluations, run.record.evaluations);
                TEST_ASSERT_EQUAL_UINT32(plain[tick].predicted, run.record.predicted);
            }
            assert_within_room();
        }
        for (size_t i = 0; i < FMUS; i++) {
            tl_twin_ledger entry = tl_twin_get_ledger(run.twin, i);
            TEST_ASSERT_EQUAL_INT64(0, entry.difference);
            TEST_ASSERT_EQUAL_UINT64(0, entry.uncached);
            repeated += set.keep == TL_KEEP_STATES ? entry.repeated : 0;
        }
        tl_test_run_end(&run, &plan);
    }
    TEST_ASSERT_TRUE(repeated > 1000); /* otherwise the test proves nothing */
}

/* The heap grows by at most the reported size, also for states of a megabyte. */
static void memory_is_within_the_reported_size(void) {
    const setting set = {.solver = "nelder-mead", .prediction = 4, .bytes = 16 * MEGABYTE, .heap = tl_heap_used};
    size_t before = tl_heap_used();
    void *volatile seen = malloc(MEGABYTE);
    bool sees = tl_heap_used() >= before + MEGABYTE;
    free(seen);
    if (!sees) {
        TEST_IGNORE_MESSAGE("not with a sanitizer");
    }
    build(&set, MEGABYTE);
    for (int64_t tick = 0; tick < TICKS; tick++) {
        step();
        tl_twin_facts facts = tl_twin_get_facts(run.twin);
        size_t grown = tl_heap_used() - before;
        TEST_ASSERT_TRUE(tick < 5 || grown <= facts.memory + facts.state_memory + MEGABYTE / 8);
        /* 2: the states where candidates begin */
        TEST_ASSERT_TRUE(facts.state_memory <= (16 + 2) * (uint64_t)MEGABYTE);
    }
    tl_twin_ledger large = tl_twin_get_ledger(run.twin, 1);
    tl_twin_ledger small = tl_twin_get_ledger(run.twin, 0);
    TEST_ASSERT_TRUE(large.state_size >= MEGABYTE && large.state_size < MEGABYTE + 8192);
    TEST_ASSERT_TRUE(large.states >= 10 && large.states <= 15);
    TEST_ASSERT_EQUAL_UINT32(small.nodes, small.states);
    /* 0 if the C library reuses freed memory, as glibc 2.41 does for calloc() */
    TEST_ASSERT_TRUE(small.state_size < 4096);
}

/* An FMU with its own allocator reports the size of its states. */
static void the_size_that_an_fmu_reports_counts_without_a_heap(void) {
    const setting set = {.solver = "secant", .prediction = 3, .bytes = 1};
    build(&set, 0);
    tl_twin_destroy(run.twin);
    fmus[2].model.capabilities.can_serialize_state = true;
    tl_test_run_init(&run, tl_test_plan_build(&plan));
    step();
    step();
    TEST_ASSERT_EQUAL_size_t(0, tl_twin_get_ledger(run.twin, 0).state_size);
    TEST_ASSERT_EQUAL_UINT32(tl_twin_get_ledger(run.twin, 0).nodes, tl_twin_get_ledger(run.twin, 0).states);
    TEST_ASSERT_TRUE(tl_twin_get_ledger(run.twin, 2).state_size > 0);
    TEST_ASSERT_EQUAL_UINT32(TL_STATES_LEAST, tl_twin_get_ledger(run.twin, 2).states);
}

/* If an FMU cannot report the size of its states, the twin ends. */
static void a_size_that_the_fmu_cannot_report_is_an_error(void) {
    const setting set = {.solver = "secant", .prediction = 3, .bytes = MEGABYTE, .heap = tl_heap_used};
    build(&set, 0);
    tl_twin_destroy(run.twin);
    fmus[2].model.capabilities.can_serialize_state = true;
    tl_test_run_init(&run, tl_test_plan_build(&plan));
    tl_test_fmu_fail(&fmus[2], TL_TEST_SERIALIZED_SIZE, TL_TEST_ERROR, 1, 1);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TL_EXPECT_PARTS("third|fmi2SerializedFMUstateSize|fmi2Error", run.error.text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(each_component_gets_all_it_needs_if_it_fits);
    RUN_TEST(zero_bytes_mean_no_limit);
    RUN_TEST(large_needs_share_what_small_ones_leave);
    RUN_TEST(each_component_keeps_at_least_two_states);
    RUN_TEST(no_components_share_nothing);
    RUN_TEST(room_for_few_states_changes_no_bit);
    RUN_TEST(memory_is_within_the_reported_size);
    RUN_TEST(the_size_that_an_fmu_reports_counts_without_a_heap);
    RUN_TEST(a_size_that_the_fmu_cannot_report_is_an_error);
    return UNITY_END();
}
