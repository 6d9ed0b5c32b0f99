/* The heap of one FMU: see fmu_heap.h. */
#include "firmware/rollback/fmu_heap.h"

#include <errno.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>

/* Up to LINEAR bytes a class each UNIT, above it PARTS to a doubling. */
enum { UNIT = 16, LINEAR = 1024, LINEAR_LOG = 10, PARTS = 4, PARTS_LOG = 2, DOUBLINGS = 26 };
enum { LINEAR_CLASSES = LINEAR / UNIT, CLASSES = LINEAR_CLASSES + PARTS * DOUBLINGS };

/* So much is made usable at a time, at least. */
enum { PIECE = 64 * 1024 };

/* At the beginning of the range. Places are counted in units from there; 0: none. */
typedef struct directory {
    uint64_t used; /* bytes */
    uint32_t free
        [CLASSES]; /* the block of each class that was given back last; each has the one before in its first bytes */
} directory;

/* Before each block that is given out. */
typedef struct block_head {
    uint32_t class;
    uint32_t shift; /* units from the block's own place to where it was given out: it had to be aligned */
    uint64_t unused;
} block_head;

/* Else blocks are not aligned. */
typedef char head_has_the_size_of_a_unit[sizeof(block_head) == UNIT ? 1 : -1];

static size_t round_up(size_t size, size_t to) {
    return (size + to - 1) / to * to;
}

static directory *directory_of(const tl_fmu_heap *heap) {
    return (directory *)(void *)heap->base;
}

size_t tl_fmu_heap_most(void) {
    return sizeof(void *) > 4 ? (size_t)1 << 30 : (size_t)32 << 20;
}

/* ---- classes ---- */

/* The smallest class that has room for `size` > 0 bytes; CLASSES: none has. */
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

tl_status tl_fmu_heap_open(tl_fmu_heap *heap, size_t reserve, tl_error *error) {
    *heap = (tl_fmu_heap){.reserved = round_up(reserve, PIECE)};
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *range = mmap(NULL, heap->reserved, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (range == MAP_FAILED) {
        return tl_fail(error, TL_TRY_AGAIN, "no addresses for the memory of an FMU: %s", strerror(errno));
    }
    heap->base = range;
    if (!make_usable(heap, sizeof(directory))) {
        tl_fmu_heap_close(heap);
        return tl_fail(error, TL_TRY_AGAIN, "no memory for an FMU: %s", strerror(errno));
    }
    heap->highest = round_up(sizeof(directory), UNIT);
    directory_of(heap)->used = heap->highest;
    return TL_OK;
}

void tl_fmu_heap_close(tl_fmu_heap *heap) {
    if (heap->base != NULL) {
        (void)munmap(heap->base, heap->reserved);
    }
    *heap = (tl_fmu_heap){.base = NULL};
}

size_t tl_fmu_heap_used(const tl_fmu_heap *heap) {
    uint64_t used = directory_of(heap)->used; /* which an FMU may have destroyed */
    return used < heap->highest ? (size_t)used : heap->highest;
}

void tl_fmu_heap_restored(tl_fmu_heap *heap, size_t used) {
    if (used < heap->highest) { /* else it was larger than it is now, and what was copied is all of it */
        memset(heap->base + used, 0, heap->highest - used);
    }
    heap->highest = used;
}

/* ---- blocks ---- */

/* What was never used: a head, and room for the class. NULL: there is none. */
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

static unsigned char *take_from_list(tl_fmu_heap *heap, uint32_t class) {
    directory *all = directory_of(heap);
    unsigned char *block = heap->base + (size_t)all->free[class] * UNIT;
    memcpy(&all->free[class], block, sizeof all->free[class]);
    return block;
}

/* A copy: the block itself may lie anywhere as far as the compiler knows. */
static block_head head_of(const void *block) {
    block_head head;
    memcpy(&head, (const unsigned char *)block - sizeof head, sizeof head);
    return head;
}

/* Held for some instructions. */
static void take_turn(tl_fmu_heap *heap) {
    while (__atomic_test_and_set(&heap->is_taken, __ATOMIC_ACQUIRE)) {
    }
}

static void end_turn(tl_fmu_heap *heap) {
    __atomic_clear(&heap->is_taken, __ATOMIC_RELEASE);
}

void *tl_fmu_heap_take(tl_fmu_heap *heap, size_t size, size_t alignment) {
    size_t more = alignment > UNIT ? alignment : 0;
    if (size > heap->reserved || more > heap->reserved) {
        return NULL;
    }
    uint32_t class = class_of((size == 0 ? 1 : size) + more);
    if (class == CLASSES) {
        return NULL;
    }
    take_turn(heap);
    unsigned char *block = directory_of(heap)->free[class] != 0 ? take_from_list(heap, class) : cut(heap, class);
    end_turn(heap);
    if (block == NULL) {
        return NULL;
    }
    size_t shift = more == 0 ? 0 : round_up((uintptr_t)block, alignment) - (uintptr_t)block;
    const block_head head = {.class = class, .shift = (uint32_t)(shift / UNIT)};
    memcpy(block + shift - sizeof head, &head, sizeof head);
    return block + shift;
}

void tl_fmu_heap_give_back(tl_fmu_heap *heap, void *block) {
    directory *all = directory_of(heap);
    const block_head head = head_of(block);
    uint32_t class = head.class;
    unsigned char *place = (unsigned char *)block - (size_t)head.shift * UNIT;
    if (class >= CLASSES) {
        return; /* it was destroyed: never given out again */
    }
    take_turn(heap);
    memcpy(place, &all->free[class], sizeof all->free[class]);
    all->free[class] = (uint32_t)((size_t)(place - heap->base) / UNIT);
    end_turn(heap);
}

size_t tl_fmu_heap_size(const void *block) {
    const block_head head = head_of(block);
    return head.class < CLASSES ? size_of_class(head.class) - (size_t)head.shift * UNIT : 0;
}
