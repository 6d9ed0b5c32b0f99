/* Where a verb prints its result: standard output, kept from the FMUs.
 *
 * Purpose: some vendors' FMUs print banners to standard output, which would spoil a JSON object or a CSV file. While an
 *          FMU may be loaded, what others print there goes to standard error; ours goes to the real one.
 * Thread:  call once, before FMUs are loaded.
 */
#ifndef TL_FIRMWARE_BASE_OUTPUT_H
#define TL_FIRMWARE_BASE_OUTPUT_H

#include <stdio.h>

#include "master/base/status.h"

/* The real standard output. From now on file descriptor 1 is standard error. Falls back to stdout. */
FILE *tl_output_claim(void);

/* Once all is printed: `status`, or TL_TRY_AGAIN (said on the log) where that was TL_OK but not everything could be
 * written. */
tl_status tl_output_finish(FILE *output, tl_status status);

#endif
