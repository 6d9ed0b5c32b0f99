/* The heap of an FMU, see fmu_heap.h. */
#include "firmware/rollback/fmu_heap.h"

#include <errno.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

/* ---- heap ---- */

/* Up to LINEAR bytes: one class per UNIT. Above: PARTS classes per doubling. */
enum { UNIT = 16, LINEAR = 1024, LINEAR_LOG = 10, PARTS = 4, PARTS_LOG = 2, DOUBLINGS = 26 };
enum { LINEAR_CLASSES = LINEAR / UNIT, CLASSES = LINEAR_CLASSES + PARTS * DOUBLINGS };

/* Smallest part that is made usable at once. */
enum { PIECE = 64 * 1024 };

enum { SPINS = 1000, SHORT_WAIT_NS = 50 * 1000 };

/* Mappings are aligned to pages of this size, on any machine. */
enum { PAGE = 4096 };

/* Lies at the beginning of the range. Positions are counted in units from there; 0: none. */
typedef struct directory {
    uint64_t used; /* bytes */
    uint32_t free
        [CLASSES]; /* the block of each class that was freed last; each contains the previous one in its first bytes */
    uint32_t mapped; /* the mapping that was made last; each head contains the previous one */
} directory;

/* Precedes each allocated block. */
typedef struct block_head {
    uint32_t class;
    uint32_t shift; /* units from the start of the block to the aligned address that was returned */
    uint32_t pages; /* of a mapping, else 0 */
    uint32_t next;  /* mapping made before this one */
} block_head;

/* Otherwise blocks would not be aligned. */
typedef char head_has_the_size_of_a_unit[sizeof(block_head) == UNIT ? 1 : -1];

static size_t round_up(size_t size, size_t to) {
    return (size + to - 1) / to * to;
}

static directory *directory_of(const tl_fmu_heap *heap) {
    return (directory *)(void *)heap->base;
}

/* ---- classes ---- */

/* The smallest class with room for `size` > 0 bytes; CLASSES: none is large enough. */
static uint32_t class_of(size_t size) {
    if (size <= LINEAR) {
        return (uint32_t)((size + UNIT - 1) / UNIT - 1);
    }
    unsigned log = (unsigned)(8 * sizeof size) - 1 - (unsigned)__builtin_clzl(size - 1); /* 2^log ≤ size − 1 */
    size_t part = ((size - 1) >> (log - PARTS_LOG)) & (PARTS - 1);
    size_t class = LINEAR_CLASSES + (size_t)PARTS * (log - LINEAR_LOG) + part;
    return class < CLASSES ? (uint32_t) class : CLASSES;
}

static size_t size_of_class(uint32_t class) {
    if (class < LINEAR_CLASSES) {
        return ((size_t) class + 1) * UNIT;
    }
    uint32_t above = class - LINEAR_CLASSES;
    size_t begin = (size_t)LINEAR << (above / PARTS);
    return begin + (begin >> PARTS_LOG) * (above % PARTS + 1);
}

/* ---- the range ---- */

static bool make_usable(tl_fmu_heap *heap, size_t end) {
    if (end <= heap->usable) {
        return true;
    }
    size_t grown = round_up(end, PIECE);
    if (grown > heap->reserved ||
        mprotect(heap->base + heap->usable, grown - heap->usable, PROT_READ | PROT_WRITE) != 0) {
        return false;
    }
    heap->usable = grown;
    return true;
}

/* Results of some FMUs depend on addresses. So heaps get the same ones in each run if they are
 * free: from 64 GiB on, which no machine with 64 bits uses by itself. 0: any. */
static void *choose_address(size_t size) {
    static uint64_t next = sizeof(void *) > 4 ? (uint64_t)64 << 30 : 0;
    uint64_t chosen = next;
    void *address = NULL;
    next += chosen != 0 ? size : 0;
    memcpy(&address, &chosen, sizeof address); /* with 32 bits: NULL */
    return address;
}

tl_status tl_fmu_heap_open(tl_fmu_heap *heap, size_t reserve, tl_error *error) {
    *heap = (tl_fmu_heap){.reserved = round_up(reserve, PIECE)};
    void *address = choose_address(heap->reserved);
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *range = mmap(address, heap->reserved, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (range == MAP_FAILED) {
        return tl_fail(error, TL_TRY_AGAIN, "no address range for the heap of an FMU: %s", strerror(errno));
    }
    heap->base = range;
    if (!make_usable(heap, sizeof(directory))) {
        (void)tl_fail(error, TL_TRY_AGAIN, "not enough memory for the heap of an FMU: %s", strerror(errno));
        (void)munmap(heap->base, heap->reserved);
        return TL_TRY_AGAIN;
    }
    heap->highest = round_up(sizeof(directory), UNIT);
    directory_of(heap)->used = heap->highest;
    return TL_OK;
}

size_t tl_fmu_heap_used(const tl_fmu_heap *heap) {
    uint64_t used = directory_of(heap)->used; /* an FMU may have overwritten it */
    return used < heap->highest ? (size_t)used : heap->highest;
}

void tl_fmu_heap_restored(tl_fmu_heap *heap, size_t used) {
    if (used < heap->highest) { /* else the copy has overwritten all of it */
        memset(heap->base + used, 0, heap->highest - used);
    }
    heap->highest = used;
}

/* ---- blocks ---- */

/* Cuts a new block from the unused part. Returns NULL if the heap is full. */
static unsigned char *cut(tl_fmu_heap *heap, uint32_t class) {
    directory *all = directory_of(heap);
    size_t begin = (size_t)all->used;
    size_t need = sizeof(block_head) + size_of_class(class);
    if (begin > heap->reserved || need > heap->reserved - begin || !make_usable(heap, begin + need)) {
        return NULL;
    }
    all->used = begin + need;
    heap->highest = all->used > heap->highest ? (size_t)all->used : heap->highest;
    return heap->base + begin + sizeof(block_head);
}

/* Copies the head, because the compiler cannot assume that the address is aligned for it. */
static block_head head_of(const void *block) {
    block_head head;
    memcpy(&head, (const unsigned char *)block - sizeof head, sizeof head);
    return head;
}

/* Spin lock, held for some instructions only. A thread that waits longer sleeps, because its owner
 * may have a lower priority on the same processor. */
static void lock_heap(tl_fmu_heap *heap) {
    for (unsigned tries = 1; __atomic_test_and_set(&heap->is_taken, __ATOMIC_ACQUIRE); tries++) {
        if (tries % SPINS == 0) {
            (void)nanosleep(&(struct timespec){.tv_nsec = SHORT_WAIT_NS}, NULL);
        }
    }
}

static void unlock_heap(tl_fmu_heap *heap) {
    __atomic_clear(&heap->is_taken, __ATOMIC_RELEASE);
}

/* As tl_fmu_heap_allocate(). *is_new: the block was never used, so it is zero. */
static void *take_block(tl_fmu_heap *heap, size_t size, size_t alignment, bool *is_new) {
    size_t more = alignment > UNIT ? alignment : 0;
    if (size > heap->reserved || more > heap->reserved) {
        return NULL;
    }
    uint32_t class = class_of((size == 0 ? 1 : size) + more);
    if (class == CLASSES) {
        return NULL;
    }
    lock_heap(heap);
    uint32_t *free_block = &directory_of(heap)->free[class];
    *is_new = *free_block == 0;
    unsigned char *block = *free_block != 0 ? heap->base + (size_t)*free_block * UNIT : cut(heap, class);
    if (*free_block != 0) {
        memcpy(free_block, block, sizeof *free_block);
    }
    unlock_heap(heap);
    if (block == NULL) {
        return NULL;
    }
    size_t shift = more == 0 ? 0 : round_up((uintptr_t)block, alignment) - (uintptr_t)block;
    const block_head head = {.class = class, .shift = (uint32_t)(shift / UNIT)};
    memcpy(block + shift - sizeof head, &head, sizeof head);
    return block + shift;
}

void *tl_fmu_heap_allocate(tl_fmu_heap *heap, size_t size, size_t alignment) {
    bool is_new = false;
    return take_block(heap, size, alignment, &is_new);
}

void tl_fmu_heap_release(tl_fmu_heap *heap, void *block) {
    directory *all = directory_of(heap);
    const block_head head = head_of(block);
    uint32_t class = head.class;
    unsigned char *address_of_block = (unsigned char *)block - (size_t)head.shift * UNIT;
    if (class >= CLASSES) {
        return; /* the head was overwritten: the block is never used again */
    }
    lock_heap(heap);
    heap->was_written = true; /* also between calls */
    memcpy(address_of_block, &all->free[class], sizeof all->free[class]);
    all->free[class] = (uint32_t)((size_t)(address_of_block - heap->base) / UNIT);
    unlock_heap(heap);
}

size_t tl_fmu_heap_size(const void *block) {
    const block_head head = head_of(block);
    return head.class < CLASSES ? size_of_class(head.class) - (size_t)head.shift * UNIT : 0;
}

/* ---- mappings ---- */

static uint32_t position_of(const tl_fmu_heap *heap, const void *address) {
    return (uint32_t)((size_t)((const unsigned char *)address - heap->base) / UNIT);
}

void *tl_fmu_heap_map(tl_fmu_heap *heap, size_t size) {
    bool is_new = false;
    if (size == 0 || size > heap->reserved) {
        return NULL;
    }
    unsigned char *mapping = take_block(heap, round_up(size, PAGE), PAGE, &is_new);
    if (mapping == NULL) {
        return NULL;
    }
    if (!is_new) {
        memset(mapping, 0, round_up(size, PAGE));
    }
    lock_heap(heap);
    block_head head = head_of(mapping);
    head.pages = (uint32_t)(round_up(size, PAGE) / PAGE);
    head.next = directory_of(heap)->mapped;
    memcpy(mapping - sizeof head, &head, sizeof head);
    directory_of(heap)->mapped = position_of(heap, mapping);
    unlock_heap(heap);
    return mapping;
}

/* Finds the link to a mapping: in the directory, or in the head of a later mapping. Returns NULL if
 * the address is not the start of one. The search is bounded, because an FMU may have overwritten a
 * head. */
static uint32_t *find_mapping(tl_fmu_heap *heap, const void *address) {
    uint32_t *link = &directory_of(heap)->mapped;
    for (size_t i = 0; i < heap->reserved / PAGE && *link != 0 && *link < heap->reserved / UNIT; i++) {
        unsigned char *mapping = heap->base + (size_t)*link * UNIT;
        if (mapping == address) {
            return link;
        }
        link = (uint32_t *)(void *)(mapping - sizeof(block_head) + offsetof(block_head, next));
    }
    return NULL;
}

void tl_fmu_heap_unmap(tl_fmu_heap *heap, void *address, size_t size) {
    lock_heap(heap);
    uint32_t *link = find_mapping(heap, address);
    bool is_whole = link != NULL && head_of(address).pages <= (size + PAGE - 1) / PAGE;
    if (is_whole) {
        *link = head_of(address).next;
    }
    unlock_heap(heap);
    if (is_whole) {
        tl_fmu_heap_release(heap, address);
    }
}
