/* Names of the types of a recorded run: see run_types.h. */
#include "firmware/store/run_types.h"

#include <string.h>

static const char *const resumed_from_names[] = {"", "checkpoint", "start", "inputs"};

const char *tl_resumed_from_name(tl_resumed_from from) {
    return resumed_from_names[from];
}

tl_resumed_from tl_resumed_from_named(const char *name) {
    int from = TL_RESUMED_INPUTS;
    while (from != TL_RESUMED_NOT && (name == NULL || strcmp(name, resumed_from_names[from]) != 0)) {
        from--;
    }
    return (tl_resumed_from)from;
}

const char *tl_severity_name(tl_severity severity) {
    static const char *const names[] = {"info", "warning", "error"};
    return names[severity];
}
