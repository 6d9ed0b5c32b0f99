/* Start-up memory in blocks; the newest block is filled from its start. */
#include "master/base/arena.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Alignment for every stored type on every target. */
enum { ALIGNMENT = 16 };

typedef struct tl_arena_block {
    struct tl_arena_block *next;
    size_t size; /* of the payload */
    size_t used;
} tl_arena_block;

static size_t aligned(size_t size) {
    return (size + (ALIGNMENT - 1)) & ~(size_t)(ALIGNMENT - 1);
}

void tl_arena_init(tl_arena *arena) {
    arena->blocks = NULL;
    arena->used = 0;
    arena->sealed = false;
}

static tl_arena_block *add_block(tl_arena *arena, size_t at_least) {
    size_t size = at_least > TL_ARENA_BLOCK ? at_least : TL_ARENA_BLOCK;
    tl_arena_block *block = calloc(1, aligned(sizeof *block) + size);
    if (block != NULL) {
        block->size = size;
        block->next = arena->blocks;
        arena->blocks = block;
    }
    return block;
}

void *tl_arena_take(tl_arena *arena, size_t count, size_t size) {
    if (arena->sealed || (size != 0 && count > (SIZE_MAX / 2) / size)) {
        return NULL;
    }
    size_t bytes = aligned(count * size == 0 ? 1 : count * size);
    tl_arena_block *block = arena->blocks;
    if (block == NULL || block->size - block->used < bytes) {
        block = add_block(arena, bytes);
        if (block == NULL) {
            return NULL;
        }
    }
    unsigned char *payload = (unsigned char *)block + aligned(sizeof *block);
    void *result = payload + block->used;
    block->used += bytes;
    arena->used += bytes;
    return result;
}

char *tl_arena_text(tl_arena *arena, const char *text) {
    size_t size = strlen(text) + 1;
    char *copy = tl_arena_take(arena, size, 1);
    if (copy != NULL) {
        memcpy(copy, text, size);
    }
    return copy;
}

void tl_arena_seal(tl_arena *arena) {
    arena->sealed = true;
}

size_t tl_arena_used(const tl_arena *arena) {
    return arena->used;
}

void tl_arena_release(tl_arena *arena) {
    tl_arena_block *block = arena->blocks;
    while (block != NULL) {
        tl_arena_block *next = block->next;
        free(block);
        block = next;
    }
    tl_arena_init(arena);
}
