/* The mailbox: the newest reading at an instant, what is forgotten, and two threads at once. */
#include <pthread.h>
#include <stdbool.h>
#include <string.h>

#include <unity.h>

#include "firmware/plant/mailbox.h"

/* Every other slot lies across the border of two cache lines, so that a torn reading has its chance. */
static struct {
    uint64_t shift[5];
    tl_mailbox mailbox;
} placed __attribute__((aligned(64)));

static tl_mailbox *const mailbox = &placed.mailbox;

void setUp(void) {
    memset(mailbox, 0, sizeof *mailbox);
}

void tearDown(void) {}

static void post(double value, tl_time stamp) {
    tl_reading reading = {.value = value, .stamp = stamp, .quality = TL_GOOD};
    tl_mailbox_post(mailbox, &reading);
}

static void expect(tl_time instant, double value, tl_time stamp) {
    tl_reading reading = {.value = -1, .stamp = -1, .quality = TL_NO_LINK};
    TEST_ASSERT_TRUE(tl_mailbox_at(mailbox, instant, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(value, reading.value);
    TEST_ASSERT_EQUAL_INT64(stamp, reading.stamp);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, reading.quality);
}

static void expect_nothing(tl_time instant) {
    tl_reading reading = {.value = 7, .stamp = 8, .quality = TL_STALE};
    TEST_ASSERT_FALSE(tl_mailbox_at(mailbox, instant, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(7, reading.value);
    TEST_ASSERT_EQUAL_INT64(8, reading.stamp);
}

static void test_empty(void) {
    expect_nothing(0);
    expect_nothing(INT64_MAX);
}

static void test_newest_at_or_before_the_instant(void) {
    post(1, 100);
    post(2, 200);
    post(3, 300);
    expect_nothing(99);
    expect(100, 1, 100);
    expect(199, 1, 100);
    expect(200, 2, 200);
    expect(299, 2, 200);
    expect(300, 3, 300);
    expect(INT64_MAX, 3, 300);
}

static void expect_from(tl_time from, tl_time until, double value) {
    tl_reading reading = {.value = -1};
    TEST_ASSERT_TRUE(tl_mailbox_from(mailbox, from, until, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(value, reading.value);
}

static void test_first_from_an_instant_on(void) {
    tl_reading reading = {.value = 7};
    post(1, 100);
    post(2, 200);
    post(3, 300);
    expect_from(50, 300, 1);
    expect_from(100, 300, 1);
    expect_from(101, 300, 2);
    expect_from(200, 200, 2);
    expect_from(201, 300, 3);
    expect_from(201, 299, 2); /* the next has not come: the newest before */
    expect_from(301, 400, 3);
    expect_from(50, 100, 1);
    TEST_ASSERT_FALSE(tl_mailbox_from(mailbox, 50, 99, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(7, reading.value);
}

static void test_first_of_equal_stamps_and_of_what_is_kept(void) {
    post(1, 100);
    post(2, 100);
    expect_from(90, 110, 2);
    for (int i = 0; i < TL_MAILBOX_READINGS; i++) {
        post(10 + i, 200 + (tl_time)i);
    }
    expect_from(90, 1000, 10);
}

static void test_of_equal_stamps_the_later_post_counts(void) {
    post(1, 100);
    post(2, 100);
    expect(100, 2, 100);
}

static void test_stamps_that_decrease_are_looked_up_in_order_of_posting(void) {
    post(1, 100);
    post(2, 300);
    post(3, 200);
    expect(250, 3, 200);
    expect(350, 3, 200);
    expect(150, 1, 100);
}

static void test_quality_and_negative_stamps_are_kept(void) {
    tl_reading reading = {.value = -0.25, .stamp = -5, .quality = TL_NOT_A_NUMBER};
    tl_mailbox_post(mailbox, &reading);
    memset(&reading, 0, sizeof reading);
    TEST_ASSERT_TRUE(tl_mailbox_at(mailbox, -5, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(-0.25, reading.value);
    TEST_ASSERT_EQUAL_INT64(-5, reading.stamp);
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, reading.quality);
}

static void test_a_full_ring_forgets_the_oldest(void) {
    for (int i = 0; i < TL_MAILBOX_READINGS; i++) {
        post(i, (tl_time)10 * i);
    }
    expect(0, 0, 0); /* just full: all are there */
    expect_nothing(-1);
    post(TL_MAILBOX_READINGS, (tl_time)10 * TL_MAILBOX_READINGS);
    expect(0, 1, 10); /* the first is forgotten: the oldest that is kept */
    expect(-1, 1, 10);
    expect(10, 1, 10);
    expect(25, 2, 20);
    expect(INT64_MAX, TL_MAILBOX_READINGS, (tl_time)10 * TL_MAILBOX_READINGS);
}

/* ---- two threads ---- */

enum { POSTS = 4000000 };

static bool done; /* atomic */

/* Value, stamp and quality of a post belong together, so that a torn reading shows. */
static void *write_many(void *context) {
    (void)context;
    for (int i = 1; i <= POSTS; i++) {
        tl_reading reading = {.value = 3.0 * i, .stamp = i, .quality = (tl_quality)(i % 5)};
        tl_mailbox_post(mailbox, &reading);
    }
    __atomic_store_n(&done, true, __ATOMIC_RELEASE);
    return NULL;
}

static void expect_whole(const tl_reading *reading) {
    TEST_ASSERT_EQUAL_DOUBLE(3.0 * (double)reading->stamp, reading->value);
    TEST_ASSERT_EQUAL_INT((int)(reading->stamp % 5), (int)reading->quality);
}

static void test_two_threads(void) {
    pthread_t writer;
    tl_time newest = 0;
    bool over = false;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&writer, NULL, write_many, NULL));
    while (!over) {
        tl_reading reading;
        over = __atomic_load_n(&done, __ATOMIC_ACQUIRE);
        if (tl_mailbox_at(mailbox, INT64_MAX, &reading)) {
            expect_whole(&reading);
            TEST_ASSERT_TRUE(reading.stamp >= newest); /* time does not go back */
            newest = reading.stamp;
        }
        if (newest > 0 && tl_mailbox_at(mailbox, newest - 10, &reading)) {
            expect_whole(&reading); /* that one, or the oldest kept */
            TEST_ASSERT_TRUE(reading.stamp >= newest - 10);
        }
        if (newest > TL_MAILBOX_READINGS && tl_mailbox_at(mailbox, 0, &reading)) {
            expect_whole(&reading); /* the oldest kept: just where the writer goes next */
            TEST_ASSERT_TRUE(reading.stamp > newest - TL_MAILBOX_READINGS);
        }
    }
    TEST_ASSERT_EQUAL_INT(0, pthread_join(writer, NULL));
    expect(INT64_MAX, 3.0 * POSTS, POSTS);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_empty);
    RUN_TEST(test_newest_at_or_before_the_instant);
    RUN_TEST(test_first_from_an_instant_on);
    RUN_TEST(test_first_of_equal_stamps_and_of_what_is_kept);
    RUN_TEST(test_of_equal_stamps_the_later_post_counts);
    RUN_TEST(test_stamps_that_decrease_are_looked_up_in_order_of_posting);
    RUN_TEST(test_quality_and_negative_stamps_are_kept);
    RUN_TEST(test_a_full_ring_forgets_the_oldest);
    RUN_TEST(test_two_threads);
    return UNITY_END();
}
