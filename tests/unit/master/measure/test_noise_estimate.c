/* Noise is distinguished from the motion of a plant. */
#include <math.h>

#include <unity.h>

#include "master/measure/noise_estimate.h"
#include "tests/support/random_numbers.h"

static tl_noise_estimate noise;
static tl_test_random chance;

void setUp(void) {
    noise = (tl_noise_estimate){0};
    chance.state = 7;
}

void tearDown(void) {}

/* Approximately normal, of variance 1. */
static double normal(void) {
    double sum = -6.0;
    for (int i = 0; i < 12; i++) {
        sum += tl_test_random_number(&chance, 0.0, 1.0);
    }
    return sum;
}

static void nothing_is_known_at_first(void) {
    for (int i = 0; i < 30; i++) {
        TEST_ASSERT_TRUE(tl_noise_estimate_variance(&noise) == 0.0);
        tl_noise_estimate_push(&noise, normal());
    }
}

static void noise_is_found_whatever_it_is_on(void) {
    static const double sizes[] = {1e-3, 0.3, 50.0};
    for (size_t k = 0; k < 3; k++) {
        setUp();
        for (int i = 0; i < 3000; i++) {
            tl_noise_estimate_push(&noise, 60.0 + 5.0 * sizes[k] * sin(0.05 * i) + sizes[k] * normal());
        }
        TEST_ASSERT_DOUBLE_WITHIN(0.5 * sizes[k] * sizes[k], sizes[k] * sizes[k], tl_noise_estimate_variance(&noise));
    }
}

/* A source slower than the twin repeats values. */
static void repeated_values_count_once(void) {
    for (int i = 0; i < 9000; i++) {
        static double held;
        held = i % 3 == 0 ? 0.3 * normal() : held;
        tl_noise_estimate_push(&noise, held);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.045, 0.09, tl_noise_estimate_variance(&noise));
}

static void what_a_plant_does_is_no_noise(void) {
    double speed = 0.0;
    double place = 0.0;
    for (int i = 0; i < 3000; i++) { /* random acceleration of variance 1 */
        speed += normal();
        place += speed;
        tl_noise_estimate_push(&noise, place);
    }
    TEST_ASSERT_TRUE(tl_noise_estimate_variance(&noise) < 0.1);
}

static void a_step_is_no_noise(void) {
    for (int i = 0; i < 1000; i++) {
        tl_noise_estimate_push(&noise, (i >= 500 ? 100.0 : 0.0) + 0.1 * normal());
    }
    TEST_ASSERT_TRUE(tl_noise_estimate_variance(&noise) < 0.03);
}

static void a_value_that_never_changes_has_none(void) {
    for (int i = 0; i < 1000; i++) {
        tl_noise_estimate_push(&noise, 3.0);
    }
    TEST_ASSERT_TRUE(tl_noise_estimate_variance(&noise) == 0.0);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(nothing_is_known_at_first);
    RUN_TEST(noise_is_found_whatever_it_is_on);
    RUN_TEST(repeated_values_count_once);
    RUN_TEST(what_a_plant_does_is_no_noise);
    RUN_TEST(a_step_is_no_noise);
    RUN_TEST(a_value_that_never_changes_has_none);
    return UNITY_END();
}
