/* Start-up memory: allocated while a twin is built, sealed before its first cycle, released as a
 * whole.
 *
 * Purpose: all sizes are known after configuration, so nothing is allocated in the cycle.
 * Bound:   tl_arena_take() is O(1) amortised; memory is allocated in blocks of at least
 *          TL_ARENA_BLOCK bytes.
 * Thread:  one thread at a time.
 */
#ifndef TL_MASTER_BASE_ARENA_H
#define TL_MASTER_BASE_ARENA_H

#include <stdbool.h>
#include <stddef.h>

enum { TL_ARENA_BLOCK = 64 * 1024 };

typedef struct tl_arena {
    struct tl_arena_block *blocks; /* newest first */
    size_t used;                   /* bytes handed out, alignment included */
    bool sealed;
} tl_arena;

void tl_arena_init(tl_arena *arena);

/* Allocates `count` zeroed objects of `size` bytes, aligned for any type; valid until
 * tl_arena_release(). Returns NULL if the arena is sealed, if count·size overflows, or if memory is
 * out. If `count` is 0, the pointer is valid but must not be dereferenced. */
void *tl_arena_take(tl_arena *arena, size_t count, size_t size);

/* A copy of `text`; NULL as for tl_arena_take(). */
char *tl_arena_text(tl_arena *arena, const char *text);

/* Makes all later calls of tl_arena_take() fail. */
void tl_arena_seal(tl_arena *arena);

/* Bytes handed out so far. */
size_t tl_arena_used(const tl_arena *arena);

/* Frees all memory; the arena can be used again. */
void tl_arena_release(tl_arena *arena);

#endif
