/* A record queue and its writer: see test_record_queue.h. */
#include "tests/support/test_record_queue.h"

#include <stdlib.h>
#include <string.h>

#include <unity.h>

enum { PAGE = 4096 };

void tl_test_queue_open(tl_test_queue *made, const tl_recorder_settings *record, size_t checkpoint_bytes) {
    tl_error error;
    made->record = *record;
    tl_record_queue_settings settings = {
        .shape = {record->plant_count, record->match_count, record->adjust_count, record->component_count},
        .checkpoint_bytes = checkpoint_bytes};
    settings.ring_bytes = tl_record_queue_ring_bytes(&settings.shape, record->step);
    size_t size = tl_record_queue_bytes(&settings);
    TEST_ASSERT_EQUAL_INT(0, posix_memalign(&made->memory, PAGE, size));
    memset(made->memory, 0, size);
    made->state = calloc(1, sizeof *made->state);
    TEST_ASSERT_NOT_NULL(made->state);
    tl_record_queue_open(&settings, made->memory, &made->state->taken[0], &made->queue);
    const tl_recorder_writer_queue queue = {"test", settings, made->memory};
    const tl_recorder_writer_settings writing = {
        .record = &made->record, .queues = &queue, .queue_count = 1, .state = made->state};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_recorder_writer_open(&writing, &made->writer, &error), error.text);
}

void tl_test_queue_write(tl_test_queue *made) {
    tl_recorder_writer_write(made->writer);
}

tl_status tl_test_queue_try_close(tl_test_queue *made, tl_error *error) {
    tl_status status = tl_recorder_writer_close(made->writer, TL_SECOND, error);
    free(made->memory);
    free(made->state);
    *made = (tl_test_queue){.memory = NULL};
    return status;
}

void tl_test_queue_close(tl_test_queue *made) {
    tl_error error;
    tl_status status = tl_test_queue_try_close(made, &error);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
}
