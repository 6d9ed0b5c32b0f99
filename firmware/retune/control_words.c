/* Words: see control_words.h. */
#include "firmware/retune/control_words.h"

#include <string.h>

#include "master/base/status.h"

static const char *const right_names[TL_CONTROL_RIGHTS] = {
    [TL_CONTROL_MAY_READ] = "read", [TL_CONTROL_MAY_RETUNE] = "retune", [TL_CONTROL_MAY_COMMISSION] = "commission"};

static const char *const origin_names[TL_CONTROL_ORIGINS] = {
    [TL_CONTROL_BY_RELOAD] = "reload", [TL_CONTROL_BY_NETWORK] = "network", [TL_CONTROL_BY_LIMITED] = "limited"};

static const char *const step_names[TL_CONTROL_STEPS] = {
    [TL_CONTROL_IDLE] = "idle",       [TL_CONTROL_AUTHORISE] = "authorise", [TL_CONTROL_VALIDATE] = "validate",
    [TL_CONTROL_TRY] = "try",         [TL_CONTROL_PREDICT] = "predict",     [TL_CONTROL_SHADOW] = "shadow",
    [TL_CONTROL_COMPARE] = "compare", [TL_CONTROL_ACTIVATE] = "activate",   [TL_CONTROL_PROBATION] = "probation",
    [TL_CONTROL_KEPT] = "kept",       [TL_CONTROL_RETURNED] = "returned",
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
    [TL_CONTROL_CANCELLED] = "cancelled",
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

/* As sysexits.h and a tl_status have them. */
int tl_control_exit_code(tl_control_result result) {
    switch (result) {
    case TL_CONTROL_DONE:
    case TL_CONTROL_SAME:
        return 0;
    case TL_CONTROL_BAD:
    case TL_CONTROL_RESTART:
        return tl_exit_code(TL_BAD_USAGE);
    case TL_CONTROL_UNDONE:
        return tl_exit_code(TL_NOT_LOCKED);
    case TL_CONTROL_INVALID:
        return tl_exit_code(TL_BAD_DATA);
    case TL_CONTROL_ABSENT:
        return tl_exit_code(TL_PLANT_DOWN);
    case TL_CONTROL_FORBIDDEN:
        return TL_CONTROL_NOT_PERMITTED;
    case TL_CONTROL_CHANGED:
    case TL_CONTROL_BUSY:
    case TL_CONTROL_FAILED:
    case TL_CONTROL_CANCELLED:
    case TL_CONTROL_RESULTS:
        break;
    }
    return tl_exit_code(TL_TRY_AGAIN);
}

const char *tl_control_right_note(const char *right) {
    return strcmp(right, "commission") == 0   ? ", takes the right to commission"
           : strcmp(right, "on the box") == 0 ? ", on the box only"
                                              : "";
}
