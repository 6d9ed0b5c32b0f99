/* Words: see control_words.h. */
#include "firmware/control/control_words.h"

#include <string.h>

static const char *const right_names[TL_CONTROL_RIGHTS] = {
    [TL_CONTROL_MAY_READ] = "read", [TL_CONTROL_MAY_RETUNE] = "retune", [TL_CONTROL_MAY_COMMISSION] = "commission"};

static const char *const origin_names[TL_CONTROL_ORIGINS] = {
    [TL_CONTROL_BY_RELOAD] = "reload", [TL_CONTROL_BY_NETWORK] = "network"};

static const char *const step_names[TL_CONTROL_STEPS] = {
    [TL_CONTROL_IDLE] = "idle",           [TL_CONTROL_AUTHORISE] = "authorise",
    [TL_CONTROL_VALIDATE] = "validate",   [TL_CONTROL_TRY] = "try",
    [TL_CONTROL_PREDICT] = "predict",     [TL_CONTROL_ACTIVATE] = "activate",
    [TL_CONTROL_PROBATION] = "probation", [TL_CONTROL_KEPT] = "kept",
    [TL_CONTROL_RETURNED] = "returned",
};

static const char *const result_names[TL_CONTROL_RESULTS] = {
    [TL_CONTROL_DONE] = "done",
    [TL_CONTROL_SAME] = "same",
    [TL_CONTROL_BAD] = "bad request",
    [TL_CONTROL_FORBIDDEN] = "forbidden",
    [TL_CONTROL_CHANGED] = "changed",
    [TL_CONTROL_INVALID] = "invalid",
    [TL_CONTROL_RESTART] = "needs a restart",
    [TL_CONTROL_BUSY] = "busy",
    [TL_CONTROL_ABSENT] = "absent",
    [TL_CONTROL_FAILED] = "failed",
    [TL_CONTROL_UNDONE] = "undone",
};

const char *tl_control_right_name(tl_control_right right) {
    return right_names[right];
}

bool tl_control_right_of(const char *name, tl_control_right *right) {
    for (unsigned i = 0; i < TL_CONTROL_RIGHTS; i++) {
        if (strcmp(name, right_names[i]) == 0) {
            *right = (tl_control_right)i;
            return true;
        }
    }
    return false;
}

const char *tl_control_origin_name(tl_control_origin origin) {
    return origin_names[origin];
}

const char *tl_control_step_name(tl_control_step step) {
    return step_names[step];
}

const char *tl_control_result_name(tl_control_result result) {
    return result_names[result];
}
