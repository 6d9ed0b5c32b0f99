/* The result of a trial is untrusted, because FMUs have run in the process that wrote it. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/retune/worker.h"
#include "master/base/signal.h"

static const tl_trial_answer good = {
    .needs = {.match = 1, .adjust = 2, .components = 3, .unconfined = 1, .unpacked_bytes = 1000, .signals = 2},
    .memory = 2000,
    .step = TL_SECOND,
    .budget = TL_SECOND / 2,
    .least = 1,
    .worst = 2};
static tl_worker_result result; /* too large for the stack */
static tl_trial_answer taken;

static bool take(const tl_trial_answer *answer) {
    result.trial = *answer;
    return tl_trial_answer_take(&result, &taken);
}

void setUp(void) {
    result.is_complete = 1;
}

void tearDown(void) {}

static void test_an_answer(void) {
    TEST_ASSERT_TRUE(take(&good));
    TEST_ASSERT_EQUAL_UINT(2, taken.needs.adjust);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND, taken.step);
}

static void test_what_is_no_answer(void) {
    tl_trial_answer bad[12];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        bad[i] = good;
    }
    bad[0].needs.match = TL_MAX_MATCH + 1;
    bad[1].needs.adjust = TL_MAX_ADJUST + 1;
    bad[2].needs.components = 64;
    bad[3].needs.unconfined = 2;
    bad[4].needs.unpacked_bytes = UINT64_MAX;
    bad[5].memory = UINT64_MAX;
    bad[6].step = 0;
    bad[7].budget = -1;
    bad[8].least = -1;
    bad[9].worst = INT64_MIN;
    bad[10].needs.signals = 0;
    bad[11].needs.signals = TL_MAX_SIGNALS + 1;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        char about[16];
        (void)snprintf(about, sizeof about, "bad[%zu]", i);
        TEST_ASSERT_FALSE_MESSAGE(take(&bad[i]), about);
    }
    result.is_complete = 0;
    TEST_ASSERT_FALSE(take(&good));
}

/* The kind is an index into a table of words. */
static void test_a_verdict_of_no_kind(void) {
    static tl_verdict verdict;
    result.verdict.kind = 1000;
    TEST_ASSERT_FALSE(tl_verdict_take(&result, &verdict));
    TEST_ASSERT_EQUAL_UINT32(0, verdict.kind);
}

static void test_an_answer_about_states(void) {
    char why[TL_TWIN_CHECK_WHY];
    (void)snprintf(result.why, sizeof result.why, "y is\033");
    TEST_ASSERT_TRUE(tl_worker_read_reason(&result, why));
    TEST_ASSERT_EQUAL_STRING("y is\\x1B", why);
    memset(result.why, 'a', sizeof result.why); /* not terminated */
    result.is_complete = 0;
    TEST_ASSERT_FALSE(tl_worker_read_reason(&result, why));
    TEST_ASSERT_EQUAL_size_t(TL_TWIN_CHECK_WHY - 1, strlen(why));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_an_answer);
    RUN_TEST(test_what_is_no_answer);
    RUN_TEST(test_a_verdict_of_no_kind);
    RUN_TEST(test_an_answer_about_states);
    return UNITY_END();
}
