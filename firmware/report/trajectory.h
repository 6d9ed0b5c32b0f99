/* A trajectory file: y, ŷ, u and û of every step as CSV, for plots and other tools.
 *
 * Format: config/SPEC.md, "Results", --csv. Numbers carry 17 digits, so that they read back to the same bits.
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_REPORT_TRAJECTORY_H
#define TL_FIRMWARE_REPORT_TRAJECTORY_H

#include <stdio.h>

#include "firmware/config/config.h"
#include "master/twin/twin.h"

/* Opens the file ("-": `output`) and writes the header row. */
tl_status tl_trajectory_open(const char *path, FILE *output, const tl_config *config, FILE **file, tl_error *error);

void tl_trajectory_add(FILE *file, const tl_config *config, const tl_record *record);

/* Closes what was opened; `output` is only flushed. TL_TRY_AGAIN where not everything could be written. */
tl_status tl_trajectory_close(FILE *file, FILE *output, const char *path, tl_error *error);

#endif
