/* An outbox in memory of the test's own, and a writer that takes what is in it into a database: what a run has in two processes.
 *
 * Thread: one, but for the outbox's own rules.
 */
#ifndef TL_TESTS_SUPPORT_TEST_RECORD_QUEUE_H
#define TL_TESTS_SUPPORT_TEST_RECORD_QUEUE_H

#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_writer.h"

/* Zeroed: none. */
typedef struct tl_test_queue {
    tl_record_queue queue;
    tl_recorder_writer *writer;
    /* private */
    void *memory;
    tl_recorder_writer_state *state;
    tl_recorder_settings record;
} tl_test_queue;

/* `record`: as for a recorder; its texts must stay. Fails the test if it cannot be. */
void tl_test_queue_open(tl_test_queue *made, const tl_recorder_settings *record, size_t checkpoint_bytes);

/* Writes what is there. */
void tl_test_queue_write(tl_test_queue *made);

/* Writes the rest, and closes all. A zeroed one is allowed. */
void tl_test_queue_close(tl_test_queue *made);

/* The same of a file that may not take it. */
tl_status tl_test_queue_try_close(tl_test_queue *made, tl_error *error);

#endif
