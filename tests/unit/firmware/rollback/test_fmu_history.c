/* History of FMU inputs: a tree that leads to each kept state with its values, without later
 * allocation. */
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "firmware/rollback/fmu_replay.h"
#include "tests/support/message.h"
#include "tests/support/random_numbers.h"

enum { MOST = 50, CALLS = 2, VALUES = 3, SET = 1, STEP = 7, ROUNDS = 4000, PLACES = 40 };

static tl_fmu_history history;
static tl_test_random dice;

/* Stands for an FMU: its inputs determine its state. */
typedef struct model {
    uint64_t value[VALUES];
    uint64_t sum;
    unsigned steps;
} model;

static model fmu;

static void set(model *one, const uint64_t *values) {
    memcpy(one->value, values, sizeof one->value);
}

static void step(model *one) {
    one->steps++;
    one->sum = one->sum * 31 + one->value[0] + 3 * one->value[1] + 5 * one->value[2];
}

void setUp(void) {
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_history_open(&history, MOST, CALLS, VALUES * sizeof(uint64_t), &error));
    fmu = (model){.sum = 1};
    dice = (tl_test_random){20261125};
}

void tearDown(void) {
    tl_fmu_history_close(&history);
}

/* Changes one value only, as in a twin. */
static void give(void) {
    static const tl_fmu_history_call set_call = {.kind = SET};
    static const tl_fmu_history_call step_call = {.kind = STEP, .is_step = true};
    uint64_t values[VALUES];
    memcpy(values, fmu.value, sizeof values);
    values[tl_test_random_below(&dice, VALUES)] = tl_test_random_below(&dice, 4);
    set(&fmu, values);
    tl_fmu_history_add(&history, &set_call, values, sizeof values);
    step(&fmu);
    tl_fmu_history_add(&history, &step_call, NULL, 0);
}

/* Replays to a kept state. Returns false if no path leads there. */
static bool go(void *kept) {
    uint32_t at;
    bool restarted;
    if (!tl_fmu_history_find_path(&history, kept, &at, &restarted)) {
        return false;
    }
    if (restarted) {
        fmu = (model){.sum = 1};
    }
    while (at != TL_FMU_HISTORY_NONE) {
        const tl_fmu_history_call *call;
        const void *values;
        at = tl_fmu_history_follow(&history, at, &call, &values);
        if (call->is_step) {
            step(&fmu);
        } else {
            set(&fmu, values);
        }
    }
    tl_fmu_history_arrive(&history, kept);
    return true;
}

static void expect_model(const model *expected) {
    TEST_ASSERT_EQUAL_UINT64(expected->sum, fmu.sum);
    TEST_ASSERT_EQUAL_UINT32(expected->steps, fmu.steps);
    TEST_ASSERT_EQUAL_UINT64_ARRAY(expected->value, fmu.value, VALUES);
}

/* ---- paths ---- */

static void test_back_and_on(void) {
    void *beginning = tl_fmu_history_save(&history);
    model first = fmu;
    give();
    give();
    model second = fmu;
    void *later = tl_fmu_history_save(&history);
    give();
    TEST_ASSERT_FALSE(tl_fmu_history_is_at(&history, later));
    TEST_ASSERT_TRUE(go(later));
    expect_model(&second);
    TEST_ASSERT_TRUE(tl_fmu_history_is_at(&history, later));
    TEST_ASSERT_TRUE(go(beginning));
    expect_model(&first);
    TEST_ASSERT_TRUE(go(later));
    expect_model(&second);
}

/* The path starts at the present state if that state lies on it. */
static void test_shortest_path(void) {
    uint32_t first;
    bool restarted;
    give();
    void *near = tl_fmu_history_save(&history);
    give();
    void *far = tl_fmu_history_save(&history);
    TEST_ASSERT_TRUE(tl_fmu_history_find_path(&history, far, &first, &restarted));
    TEST_ASSERT_TRUE(first == TL_FMU_HISTORY_NONE && !restarted);
    TEST_ASSERT_TRUE(go(near));
    TEST_ASSERT_TRUE(tl_fmu_history_find_path(&history, far, &first, &restarted));
    TEST_ASSERT_TRUE(first != TL_FMU_HISTORY_NONE && !restarted);
    TEST_ASSERT_TRUE(go(far));
    TEST_ASSERT_TRUE(tl_fmu_history_find_path(&history, near, &first, &restarted));
    TEST_ASSERT_TRUE(restarted);
}

typedef struct place {
    void *kept;
    model expected;
} place;

/* Random branches, released in any order: each kept state is right, and finally all memory is
 * free. */
static void test_any_tree(void) {
    place places[PLACES] = {{.kept = NULL}};
    void *root = tl_fmu_history_save(&history);
    model beginning = fmu;
    for (int round = 0; round < ROUNDS; round++) {
        place *one = &places[tl_test_random_below(&dice, PLACES)];
        if (one->kept != NULL && tl_test_random_chance(&dice, 50)) {
            TEST_ASSERT_TRUE(go(one->kept));
            expect_model(&one->expected);
        }
        if (fmu.steps >= MOST) {
            TEST_ASSERT_TRUE(go(root));
            expect_model(&beginning);
        }
        give();
        tl_fmu_history_forget(&history, one->kept);
        *one = (place){tl_fmu_history_save(&history), fmu};
    }
    TEST_ASSERT_FALSE(history.has_run_over);
    for (int i = 0; i < PLACES; i++) {
        tl_fmu_history_forget(&history, places[i].kept);
    }
    TEST_ASSERT_TRUE(go(root));
    uint32_t calls = 0;
    for (uint32_t at = history.free_call; at != TL_FMU_HISTORY_NONE; at = history.calls[at].next) {
        calls++;
    }
    TEST_ASSERT_EQUAL_UINT32(history.call_count - 1, calls);
}

/* ---- limits ---- */

static void test_beyond_most(void) {
    void *root = tl_fmu_history_save(&history);
    for (int i = 0; i < MOST; i++) {
        give();
    }
    void *last = tl_fmu_history_save(&history);
    give();
    void *beyond = tl_fmu_history_save(&history);
    TEST_ASSERT_TRUE(tl_fmu_history_is_at(&history, beyond));
    TEST_ASSERT_TRUE(go(beyond)); /* the FMU is in that state already */
    give();
    TEST_ASSERT_FALSE(go(beyond));
    TEST_ASSERT_TRUE(go(last));
    TEST_ASSERT_EQUAL_UINT32(MOST, fmu.steps);
    TEST_ASSERT_TRUE(go(root));
    TEST_ASSERT_FALSE(history.has_run_over);
    tl_fmu_history_forget(&history, beyond);
}

static void test_lost(void) {
    give();
    void *kept = tl_fmu_history_save(&history);
    model expected = fmu;
    give();
    tl_fmu_history_lose(&history);
    void *nowhere = tl_fmu_history_save(&history);
    tl_fmu_history_lose(&history);
    TEST_ASSERT_FALSE(go(nowhere));
    TEST_ASSERT_TRUE(go(kept));
    expect_model(&expected);
}

/* Each kept state lies on its own branch. */
static void test_no_room(void) {
    void *root = tl_fmu_history_save(&history);
    for (int i = 0; !history.has_run_over; i++) {
        TEST_ASSERT_LESS_OR_EQUAL_INT(MOST + TL_FMU_HISTORY_BRANCHES, i);
        TEST_ASSERT_TRUE(go(root));
        give();
        (void)tl_fmu_history_save(&history);
    }
    TEST_ASSERT_TRUE(go(root));
}

/* States from before the restart are unreachable, but can be released. */
static void test_restart(void) {
    give();
    void *before = tl_fmu_history_save(&history);
    void *again = tl_fmu_history_save(&history);
    tl_fmu_history_begin(&history);
    fmu = (model){.sum = 1};
    TEST_ASSERT_FALSE(go(before));
    give();
    void *kept = tl_fmu_history_save(&history);
    model expected = fmu;
    tl_fmu_history_forget(&history, before);
    tl_fmu_history_forget(&history, again);
    give();
    TEST_ASSERT_TRUE(go(kept));
    expect_model(&expected);
}

static void test_no_memory(void) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    TEST_IGNORE_MESSAGE("not with a sanitizer");
#else
    tl_fmu_history none;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_fmu_history_open(&none, 100000, 7, 1000000, &error));
    TL_EXPECT_PARTS("memory", error.text);
#endif
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_back_and_on);
    RUN_TEST(test_shortest_path);
    RUN_TEST(test_any_tree);
    RUN_TEST(test_beyond_most);
    RUN_TEST(test_lost);
    RUN_TEST(test_no_room);
    RUN_TEST(test_restart);
    RUN_TEST(test_no_memory);
    return UNITY_END();
}
