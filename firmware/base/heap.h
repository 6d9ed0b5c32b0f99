/* How much memory of this process is allocated.
 *
 * Purpose: what an FMU's saved state takes, it seldom says; what the heap grows by when one is made, does.
 * Limits:  what is allocated by malloc() and its like, in any thread. An FMU with an allocator of its own is not seen.
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_BASE_HEAP_H
#define TL_FIRMWARE_BASE_HEAP_H

#include <stddef.h>

/* Bytes, the allocator's own among them. */
size_t tl_heap_used(void);

#endif
