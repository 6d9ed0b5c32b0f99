/* Sequence cache: a tree of the input sequences of one component; approach 2 of the thesis (4.4.2,
 * algorithm 4).
 *
 * Purpose: a component that starts from the same state with the same inputs gives the same outputs.
 *          Each node stands for one sequence of inputs from the root on. Its key is the last input,
 *          its value the output, and it may hold the saved state after it. Keys are compared bit by
 *          bit; nothing is approximated.
 * Memory:  a fixed pool of nodes from the arena, which never grows. The state handle of a dropped
 *          node is reused for the next state, so that the FMU need not allocate.
 * Cost:    a search is linear in the number of siblings, newest first; dropping is linear in the
 *          number of dropped nodes.
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
    uint32_t child;   /* newest child */
    uint32_t sibling; /* next older sibling; of a free node: next free node */
    bool used;
    fmi2FMUstate state; /* after this sequence; NULL: not saved */
} tl_sequence_node;

typedef struct tl_sequence_cache {
    size_t key_size;
    size_t value_size;
    uint32_t capacity;
    uint32_t count; /* nodes in use */
    uint32_t peak;  /* maximum number of nodes ever in use */
    uint32_t free;  /* first free node */
    uint32_t spare_count;
    fmi2FMUstate *spare; /* state handles without a node; handles of dropped nodes are added here */
    tl_sequence_node *nodes;
    unsigned char *bytes; /* capacity × (key, value) */
} tl_sequence_cache;

/* Creates an empty tree for `capacity` (≥ 2) nodes. Sizes in bytes, 0 is allowed. Returns false if
 * memory is out. */
bool tl_sequence_cache_init(tl_sequence_cache *cache, tl_arena *arena, size_t key_size, size_t value_size,
                            uint32_t capacity);

/* Bytes allocated from the arena, without the FMU's states. */
size_t tl_sequence_cache_memory(const tl_sequence_cache *cache);

/* Creates the root of an empty tree. */
uint32_t tl_sequence_cache_create_root(tl_sequence_cache *cache);

/* Returns the child of a node with this key; TL_NO_NODE if there is none. */
uint32_t tl_sequence_cache_find(const tl_sequence_cache *cache, uint32_t node, const void *key);

/* Adds a child that does not exist yet. Returns TL_NO_NODE if the pool is full. */
uint32_t tl_sequence_cache_add(tl_sequence_cache *cache, uint32_t parent, const void *key, const void *value);

const unsigned char *tl_sequence_cache_key(const tl_sequence_cache *cache, uint32_t node);
const unsigned char *tl_sequence_cache_value(const tl_sequence_cache *cache, uint32_t node);

/* Takes a spare handle for a new state (NULL: there is none); adds a handle to the spare ones. At
 * any time there may be at most one handle per node. */
fmi2FMUstate tl_sequence_cache_take_spare(tl_sequence_cache *cache);
void tl_sequence_cache_put_spare(tl_sequence_cache *cache, fmi2FMUstate state);

/* Drops all nodes except those from `first` down to `root` and all below `root`. `first` is root or
 * one of its ancestors, and has no parent afterwards. */
void tl_sequence_cache_keep_only(tl_sequence_cache *cache, uint32_t first, uint32_t root);

/* Drops all nodes; a new root may be created. */
void tl_sequence_cache_clear(tl_sequence_cache *cache);

/* Drops all nodes below a node. */
void tl_sequence_cache_prune(tl_sequence_cache *cache, uint32_t node);

#endif
