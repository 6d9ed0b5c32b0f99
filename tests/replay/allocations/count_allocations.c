/* Counts what a process of twinlock asks the C library's allocator for: to be preloaded (LD_PRELOAD). test_allocations.py reads the counts.
 *
 * The program's own malloc() and its like lead on to these functions, unless an FMU's own heap serves the call. A count stands in a file that TL_TEST_ALLOCATIONS names, which is mapped before the
 * process gives up its rights. */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { SLOTS = 64, TEXT = 112 };

/* One process's. */
typedef struct slot {
    atomic_llong is_taken;
    atomic_llong count;
    char title[TEXT]; /* its first word */
} slot;

#define EXPORTED __attribute__((visibility("default")))

static slot *own;

static void __attribute__((constructor)) begin(int argc, char **argv) {
    const char *path = getenv("TL_TEST_ALLOCATIONS");
    int file = path != NULL ? open(path, O_RDWR | O_CLOEXEC) : -1;
    slot *slots =
        file >= 0 ? mmap(NULL, SLOTS * sizeof *slots, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0) : MAP_FAILED;
    for (int i = 0; slots != MAP_FAILED && i < SLOTS && own == NULL; i++) {
        own = atomic_exchange(&slots[i].is_taken, 1) == 0 ? &slots[i] : NULL;
    }
    if (own != NULL && argc > 0) {
        strncpy(own->title, argv[0], TEXT - 1);
    }
    if (file >= 0) {
        (void)close(file);
    }
}

static void count(void) {
    if (own != NULL) {
        atomic_fetch_add(&own->count, 1);
    }
}

EXPORTED void *__libc_malloc(size_t size) {
    static void *(*next)(size_t);
    next = next != NULL ? next : (void *(*)(size_t))dlsym(RTLD_NEXT, "__libc_malloc");
    count();
    return next(size);
}

EXPORTED void *__libc_calloc(size_t number, size_t size) {
    static void *(*next)(size_t, size_t);
    next = next != NULL ? next : (void *(*)(size_t, size_t))dlsym(RTLD_NEXT, "__libc_calloc");
    count();
    return next(number, size);
}

EXPORTED void *__libc_realloc(void *block, size_t size) {
    static void *(*next)(void *, size_t);
    next = next != NULL ? next : (void *(*)(void *, size_t))dlsym(RTLD_NEXT, "__libc_realloc");
    count();
    return next(block, size);
}

EXPORTED void *__libc_memalign(size_t alignment, size_t size) {
    static void *(*next)(size_t, size_t);
    next = next != NULL ? next : (void *(*)(size_t, size_t))dlsym(RTLD_NEXT, "__libc_memalign");
    count();
    return next(alignment, size);
}
