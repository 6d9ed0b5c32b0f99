/* A tuning: what of a plan a running twin can take anew, as plain data.
 *
 * Purpose: tolerances, weights, bounds and budgets are numbers; another one of them needs no other twin. All that the twin has learnt stays.
 * Kinds:   what makes a twin what it is built as stays too: how many are matched and adjusted, which matches have a weight, which variables a nominal of
 *          their own, and the evaluations that its caches are sized for (tl_tuning_fits()).
 * Trust:   may come from another process's memory: tl_tuning_check() believes nothing of it. No pointers, no padding.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_PLAN_TUNING_H
#define TL_MASTER_PLAN_TUNING_H

#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/plan/plan.h"

/* The most evaluations of a step, in any plan; and those that every twin has room for, however few it is built with. */
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
    double nominal;       /* in the variable's unit; of a Boolean 0 or 1 */
    double lower;         /* −infinity: none; the variable's declared minimum holds as well */
    double upper;         /* +infinity: none */
    double deviation_penalty;
    double rate_penalty;
} tl_tuning_adjust;

typedef struct tl_tuning {
    uint32_t matches; /* at most TL_MAX_MATCH */
    uint32_t adjusts; /* at most TL_MAX_ADJUST */
    double margin;
    double noise_floor;
    uint64_t evaluations; /* of a step's budget, 1 … TL_TUNING_EVALUATIONS */
    tl_time time;         /* of a step's budget, ns; 0: none but the step itself */
    tl_tuning_match match[TL_MAX_MATCH];
    tl_tuning_adjust adjust[TL_MAX_ADJUST];
} tl_tuning;

/* That of a plan, which was checked. A plan says nothing of time: 0. */
void tl_tuning_of(const tl_plan *plan, tl_tuning *tuning);

/* Whether each number is one that a plan may have. Errors: TL_BAD_DATA, which says which one is not. */
tl_status tl_tuning_check(const tl_tuning *tuning, tl_error *error);

/* The evaluations that a twin has room for that was built with so many. */
static inline uint64_t tl_tuning_room(uint64_t evaluations) {
    return evaluations > TL_TUNING_ROOM ? evaluations : TL_TUNING_ROOM;
}

/* Whether a twin that was built with `built` can take it; both were checked. Errors: TL_BAD_DATA, which says what cannot change. */
tl_status tl_tuning_fits(const tl_tuning *tuning, const tl_tuning *built, tl_error *error);

#endif
