/* One tree of input sequences of one component: approach 2 of the thesis (4.4.2, algorithm 4).
 *
 * Purpose: a component that starts from the same state and receives the same inputs gives the same outputs. Each node
 *          stands for one sequence of inputs from the root on: its key is the last input, its value what came out of it,
 *          and it may carry a saved state of the FMU behind it. Keys are compared bit by bit; nothing is ever
 *          approximated.
 * Memory:  a fixed pool of nodes from the arena; a full pool refuses, it never grows. The handle of a node that is given up
 *          becomes a spare one for the next state, so that the FMU need not allocate.
 * Cost:    finding is linear in the number of siblings, newest first; keeping is linear in the number of nodes given up.
 * Thread:  the twin's.
 */
#ifndef TL_MASTER_CACHE_SEQUENCE_CACHE_H
#define TL_MASTER_CACHE_SEQUENCE_CACHE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/fmi/fmi2.h"

/* No node. */
#define TL_NO_NODE UINT32_MAX

typedef struct tl_sequence_node {
    uint32_t parent;
    uint32_t child;   /* newest */
    uint32_t sibling; /* older; also the list of free nodes */
    bool used;
    fmi2FMUstate state; /* behind this sequence; NULL: not saved */
} tl_sequence_node;

typedef struct tl_sequence_cache {
    size_t key_size;
    size_t value_size;
    uint32_t capacity;
    uint32_t count; /* nodes in use */
    uint32_t peak;  /* the most there ever were */
    uint32_t free;  /* first free node */
    uint32_t spare_count;
    fmi2FMUstate *spare; /* handles without a node, the FMU's; those of nodes in use come back here */
    tl_sequence_node *nodes;
    unsigned char *bytes; /* capacity × (key, value) */
} tl_sequence_cache;

/* An empty tree with room for `capacity` (≥ 2) nodes; false when memory is out. Sizes in bytes, 0 is allowed. */
bool tl_sequence_cache_init(tl_sequence_cache *cache, tl_arena *arena, size_t key_size, size_t value_size,
                            uint32_t capacity);

/* Bytes that it took from the arena. The FMU's states are the FMU's. */
size_t tl_sequence_cache_memory(const tl_sequence_cache *cache);

/* A node without a parent: where all sequences begin. The tree must be empty. */
uint32_t tl_sequence_cache_plant(tl_sequence_cache *cache);

/* The child of a node by its key; TL_NO_NODE where there is none. */
uint32_t tl_sequence_cache_find(const tl_sequence_cache *cache, uint32_t node, const void *key);

/* Adds a child that is not there yet; TL_NO_NODE where the pool is full. */
uint32_t tl_sequence_cache_add(tl_sequence_cache *cache, uint32_t parent, const void *key, const void *value);

const unsigned char *tl_sequence_cache_key(const tl_sequence_cache *cache, uint32_t node);
const unsigned char *tl_sequence_cache_value(const tl_sequence_cache *cache, uint32_t node);

/* A spare handle to save a state in, or NULL; and one that is not in use any more. There must never be more than one for each
 * node. */
fmi2FMUstate tl_sequence_cache_take_spare(tl_sequence_cache *cache);
void tl_sequence_cache_put_spare(tl_sequence_cache *cache, fmi2FMUstate state);

/* Gives up all nodes but those on the way from `first` down to `root` and all below `root`. `first` is root or an
 * ancestor of it; it has no parent afterwards. */
void tl_sequence_cache_keep(tl_sequence_cache *cache, uint32_t first, uint32_t root);

/* Gives up all nodes: the tree is empty, and may be planted anew. */
void tl_sequence_cache_clear(tl_sequence_cache *cache);

/* Gives up everything below a node. */
void tl_sequence_cache_prune(tl_sequence_cache *cache, uint32_t node);

#endif
