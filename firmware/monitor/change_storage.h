/* Storage of the change detector: its findings as rows, and what it has learnt as bytes.
 *
 * Purpose: the recorder writes both to the database, so that findings survive restarts and the data
 *          of their run, and a restarted process continues to learn.
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
    tl_run_changes changes; /* points to the rest */
    tl_run_finding rows[TL_FINDINGS];
    char also[TL_FINDINGS][TL_FINDING_ALSO];
    char cause[TL_FINDINGS][TL_FINDING_NAME + 8];
    unsigned char *bytes;
} tl_change_storage;

/* Fills the storage from the detector; call it again after each change. `config`: the detector's.
 * The storage must be zeroed at first. Its texts are valid until the detector's next step. Returns
 * false if memory is out. */
bool tl_change_storage_fill(tl_change_storage *storage, const tl_config *config, const tl_change_detector *detector);

/* Frees its bytes. */
void tl_change_storage_release(tl_change_storage *storage);

/* Converts a stored finding. Returns false if the row cannot be of a finding. */
bool tl_change_storage_read(const tl_run_finding *row, tl_finding *finding);

#endif
