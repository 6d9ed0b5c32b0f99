/* What a recording proposes for the configuration, and its page.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_MONITOR_PROPOSAL_H
#define TL_FIRMWARE_MONITOR_PROPOSAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "firmware/config/config.h"
#include "firmware/monitor/survey.h"

/* ---- What a recording proposes: between, condition and tolerance of each match, and between of each input, with the reason.
 *
 * Rule:    line, if a step would else be matched with what is older than itself. A low-pass, if it halves the error of the readings (survey.h): the shortest
 *          that is nearly as good as the best, as the longer one makes a step wait. A gate, if there are outliers and nearly all of them are further off than
 *          the plant goes between two readings, in the geometric middle of both; else a median of 5. A tolerance of 3 σ, or the configured one if that is 3 to 6 σ; twice that, if the plant rests in all of the recording. An input is on
 *          a line, or the mean of it, if it moves by more than its noise from one reading to the next.
 * Modes:   a step waits for a next reading in mode lag only, and for a filter in lag and hold: what would do nothing, or be late, is not proposed.
 * Thread:  pure.
 */

enum { TL_PROPOSAL_REASON = 240 };

/* Why something is proposed; "": nothing is said of it. */
typedef struct tl_proposal_reason {
    char text[TL_PROPOSAL_REASON];
} tl_proposal_reason;

typedef struct tl_proposal_match {
    size_t signal; /* of the survey */
    tl_between between;
    tl_condition condition;
    double tolerance;     /* 0: none is proposed */
    bool is_within_noise; /* the configured tolerance is, below 3 σ */
    tl_proposal_reason why_between, why_condition, why_tolerance;
} tl_proposal_match;

typedef struct tl_proposal_input {
    tl_between between;
    tl_proposal_reason why;
} tl_proposal_input;

typedef struct tl_proposal {
    size_t match_count;
    tl_proposal_match match[TL_MAX_MATCH];
    tl_proposal_input inputs[TL_MAX_SIGNALS]; /* by signal: of those that feed one */
    tl_time every[TL_MAX_SIGNALS];            /* by signal: every_s; 0: none is needed */
} tl_proposal;

/* `survey` is of a recording of this configuration's plant. */
void tl_proposal_make(const tl_config *config, const tl_survey *survey, tl_proposal *proposal);

/* ---- What a recording tells and proposes, for a person or for a program.
 *
 * Purpose: the page of `check --recording`, and its JSON (config/SPEC.md). Both end with the proposal as a configuration has it: the page without what is to be
 *          taken out, the JSON as a merge patch (RFC 7396), in which null takes out.
 * Thread:  the writer's.
 */

/* `recording` is the path as it was given. Errors: TL_TRY_AGAIN: memory was out. */
tl_status tl_proposal_print_page(const tl_config *config, const char *recording, const tl_survey *survey,
                                 const tl_proposal *proposal, FILE *file, tl_error *error);

tl_status tl_proposal_print_json(const tl_config *config, const char *recording, const tl_survey *survey,
                                 const tl_proposal *proposal, FILE *file, tl_error *error);

#endif
