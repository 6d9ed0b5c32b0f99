/* A register that is read more often than it is written: which readings are new. */
#include "firmware/plant/plant_reader.h"

#include <math.h>

#include <unity.h>

enum { WITHIN = 100 };

static tl_repeated_reading repeated;

void setUp(void) {
    repeated = (tl_repeated_reading){.has_last = false};
}

void tearDown(void) {}

static bool is_repeated(double value, tl_time stamp, tl_quality quality) {
    const tl_reading reading = {.value = value, .stamp = stamp, .quality = quality};
    return tl_repeated_reading_is(&repeated, WITHIN, &reading);
}

static void the_first_one_is_new(void) {
    TEST_ASSERT_FALSE(is_repeated(0.0, 0, TL_GOOD));
    TEST_ASSERT_TRUE(is_repeated(0.0, 1, TL_GOOD));
}

static void another_value_is_new(void) {
    TEST_ASSERT_FALSE(is_repeated(1.0, 10, TL_GOOD));
    TEST_ASSERT_FALSE(is_repeated(2.0, 20, TL_GOOD));
    TEST_ASSERT_FALSE(is_repeated(1.0, 30, TL_GOOD));
    TEST_ASSERT_FALSE(is_repeated(nextafter(1.0, 2.0), 40, TL_GOOD));
}

/* The time counts from the last new reading, not from the last poll. */
static void the_same_value_is_new_when_one_is_due(void) {
    TEST_ASSERT_FALSE(is_repeated(1.0, 1000, TL_GOOD));
    TEST_ASSERT_TRUE(is_repeated(1.0, 1060, TL_GOOD));
    TEST_ASSERT_TRUE(is_repeated(1.0, 1000 + WITHIN - 1, TL_GOOD));
    TEST_ASSERT_FALSE(is_repeated(1.0, 1000 + WITHIN, TL_GOOD));
    TEST_ASSERT_TRUE(is_repeated(1.0, 1000 + WITHIN + 1, TL_GOOD));
}

static void what_is_not_good_is_new(void) {
    TEST_ASSERT_FALSE(is_repeated(1.0, 10, TL_GOOD));
    TEST_ASSERT_FALSE(is_repeated(1.0, 11, TL_NO_LINK));
    TEST_ASSERT_FALSE(is_repeated(1.0, 12, TL_NO_LINK));
    TEST_ASSERT_FALSE(is_repeated(1.0, 13, TL_GOOD));
}

static void without_a_time_each_is_new(void) {
    const tl_reading reading = {.value = 1.0, .stamp = 5, .quality = TL_GOOD};
    TEST_ASSERT_FALSE(tl_repeated_reading_is(&repeated, 0, &reading));
    TEST_ASSERT_FALSE(tl_repeated_reading_is(&repeated, 0, &reading));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(the_first_one_is_new);
    RUN_TEST(another_value_is_new);
    RUN_TEST(the_same_value_is_new_when_one_is_due);
    RUN_TEST(what_is_not_good_is_new);
    RUN_TEST(without_a_time_each_is_new);
    return UNITY_END();
}
