/* MSE (eq. 5.2) and MAX (eq. 5.3) over good pairs only. */
#include <math.h>
#include <unity.h>

#include "master/twin/metrics.h"

void setUp(void) {}

void tearDown(void) {}

static void mse_divides_by_the_pairs_less_one(void) {
    tl_metrics metrics = {0};
    tl_metrics_add(&metrics, 1.0, 0.0, TL_GOOD);
    tl_metrics_add(&metrics, 0.0, 2.0, TL_GOOD);
    tl_metrics_add(&metrics, 5.0, 2.0, TL_GOOD);
    TEST_ASSERT_EQUAL_UINT64(3, metrics.pairs);
    TEST_ASSERT_EQUAL_DOUBLE((1.0 + 4.0 + 9.0) / 2.0, tl_metrics_mse(&metrics));
    TEST_ASSERT_EQUAL_DOUBLE(3.0, metrics.maximum);
}

static void the_maximum_is_of_the_size_not_the_sign(void) {
    tl_metrics metrics = {0};
    tl_metrics_add(&metrics, 1.0, 8.0, TL_GOOD);
    tl_metrics_add(&metrics, 2.0, 0.0, TL_GOOD);
    TEST_ASSERT_EQUAL_DOUBLE(7.0, metrics.maximum);
}

static void bad_pairs_are_left_out_and_counted(void) {
    tl_metrics metrics = {0};
    const tl_quality bad[] = {TL_STALE, TL_OUT_OF_RANGE, TL_NOT_A_NUMBER, TL_NO_LINK};
    for (size_t i = 0; i < 4; i++) {
        tl_metrics_add(&metrics, 1e6, (double)NAN, bad[i]);
    }
    tl_metrics_add(&metrics, 1.0, 2.0, TL_GOOD);
    tl_metrics_add(&metrics, 1.0, 2.0, TL_GOOD);
    TEST_ASSERT_EQUAL_UINT64(4, metrics.left_out);
    TEST_ASSERT_EQUAL_UINT64(2, metrics.pairs);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, tl_metrics_mse(&metrics));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, metrics.maximum);
}

static void fewer_than_two_pairs_give_nothing(void) {
    tl_metrics metrics = {0};
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_metrics_mse(&metrics));
    tl_metrics_add(&metrics, 3.0, 0.0, TL_GOOD);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_metrics_mse(&metrics));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(mse_divides_by_the_pairs_less_one);
    RUN_TEST(the_maximum_is_of_the_size_not_the_sign);
    RUN_TEST(bad_pairs_are_left_out_and_counted);
    RUN_TEST(fewer_than_two_pairs_give_nothing);
    return UNITY_END();
}
