/* A record queue and a writer that moves its entries into a database, in one process. A live run
 * has them in two processes.
 *
 * Thread: one, except that any thread may put events (record_queue.h).
 */
#ifndef TL_TESTS_SUPPORT_TEST_RECORD_QUEUE_H
#define TL_TESTS_SUPPORT_TEST_RECORD_QUEUE_H

#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_writer.h"

/* Zeroed: not open. */
typedef struct tl_test_queue {
    tl_record_queue queue;
    tl_recorder_writer *writer;
    /* private */
    void *memory;
    tl_recorder_writer_state *state;
    tl_recorder_settings record;
} tl_test_queue;

/* Opens both. `record`: as for a recorder; its texts must outlive the queue. Fails the test on an
 * error. */
void tl_test_queue_open(tl_test_queue *made, const tl_recorder_settings *record, size_t checkpoint_bytes);

/* Writes all present entries. */
void tl_test_queue_write(tl_test_queue *made);

/* Writes the remaining entries, and closes both. A zeroed queue is allowed. */
void tl_test_queue_close(tl_test_queue *made);

/* The same, if the file may be refused: returns the status of the writer. */
tl_status tl_test_queue_try_close(tl_test_queue *made, tl_error *error);

#endif
