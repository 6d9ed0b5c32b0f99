/* The status line: how the twin is, in one line, for a terminal and for the service manager.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_TWIN_STATUS_LINE_H
#define TL_FIRMWARE_TWIN_STATUS_LINE_H

#include "firmware/config/config.h"
#include "firmware/twin/cycle.h"

enum { TL_STATUS_LINE = 512 };

/* What matters first: the end is cut off where there is no room. Valid UTF-8. */
void tl_status_line_write(const tl_config *config, const tl_cycle_status *status, char line[TL_STATUS_LINE]);

#endif
