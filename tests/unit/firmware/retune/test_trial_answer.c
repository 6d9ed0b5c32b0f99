/* What a trial answers, and the line with which a check tells what a twin costs: both are written beside a stranger's FMUs. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/retune/trial.h"
#include "master/base/signal.h"

static const tl_trial_answer good = {.is_there = 1,
                                     .match = 1,
                                     .adjust = 2,
                                     .components = 3,
                                     .unconfined = 1,
                                     .fmu_bytes = 1000,
                                     .signals = 2,
                                     .memory = 2000,
                                     .step = TL_SECOND,
                                     .budget = TL_SECOND / 2,
                                     .least = 1,
                                     .worst = 2};
static tl_trial_answer taken;

void setUp(void) {}

void tearDown(void) {}

static void test_an_answer(void) {
    TEST_ASSERT_TRUE(tl_trial_answer_take(&good, &taken));
    TEST_ASSERT_EQUAL_UINT(2, taken.adjust);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND, taken.step);
}

static void test_what_is_no_answer(void) {
    tl_trial_answer bad[13];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        bad[i] = good;
    }
    bad[0].is_there = 0;
    bad[1].match = TL_MAX_MATCH + 1;
    bad[2].adjust = TL_MAX_ADJUST + 1;
    bad[3].components = 64;
    bad[4].unconfined = 2;
    bad[5].fmu_bytes = UINT64_MAX;
    bad[6].memory = UINT64_MAX;
    bad[7].step = 0;
    bad[8].budget = -1;
    bad[9].least = -1;
    bad[10].worst = INT64_MIN;
    bad[11].signals = 0;
    bad[12].signals = TL_MAX_SIGNALS + 1;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        char about[16];
        (void)snprintf(about, sizeof about, "bad[%zu]", i);
        TEST_ASSERT_FALSE_MESSAGE(tl_trial_answer_take(&bad[i], &taken), about);
    }
}

static void test_an_answer_about_states(void) {
    static tl_trial_states told = {.is_there = 1, .why = "y is\033"};
    char why[TL_TRIAL_WHY];
    TEST_ASSERT_TRUE(tl_trial_states_take(&told, why));
    TEST_ASSERT_EQUAL_STRING("y is\\x1B", why);
    memset(told.why, 'a', sizeof told.why); /* without an end */
    told.is_there = 0;
    TEST_ASSERT_FALSE(tl_trial_states_take(&told, why));
    TEST_ASSERT_EQUAL_size_t(TL_TRIAL_WHY - 1, strlen(why));
}

/* ---- the line ---- */

static bool take(const char *text, tl_twin_cost *cost) {
    char page[256];
    (void)snprintf(page, sizeof page, "%s", text);
    return tl_twin_cost_take(page, cost);
}

static void test_a_cost(void) {
    const tl_twin_cost cost = {.least = 12, .worst = INT64_MAX, .memory = 345};
    tl_twin_cost found;
    char *text = NULL;
    size_t size = 0;
    FILE *page = open_memstream(&text, &size);
    TEST_ASSERT_NOT_NULL(page);
    (void)fputs("cost\n  free step\ntwin-cost 1 2 3\nno problem found\n", page); /* an FMU has printed one before */
    tl_twin_cost_print(&cost, page);
    TEST_ASSERT_EQUAL_INT(0, fclose(page));
    TEST_ASSERT_TRUE(tl_twin_cost_take(text, &found));
    TEST_ASSERT_EQUAL_INT64(12, found.least);
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, found.worst);
    TEST_ASSERT_EQUAL_UINT64(345, found.memory);
    TEST_ASSERT_EQUAL_STRING("cost\n  free step\ntwin-cost 1 2 3\nno problem found\n", text);
    free(text);
}

static void test_what_is_no_cost(void) {
    static const char *const bad[] = {
        "",
        "a page\n",
        "a page\ntwin-cost \n",
        "a page\ntwin-cost 1 2\n",
        "a page\ntwin-cost 1 2 3",
        "a page\ntwin-cost 1 2 3 4\n",
        "a page\ntwin-cost 1 2 3\nand more\n",
        "a page\ntwin-cost 1 -2 3\n",
        "a page\ntwin-cost 1 2 99999999999999999999\n",
        "a page\ntwin-cost 1 2 x\n",
    };
    tl_twin_cost cost;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(take(bad[i], &cost), bad[i]);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_an_answer);
    RUN_TEST(test_what_is_no_answer);
    RUN_TEST(test_an_answer_about_states);
    RUN_TEST(test_a_cost);
    RUN_TEST(test_what_is_no_cost);
    return UNITY_END();
}
