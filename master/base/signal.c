/* Names of qualities and types, and the age of a reading. */
#include "master/base/signal.h"

const char *tl_quality_name(tl_quality quality) {
    static const char *const names[] = {"good",    "stale",   "out of range", "not a number",
                                        "no link", "outlier", "frozen"};
    return names[quality];
}

const char *tl_type_name(tl_type type) {
    static const char *const names[] = {"Real", "Integer", "Boolean", "String", "Enumeration"};
    return names[type];
}

bool tl_condition_is_needed(const tl_condition *condition) {
    return condition->gate > 0.0 || condition->leap > 0.0 || condition->median > 1 || condition->low_pass > 0;
}

tl_time tl_sample_age(const tl_sample *sample, size_t signal) {
    tl_time stamp = sample->stamps[signal];
    if (stamp == TL_TIME_NEVER || stamp >= sample->instant) {
        return 0;
    }
    uint64_t age = (uint64_t)sample->instant - (uint64_t)stamp;
    return age > INT64_MAX ? INT64_MAX : (tl_time)age;
}
