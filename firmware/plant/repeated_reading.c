/* A reading that a poll has found again: see repeated_reading.h. */
#include "firmware/plant/repeated_reading.h"

#include <string.h>

static bool are_equal(const tl_reading *one, const tl_reading *other) {
    return one->quality == TL_GOOD && other->quality == TL_GOOD &&
           memcmp(&one->value, &other->value, sizeof one->value) == 0;
}

bool tl_repeated_reading_is(tl_repeated_reading *self, tl_time within, const tl_reading *reading) {
    bool is_early = self->has_last && reading->stamp - self->last.stamp < within;
    bool is_again = is_early && are_equal(&self->last, reading);
    if (!is_again) {
        self->last = *reading;
        self->has_last = true;
    }
    return is_again;
}
