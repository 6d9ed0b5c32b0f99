/* Names of outcomes and of reasons to stop. */
#include "master/sync/record.h"

const char *tl_outcome_name(tl_outcome outcome) {
    static const char *const names[] = {"free",    "first guess", "optimised", "best so far",
                                        "nominal", "free run",    "made up"};
    return names[outcome];
}

const char *tl_stop_name(tl_stop stop) {
    static const char *const names[] = {"none", "tolerance", "solver", "evaluations", "time"};
    return names[stop];
}
