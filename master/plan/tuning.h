/* Tuning: the part of a plan that a running twin can change, as plain data.
 *
 * Purpose: tolerances, weights, bounds and budgets are numbers; changing them needs no new twin and
 *          keeps all that the twin has learned.
 * Fixed:   the number of matches and adjusted variables; which matches have a weight; which
 *          variables have a configured nominal. The largest number of evaluations is fixed too,
 *          because the size of the caches depends on it. tl_tuning_fits() checks this.
 * Trust:   may come from another process's memory, so tl_tuning_check() checks every value. No
 *          pointers, no padding.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_PLAN_TUNING_H
#define TL_MASTER_PLAN_TUNING_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/plan/plan.h"

/* Largest number of evaluations of a step in any plan, and the number that every twin has room for.
 */
enum { TL_TUNING_EVALUATIONS = 100000, TL_TUNING_ROOM = TL_PLAN_EVALUATIONS };

/* As in tl_plan_match. */
typedef struct tl_tuning_match {
    double tolerance;
    double weight;
    double huber;
} tl_tuning_match;

/* As in tl_plan_adjust. */
typedef struct tl_tuning_adjust {
    uint64_t has_nominal; /* 0 or 1 */
    double nominal;       /* û, in the variable's unit; Boolean: 0 or 1 */
    double lower;         /* −infinity: no bound; the declared minimum of the variable applies as well */
    double upper;         /* +infinity: no bound; the declared maximum applies as well */
    double approved;      /* u − û */
    double deviation_penalty;
    double rate_penalty;
} tl_tuning_adjust;

typedef struct tl_tuning {
    uint32_t matches; /* at most TL_MAX_MATCH */
    uint32_t adjusts; /* at most TL_MAX_ADJUST */
    double margin;
    double noise_floor;
    uint64_t evaluations; /* of a step's budget, 1 … TL_TUNING_EVALUATIONS */
    tl_time time;         /* of a step's budget, ns; 0: limited only by the length of the step */
    tl_tuning_match match[TL_MAX_MATCH];
    tl_tuning_adjust adjust[TL_MAX_ADJUST];
} tl_tuning;

/* Extracts the tuning of a checked plan. `time` is 0, because a plan has no time budget. */
void tl_tuning_of(const tl_plan *plan, tl_tuning *tuning);

/* Checks the range of each number, as for a plan. Errors: TL_BAD_DATA; the text names the
 * number. */
tl_status tl_tuning_check(const tl_tuning *tuning, tl_error *error);

/* Evaluations that a twin built for `evaluations` has room for. */
static inline uint64_t tl_tuning_room(uint64_t evaluations) {
    return evaluations > TL_TUNING_ROOM ? evaluations : TL_TUNING_ROOM;
}

/* Returns u with an approved correction: nominal + `approved`, within the bounds. Without one it is
 * nominal, also outside of the bounds. */
static inline double tl_approved_u(double nominal, double approved, double lower, double upper) {
    bool has_any = approved < 0.0 || approved > 0.0;
    return has_any ? fmin(fmax(nominal + approved, lower), upper) : nominal;
}

/* Checks that a twin that was built with `built` can use the tuning. Both must have passed
 * tl_tuning_check(). Errors: TL_BAD_DATA; the text names the number that cannot change. */
tl_status tl_tuning_fits(const tl_tuning *tuning, const tl_tuning *built, tl_error *error);

#endif
