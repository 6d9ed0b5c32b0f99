/* Decimal numbers: see csv_number.h. */
#include "board/csv/csv_number.h"

#include <fenv.h>
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* MOST_POWER: the largest power of ten that is exact as a double. MOST_EXPONENT: the exponent of
 * larger ones is not read to its end. BIAS: of the exponent of 2 if the mantissa is an integer. */
enum { MOST_POWER = 22, MOST_EXPONENT = 1000, BIAS = DBL_MAX_EXP + DBL_MANT_DIG - 2 };

/* Up to this value, one more digit fits into 63 bits. */
static const int64_t MOST_DIGITS = INT64_C(99999999999999999);

/* All integers up to 2^53 are exact as a double. */
static const int64_t EXACT = INT64_C(1) << DBL_MANT_DIG;

static const double tens[MOST_POWER + 1] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                            1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/* A number as it is written: digits times 10^power. */
typedef struct decimal {
    int64_t digits;
    int power;
    bool is_negative;
} decimal;

static bool is_digit(char letter) {
    return letter >= '0' && letter <= '9';
}

/* Returns the end of the digits; stops earlier if they are too many. */
static const char *add_digits(const char *at, decimal *made) {
    for (; is_digit(*at) && made->digits <= MOST_DIGITS; at++) {
        made->digits = 10 * made->digits + (*at - '0');
    }
    return at;
}

static const char *add_exponent(const char *at, decimal *made) {
    const bool is_negative = *at == '-';
    const char *begin = at + (*at == '-' || *at == '+' ? 1 : 0);
    int exponent = 0;
    for (at = begin; is_digit(*at) && exponent < MOST_EXPONENT; at++) {
        exponent = 10 * exponent + (*at - '0');
    }
    made->power += is_negative ? -exponent : exponent;
    return at > begin ? at : NULL;
}

/* Returns true if the whole text is a number that `made` has room for. */
static bool split_text(const char *text, decimal *made) {
    *made = (decimal){.is_negative = *text == '-'};
    const char *begin = text + (*text == '-' || *text == '+' ? 1 : 0);
    const char *at = add_digits(begin, made);
    bool has_digits = at > begin;
    if (*at == '.') {
        begin = at + 1;
        at = add_digits(begin, made);
        made->power = (int)(begin - at);
        has_digits = has_digits || at > begin;
    }
    if (has_digits && (*at == 'e' || *at == 'E')) {
        at = add_exponent(at + 1, made);
    }
    return has_digits && at != NULL && *at == '\0';
}

/* Divides digits above 2^53 by 10^power and rounds to the nearest double. The quotient of the
 * rounded digits is at most one unit in the last place away from it. So the exact remainder
 * digits·2^shift − mantissa·5^power is below 2^53, and 64 bits that overflow still hold it. The
 * remainder is never half of the divisor, because 5^power is odd. */
static bool divide_long(int64_t digits, int power, double *quotient) {
    const uint64_t hidden = UINT64_C(1) << (DBL_MANT_DIG - 1);
    uint64_t bits = 0;
    *quotient = (double)digits / tens[power];
    memcpy(&bits, quotient, sizeof bits);
    const uint64_t mantissa = (bits & (hidden - 1)) | hidden;
    const int shift = BIAS - (int)(bits >> (DBL_MANT_DIG - 1)) - power;
    if (shift < 0 || mantissa == hidden || fegetround() != FE_TONEAREST) {
        return false; /* below a power of two, the units are smaller */
    }
    const int64_t divisor = (int64_t)(tens[power] / (double)(1 << power)); /* 5^power */
    const int64_t remainder = (int64_t)(((uint64_t)digits << shift) - mantissa * (uint64_t)divisor);
    bits += 2 * remainder > divisor ? 1U : 0U;
    bits -= 2 * remainder < -divisor ? 1U : 0U;
    memcpy(quotient, &bits, sizeof bits);
    return true;
}

/* Up to 2^53, both operands of the one operation are exact. So it rounds once, in any rounding mode
 * (W. D. Clinger: How to Read Floating Point Numbers Accurately, 1990). */
static bool convert(const decimal *made, double *number) {
    if (made->power < -MOST_POWER || made->power > MOST_POWER) {
        return false;
    }
    if (made->digits > EXACT) {
        bool is_done = made->power < 0 && divide_long(made->digits, -made->power, number);
        *number = made->is_negative ? -*number : *number;
        return is_done;
    }
    const double digits = made->is_negative ? -(double)made->digits : (double)made->digits;
    *number = made->power < 0 ? digits / tens[-made->power] : digits * tens[made->power];
    return true;
}

/* Converts with strtod(), which would also accept words and hexadecimal numbers. */
static bool convert_slowly(const char *text, double *number) {
    char *end = NULL;
    *number = 0;
    if (text[0] == '\0' || text[strspn(text, "+-.0123456789eE")] != '\0') {
        return false;
    }
    double value = strtod(text, &end);
    if (*end != '\0' || !isfinite(value)) {
        return false;
    }
    *number = value;
    return true;
}

bool tl_csv_number_read(const char *text, double *number) {
    const bool rounds_once = FLT_EVAL_METHOD == 0; /* a wider format would round again to a double */
    decimal made;
    return (rounds_once && split_text(text, &made) && convert(&made, number)) || convert_slowly(text, number);
}
