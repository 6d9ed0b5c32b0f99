/* Names of qualities and types. */
#include "master/base/signal.h"

const char *tl_quality_name(tl_quality quality) {
    switch (quality) {
    case TL_GOOD:
        return "good";
    case TL_STALE:
        return "stale";
    case TL_OUT_OF_RANGE:
        return "out of range";
    case TL_NOT_A_NUMBER:
        return "not a number";
    case TL_NO_LINK:
        return "no link";
    case TL_OUTLIER:
        return "outlier";
    }
    return "unknown";
}

const char *tl_type_name(tl_type type) {
    switch (type) {
    case TL_REAL:
        return "Real";
    case TL_INTEGER:
        return "Integer";
    case TL_BOOLEAN:
        return "Boolean";
    case TL_STRING:
        return "String";
    case TL_ENUMERATION:
        return "Enumeration";
    }
    return "unknown";
}
