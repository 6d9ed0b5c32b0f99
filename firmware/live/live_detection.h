/* Change detection of a live run, in the recorder's process: it takes no time of the cycle.
 *
 * Purpose: passes what the recorder reads from the record queue to the change detector
 *          (change_detector.h), before it is written. Reports findings as events of the source
 *          "finding".
 * Storing: findings, and what was learnt: after each change of a finding, every hour (24 times in a
 *          learning time below a day), and at the end. The next process and the next run continue
 *          with it.
 * Begin:   reads what an earlier process has learnt, as soon as the database can be read. If the
 *          variables, the step or the cycle differ, learning begins at zero, with a notice.
 * Owner:   the caller frees the object with tl_live_detection_close().
 * Thread:  the recorder's.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_DETECTION_H
#define TL_FIRMWARE_LIVE_LIVE_DETECTION_H

#include "firmware/config/config.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/store/recorder_state.h"
#include "firmware/store/recorder_writer.h"

typedef struct tl_live_detection tl_live_detection;

/* `config` and `state` (of the writer) must outlive the result. Returns NULL if memory is out. */
tl_live_detection *tl_live_detection_create(const tl_config *config, tl_recorder_writer_state *state);

/* Takes the next entry of the record queue: `observe` of the writer (recorder_writer.h). */
void tl_live_detection_observe(tl_live_detection *self, const tl_recorder_entry *entry);

/* Reads what was learnt before, and stores what is due; `at_end`: also what is not due yet. */
void tl_live_detection_store(tl_live_detection *self, tl_recorder_writer *writer, bool at_end);

/* Returns the number of a finding whose explanation has become due since the last call; 0: none.
 * Each finding is explained twice: R after the detector found it, and TL_EXPLANATION_AFTER (10) · R
 * after its onset. R is how long a twin stays released (explanation.h). */
uint32_t tl_live_detection_take_due(tl_live_detection *self);

/* Returns how many findings are open. */
uint32_t tl_live_detection_count_open(const tl_live_detection *self);

/* NULL is allowed. */
void tl_live_detection_close(tl_live_detection *self);

#endif
