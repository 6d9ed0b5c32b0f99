/* Judges what the plant says: the newest reading at an instant, and how far it can be trusted. */
#include "firmware/plant/plant_input.h"

#include <math.h>

/* 2^31: integers of FMI 2.0 are below it. */
#define INTEGER_LIMIT 2147483648.0

void tl_plant_input_post(const tl_plant_input *input, size_t signal, const tl_reading *reading) {
    tl_mailbox_post(&input->mailboxes[signal], reading);
}

bool tl_plant_input_is_complete(const tl_plant_input *input) {
    for (size_t i = 0; i < input->count; i++) {
        tl_reading reading;
        if (!tl_mailbox_at(&input->mailboxes[i], INT64_MAX, &reading) || reading.quality != TL_GOOD) {
            return false;
        }
    }
    return true;
}

static bool fits_type(double value, tl_type type) {
    switch (type) {
    case TL_BOOLEAN:
        return value == 0 || value == 1;
    case TL_INTEGER:
    case TL_ENUMERATION:
        return fabs(value) < INTEGER_LIMIT && value == trunc(value);
    case TL_REAL:
    case TL_STRING:
        break;
    }
    return true;
}

/* Whether a stamp can be one of this plant's. What is between them may be more than a tl_time holds. */
static bool is_near(tl_time stamp, tl_time instant) {
    uint64_t apart = stamp < instant ? (uint64_t)instant - (uint64_t)stamp : (uint64_t)stamp - (uint64_t)instant;
    return apart <= TL_PLANT_FARTHEST;
}

static tl_quality worse(tl_quality a, tl_quality b) {
    return a > b ? a : b;
}

/* The quality of a reading at an instant; corrects the value of one that is no number. */
static tl_quality judge(const tl_plant_limits *limits, tl_time instant, tl_reading *reading) {
    tl_quality quality = reading->quality;
    if (!isfinite(reading->value) || quality >= TL_NOT_A_NUMBER) {
        reading->value = isfinite(reading->value) ? reading->value : 0;
        return worse(quality, TL_NOT_A_NUMBER);
    }
    if (reading->value < limits->minimum || reading->value > limits->maximum ||
        !fits_type(reading->value, limits->type)) {
        quality = worse(quality, TL_OUT_OF_RANGE);
    }
    if (limits->stale > 0 && instant > reading->stamp && instant - reading->stamp > limits->stale) {
        quality = worse(quality, TL_STALE);
    }
    return quality;
}

/* By `instant`, as the signal's look says. */
static bool look_up(const tl_mailbox *mailbox, const tl_plant_look *look, tl_time instant, tl_reading *reading) {
    tl_time at = instant - look->back;
    return (!look->next && tl_mailbox_at(mailbox, at, reading)) || tl_mailbox_from(mailbox, at, instant, reading);
}

void tl_plant_input_take(const tl_plant_input *input, int64_t tick, tl_time instant, tl_sample *sample) {
    sample->tick = tick;
    sample->instant = instant;
    for (size_t i = 0; i < input->count; i++) {
        tl_time at = instant - input->looks[i].back;
        tl_reading reading;
        if (look_up(&input->mailboxes[i], &input->looks[i], instant, &reading) && is_near(reading.stamp, at)) {
            sample->quality[i] = (uint8_t)judge(&input->limits[i], at, &reading);
        } else {
            reading = (tl_reading){.value = 0, .stamp = TL_TIME_NEVER};
            sample->quality[i] = (uint8_t)TL_NO_LINK;
        }
        sample->values[i] = reading.value;
        sample->stamps[i] = reading.stamp;
    }
}
