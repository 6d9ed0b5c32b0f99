/* Converts numbers between the bits that a device sends and a double. Used by the drivers' codecs.
 *
 * Purpose: two's complement and IEEE 754, independent of the machine's byte order.
 * Bits:    a number of n bits is in the lowest n bits of a uint64_t. Functions that read bits
 *          ignore the higher bits; functions that return bits set the higher bits to 0.
 * Thread:  any. Errors: none.
 */
#ifndef TL_BOARD_IO_BITS_H
#define TL_BOARD_IO_BITS_H

#include <stdint.h>

/* Reads a two's complement number of `width` bits, 1 to 64. If |value| > 2^53, it is rounded to the
 * nearest double. */
double tl_bits_to_signed(uint64_t bits, unsigned width);

double tl_bits_to_float32(uint64_t bits);
double tl_bits_to_float64(uint64_t bits);

/* Rounds to the nearest float32. Finite values out of range saturate at ±FLT_MAX; infinities and
 * NaN are kept. */
uint64_t tl_bits_of_float32(double value);

uint64_t tl_bits_of_float64(double value);

#endif
