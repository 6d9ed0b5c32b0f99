/* The end of a run as its twin tells it: whether it can be one.
 *
 * Purpose: a process with FMUs may have written anything into its pulse. What indexes something, and what is printed as text, is checked before.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_REPORT_RUN_END_H
#define TL_FIRMWARE_REPORT_RUN_END_H

#include <stdbool.h>

#include "firmware/config/config.h"
#include "firmware/report/summary.h"
#include "master/twin/account.h"

/* Of copies, which nobody changes any more. Numbers are not judged. */
bool tl_run_end_is_sound(const tl_summary *summary, const tl_account *account, const tl_config *config);

#endif
