/* An outbox in memory of the test's own, and a writer that takes what is in it into a database: what a run has in two processes.
 *
 * Thread: one, but for the outbox's own rules.
 */
#ifndef TL_TESTS_SUPPORT_TEST_OUTBOX_H
#define TL_TESTS_SUPPORT_TEST_OUTBOX_H

#include "firmware/store/outbox.h"
#include "firmware/store/recorder_writer.h"

/* Zeroed: none. */
typedef struct tl_test_outbox {
    tl_outbox outbox;
    tl_recorder_writer *writer;
    /* private */
    void *memory;
    tl_recorder_writer_state *state;
    tl_recorder_settings record;
} tl_test_outbox;

/* `record`: as for a recorder; its texts must stay. Fails the test if it cannot be. */
void tl_test_outbox_open(tl_test_outbox *made, const tl_recorder_settings *record, size_t checkpoint_bytes);

/* Writes what is there. */
void tl_test_outbox_write(tl_test_outbox *made);

/* Writes the rest, and closes all. A zeroed one is allowed. */
void tl_test_outbox_close(tl_test_outbox *made);

/* The same of a file that may not take it. */
tl_status tl_test_outbox_try_close(tl_test_outbox *made, tl_error *error);

#endif
