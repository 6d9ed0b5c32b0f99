/* Modes of measurements: see measurements.h. */
#include "firmware/config/measurements.h"

#include <stddef.h>
#include <string.h>

const char *const tl_measurements_names[] = {[TL_LAG] = "lag", [TL_AHEAD] = "ahead", [TL_HOLD] = "hold", NULL};

const char *tl_measurements_name(tl_measurements measurements) {
    return tl_measurements_names[measurements];
}

tl_measurements tl_measurements_named(const char *name) {
    for (int i = TL_LAG; name != NULL && i <= TL_HOLD; i++) {
        if (strcmp(name, tl_measurements_names[i]) == 0) {
            return (tl_measurements)i;
        }
    }
    return TL_LAG;
}
