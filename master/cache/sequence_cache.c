/* Sequence cache: see sequence_cache.h. */
#include "master/cache/sequence_cache.h"

#include <string.h>

/* Bytes of key and value of one node, plus one so that they are never zero. */
static size_t room(const tl_sequence_cache *cache) {
    return cache->key_size + cache->value_size + 1;
}

bool tl_sequence_cache_init(tl_sequence_cache *cache, tl_arena *arena, size_t key_size, size_t value_size,
                            uint32_t capacity) {
    *cache = (tl_sequence_cache){.key_size = key_size, .value_size = value_size, .capacity = capacity};
    cache->nodes = tl_arena_take(arena, capacity, sizeof *cache->nodes);
    cache->bytes = tl_arena_take(arena, capacity, room(cache));
    cache->spare = tl_arena_take(arena, capacity, sizeof(fmi2FMUstate));
    if (cache->nodes == NULL || cache->bytes == NULL || cache->spare == NULL) {
        return false;
    }
    for (uint32_t i = 0; i < capacity; i++) {
        cache->nodes[i].sibling = i + 1 < capacity ? i + 1 : TL_NO_NODE;
    }
    return true;
}

size_t tl_sequence_cache_memory(const tl_sequence_cache *cache) {
    return cache->capacity * (sizeof *cache->nodes + sizeof(fmi2FMUstate) + room(cache));
}

static unsigned char *bytes_of(const tl_sequence_cache *cache, uint32_t node) {
    return cache->bytes + (size_t)node * (cache->key_size + cache->value_size);
}

const unsigned char *tl_sequence_cache_key(const tl_sequence_cache *cache, uint32_t node) {
    return bytes_of(cache, node);
}

const unsigned char *tl_sequence_cache_value(const tl_sequence_cache *cache, uint32_t node) {
    return bytes_of(cache, node) + cache->key_size;
}

static uint32_t take_node(tl_sequence_cache *cache, uint32_t parent) {
    uint32_t taken = cache->free;
    if (taken == TL_NO_NODE) {
        return TL_NO_NODE;
    }
    tl_sequence_node *node = &cache->nodes[taken];
    cache->free = node->sibling;
    node->parent = parent;
    node->child = TL_NO_NODE;
    node->sibling = TL_NO_NODE;
    node->used = true;
    cache->count++;
    cache->peak = cache->count > cache->peak ? cache->count : cache->peak;
    return taken;
}

uint32_t tl_sequence_cache_create_root(tl_sequence_cache *cache) {
    return take_node(cache, TL_NO_NODE);
}

uint32_t tl_sequence_cache_find(const tl_sequence_cache *cache, uint32_t node, const void *key) {
    uint32_t child = cache->nodes[node].child;
    while (child != TL_NO_NODE && memcmp(bytes_of(cache, child), key, cache->key_size) != 0) {
        child = cache->nodes[child].sibling;
    }
    return child;
}

uint32_t tl_sequence_cache_add(tl_sequence_cache *cache, uint32_t parent, const void *key, const void *value) {
    uint32_t added = take_node(cache, parent);
    if (added != TL_NO_NODE) {
        memcpy(bytes_of(cache, added), key, cache->key_size);
        memcpy(bytes_of(cache, added) + cache->key_size, value, cache->value_size);
        cache->nodes[added].sibling = cache->nodes[parent].child;
        cache->nodes[parent].child = added;
    }
    return added;
}

fmi2FMUstate tl_sequence_cache_take_spare(tl_sequence_cache *cache) {
    return cache->spare_count == 0 ? NULL : cache->spare[--cache->spare_count];
}

void tl_sequence_cache_put_spare(tl_sequence_cache *cache, fmi2FMUstate state) {
    if (state != NULL) {
        cache->spare[cache->spare_count++] = state;
    }
}

static void free_node(tl_sequence_cache *cache, uint32_t node) {
    cache->nodes[node].used = false;
    tl_sequence_cache_put_spare(cache, cache->nodes[node].state);
    cache->nodes[node].state = NULL;
    cache->nodes[node].sibling = cache->free;
    cache->free = node;
    cache->count--;
}

/* Depth first without recursion: removes leaves from the front of their parent's list until nothing
 * is left. */
void tl_sequence_cache_prune(tl_sequence_cache *cache, uint32_t node) {
    uint32_t at = node;
    while (at != node || cache->nodes[node].child != TL_NO_NODE) {
        if (cache->nodes[at].child != TL_NO_NODE) {
            at = cache->nodes[at].child;
        } else {
            uint32_t parent = cache->nodes[at].parent;
            cache->nodes[parent].child = cache->nodes[at].sibling;
            free_node(cache, at);
            at = parent;
        }
    }
}

void tl_sequence_cache_clear(tl_sequence_cache *cache) {
    for (uint32_t node = 0; node < cache->capacity; node++) {
        if (cache->nodes[node].used) {
            free_node(cache, node);
        }
    }
}

/* Makes `child` the only child of its parent. */
static void keep_only(tl_sequence_cache *cache, uint32_t child) {
    uint32_t parent = cache->nodes[child].parent;
    uint32_t *link = &cache->nodes[parent].child;
    while (*link != child) {
        link = &cache->nodes[*link].sibling;
    }
    *link = cache->nodes[child].sibling;
    tl_sequence_cache_prune(cache, parent);
    cache->nodes[child].sibling = TL_NO_NODE;
    cache->nodes[parent].child = child;
}

/* Each node above `first` has one child by now. */
static void free_above(tl_sequence_cache *cache, uint32_t first) {
    uint32_t above = cache->nodes[first].parent;
    cache->nodes[first].parent = TL_NO_NODE;
    while (above != TL_NO_NODE) {
        uint32_t next = cache->nodes[above].parent;
        free_node(cache, above);
        above = next;
    }
}

void tl_sequence_cache_keep_only(tl_sequence_cache *cache, uint32_t first, uint32_t root) {
    for (uint32_t node = root; cache->nodes[node].parent != TL_NO_NODE; node = cache->nodes[node].parent) {
        keep_only(cache, node);
    }
    free_above(cache, first);
}
