/* Storage of the change detector: its findings as rows, and what it has learnt as bytes.
 *
 * Purpose: the recorder writes both to the database. So findings survive a restart and the deletion
 *          of their run's data, and a restarted process continues to learn.
 * Thread:  the detector's.
 */
#ifndef TL_FIRMWARE_MONITOR_CHANGE_STORAGE_H
#define TL_FIRMWARE_MONITOR_CHANGE_STORAGE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/config.h"
#include "firmware/monitor/change_detector.h"
#include "firmware/monitor/finding.h"
#include "firmware/store/run_types.h"

enum { TL_FINDING_ALSO = 512 };

typedef struct tl_change_storage {
    tl_run_changes changes; /* result; points to the other fields */
    tl_run_finding rows[TL_FINDINGS];
    char also[TL_FINDINGS][TL_FINDING_ALSO]; /* names of the other variables that changed, one a line */
    char cause[TL_FINDINGS][TL_FINDING_NAME + 8];
    unsigned char *bytes; /* of tl_change_detector_save() */
} tl_change_storage;

/* Fills the storage from the detector; call it again after each change. `config`: the detector's.
 * The storage must be zeroed at first. Its texts are valid until the detector's next step. Returns
 * false if memory is out. */
bool tl_change_storage_fill(tl_change_storage *storage, const tl_config *config, const tl_change_detector *detector);

/* Frees `bytes`. */
void tl_change_storage_release(tl_change_storage *storage);

/* Converts a stored finding. Sets `index`, `corrections`, `outputs`, `is_normal` and `is_decided`
 * to 0. Returns false if the row is not a valid finding. */
bool tl_change_storage_read(const tl_run_finding *row, tl_finding *finding);

#endif
