/* A latest-value register: a reader gets a complete copy or none, whatever the writer does. */
#include <pthread.h>
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"

enum { BYTES = 8 * TL_LATEST_WORDS, READS = 20000 };

static tl_latest latest;

void setUp(void) {
    memset(&latest, 0, sizeof latest);
}

void tearDown(void) {}

static void test_a_new_one_holds_zeroes(void) {
    unsigned char zeroes[BYTES] = {0};
    unsigned char data[BYTES];
    memset(data, 0xA5, sizeof data);
    TEST_ASSERT_TRUE(tl_latest_read(&latest, data, sizeof data));
    TEST_ASSERT_EQUAL_MEMORY(zeroes, data, sizeof data);
}

static void test_any_size_comes_back_and_no_byte_more(void) {
    static const size_t sizes[] = {1, 7, 8, 9, 15, 100, BYTES - 1, BYTES};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        unsigned char written[BYTES];
        unsigned char data[BYTES + 8];
        memset(data, 0xA5, sizeof data);
        for (size_t k = 0; k < sizes[i]; k++) {
            written[k] = (unsigned char)(k * 31 + i);
        }
        tl_latest_publish(&latest, written, sizes[i]);
        TEST_ASSERT_TRUE(tl_latest_read(&latest, data, sizes[i]));
        TEST_ASSERT_EQUAL_MEMORY(written, data, sizes[i]);
        TEST_ASSERT_EACH_EQUAL_HEX8(0xA5, data + sizes[i], 8);
    }
}

static void test_the_newest_counts(void) {
    int data = 0;
    for (int i = 1; i < 1000; i++) {
        tl_latest_publish(&latest, &i, sizeof i);
    }
    TEST_ASSERT_TRUE(tl_latest_read(&latest, &data, sizeof data));
    TEST_ASSERT_EQUAL_INT(999, data);
}

static void test_a_writer_that_stopped_half_way(void) {
    int data = 0;
    latest.sequence = 1;
    TEST_ASSERT_FALSE(tl_latest_read(&latest, &data, sizeof data));
    tl_latest_publish(&latest, &(int){7}, sizeof data); /* the next writer */
    TEST_ASSERT_TRUE(tl_latest_read(&latest, &data, sizeof data));
    TEST_ASSERT_EQUAL_INT(7, data);
}

/* ---- two threads ---- */

typedef struct counted {
    uint64_t numbers[40]; /* all equal */
} counted;

static bool stop;

static void *write_numbers(void *unused) {
    (void)unused;
    for (uint64_t n = 1; !__atomic_load_n(&stop, __ATOMIC_RELAXED); n++) {
        counted data;
        for (size_t i = 0; i < sizeof data.numbers / sizeof *data.numbers; i++) {
            data.numbers[i] = n;
        }
        tl_latest_publish(&latest, &data, sizeof data);
    }
    return NULL;
}

static void test_a_reader_never_sees_two_copies_mixed(void) {
    pthread_t writer;
    uint64_t last = 0;
    int good = 0;
    stop = false;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&writer, NULL, write_numbers, NULL));
    bool mixed = false;
    bool backwards = false;
    for (int i = 0; i < READS || good == 0; i++) {
        counted data;
        if (tl_latest_read(&latest, &data, sizeof data)) {
            good++;
            for (size_t k = 1; k < sizeof data.numbers / sizeof *data.numbers; k++) {
                mixed = mixed || data.numbers[k] != data.numbers[0];
            }
            backwards = backwards || data.numbers[0] < last;
            last = data.numbers[0];
        }
    }
    __atomic_store_n(&stop, true, __ATOMIC_RELAXED);
    (void)pthread_join(writer, NULL);
    TEST_ASSERT_FALSE(mixed);
    TEST_ASSERT_FALSE(backwards);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_new_one_holds_zeroes);
    RUN_TEST(test_any_size_comes_back_and_no_byte_more);
    RUN_TEST(test_the_newest_counts);
    RUN_TEST(test_a_writer_that_stopped_half_way);
    RUN_TEST(test_a_reader_never_sees_two_copies_mixed);
    return UNITY_END();
}
