/* What a recording tells and proposes, for a person or for a program.
 *
 * Purpose: the page of `check --recording`, and its JSON (config/SPEC.md). Both end with the proposal as a configuration has it: the page without what is to be
 *          taken out, the JSON as a merge patch (RFC 7396), in which null takes out.
 * Thread:  the writer's.
 */
#ifndef TL_FIRMWARE_MONITOR_PROPOSAL_PAGE_H
#define TL_FIRMWARE_MONITOR_PROPOSAL_PAGE_H

#include <stdio.h>

#include "firmware/monitor/proposal.h"

/* `recording` is the path as it was given. Errors: TL_TRY_AGAIN: memory was out. */
tl_status tl_proposal_print_page(const tl_config *config, const char *recording, const tl_survey *survey,
                                 const tl_proposal *proposal, FILE *file, tl_error *error);

tl_status tl_proposal_print_json(const tl_config *config, const char *recording, const tl_survey *survey,
                                 const tl_proposal *proposal, FILE *file, tl_error *error);

#endif
