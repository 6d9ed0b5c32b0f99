/* Jobs: read back as written. A truncated or too long one is refused. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/twin_role.h"

static const unsigned char checkpoint[] = {1, 7, 2, 255, 9}; /* without 0, unlike a text */
static const unsigned char tunings[] = {8, 1, 77, 6};
static const unsigned char live[] = {3, 0, 141};
static const tl_twin_job order = {.task = TL_TASK_LIVE,
                                  .attached = TL_ATTACHED_COUNTS,
                                  .tick = -77,
                                  .checkpoint = checkpoint,
                                  .checkpoint_size = sizeof checkpoint,
                                  .tunings = tunings,
                                  .tunings_size = sizeof tunings,
                                  .path = "a folder/lock.json",
                                  .text = "{ \"twinlock\": 1 }\n",
                                  .folder = "/tmp/twinlock-twin-1-abcdef",
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
    TEST_ASSERT_EQUAL_INT(order.attached, job.attached);
    TEST_ASSERT_EQUAL_INT64(order.tick, job.tick);
    TEST_ASSERT_EQUAL_STRING(order.path, job.path);
    TEST_ASSERT_EQUAL_STRING(order.text, job.text);
    TEST_ASSERT_EQUAL_STRING(order.folder, job.folder);
    TEST_ASSERT_EQUAL_UINT64(order.memory, job.memory);
    TEST_ASSERT_EQUAL_UINT32(order.user, job.user);
    TEST_ASSERT_TRUE(job.plain && job.variables && job.holds);
    TEST_ASSERT_FALSE(job.unconfined);
}

static bool lies_in_block(const void *slot_index) {
    uintptr_t at = (uintptr_t)slot_index;
    return at >= (uintptr_t)block.bytes && at <= (uintptr_t)block.bytes + block.size;
}

/* Read by descriptor, as another process does. */
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
    block.descriptor = -1; /* `taken` owns it now */
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

/* Copies to memory of this size, so that a sanitizer detects overruns. */
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

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_of_it_comes_back);
    RUN_TEST(test_its_texts_are_in_the_block);
    RUN_TEST(test_without_pieces_that_may_be_missing);
    RUN_TEST(test_one_that_is_cut_is_refused);
    RUN_TEST(test_one_that_is_too_long_is_refused);
    return UNITY_END();
}
