/* Reads the bytes of one input in sequence, for harnesses that simulate a device.
 *
 * Purpose: each decision of the simulated device takes the next byte. After the last byte all bytes
 *          are 0, so that the same input always has the same effect.
 * Owner:   libFuzzer owns the bytes; there is one input at a time. Thread: one.
 */
#ifndef TL_TESTS_FUZZ_INPUT_H
#define TL_TESTS_FUZZ_INPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Starts with the first of these bytes. */
void tl_fuzz_begin(const uint8_t *data, size_t size);

/* Return the next byte, 0 to 255; or the next four as a word, most significant first. */
unsigned tl_fuzz_take(void);
uint32_t tl_fuzz_take_word(void);

/* Returns true if all bytes were taken. */
bool tl_fuzz_is_over(void);

/* Aborts unless `what` is true: then libFuzzer reports a finding. */
void tl_fuzz_hold(bool what);

#endif
