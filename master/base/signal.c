/* Names of qualities and types. */
#include "master/base/signal.h"

const char *tl_quality_name(tl_quality quality) {
    static const char *const names[] = {"good", "stale", "out of range", "not a number", "no link", "outlier"};
    return names[quality];
}

const char *tl_type_name(tl_type type) {
    static const char *const names[] = {"Real", "Integer", "Boolean", "String", "Enumeration"};
    return names[type];
}

bool tl_condition_is_needed(const tl_condition *condition) {
    return condition->gate > 0.0 || condition->median > 1 || condition->low_pass > 0;
}
