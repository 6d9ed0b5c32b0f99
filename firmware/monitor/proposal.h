/* Proposal: derives settings for the configuration from a recording, and prints them.
 *
 * Memory: plain data of the caller.
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_MONITOR_PROPOSAL_H
#define TL_FIRMWARE_MONITOR_PROPOSAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "firmware/config/config.h"
#include "firmware/monitor/horizon_choice.h"
#include "firmware/monitor/survey.h"

/* ---- Proposes `between`, `condition` and `tolerance` of each match and `between` of each input,
 * each with its reason.
 *
 * Line:      interpolation between two readings is proposed if more than 5 % of the intervals
 *            between readings exceed a step. Otherwise a step would be matched with an older
 *            reading.
 * Low-pass:  proposed if it reduces the mean square error of the readings (survey.h) to less than
 *            60 %. The proposal is the shortest low-pass that is nearly as good as the best one,
 *            because a step waits longer with a longer low-pass.
 * Gate:      proposed if there are at least two outliers, and nearly all of them are further off
 *            than the plant moves between two readings. The gate is the geometric mean of both
 *            distances. If some outliers are nearer, a median of 5 is proposed instead.
 * Tolerance: 3 σ, or the configured one if that is 3 to 6 σ. If the plant is at rest in the whole
 *            recording, both limits are doubled.
 * Input:     the mean over a step, if the input moves by more than twice its noise between two
 *            readings.
 * Modes:     a step waits for a next reading only in pairing mode lag, and for a filter only in lag
 *            and hold. A setting that would have no effect, or be late, is not proposed.
 * Thread:    pure functions.
 */

enum { TL_PROPOSAL_REASON = 240 };

/* Why a setting is proposed, or why none is; "": no reason is given. */
typedef struct tl_proposal_reason {
    char text[TL_PROPOSAL_REASON];
} tl_proposal_reason;

typedef struct tl_proposal_match {
    size_t signal; /* index in the survey */
    tl_between between;
    tl_condition condition;
    double tolerance;     /* in the signal's unit; 0: no proposal */
    bool is_within_noise; /* the configured tolerance is below 3 σ */
    tl_proposal_reason why_between, why_condition, why_tolerance;
} tl_proposal_match;

typedef struct tl_proposal_input {
    tl_between between;
    tl_proposal_reason why;
} tl_proposal_input;

typedef struct tl_proposal {
    size_t match_count;
    tl_proposal_match match[TL_MAX_MATCH];
    tl_proposal_input inputs[TL_MAX_SIGNALS]; /* by signal; only of signals that feed an input */
    tl_time every[TL_MAX_SIGNALS];            /* by signal: proposed every_s, in ns; 0: the key is not needed */
} tl_proposal;

/* Fills `proposal`. `survey`: of a recording of this configuration's plant. */
void tl_proposal_make(const tl_config *config, const tl_survey *survey, tl_proposal *proposal);

/* ---- Output of survey and proposal, for a person or a program.
 *
 * Purpose: the page of `check --recording`, and its JSON (config/SPEC.md). Both contain the
 *          proposal in the form of the configuration. On the page, keys to be removed are left out.
 *          In the JSON the proposal is a merge patch (RFC 7396), in which null removes a key.
 * Thread:  the caller's.
 */

/* What is printed. `recording`: path as given. `choice`: NULL: no horizons were tried. */
typedef struct tl_proposal_page {
    const tl_config *config;
    const char *recording;
    const tl_survey *survey;
    const tl_proposal *proposal;
    const tl_horizon_choice *choice;
} tl_proposal_page;

/* Print the page, or all results as JSON. Errors: TL_TRY_AGAIN if memory is out. */
tl_status tl_proposal_print_page(const tl_proposal_page *page, FILE *file, tl_error *error);
tl_status tl_proposal_print_json(const tl_proposal_page *page, FILE *file, tl_error *error);

/* Prints only the merge patch. Errors: as above. */
tl_status tl_proposal_print_patch(const tl_proposal_page *page, FILE *file, tl_error *error);

/* The same as a text, which the caller frees, even after an error. Errors: as above. */
tl_status tl_proposal_write_patch(const tl_proposal_page *page, char **patch, tl_error *error);

#endif
