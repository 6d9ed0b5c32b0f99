/* The rest: what is in an outbox, and nobody is left who records it.
 *
 * Purpose: what is lost at the end of a run is counted, by who has outlived all others.
 * Trust:   none in the outbox, nor in what is said to be taken of it.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_STORE_OUTBOX_REST_H
#define TL_FIRMWARE_STORE_OUTBOX_REST_H

#include <stdint.h>

#include "firmware/store/outbox.h"

/* Samples, steps and events that were not taken, up to the first thing that cannot be. */
uint64_t tl_outbox_rest_count(const tl_outbox_settings *settings, const void *memory, const tl_outbox_taken *taken);

#endif
