/* Jobs: what was put in comes out, and one whose lengths are damaged is refused. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/twin_job.h"

/* Of pieces, behind the job in the block; those of texts come first. */
enum { LENGTHS = 6, TEXTS = 3 };

static const unsigned char checkpoint[] = {1, 7, 2, 255, 9}; /* no zero, which could be a text's end */
static const unsigned char tunings[] = {8, 1, 77, 6};
static const unsigned char live[] = {3, 0, 141};
static const tl_twin_job order = {.task = TL_TASK_LIVE,
                                  .tells = TL_TELLS_COUNTS,
                                  .begins = TL_BEGINS_CHECKPOINT,
                                  .tick = -77,
                                  .checkpoint = checkpoint,
                                  .checkpoint_size = sizeof checkpoint,
                                  .tunings = tunings,
                                  .tunings_size = sizeof tunings,
                                  .path = "a folder/lock.json",
                                  .text = "{ \"twinlock\": 1 }\n",
                                  .folder = "/tmp/twinlock-twin-1-abcdef",
                                  .file_bytes = UINT64_MAX,
                                  .memory = 12345678901,
                                  .user = 0x70000001,
                                  .plain = true,
                                  .variables = true,
                                  .holds = true,
                                  .live = live,
                                  .live_size = sizeof live};
static tl_block block;
static tl_twin_job job;
static tl_error error;

void setUp(void) {
    error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_job_make(&order, &block, &error));
}

void tearDown(void) {
    tl_block_close(&block);
}

static void expect_order(void) {
    TEST_ASSERT_EQUAL_INT(order.task, job.task);
    TEST_ASSERT_EQUAL_INT(order.tells, job.tells);
    TEST_ASSERT_EQUAL_INT(order.begins, job.begins);
    TEST_ASSERT_EQUAL_INT64(order.tick, job.tick);
    TEST_ASSERT_EQUAL_STRING(order.path, job.path);
    TEST_ASSERT_EQUAL_STRING(order.text, job.text);
    TEST_ASSERT_EQUAL_STRING(order.folder, job.folder);
    TEST_ASSERT_EQUAL_UINT64(order.file_bytes, job.file_bytes);
    TEST_ASSERT_EQUAL_UINT64(order.memory, job.memory);
    TEST_ASSERT_EQUAL_UINT32(order.user, job.user);
    TEST_ASSERT_TRUE(job.plain && job.variables && job.holds);
    TEST_ASSERT_FALSE(job.without_delays || job.unconfined);
}

static bool lies_in_block(const void *place) {
    uintptr_t at = (uintptr_t)place;
    return at >= (uintptr_t)block.bytes && at <= (uintptr_t)block.bytes + block.size;
}

/* From the descriptor, as another process takes it. */
static void test_all_of_it_comes_back(void) {
    tl_block taken;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_take(block.descriptor, 0, TL_BLOCK_IS_WRITTEN, &taken, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_job_read(&taken, &job, &error));
    expect_order();
    TEST_ASSERT_EQUAL_size_t(sizeof checkpoint, job.checkpoint_size);
    TEST_ASSERT_EQUAL_UINT8_ARRAY(checkpoint, job.checkpoint, sizeof checkpoint);
    TEST_ASSERT_EQUAL_size_t(sizeof tunings, job.tunings_size);
    TEST_ASSERT_EQUAL_UINT8_ARRAY(tunings, job.tunings, sizeof tunings);
    TEST_ASSERT_EQUAL_size_t(sizeof live, job.live_size);
    TEST_ASSERT_EQUAL_UINT8_ARRAY(live, job.live, sizeof live);
    block.descriptor = -1; /* which `taken` owns now */
    tl_block_close(&taken);
}

static void test_its_texts_are_in_the_block(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_job_read(&block, &job, &error));
    TEST_ASSERT_TRUE(lies_in_block(job.path));
    TEST_ASSERT_TRUE(lies_in_block(job.text));
    TEST_ASSERT_TRUE(lies_in_block(job.folder));
    TEST_ASSERT_TRUE(lies_in_block(job.checkpoint));
    TEST_ASSERT_TRUE(lies_in_block(job.live));
}

static void test_without_pieces_that_may_be_missing(void) {
    tl_twin_job plain = order;
    plain.begins = TL_BEGINS_NEW;
    plain.checkpoint = NULL;
    plain.checkpoint_size = 0;
    plain.live = NULL;
    plain.live_size = 0;
    plain.path = "";
    tl_block_close(&block);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_job_make(&plain, &block, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_job_read(&block, &job, &error));
    TEST_ASSERT_EQUAL_STRING("", job.path);
    TEST_ASSERT_EQUAL_size_t(0, job.checkpoint_size);
    TEST_ASSERT_EQUAL_size_t(0, job.live_size);
}

/* ---- damage ---- */

/* Bytes in memory of just that size, so that a sanitizer sees what is read beyond. */
static tl_status read_bytes(const unsigned char *bytes, size_t size) {
    unsigned char *copy = malloc(size > 0 ? size : 1);
    TEST_ASSERT_NOT_NULL(copy);
    memcpy(copy, bytes, size);
    const tl_block damaged = {.bytes = copy, .size = size, .descriptor = -1};
    tl_status status = tl_twin_job_read(&damaged, &job, &error);
    free(copy);
    return status;
}

static void test_one_that_is_cut_is_refused(void) {
    for (size_t size = 0; size < block.size; size++) {
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_bytes(block.bytes, size));
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, read_bytes(block.bytes, block.size));
}

static void test_one_that_is_too_long_is_refused(void) {
    unsigned char *longer = calloc(1, block.size + 1);
    TEST_ASSERT_NOT_NULL(longer);
    memcpy(longer, block.bytes, block.size);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_bytes(longer, block.size + 1));
    free(longer);
}

static size_t place_of(size_t which) {
    return sizeof(tl_twin_job) + which * sizeof(size_t);
}

static size_t length_of(const unsigned char *bytes, size_t which) {
    size_t length = 0;
    memcpy(&length, bytes + place_of(which), sizeof length);
    return length;
}

static void put_length(unsigned char *bytes, size_t which, size_t length) {
    memcpy(bytes + place_of(which), &length, sizeof length);
}

static void test_a_length_that_is_wrong_is_refused(void) {
    unsigned char *bytes = malloc(block.size);
    TEST_ASSERT_NOT_NULL(bytes);
    memcpy(bytes, block.bytes, block.size);
    for (size_t which = 0; which < LENGTHS; which++) {
        const size_t right = length_of(bytes, which);
        const size_t wrong[] = {0,          right - 1,    right + 1,        block.size,
                                SIZE_MAX,   SIZE_MAX / 2, SIZE_MAX - right, SIZE_MAX - block.size,
                                right << 8, 0 - right};
        for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
            put_length(bytes, which, wrong[i]);
            TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_bytes(bytes, block.size));
            TEST_ASSERT_EQUAL_STRING("the job's parts are not as long as it says", error.text);
        }
        put_length(bytes, which, right);
    }
    free(bytes);
}

/* Two lengths that are wrong and still add up, the sum wrapped around or not. */
static void test_lengths_that_add_up_are_refused(void) {
    unsigned char *bytes = malloc(block.size);
    TEST_ASSERT_NOT_NULL(bytes);
    memcpy(bytes, block.bytes, block.size);
    const size_t by[] = {1, 2, (size_t)0 - 1, SIZE_MAX / 2};
    const size_t pairs = TEXTS; /* each with the piece behind it */
    for (size_t i = 0; i < pairs * (sizeof by / sizeof by[0]); i++) {
        size_t which = i % pairs;
        size_t one = length_of(bytes, which);
        size_t other = length_of(bytes, which + 1);
        put_length(bytes, which, one + by[i / pairs]);
        put_length(bytes, which + 1, other - by[i / pairs]);
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_bytes(bytes, block.size));
        put_length(bytes, which, one);
        put_length(bytes, which + 1, other);
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, read_bytes(bytes, block.size));
    free(bytes);
}

static void test_a_text_without_an_end_is_refused(void) {
    unsigned char *bytes = malloc(block.size);
    TEST_ASSERT_NOT_NULL(bytes);
    memcpy(bytes, block.bytes, block.size);
    size_t end = block.size; /* minus all pieces: where the first one begins */
    for (size_t which = 0; which < LENGTHS; which++) {
        end -= length_of(bytes, which);
    }
    for (size_t which = 0; which < TEXTS; which++) {
        end += length_of(bytes, which);
        TEST_ASSERT_EQUAL_UINT8('\0', bytes[end - 1]);
        bytes[end - 1] = 'x';
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_bytes(bytes, block.size));
        TEST_ASSERT_EQUAL_STRING("a text of the job has no end", error.text);
        bytes[end - 1] = '\0';
    }
    free(bytes);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_of_it_comes_back);
    RUN_TEST(test_its_texts_are_in_the_block);
    RUN_TEST(test_without_pieces_that_may_be_missing);
    RUN_TEST(test_one_that_is_cut_is_refused);
    RUN_TEST(test_one_that_is_too_long_is_refused);
    RUN_TEST(test_a_length_that_is_wrong_is_refused);
    RUN_TEST(test_lengths_that_add_up_are_refused);
    RUN_TEST(test_a_text_without_an_end_is_refused);
    return UNITY_END();
}
