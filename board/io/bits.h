/* Bits of a number as a device sends them, and the number. Pure arithmetic for the drivers' codecs.
 *
 * Purpose: two's complement and IEEE 754, independent of the machine.
 * Bits:    the lowest bits of 64; higher bits are 0 and are ignored.
 * Thread:  any. Errors: none.
 */
#ifndef TL_BOARD_IO_BITS_H
#define TL_BOARD_IO_BITS_H

#include <stdint.h>

/* Two's complement of `width` bits, 1 to 64; above 53 the value is rounded to a double. */
double tl_bits_to_signed(uint64_t bits, unsigned width);

double tl_bits_to_float32(uint64_t bits);
double tl_bits_to_float64(uint64_t bits);

/* Nearest value for a finite number: out of range saturates. Infinities and NaN are kept. */
uint64_t tl_bits_of_float32(double value);

uint64_t tl_bits_of_float64(double value);

#endif
