/* The bytes of one input, taken one after the other: for harnesses that stand in for a device.
 *
 * Purpose: what happens is decided by the bytes, in the order in which it is asked. Behind the last one everything is 0, so
 *          that the same bytes always do the same.
 * Owner:   the bytes belong to libFuzzer; there is one input at a time. Thread: one.
 */
#ifndef TL_TESTS_FUZZ_INPUT_H
#define TL_TESTS_FUZZ_INPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* From now on these are taken. */
void tl_fuzz_begin(const uint8_t *data, size_t size);

/* The next byte, 0 to 255; the next four, most significant first. */
unsigned tl_fuzz_take(void);
uint32_t tl_fuzz_take_word(void);

/* Were all of them taken? */
bool tl_fuzz_is_over(void);

/* What must hold whatever the input is: else a finding. */
void tl_fuzz_hold(bool what);

#endif
