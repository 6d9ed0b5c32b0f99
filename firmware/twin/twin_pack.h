/* Ticks and results as they cross between processes: packed, since a tick of two signals needs a tenth of the room that one of 64 has.
 *
 * Sizes:  fixed for a configuration.
 * Trust:  packing copies numbers and judges none; tl_twin_result_is_sound() does.
 * Memory: what is unpacked is written as far as the configuration has signals, matches and adjustments.
 * Thread: pure.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_PACK_H
#define TL_FIRMWARE_TWIN_TWIN_PACK_H

#include <stddef.h>

#include "firmware/twin/twin_step.h"

/* Bytes that any of the two takes at most. */
enum { TL_TWIN_PACKED = 8192 };

size_t tl_twin_packed_tick_size(const tl_config *config);
size_t tl_twin_packed_result_size(const tl_config *config, tl_twin_tells tells);

/* `bytes` has that size, and may lie anywhere. */
void tl_twin_pack_tick(const tl_config *config, const tl_recording_tick *tick, unsigned char *bytes);
void tl_twin_unpack_tick(const tl_config *config, const unsigned char *bytes, tl_recording_tick *tick);
void tl_twin_pack_result(const tl_config *config, tl_twin_tells tells, const tl_twin_result *result,
                         unsigned char *bytes);
void tl_twin_unpack_result(const tl_config *config, tl_twin_tells tells, const unsigned char *bytes,
                           tl_twin_result *result);

#endif
