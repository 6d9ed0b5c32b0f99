/* Initial record; names of outcomes, of reasons to stop, and of flags. */
#include "master/sync/record.h"

#include <math.h>

#include "master/plan/plan.h"

tl_budget tl_budget_defaults(tl_time step) {
    return (tl_budget){.evaluations = TL_PLAN_EVALUATIONS, .time = step * 6 / 10};
}

void tl_record_begin(tl_record *record, int64_t step) {
    record->step = step;
    record->stop = TL_STOP_NONE;
    record->objective = (double)NAN;
    record->objective_nominal = (double)NAN;
    record->evaluations = 0;
    record->flags = 0;
    record->held = 0;
    record->bad_outputs = 0;
    record->refused = (tl_record_refused){0};
    record->release_age = 0;
}

const char *tl_released_state_text(tl_released_state state) {
    static const char *const texts[] = {
        [TL_RELEASED_OFF] = "not wanted",
        [TL_RELEASED_ON] = "on",
        [TL_RELEASED_EVENT] = "not possible with an event horizon",
        [TL_RELEASED_OUTPUTS] = "not possible with \"keep\": \"outputs\"",
        [TL_RELEASED_REPLAY] = "an FMU can only repeat its steps",
        [TL_RELEASED_MEMORY] = "their states need more than a quarter of saving.memory_mb",
        [TL_RELEASED_SLOW] = "they take more than a tenth of step_s",
    };
    return texts[state];
}

const char *tl_outcome_name(tl_outcome outcome) {
    static const char *const names[] = {"free",     "first guess", "optimised", "best so far", "nominal",
                                        "free run", "caught up",   "held",      "searching",   "resumed"};
    return names[outcome];
}

const char *tl_stop_name(tl_stop stop) {
    static const char *const names[] = {"none", "tolerance", "solver", "evaluations", "time"};
    return names[stop];
}

const char *tl_flag_name(tl_flag flag) {
    switch (flag) {
    case TL_FLAG_FALLBACK:
        return "fallback";
    case TL_FLAG_STAGNATED:
        return "stagnated";
    case TL_FLAG_WITHOUT_NOMINAL:
        return "without nominal";
    case TL_FLAG_PLATEAU:
        return "plateau";
    case TL_FLAG_ABANDONED:
        return "abandoned";
    case TL_FLAG_RESET:
        return "reset";
    case TL_FLAG_DIFFERED:
        return "rollback differed";
    case TL_FLAG_NO_ROLLBACK:
        return "no rollback";
    case TL_FLAG_RESTS:
        return "resting";
    case TL_FLAG_REFUSED:
        return "refused";
    case TL_FLAG_NOT_FINITE:
        return "not finite";
    case TL_FLAG_RELEASED_SLOW:
        return "released twins slow";
    case TL_FLAG_STARTS:
        return "start values";
    }
    return "unknown";
}
