/* Page of `twinlock check`: the built twin, its delays, a forecast of its costs, and advice.
 *
 * Thread:  the one that calls the FMUs.
 */
#ifndef TL_FIRMWARE_CLI_CHECK_PAGE_H
#define TL_FIRMWARE_CLI_CHECK_PAGE_H

#include <stdio.h>

#include "firmware/twin/twin_role.h"

/* For job->reactions: prints a line for each adjusted variable whose response is known, with its
 * index and the fields `match`, `most` and `half` (in s) of tl_response. Else prints the page that
 * the job requests, and sets *found to its results, for example the number of warnings. If
 * job->states_only, only tests whether another process can use the FMUs' states, and sets
 * found->why. `status`: result of building the assembly. If `status` is not TL_OK, logs the number
 * of problems (if above 1), prints at most the list of variables, and returns `status`. Else
 * returns TL_OK, or the error of the dry run (advice.h). `host`: as in tl_read_back_run(). */
tl_status tl_check_page_print(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                              const tl_read_back_host *host, FILE *page, tl_twin_check *found);

#endif
