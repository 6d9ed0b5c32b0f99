/* Bits and numbers: see bits.h. */
#include "board/io/bits.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

double tl_bits_to_signed(uint64_t bits, unsigned width) {
    assert(width >= 1 && width <= 64);
    uint64_t sign = (uint64_t)1 << (width - 1);
    uint64_t extended = ((bits & (sign | (sign - 1))) ^ sign) - sign;
    int64_t number = 0;
    memcpy(&number, &extended, sizeof number);
    return (double)number;
}

double tl_bits_to_float32(uint64_t bits) {
    uint32_t word = (uint32_t)bits;
    float value = 0;
    memcpy(&value, &word, sizeof value);
    return (double)value;
}

double tl_bits_to_float64(uint64_t bits) {
    double value = 0;
    memcpy(&value, &bits, sizeof value);
    return value;
}

uint64_t tl_bits_of_float32(double value) {
    float nearest = (float)value;
    if (isfinite(value)) {
        nearest = (float)fmin(fmax(value, -(double)FLT_MAX), (double)FLT_MAX);
    }
    uint32_t word = 0;
    memcpy(&word, &nearest, sizeof word);
    return word;
}

uint64_t tl_bits_of_float64(double value) {
    uint64_t bits = 0;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}
