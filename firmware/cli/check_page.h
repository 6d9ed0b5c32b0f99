/* The page of `twinlock check`: an assembled twin, its delays, its costs and a forecast.
 *
 * Thread:  the one that calls the FMUs.
 */
#ifndef TL_FIRMWARE_CLI_CHECK_PAGE_H
#define TL_FIRMWARE_CLI_CHECK_PAGE_H

#include <stdio.h>

#include "firmware/twin/twin_role.h"

/* Prints to `page` what the job asks for. `status`: of assembling, which is returned if it is not TL_OK. `found`: with the number of warnings that were printed. */
tl_status tl_check_page_print(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                              const tl_read_back_host *host, FILE *page, tl_twin_check *found);

#endif
