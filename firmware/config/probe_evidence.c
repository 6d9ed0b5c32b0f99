/* Evidence of a value for its mapping: see probe_evidence.h. */
#include "firmware/config/probe_evidence.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* A value this many times beyond its limits, or this large without limits, is absurd. */
static const double ABSURD = 1000;
static const double LARGEST = 1e15;

/* A mapping that is right: parts of the values that are near the start, and of faulty sensors;
 * standard deviation from the start, relative to the range. */
static const double NEAR = 0.96;
static const double FAULTY = 0.03;
static const double SPREAD = 0.05;

/* A mapping that is wrong: density of v·p(v), for 10 orders of magnitude of both signs and a third
 * of zeros. */
static const double WRONG = 0.015;

/* Evidence of a sensor that is off while others are not. */
static const double OFF = -2;

static const double PI = 3.14159265358979323846;

static double density_at_start(const tl_config_signal *signal, double range, double value) {
    const double distance = (value - signal->plan.initial) / (SPREAD * range);
    return exp(-0.5 * distance * distance) / (SPREAD * range * sqrt(2 * PI));
}

/* Of a value ≠ 0. Without limits and start value it proves nothing. */
static double evidence_of_value(const tl_config_signal *signal, double value, bool at_start) {
    const bool has_start = signal->plan.has_initial;
    const bool is_limited = isfinite(signal->minimum) && isfinite(signal->maximum);
    const double range = is_limited ? signal->maximum - signal->minimum : 4 * fabs(signal->plan.initial);
    const bool is_inside = value >= signal->minimum && value <= signal->maximum;
    const double wrong = WRONG / fabs(value);
    if (!(range > 0)) {
        return is_inside ? 0 : log(FAULTY);
    }
    const double near = has_start && at_start ? NEAR : 0;
    const double inside = (is_inside ? 1 - FAULTY - near : 0) / range;
    const double uniform = is_limited ? inside : fmin(inside, wrong); /* an open range proves nothing */
    return log((near > 0 ? near * density_at_start(signal, range, value) : 0) + uniform + FAULTY * wrong) - log(wrong);
}

/* A sensor that is off often gives 0. */
static double evidence_of_zero(const tl_config_signal *signal, bool at_start) {
    const double range = signal->maximum - signal->minimum;
    const bool is_far =
        at_start && signal->plan.has_initial && isfinite(range) && fabs(signal->plan.initial) > 3 * SPREAD * range;
    return is_far ? OFF : 0;
}

static bool is_absurd(const tl_config_signal *signal, double value) {
    const double low = isfinite(signal->minimum) ? fabs(signal->minimum) : 0;
    const double high = isfinite(signal->maximum) ? fabs(signal->maximum) : 0;
    const bool is_limited = isfinite(signal->minimum) && isfinite(signal->maximum);
    const double size = is_limited ? fmax(low, high) : 0;
    return fabs(value) < (double)FLT_MIN || fabs(value) > (size > 0 ? ABSURD * size : LARGEST);
}

/* Many devices give the largest or smallest content if they have no value, or a NaN whose last
 * register is 0 or FFFF. */
static bool is_no_value(const tl_modbus_channel *plain, const uint16_t *registers, double raw, bool is_number) {
    const size_t count = tl_modbus_registers(plain->type);
    const double half = ldexp(1, 16 * (int)count - 1);
    const uint16_t last = registers[plain->words_little ? 0 : count - 1];
    switch (plain->type) {
    case TL_MODBUS_INT16:
    case TL_MODBUS_INT32:
    case TL_MODBUS_INT64:
        return raw >= half - 1 || raw <= -half;
    case TL_MODBUS_UINT16:
    case TL_MODBUS_UINT32:
        return raw >= 2 * half - 1;
    default:
        return !is_number && (last == 0 || last == UINT16_MAX);
    }
}

double tl_probe_evidence(const tl_config_signal *signal, const tl_modbus_channel *channel, const uint16_t *registers,
                         bool at_start) {
    tl_modbus_channel plain = *channel;
    double raw = 0;
    double value = 0;
    plain.scale = 1;
    plain.offset = 0;
    const bool is_number = tl_modbus_decode(&plain, registers, &raw) && tl_modbus_decode(channel, registers, &value);
    if (is_no_value(&plain, registers, raw, is_number)) {
        return TL_PROBE_NO_VALUE;
    }
    if (!is_number) {
        return channel->code_count > 0 ? TL_PROBE_NO_VALUE : TL_PROBE_ABSURD;
    }
    if (channel->type == TL_MODBUS_BIT || channel->type == TL_MODBUS_REGISTER_BIT) {
        return value < signal->minimum || value > signal->maximum ? log(FAULTY) : 0;
    }
    if (!(fabs(raw) > 0)) {
        return evidence_of_zero(signal, at_start);
    }
    return is_absurd(signal, value) ? TL_PROBE_ABSURD
           : fabs(value) > 0        ? evidence_of_value(signal, value, at_start)
                                    : 0;
}
