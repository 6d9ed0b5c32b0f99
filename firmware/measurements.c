/* Modes of measurements: see measurements.h. */
#include "firmware/measurements.h"

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

int64_t tl_measurements_delay(tl_measurements measurements, uint32_t prediction) {
    switch (measurements) {
    case TL_LAG:
        return (int64_t)prediction;
    case TL_AHEAD:
        return 0;
    case TL_HOLD:
        return 1;
    }
    return 0;
}
