/* Where the values of a call stand in a message: private to forked_calls.c and forked_answer.c, which must mean the same.
 *
 * Values first, from the beginning on: they need alignment most; then their references. Of a step: Reals that are set, Reals that are read, then the
 * references of both.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_LAYOUT_H
#define TL_FIRMWARE_FORKED_FORKED_LAYOUT_H

#include "firmware/forked/forked_block.h"
#include "master/fmi/fmi2.h"

/* numbers[] of a message. */
enum { TL_FORKED_COUNT, TL_FORKED_READ, TL_FORKED_FLAG, TL_FORKED_DONE };

/* Whether `count` values of `size` bytes fit, with their references. */
static inline bool tl_forked_fits(size_t count, size_t size) {
    return count <= TL_FORKED_BYTES / (size + sizeof(fmi2ValueReference));
}

static inline fmi2ValueReference *tl_forked_references(tl_forked_message *message, size_t count, size_t size) {
    return (fmi2ValueReference *)(void *)(message->bytes + count * size);
}

#endif
