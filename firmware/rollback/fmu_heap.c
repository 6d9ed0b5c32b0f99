/* The heap of an FMU: memory that it allocates comes from a place of its own, so that it can be copied: see fmu_heap.h. */
#include "firmware/rollback/fmu_heap.h"

#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <link.h>
#include <malloc.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdio_ext.h>
#include <stdlib.h>
#include <string.h>
#include <sys/auxv.h>
#include <sys/mman.h>
#include <unistd.h>

/* ---- fmu heap ---- */

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

/* ---- fmu allocation ---- */

__thread tl_fmu_heap *tl_fmu_allocation_heap;

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define HAS_ANOTHER_ALLOCATOR 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define HAS_ANOTHER_ALLOCATOR 1
#endif
#endif

#ifdef HAS_ANOTHER_ALLOCATOR

bool tl_fmu_allocation_serves(void) {
    return false;
}

tl_fmu_heap *tl_fmu_allocation_open(size_t reserve, tl_error *error) {
    (void)reserve;
    (void)tl_fail(error, TL_TRY_AGAIN, "a sanitizer has an allocator of its own");
    return NULL;
}

size_t tl_fmu_allocation_used(void) {
    return 0;
}

#else

/* The C library's own, which has them under other names besides. */
extern void *own_malloc(size_t size) __asm__("__libc_malloc");
extern void *own_calloc(size_t count, size_t size) __asm__("__libc_calloc");
extern void *own_realloc(void *block, size_t size) __asm__("__libc_realloc");
extern void own_free(void *block) __asm__("__libc_free");
extern void *own_memalign(size_t alignment, size_t size) __asm__("__libc_memalign");

enum { ALIGNMENT = 16 };

/* Addresses from `begin` on up to `end`. */
typedef struct range {
    uintptr_t begin;
    uintptr_t end;
} range;

static tl_fmu_heap heaps[TL_FMU_ALLOCATION_HEAPS];
static size_t heap_count;
static range loader;

bool tl_fmu_allocation_serves(void) {
    return true;
}

/* ---- the loader ---- */

static bool is_in(const range *where, const void *address) {
    return (uintptr_t)address - where->begin < where->end - where->begin;
}

/* From its program headers, which the kernel tells where to find. */
static void find_loader(void) {
    const unsigned long address = getauxval(AT_BASE);
    const unsigned char *base = NULL;
    if (loader.end != 0 || address == 0) {
        return;
    }
    memcpy(&base, &address, sizeof base);
    ElfW(Ehdr) head;
    memcpy(&head, base, sizeof head);
    for (size_t i = 0; i < head.e_phnum; i++) {
        ElfW(Phdr) segment;
        memcpy(&segment, base + head.e_phoff + i * sizeof segment, sizeof segment);
        uintptr_t end = (uintptr_t)base + segment.p_vaddr + segment.p_memsz;
        loader.end = segment.p_type == PT_LOAD && end > loader.end ? end : loader.end;
    }
    loader.begin = (uintptr_t)base;
}

/* ---- whose it is ---- */

/* A stream of everybody's asks for its buffer when it is first used: that must not be in a call of an FMU. */
static void give_buffers(void) {
    static char buffer[BUFSIZ];
    static char read[BUFSIZ];
    if (__fbufsize(stdin) == 0) {
        (void)setvbuf(stdin, read, _IOFBF, sizeof read);
    }
    if (__fbufsize(stdout) == 0) {
        (void)setvbuf(stdout, buffer, isatty(STDOUT_FILENO) == 1 ? _IOLBF : _IOFBF, sizeof buffer);
    }
}

tl_fmu_heap *tl_fmu_allocation_open(size_t reserve, tl_error *error) {
    tl_fmu_heap *heap = &heaps[heap_count];
    if (heap_count == TL_FMU_ALLOCATION_HEAPS) {
        (void)tl_fail(error, TL_TRY_AGAIN, "an FMU has no memory of its own: %d have at most",
                      (int)TL_FMU_ALLOCATION_HEAPS);
        return NULL;
    }
    find_loader();
    give_buffers();
    if (tl_fmu_heap_open(heap, reserve, error) != TL_OK) {
        return NULL;
    }
    __atomic_store_n(&heap_count, heap_count + 1, __ATOMIC_RELEASE);
    return heap;
}

size_t tl_fmu_allocation_used(void) {
    size_t sum = 0;
    for (size_t i = 0; i < heap_count; i++) {
        sum += tl_fmu_heap_used(&heaps[i]);
    }
    return sum;
}

/* NULL: the C library's. */
static tl_fmu_heap *find_owner(const void *block) {
    size_t count = __atomic_load_n(&heap_count, __ATOMIC_ACQUIRE);
    for (size_t i = 0; i < count; i++) {
        if (tl_fmu_heap_holds(&heaps[i], block)) {
            return &heaps[i];
        }
    }
    return NULL;
}

/* The heap that serves who has called from `caller`; NULL: the C library does. */
static inline tl_fmu_heap *find_server(const void *caller) {
    tl_fmu_heap *heap = tl_fmu_allocation_heap;
    return heap == NULL || is_in(&loader, caller) ? NULL : heap;
}

static void *take(tl_fmu_heap *heap, size_t size, size_t alignment) {
    void *block = tl_fmu_heap_take(heap, size, alignment);
    if (block == NULL) {
        block = own_memalign(alignment, size);
        heap->is_not_all = heap->is_not_all || block != NULL;
    }
    return block;
}

/* ---- the family ---- */

#define CALLER __builtin_return_address(0)

// NOLINTBEGIN(readability-inconsistent-declaration-parameter-name): the C library's headers call them otherwise

void *malloc(size_t size) {
    tl_fmu_heap *heap = find_server(CALLER);
    return heap == NULL ? own_malloc(size) : take(heap, size, ALIGNMENT);
}

void *calloc(size_t count, size_t size) {
    tl_fmu_heap *heap = find_server(CALLER);
    size_t all = 0;
    if (heap == NULL) {
        return own_calloc(count, size);
    }
    if (__builtin_mul_overflow(count, size, &all)) {
        errno = ENOMEM;
        return NULL;
    }
    void *block = take(heap, all, ALIGNMENT);
    return block == NULL ? NULL : memset(block, 0, all);
}

void free(void *block) {
    tl_fmu_heap *owner = find_owner(block);
    if (owner == NULL) {
        own_free(block);
    } else {
        tl_fmu_heap_give_back(owner, block);
    }
}

void *realloc(void *block, size_t size) {
    tl_fmu_heap *owner = block == NULL ? find_server(CALLER) : find_owner(block);
    if (owner == NULL) {
        return own_realloc(block, size);
    }
    size_t before = block == NULL ? 0 : tl_fmu_heap_size(block);
    if (block != NULL && size == 0) {
        tl_fmu_heap_give_back(owner, block);
        return NULL;
    }
    if (block != NULL && size <= before && size > before / 2) {
        return block;
    }
    void *other = take(owner, size, ALIGNMENT);
    if (other != NULL && block != NULL) {
        memcpy(other, block, before < size ? before : size);
        tl_fmu_heap_give_back(owner, block);
    }
    return other;
}

static void *take_aligned(size_t alignment, size_t size, const void *caller) {
    tl_fmu_heap *heap = find_server(caller);
    return heap == NULL ? own_memalign(alignment, size)
                        : take(heap, size, alignment > ALIGNMENT ? alignment : ALIGNMENT);
}

static bool is_power_of_two(size_t number) {
    return number != 0 && (number & (number - 1)) == 0;
}

void *memalign(size_t alignment, size_t size) {
    size_t power = ALIGNMENT;
    while (power < alignment && power <= SIZE_MAX / 4) {
        power *= 2;
    }
    return take_aligned(power, size, CALLER);
}

void *aligned_alloc(size_t alignment, size_t size) {
    if (!is_power_of_two(alignment)) {
        errno = EINVAL;
        return NULL;
    }
    return take_aligned(alignment, size, CALLER);
}

int posix_memalign(void **block, size_t alignment, size_t size) {
    if (!is_power_of_two(alignment) || alignment % sizeof(void *) != 0) {
        return EINVAL;
    }
    int before = errno; /* which this one does not change */
    void *taken = take_aligned(alignment, size, CALLER);
    errno = before;
    if (taken == NULL) {
        return ENOMEM;
    }
    *block = taken;
    return 0;
}

static size_t page_size(void) {
    return (size_t)sysconf(_SC_PAGESIZE);
}

void *valloc(size_t size) {
    return take_aligned(page_size(), size, CALLER);
}

void *pvalloc(size_t size) {
    size_t page = page_size();
    if (size > SIZE_MAX - page) {
        errno = ENOMEM;
        return NULL;
    }
    return take_aligned(page, (size + page - 1) / page * page, CALLER);
}

/* POSIX makes an address a function pointer; ISO C knows no cast for that. */
static void find_next(const char *name, void *function, size_t size) {
    void *address = dlsym(RTLD_NEXT, name);
    memcpy(function, &address, size);
}

size_t malloc_usable_size(void *block) {
    static size_t (*next)(void *);
    if (block == NULL) {
        return 0;
    }
    if (find_owner(block) != NULL) {
        return tl_fmu_heap_size(block);
    }
    if (next == NULL) {
        find_next("malloc_usable_size", (void *)&next, sizeof next);
    }
    return next(block);
}

/* ---- threads ---- */

/* What a thread of the FMU's allocates is in no heap, and nobody can put a thread back to where it was. */
int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*run)(void *), void *context) {
    static int (*next)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    if (next == NULL) {
        find_next("pthread_create", (void *)&next, sizeof next);
    }
    if (tl_fmu_allocation_heap != NULL) {
        tl_fmu_allocation_heap->has_threads = true;
    }
    return next(thread, attributes, run, context);
}

/* ---- memory that is mapped ---- */

void *sbrk(intptr_t more) {
    static void *(*next)(intptr_t);
    if (next == NULL) {
        find_next("sbrk", (void *)&next, sizeof next);
    }
    if (more != 0 && tl_fmu_allocation_heap != NULL) {
        tl_fmu_allocation_heap->is_not_all = true;
    }
    return next(more);
}

/* Under both names that it has: one for offsets of 64 bits, and one for those of a word. */
typedef void *map_function(void *address, size_t size, int protection, int flags, int file, off_t offset);
typedef void *map_word_function(void *address, size_t size, int protection, int flags, int file, long offset);
map_word_function tl_fmu_allocation_map __asm__("mmap");

static void note_map(const void *caller, int protection) {
    tl_fmu_heap *heap = find_server(caller);
    if (heap != NULL && (protection & PROT_WRITE) != 0) {
        heap->is_not_all = true;
    }
}

void *mmap(void *address, size_t size, int protection, int flags, int file, off_t offset) {
    static map_function *next;
    if (next == NULL) {
        find_next("mmap64", (void *)&next, sizeof next);
    }
    note_map(CALLER, protection);
    return next(address, size, protection, flags, file, offset);
}

void *tl_fmu_allocation_map(void *address, size_t size, int protection, int flags, int file, long offset) {
    static map_word_function *next;
    if (next == NULL) {
        find_next("mmap", (void *)&next, sizeof next);
    }
    note_map(CALLER, protection);
    return next(address, size, protection, flags, file, offset);
}

// NOLINTEND(readability-inconsistent-declaration-parameter-name)

#endif
