/* The sample buffer: the newest reading at an instant, overwritten readings, a dead writer, and
 * two threads at once. */
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/plant/sample_buffer.h"
#include "tests/support/random_numbers.h"
#include "tests/support/real_time.h"

enum { DEPTH = 256, DEEPEST = 65536 };

/* Every other slot crosses a boundary of cache lines, which makes a torn read more likely. */
static struct {
    uint64_t shift[5];
    tl_sample_buffer_slot slots[DEEPEST];
    uint64_t count;
} placed __attribute__((aligned(64)));

static tl_sample_buffer handle;
static const tl_sample_buffer *const buffer = &handle;

static void begin(uint32_t depth) {
    memset(&placed, 0, sizeof placed);
    handle = (tl_sample_buffer){.slots = placed.slots, .count = &placed.count, .depth = depth};
}

void setUp(void) {
    begin(DEPTH);
}

void tearDown(void) {}

static void post(double value, tl_time stamp) {
    tl_reading reading = {.value = value, .stamp = stamp, .quality = TL_GOOD};
    tl_sample_buffer_post(buffer, &reading);
}

static void expect(tl_time instant, double value, tl_time stamp) {
    tl_reading reading = {.value = -1, .stamp = -1, .quality = TL_NO_LINK};
    TEST_ASSERT_TRUE(tl_sample_buffer_at(buffer, instant, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(value, reading.value);
    TEST_ASSERT_EQUAL_INT64(stamp, reading.stamp);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, reading.quality);
}

static void expect_nothing(tl_time instant) {
    tl_reading reading = {.value = 7, .stamp = 8, .quality = TL_STALE};
    TEST_ASSERT_FALSE(tl_sample_buffer_at(buffer, instant, &reading));
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
    TEST_ASSERT_TRUE(tl_sample_buffer_from(buffer, from, until, &reading));
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
    expect_from(201, 299, 2); /* the next reading has not come: the newest before */
    expect_from(301, 400, 3);
    expect_from(50, 100, 1);
    TEST_ASSERT_FALSE(tl_sample_buffer_from(buffer, 50, 99, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(7, reading.value);
}

static void test_first_of_equal_stamps_and_of_what_is_kept(void) {
    post(1, 100);
    post(2, 100);
    expect_from(90, 110, 2);
    for (int i = 0; i < DEPTH; i++) {
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
    post(4, 400);
    expect(250, 3, 200); /* slightly older than the newest ones */
    expect(350, 3, 200);
}

static void test_quality_and_negative_stamps_are_kept(void) {
    tl_reading reading = {.value = -0.25, .stamp = -5, .quality = TL_NOT_A_NUMBER};
    tl_sample_buffer_post(buffer, &reading);
    memset(&reading, 0, sizeof reading);
    TEST_ASSERT_TRUE(tl_sample_buffer_at(buffer, -5, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(-0.25, reading.value);
    TEST_ASSERT_EQUAL_INT64(-5, reading.stamp);
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, reading.quality);
}

static void test_a_full_ring_forgets_the_oldest(void) {
    for (int i = 0; i < DEPTH; i++) {
        post(i, (tl_time)10 * i);
    }
    expect(0, 0, 0); /* just full: all are kept */
    expect_nothing(-1);
    post(DEPTH, (tl_time)10 * DEPTH);
    expect(0, 1, 10); /* the first one is overwritten: the oldest kept reading */
    expect(-1, 1, 10);
    expect(10, 1, 10);
    expect(25, 2, 20);
    expect(INT64_MAX, DEPTH, (tl_time)10 * DEPTH);
}

/* ---- comparison with a linear search, for stamps that do not decrease ---- */

enum { POSTED = 3000 };

static tl_reading posted[POSTED];

/* Reference search, from the newest reading back. Returns true if no older reading can be
 * better. */
static bool settle(const tl_reading *seen, tl_time from, tl_time until, bool *any, tl_reading *best) {
    bool before = seen->stamp <= from;
    bool first = !*any || seen->stamp < best->stamp;
    if (seen->stamp <= until && first && (!before || !*any || seen->stamp == from)) {
        *best = *seen;
        *any = true;
    }
    return before;
}

static bool walk(size_t count, tl_time from, tl_time until, tl_reading *best) {
    size_t oldest = count > handle.depth ? count - handle.depth : 0;
    size_t post = count;
    bool any = false;
    bool settled = false;
    while (!settled && post > oldest) {
        settled = settle(&posted[--post], from, until, &any, best);
    }
    if (!any && post > 0) {
        *best = posted[post];
        any = true;
    }
    return any;
}

static void compare(size_t count, tl_time from, tl_time until) {
    tl_reading expected = {.value = -1, .stamp = -1};
    tl_reading found = expected;
    char what[128];
    bool any = walk(count, from, until, &expected);
    (void)snprintf(what, sizeof what, "%zu posts, depth %u, from %lld until %lld", count, handle.depth, (long long)from,
                   (long long)until);
    TEST_ASSERT_EQUAL_INT_MESSAGE(any, tl_sample_buffer_from(buffer, from, until, &found), what);
    TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(expected.value, found.value, what);
    TEST_ASSERT_EQUAL_INT64_MESSAGE(expected.stamp, found.stamp, what);
    if (from == until) {
        tl_reading at = {.value = -1, .stamp = -1};
        TEST_ASSERT_EQUAL_INT_MESSAGE(any, tl_sample_buffer_at(buffer, until, &at), what);
        TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(expected.value, at.value, what);
    }
}

/* An instant near a posted one, or an extreme one. */
static tl_time any_instant(tl_test_random *random, size_t count) {
    static const tl_time ENDS[] = {INT64_MIN, -1, 0, INT64_MAX};
    if (count == 0 || tl_test_random_chance(random, 5)) {
        return ENDS[tl_test_random_below(random, sizeof ENDS / sizeof ENDS[0])];
    }
    size_t oldest = count > handle.depth ? count - handle.depth : 0;
    tl_time stamp = posted[tl_test_random_between(random, oldest, count - 1)].stamp;
    return stamp + (tl_time)tl_test_random_below(random, 5) - 2;
}

static void ask(tl_test_random *random, size_t count) {
    tl_time from = any_instant(random, count);
    tl_time until = any_instant(random, count);
    compare(count, from < until ? from : until, from < until ? until : from);
    compare(count, until, until);
}

/* Stamps that are equal, one apart, or up to four apart. */
static void run_campaign(uint64_t seed) {
    tl_test_random random = {seed};
    size_t equal = tl_test_random_below(&random, 101);
    size_t gap = 1 + tl_test_random_below(&random, 4);
    tl_time stamp = (tl_time)tl_test_random_below(&random, 100) - 50;
    begin((uint32_t)1 << tl_test_random_below(&random, 11));
    for (size_t i = 0; i < POSTED; i++) {
        stamp += tl_test_random_chance(&random, equal) ? 0 : 1 + (tl_time)tl_test_random_below(&random, gap);
        posted[i] = (tl_reading){.value = (double)i, .stamp = stamp, .quality = TL_GOOD};
        tl_sample_buffer_post(buffer, &posted[i]);
        ask(&random, i + 1);
    }
}

static void test_a_search_finds_what_a_walk_finds(void) {
    tl_test_random nobody = {0};
    ask(&nobody, 0);
    for (uint64_t seed = 1; seed <= 40; seed++) {
        run_campaign(seed);
    }
}

/* ---- an old reading costs little more than the newest ---- */

static double cost_of(tl_time least, tl_time width) {
    enum { ASKED = 20000 };
    tl_test_random random = {7};
    double sum = 0;
    tl_time begun = tl_test_now();
    for (int i = 0; i < ASKED; i++) {
        tl_reading reading = {.value = 0};
        (void)tl_sample_buffer_at(buffer, least + (tl_time)tl_test_random_below(&random, (size_t)width), &reading);
        sum += reading.value;
    }
    TEST_ASSERT_TRUE(sum > 0);
    return tl_seconds(tl_test_now() - begun);
}

static void test_the_far_past_costs_little_more_than_the_newest(void) {
    double ratio = 1e9;
    begin(DEEPEST);
    for (int i = 0; i < 2 * DEEPEST; i++) {
        post(1, i);
    }
    for (int i = 0; i < 5; i++) {
        double far = cost_of(DEEPEST, DEEPEST / 2) / cost_of(2 * DEEPEST, DEEPEST);
        ratio = far < ratio ? far : ratio;
    }
    TEST_ASSERT_TRUE_MESSAGE(ratio < 300, "a look-up walks"); /* about 40 reads for one; a linear search needs 50000 */
}

/* ---- a writer that has died ---- */

static void test_a_post_that_was_not_counted_is_found_by_the_successor(void) {
    post(1, 100);
    post(2, 200);
    placed.count = 1; /* the writer died before it counted the second one */
    expect(300, 1, 100);
    tl_sample_buffer_repair(buffer);
    expect(300, 2, 200);
    post(3, 300);
    expect(300, 3, 300);
    expect(299, 2, 200);
}

static void test_a_slot_that_was_left_odd_was_never_begun(void) {
    for (int i = 0; i < DEPTH + 10; i++) {
        post(i, i);
    }
    tl_sample_buffer_slot *slot = &placed.slots[(DEPTH + 10) % DEPTH]; /* of the next post */
    slot->sequence = 2 * (uint64_t)(DEPTH + 10) + 1;
    slot->stamp = 5000;
    expect(INT64_MAX, DEPTH + 9, DEPTH + 9);
    expect(0, 11, 11);
    tl_sample_buffer_repair(buffer);
    expect(INT64_MAX, DEPTH + 9, DEPTH + 9);
    expect(0, 11, 11);
    TEST_ASSERT_EQUAL_UINT64(0, slot->sequence);
    post(1000, 1000);
    expect(INT64_MAX, 1000, 1000);
    expect(0, 11, 11);
}

static void test_mending_what_is_whole_changes_nothing(void) {
    tl_sample_buffer_repair(buffer);
    expect_nothing(INT64_MAX);
    for (int i = 0; i < DEPTH + 10; i++) {
        static tl_sample_buffer_slot before[DEPTH];
        post(i, i);
        memcpy(before, placed.slots, sizeof before);
        tl_sample_buffer_repair(buffer);
        TEST_ASSERT_EQUAL_MEMORY(before, placed.slots, sizeof before);
        TEST_ASSERT_EQUAL_UINT64(i + 1, placed.count);
    }
}

/* ---- two threads ---- */

enum { POSTS = 4000000 };

static bool done; /* atomic */

/* Value, stamp and quality of a post match each other, so a torn read is detected. */
static void *write_many(void *context) {
    (void)context;
    for (int i = 1; i <= POSTS; i++) {
        tl_reading reading = {.value = 3.0 * i, .stamp = i, .quality = (tl_quality)(i % 5)};
        tl_sample_buffer_post(buffer, &reading);
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
        if (tl_sample_buffer_at(buffer, INT64_MAX, &reading)) {
            expect_whole(&reading);
            TEST_ASSERT_TRUE(reading.stamp >= newest); /* stamps never decrease */
            newest = reading.stamp;
        }
        if (newest > 0 && tl_sample_buffer_at(buffer, newest - 10, &reading)) {
            expect_whole(&reading); /* that reading, or the oldest kept one */
            TEST_ASSERT_TRUE(reading.stamp >= newest - 10);
        }
        if (newest > DEPTH && tl_sample_buffer_at(buffer, 0, &reading)) {
            expect_whole(&reading); /* the oldest kept one, next to be overwritten */
            TEST_ASSERT_TRUE(reading.stamp > newest - DEPTH);
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
    RUN_TEST(test_a_search_finds_what_a_walk_finds);
    RUN_TEST(test_the_far_past_costs_little_more_than_the_newest);
    RUN_TEST(test_a_post_that_was_not_counted_is_found_by_the_successor);
    RUN_TEST(test_a_slot_that_was_left_odd_was_never_begun);
    RUN_TEST(test_mending_what_is_whole_changes_nothing);
    RUN_TEST(test_two_threads);
    return UNITY_END();
}
