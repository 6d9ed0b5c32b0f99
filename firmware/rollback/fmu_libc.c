/* Functions of the C library for calls of FMUs, see fmu_libc.h. */
#include "firmware/rollback/fmu_libc.h"

#include <dirent.h>
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <iconv.h>
#include <libintl.h>
#include <limits.h>
#include <link.h>
#include <locale.h>
#include <malloc.h>
#include <netdb.h>
#include <pthread.h>
#include <pwd.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdio_ext.h>
#include <stdlib.h>
#include <string.h>
#include <sys/auxv.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/timerfd.h>
#include <threads.h>
#include <time.h>
#include <unistd.h>
#include <wchar.h>

#include "firmware/rollback/fmu_heap.h"

/* ---- allocation per thread ---- */

__thread tl_fmu_heap *tl_fmu_libc_heap;

/* ---- random numbers ---- */

/* The same size as in the C library, so that it yields the same numbers. */
enum { STATE = 128, FIRST_SEED = 1 };

/* The first block of a heap; a rollback restores it. */
typedef struct tl_fmu_heap_first {
    struct random_data data;   /* of rand() and random() */
    struct drand48_data words; /* of drand48() and related functions */
    char state[STATE];
    uint32_t logs; /* bits: streams of the heap that the FMU has open */
} random_state;

static void begin_random(random_state *self) {
    memset(self, 0, sizeof *self);
    (void)initstate_r(FIRST_SEED, self->state, sizeof self->state, &self->data);
}

/* ---- which state ---- */

/* Used outside of calls of FMUs with a heap; several threads may use it at a time. */
static random_state common;
static bool common_has_begun;
static bool common_is_taken;

static random_state *take_random_state(void) {
    if (tl_fmu_libc_heap != NULL) {
        return tl_fmu_libc_heap->first;
    }
    while (__atomic_test_and_set(&common_is_taken, __ATOMIC_ACQUIRE)) {
    }
    if (!common_has_begun) {
        begin_random(&common);
        common_has_begun = true;
    }
    return &common;
}

static void swap_random_state(const random_state *state) {
    if (state == &common) {
        __atomic_clear(&common_is_taken, __ATOMIC_RELEASE);
    }
}

// NOLINTBEGIN(readability-inconsistent-declaration-parameter-name): the C library's headers call them otherwise

/* ---- rand() and random() ---- */

long random(void) {
    int32_t number = 0;
    random_state *state = take_random_state();
    (void)random_r(&state->data, &number);
    swap_random_state(state);
    return number;
}

void srandom(unsigned seed) {
    random_state *state = take_random_state();
    (void)srandom_r(seed, &state->data);
    swap_random_state(state);
}

int rand(void) {
    return (int)random();
}

void srand(unsigned seed) {
    srandom(seed);
}

/* The caller's buffer: the C library keeps one 32-bit value before the numbers. */
static char *bytes_of(const random_state *state) {
    return (char *)(state->data.state - 1);
}

char *initstate(unsigned seed, char *bytes, size_t size) {
    random_state *state = take_random_state();
    char *before = bytes_of(state);
    int failed = initstate_r(seed, bytes, size, &state->data);
    swap_random_state(state);
    return failed != 0 ? NULL : before;
}

char *setstate(char *bytes) {
    random_state *state = take_random_state();
    char *before = bytes_of(state);
    int failed = setstate_r(bytes, &state->data);
    swap_random_state(state);
    return failed != 0 ? NULL : before;
}

/* ---- drand48() and related functions ---- */

/* If `words` is NULL, uses those of the state. */
static double draw_real(unsigned short words[3]) {
    double number = 0.0;
    random_state *state = take_random_state();
    (void)erand48_r(words != NULL ? words : state->words.__x, &state->words, &number);
    swap_random_state(state);
    return number;
}

static long draw_integer(unsigned short words[3], int (*draw)(unsigned short *, struct drand48_data *, long *)) {
    long number = 0;
    random_state *state = take_random_state();
    (void)draw(words != NULL ? words : state->words.__x, &state->words, &number);
    swap_random_state(state);
    return number;
}

double drand48(void) {
    return draw_real(NULL);
}

double erand48(unsigned short words[3]) {
    return draw_real(words);
}

long lrand48(void) {
    return draw_integer(NULL, nrand48_r);
}

long nrand48(unsigned short words[3]) {
    return draw_integer(words, nrand48_r);
}

long mrand48(void) {
    return draw_integer(NULL, jrand48_r);
}

long jrand48(unsigned short words[3]) {
    return draw_integer(words, jrand48_r);
}

void srand48(long seed) {
    random_state *state = take_random_state();
    (void)srand48_r(seed, &state->words);
    swap_random_state(state);
}

unsigned short *seed48(unsigned short words[3]) {
    random_state *state = take_random_state();
    (void)seed48_r(words, &state->words);
    swap_random_state(state);
    return state->words.__old_x;
}

void lcong48(unsigned short parameters[7]) {
    random_state *state = take_random_state();
    (void)lcong48_r(parameters, &state->words);
    swap_random_state(state);
}

// NOLINTEND(readability-inconsistent-declaration-parameter-name)

/* ---- allocation ---- */

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define HAS_ANOTHER_ALLOCATOR 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define HAS_ANOTHER_ALLOCATOR 1
#endif
#endif

#ifdef HAS_ANOTHER_ALLOCATOR

bool tl_fmu_libc_serves(void) {
    return false;
}

tl_fmu_heap *tl_fmu_libc_open(size_t reserve, tl_error *error) {
    (void)reserve;
    (void)tl_fail(error, TL_TRY_AGAIN, "the memory of FMUs cannot be copied in a build with a sanitizer");
    return NULL;
}

size_t tl_fmu_libc_used(void) {
    return 0;
}

bool tl_fmu_libc_threads_ran(tl_fmu_heap *heap) {
    (void)heap;
    return true;
}

uint32_t tl_fmu_libc_threads_alive(const tl_fmu_heap *heap) {
    (void)heap;
    return 0;
}

void tl_fmu_libc_read_keys(const tl_fmu_heap *heap, void *values[TL_FMU_HEAP_KEYS]) {
    (void)heap;
    (void)values;
}

void tl_fmu_libc_write_keys(tl_fmu_heap *heap, void *const values[TL_FMU_HEAP_KEYS], uint32_t count) {
    (void)heap;
    (void)values;
    (void)count;
}

void tl_fmu_libc_keep_logs(tl_fmu_heap *heap) {
    (void)heap;
}

#else

/* The C library's allocator under its internal names. */
extern void *own_malloc(size_t size) __asm__("__libc_malloc");
extern void *own_calloc(size_t count, size_t size) __asm__("__libc_calloc");
extern void *own_realloc(void *block, size_t size) __asm__("__libc_realloc");
extern void own_free(void *block) __asm__("__libc_free");
extern void *own_memalign(size_t alignment, size_t size) __asm__("__libc_memalign");

enum { ALIGNMENT = 16 };

/* Processor time of a thread that has ended. */
enum { THREAD_ENDED = -1 };

/* Addresses from `begin` to before `end`. */
typedef struct range {
    uintptr_t begin;
    uintptr_t end;
} range;

static tl_fmu_heap heaps[TL_FMU_LIBC_HEAPS];
static size_t heap_count;
static range loader;

bool tl_fmu_libc_serves(void) {
    return true;
}

/* ---- the loader ---- */

static bool is_in(const range *where, const void *address) {
    return (uintptr_t)address - where->begin < where->end - where->begin;
}

/* Reads the loader's program headers; the kernel passes their address to the process. */
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

/* ---- which heap ---- */

/* Standard streams are shared and allocate their buffers at their first use. That must not happen
 * in a call of an FMU. */
static void set_stream_buffers(void) {
    static char buffer[BUFSIZ];
    static char read[BUFSIZ];
    if (__fbufsize(stdin) == 0) {
        (void)setvbuf(stdin, read, _IOFBF, sizeof read);
    }
    if (__fbufsize(stdout) == 0) {
        (void)setvbuf(stdout, buffer, isatty(STDOUT_FILENO) == 1 ? _IOLBF : _IOFBF, sizeof buffer);
    }
}

tl_fmu_heap *tl_fmu_libc_open(size_t reserve, tl_error *error) {
    tl_fmu_heap *heap = &heaps[heap_count];
    if (heap_count == TL_FMU_LIBC_HEAPS) {
        (void)tl_fail(error, TL_TRY_AGAIN, "too many FMUs: at most %d can have a heap", (int)TL_FMU_LIBC_HEAPS);
        return NULL;
    }
    find_loader();
    set_stream_buffers();
    if (tl_fmu_heap_open(heap, reserve, error) != TL_OK) {
        return NULL;
    }
    heap->first = tl_fmu_heap_allocate(heap, sizeof(random_state), 1); /* a new heap has room for it */
    begin_random(heap->first);
    __atomic_store_n(&heap_count, heap_count + 1, __ATOMIC_RELEASE);
    return heap;
}

size_t tl_fmu_libc_used(void) {
    size_t sum = 0;
    for (size_t i = 0; i < heap_count; i++) {
        sum += tl_fmu_heap_used(&heaps[i]);
    }
    return sum;
}

/* Returns NULL if the block belongs to the C library. */
static tl_fmu_heap *find_owner(const void *block) {
    size_t count = __atomic_load_n(&heap_count, __ATOMIC_ACQUIRE);
    for (size_t i = 0; i < count; i++) {
        if (tl_fmu_heap_holds(&heaps[i], block)) {
            return &heaps[i];
        }
    }
    return NULL;
}

/* Heap of the FMU whose call opens a library while the C library serves its constructors; else
 * NULL. */
static __thread tl_fmu_heap *opening_heap;

/* The heap for a call from the code at `caller`; NULL: the C library. */
static inline tl_fmu_heap *find_server(const void *caller) {
    tl_fmu_heap *heap = tl_fmu_libc_heap;
    if (heap == NULL && opening_heap != NULL && !is_in(&loader, caller)) {
        opening_heap->has_constructed = true;
    }
    return heap == NULL || is_in(&loader, caller) ? NULL : heap;
}

static void *take(tl_fmu_heap *heap, size_t size, size_t alignment) {
    void *block = tl_fmu_heap_allocate(heap, size, alignment);
    if (block == NULL) {
        block = own_memalign(alignment, size);
        heap->has_outside_memory = heap->has_outside_memory || block != NULL;
    }
    return block;
}

/* ---- malloc() and related functions ---- */

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
        tl_fmu_heap_release(owner, block);
    }
}

void *realloc(void *block, size_t size) {
    tl_fmu_heap *owner = block == NULL ? find_server(CALLER) : find_owner(block);
    if (owner == NULL) {
        return own_realloc(block, size);
    }
    size_t before = block == NULL ? 0 : tl_fmu_heap_size(block);
    if (block != NULL && size == 0) {
        tl_fmu_heap_release(owner, block);
        return NULL;
    }
    if (block != NULL && size <= before && size > before / 2) {
        return block;
    }
    void *other = take(owner, size, ALIGNMENT);
    if (other != NULL && block != NULL) {
        memcpy(other, block, before < size ? before : size);
        tl_fmu_heap_release(owner, block);
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
    int before = errno; /* POSIX: posix_memalign() does not change errno */
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

/* dlsym() returns an object pointer, and ISO C has no cast from it to a function pointer. */
static void find_next(const char *name, void *function, size_t size) {
    void *address = dlsym(RTLD_NEXT, name);
    memcpy(function, &address, size);
}

/* Finds the C library's function of this name: when the program is loaded, or earlier if a
 * library's constructor calls it. */
// NOLINTBEGIN(bugprone-macro-parentheses): a type, and lists that have their own
#define NEXT(Result, Name, Parameters)                                                                                 \
    static Result(*own_##Name) Parameters;                                                                             \
    __attribute__((constructor)) static void find_##Name(void) {                                                       \
        if (own_##Name == NULL) {                                                                                      \
            find_next(#Name, (void *)&own_##Name, sizeof own_##Name);                                                  \
        }                                                                                                              \
    }
// NOLINTEND(bugprone-macro-parentheses)

NEXT(size_t, malloc_usable_size, (void *block))
NEXT(int, pthread_create, (pthread_t *, const pthread_attr_t *, void *(*run)(void *), void *))
NEXT(void *, sbrk, (intptr_t more))
NEXT(void *, mmap64, (void *, size_t, int, int, int, off_t))
NEXT(void *, mmap, (void *, size_t, int, int, int, long))
NEXT(int, munmap, (void *, size_t))
NEXT(void *, mremap, (void *, size_t, size_t, int, ...))
NEXT(int, mprotect, (void *, size_t, int))
NEXT(int, madvise, (void *, size_t, int))
NEXT(void *, dlopen, (const char *, int))
NEXT(int, dlclose, (void *))
NEXT(void *, dlmopen, (Lmid_t, const char *, int))
NEXT(int, pthread_key_create, (pthread_key_t *, void (*)(void *)))
NEXT(int, pthread_key_delete, (pthread_key_t))
NEXT(int, tss_create, (tss_t *, tss_dtor_t))
NEXT(void, tss_delete, (tss_t))
NEXT(int, open, (const char *, int, ...))
NEXT(int, open64, (const char *, int, ...))
NEXT(int, openat, (int, const char *, int, ...))
NEXT(int, openat64, (int, const char *, int, ...))
NEXT(FILE *, fopen, (const char *, const char *))
NEXT(FILE *, fopen64, (const char *, const char *))
NEXT(FILE *, freopen, (const char *, const char *, FILE *))
NEXT(FILE *, freopen64, (const char *, const char *, FILE *))
NEXT(int, mkstemp, (char *))
NEXT(int, mkstemp64, (char *))
NEXT(FILE *, tmpfile, (void))
NEXT(FILE *, tmpfile64, (void))
NEXT(int, fclose, (FILE *))
NEXT(int, setvbuf, (FILE *, char *, int, size_t))
NEXT(DIR *, opendir, (const char *))
NEXT(int, pipe, (int *))
NEXT(int, pipe2, (int *, int))
NEXT(int, fcntl, (int, int, ...))
NEXT(int, fcntl64, (int, int, ...))
NEXT(int, socketpair, (int, int, int, int *))
NEXT(int, creat, (const char *, mode_t))
NEXT(int, creat64, (const char *, mode_t))
NEXT(int, thrd_create, (thrd_t *, thrd_start_t, void *))
NEXT(int, timer_create, (clockid_t, struct sigevent *, timer_t *))

size_t malloc_usable_size(void *block) {
    if (block == NULL) {
        return 0;
    }
    if (find_owner(block) != NULL) {
        return tl_fmu_heap_size(block);
    }
    find_malloc_usable_size();
    return own_malloc_usable_size(block);
}

/* ---- threads ---- */

typedef struct thread_start {
    void *(*run)(void *);
    void *context;
    tl_fmu_heap *heap;
} thread_start;

static int64_t processor_time(clockid_t clock) {
    struct timespec time;
    return clock_gettime(clock, &time) == 0 ? (int64_t)time.tv_sec * 1000000000 + time.tv_nsec : THREAD_ENDED;
}

/* The new thread is served from the heap of the call that has started it. */
static void *run_thread(void *context) {
    const thread_start start = *(const thread_start *)context;
    own_free(context);
    (void)tl_fmu_libc_enter(start.heap);
    uint32_t index = __atomic_fetch_add(&start.heap->thread_count, 1, __ATOMIC_RELAXED);
    if (index >= TL_FMU_HEAP_THREADS || pthread_getcpuclockid(pthread_self(), &start.heap->threads[index].clock) != 0) {
        start.heap->has_threads = true;
    }
    __atomic_fetch_add(&start.heap->threads_begun, 1, __ATOMIC_RELEASE);
    return start.run(start.context);
}

/* Python scripts start threads that compute between calls, so these are not allowed. */
static bool is_script(const void *caller) {
    Dl_info info;
    return dladdr(caller, &info) != 0 && strstr(info.dli_fname, "libpython") != NULL;
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*run)(void *), void *context) {
    find_pthread_create();
    tl_fmu_heap *heap = tl_fmu_libc_heap;
    if (heap == NULL) {
        return own_pthread_create(thread, attributes, run, context);
    }
    heap->has_threads = heap->has_threads || !heap->allows_threads || is_script(CALLER);
    thread_start *start = heap->allows_threads ? own_malloc(sizeof *start) : NULL;
    if (start == NULL) {
        return heap->allows_threads ? EAGAIN : own_pthread_create(thread, attributes, run, context);
    }
    *start = (thread_start){run, context, heap};
    heap->threads_started++;
    int failed = own_pthread_create(thread, attributes, run_thread, start);
    if (failed != 0) {
        heap->threads_started--;
        own_free(start);
    }
    return failed;
}

/* The C library starts these threads without pthread_create(), so they are not served from the
 * heap. */
static void note_thread(void) {
    if (tl_fmu_libc_heap != NULL) {
        tl_fmu_libc_heap->has_threads = true;
    }
}

int thrd_create(thrd_t *thread, thrd_start_t run, void *context) {
    find_thrd_create();
    note_thread();
    return own_thrd_create(thread, run, context);
}

int timer_create(clockid_t clock, struct sigevent *event, timer_t *timer) {
    find_timer_create();
    if (event != NULL && event->sigev_notify == SIGEV_THREAD) {
        note_thread();
    }
    return own_timer_create(clock, event, timer);
}

bool tl_fmu_libc_threads_ran(tl_fmu_heap *heap) {
    uint32_t begun = __atomic_load_n(&heap->threads_begun, __ATOMIC_ACQUIRE);
    bool ran = begun != heap->threads_started;
    for (uint32_t i = 0; i < begun && i < TL_FMU_HEAP_THREADS; i++) {
        tl_fmu_heap_thread *thread = &heap->threads[i];
        int64_t now = thread->ran == THREAD_ENDED ? THREAD_ENDED : processor_time(thread->clock);
        ran = ran || now != thread->ran;
        thread->ran = now;
    }
    return ran;
}

uint32_t tl_fmu_libc_threads_alive(const tl_fmu_heap *heap) {
    uint32_t alive = 0;
    for (uint32_t i = 0; i < heap->thread_count && i < TL_FMU_HEAP_THREADS; i++) {
        alive += heap->threads[i].ran != THREAD_ENDED ? 1 : 0;
    }
    return alive;
}

/* ---- thread-specific values ---- */

typedef char keys_are_unsigned[sizeof(pthread_key_t) == sizeof(unsigned) && sizeof(tss_t) == sizeof(unsigned) ? 1 : -1];

static void note_key(unsigned key) {
    tl_fmu_heap *heap = tl_fmu_libc_heap;
    if (heap != NULL && heap->key_count < TL_FMU_HEAP_KEYS) {
        heap->keys[heap->key_count++] = key;
    } else if (heap != NULL) {
        heap->has_outside_memory = true;
    }
}

/* A restore cannot create the same key again. */
static void note_deleted_key(unsigned key) {
    tl_fmu_heap *heap = tl_fmu_libc_heap;
    for (uint32_t i = 0; heap != NULL && i < heap->key_count; i++) {
        heap->has_outside_memory = heap->has_outside_memory || heap->keys[i] == key;
    }
}

int pthread_key_create(pthread_key_t *key, void (*destructor)(void *)) {
    find_pthread_key_create();
    int failed = own_pthread_key_create(key, destructor);
    if (failed == 0) {
        note_key(*key);
    }
    return failed;
}

int pthread_key_delete(pthread_key_t key) {
    find_pthread_key_delete();
    note_deleted_key(key);
    return own_pthread_key_delete(key);
}

/* The C library's keys are the same for both standards. */
int tss_create(tss_t *key, tss_dtor_t destructor) {
    find_tss_create();
    int failed = own_tss_create(key, destructor);
    if (failed == thrd_success) {
        note_key(*key);
    }
    return failed;
}

void tss_delete(tss_t key) {
    find_tss_delete();
    note_deleted_key(key);
    own_tss_delete(key);
}

void tl_fmu_libc_read_keys(const tl_fmu_heap *heap, void *values[TL_FMU_HEAP_KEYS]) {
    for (uint32_t i = 0; i < heap->key_count; i++) {
        values[i] = pthread_getspecific(heap->keys[i]);
    }
}

void tl_fmu_libc_write_keys(tl_fmu_heap *heap, void *const values[TL_FMU_HEAP_KEYS], uint32_t count) {
    for (uint32_t i = 0; i < count && i < heap->key_count; i++) {
        if (pthread_getspecific(heap->keys[i]) != values[i]) {
            (void)pthread_setspecific(heap->keys[i], values[i]);
        }
    }
    while (heap->key_count > count) {
        (void)own_pthread_key_delete(heap->keys[--heap->key_count]);
    }
}

/* ---- descriptors ---- */

static int note_descriptor(int opened) {
    tl_fmu_heap *heap = tl_fmu_libc_heap;
    if (heap != NULL && opened >= 0 && opened < TL_FMU_HEAP_DESCRIPTORS) {
        heap->is_opened[opened] = true;
        heap->has_opened = true;
    }
    return opened;
}

/* A file that is only written may stay open, because its content does not change the results. */
static int note_opened(const char *path, int flags, int opened) {
    bool is_device = strncmp(path, "/dev/", 5) == 0;
    if (opened >= 0 && tl_fmu_libc_heap != NULL && (flags & O_ACCMODE) != O_RDONLY && !is_device) {
        tl_fmu_libc_heap->writes_files = true;
    }
    if (opened >= 0 && opened < TL_FMU_HEAP_DESCRIPTORS && tl_fmu_libc_heap != NULL) {
        tl_fmu_libc_heap->is_opened[opened] = false; /* the call may have closed another file with this number */
    }
    return (flags & O_ACCMODE) == O_WRONLY ? opened : note_descriptor(opened);
}

/* Own names, because the headers rename open() on some machines. */
int tl_noted_open(const char *path, int flags, ...) __asm__("open");
int tl_noted_open64(const char *path, int flags, ...) __asm__("open64");
int tl_noted_openat(int folder, const char *path, int flags, ...) __asm__("openat");
int tl_noted_openat64(int folder, const char *path, int flags, ...) __asm__("openat64");
FILE *tl_noted_fopen(const char *path, const char *mode) __asm__("fopen");
FILE *tl_noted_fopen64(const char *path, const char *mode) __asm__("fopen64");
FILE *tl_noted_freopen(const char *path, const char *mode, FILE *stream) __asm__("freopen");
FILE *tl_noted_freopen64(const char *path, const char *mode, FILE *stream) __asm__("freopen64");
int tl_noted_mkstemp(char *name) __asm__("mkstemp");
int tl_noted_mkstemp64(char *name) __asm__("mkstemp64");
FILE *tl_noted_tmpfile(void) __asm__("tmpfile");
FILE *tl_noted_tmpfile64(void) __asm__("tmpfile64");

/* Reads the argument `mode` after `flags`. It exists only with O_CREAT or O_TMPFILE. */
#define READ_MODE(mode, flags)                                                                                         \
    mode_t mode = 0;                                                                                                   \
    va_list arguments;                                                                                                 \
    va_start(arguments, flags);                                                                                        \
    if (((flags)&O_CREAT) != 0 || ((flags)&O_TMPFILE) == O_TMPFILE) {                                                  \
        (mode) = va_arg(arguments, mode_t);                                                                            \
    }                                                                                                                  \
    va_end(arguments)

int tl_noted_open(const char *path, int flags, ...) {
    READ_MODE(mode, flags);
    find_open();
    return note_opened(path, flags, own_open(path, flags, mode));
}

int tl_noted_open64(const char *path, int flags, ...) {
    READ_MODE(mode, flags);
    find_open64();
    return note_opened(path, flags, own_open64(path, flags, mode));
}

int tl_noted_openat(int folder, const char *path, int flags, ...) {
    READ_MODE(mode, flags);
    find_openat();
    return note_opened(path, flags, own_openat(folder, path, flags, mode));
}

int tl_noted_openat64(int folder, const char *path, int flags, ...) {
    READ_MODE(mode, flags);
    find_openat64();
    return note_opened(path, flags, own_openat64(folder, path, flags, mode));
}

static FILE *note_file(const char *path, const char *mode, FILE *opened) {
    int flags = strchr(mode, '+') != NULL ? O_RDWR : mode[0] == 'r' ? O_RDONLY : O_WRONLY;
    (void)note_opened(path, flags, opened != NULL ? fileno(opened) : -1);
    return opened;
}

/* Returns the index of a stream that is only written; TL_FMU_HEAP_LOGS: there is no such stream. */
static unsigned find_log(const tl_fmu_heap *heap, const FILE *stream) {
    unsigned i = heap != NULL ? 0 : TL_FMU_HEAP_LOGS;
    while (i < TL_FMU_HEAP_LOGS && heap->logs[i] != stream) {
        i++;
    }
    return i;
}

static bool is_same_file(const char *path, FILE *stream) {
    struct stat wanted;
    struct stat opened;
    return stat(path, &wanted) == 0 && fstat(fileno(stream), &opened) == 0 && wanted.st_dev == opened.st_dev &&
           wanted.st_ino == opened.st_ino;
}

/* Returns the index of a stream that a rollback has left open; TL_FMU_HEAP_LOGS: none. */
static unsigned find_left_log(const tl_fmu_heap *heap, const char *path, const char *mode) {
    unsigned i = 0;
    while (i < TL_FMU_HEAP_LOGS && (heap->logs[i] == NULL || (heap->first->logs >> i & 1U) != 0 ||
                                    heap->log_modes[i] != mode[0] || !is_same_file(path, heap->logs[i]))) {
        i++;
    }
    return i;
}

/* Opens a file that is only written. The stream and its buffer lie outside of the heap, because
 * the C library has a list of all streams. A rollback to before the opening leaves it open, because
 * another state may contain it. If the FMU then opens the file again, it gets this stream again, so
 * that the descriptors do not run out. */
static FILE *open_log(tl_fmu_heap *heap, const char *path, const char *mode,
                      FILE *(*open_file)(const char *, const char *)) {
    unsigned i = strchr(mode, 'x') == NULL ? find_left_log(heap, path, mode) : TL_FMU_HEAP_LOGS;
    bool is_left = i < TL_FMU_HEAP_LOGS;
    FILE *stream = is_left ? heap->logs[i] : open_file(path, mode);
    if (is_left && mode[0] == 'w') {
        rewind(stream);
        (void)!ftruncate(fileno(stream), 0);
    }
    for (i = is_left ? i : 0; i < TL_FMU_HEAP_LOGS && heap->logs[i] != NULL && !is_left; i++) {
    }
    if (stream == NULL || i == TL_FMU_HEAP_LOGS) {
        return stream;
    }
    (void)own_setvbuf(stream, NULL, _IOFBF, 0); /* allocates the buffer now */
    heap->logs[i] = stream;
    heap->log_modes[i] = mode[0];
    heap->first->logs |= 1U << i;
    return stream;
}

static FILE *open_stream(const char *path, const char *mode, FILE *(*open_file)(const char *, const char *)) {
    bool is_log = tl_fmu_libc_heap != NULL && mode[0] != 'r' && strchr(mode, '+') == NULL;
    tl_fmu_heap *heap = is_log ? tl_fmu_libc_enter(NULL) : NULL;
    FILE *opened = is_log ? open_log(heap, path, mode, open_file) : open_file(path, mode);
    if (is_log) {
        (void)tl_fmu_libc_enter(heap);
    }
    (void)note_file(path, mode, opened);
    if (is_log && opened != NULL && find_log(heap, opened) == TL_FMU_HEAP_LOGS) { /* it must be closed in this call */
        (void)note_descriptor(fileno(opened));
    }
    return opened;
}

FILE *tl_noted_fopen(const char *path, const char *mode) {
    find_fopen();
    return open_stream(path, mode, own_fopen);
}

FILE *tl_noted_fopen64(const char *path, const char *mode) {
    find_fopen64();
    return open_stream(path, mode, own_fopen64);
}

/* A stream that a state may contain stays open. */
int fclose(FILE *stream) {
    find_fclose();
    tl_fmu_heap *heap = tl_fmu_libc_heap;
    unsigned i = find_log(heap, stream);
    if (i < TL_FMU_HEAP_LOGS) {
        heap->first->logs &= ~(1U << i);
        if ((heap->saved_logs >> i & 1U) != 0) {
            return fflush(stream);
        }
        heap->logs[i] = NULL;
    }
    return own_fclose(stream);
}

/* A buffer of the FMU may be freed by a rollback while the stream is open. */
int setvbuf(FILE *stream, char *buffer, int kind, size_t size) {
    find_setvbuf();
    bool is_log = find_log(tl_fmu_libc_heap, stream) < TL_FMU_HEAP_LOGS;
    return is_log ? own_setvbuf(stream, NULL, kind, 0) : own_setvbuf(stream, buffer, kind, size);
}

void tl_fmu_libc_keep_logs(tl_fmu_heap *heap) {
    heap->saved_logs |= heap->first->logs;
}

static FILE *note_stream(FILE *opened) {
    (void)note_descriptor(opened != NULL ? fileno(opened) : -1);
    return opened;
}

/* A rollback does not return a stream to its former file. */
FILE *tl_noted_freopen(const char *path, const char *mode, FILE *stream) {
    find_freopen();
    return note_stream(own_freopen(path, mode, stream));
}

FILE *tl_noted_freopen64(const char *path, const char *mode, FILE *stream) {
    find_freopen64();
    return note_stream(own_freopen64(path, mode, stream));
}

FILE *tl_noted_tmpfile(void) {
    find_tmpfile();
    return note_stream(own_tmpfile());
}

FILE *tl_noted_tmpfile64(void) {
    find_tmpfile64();
    return note_stream(own_tmpfile64());
}

int tl_noted_mkstemp(char *name) {
    find_mkstemp();
    return note_descriptor(own_mkstemp(name));
}

int tl_noted_mkstemp64(char *name) {
    find_mkstemp64();
    return note_descriptor(own_mkstemp64(name));
}

DIR *opendir(const char *path) {
    find_opendir();
    DIR *opened = own_opendir(path);
    (void)note_descriptor(opened != NULL ? dirfd(opened) : -1);
    return opened;
}

static int note_pipe(int failed, const int ends[2]) {
    (void)note_descriptor(failed == 0 ? ends[0] : -1);
    (void)note_descriptor(failed == 0 ? ends[1] : -1);
    return failed;
}

int pipe(int ends[2]) {
    find_pipe();
    return note_pipe(own_pipe(ends), ends);
}

int pipe2(int ends[2], int flags) {
    find_pipe2();
    return note_pipe(own_pipe2(ends, flags), ends);
}

/* Defines a function that calls the C library's function of the same name, and notes the result. */
// NOLINTBEGIN(bugprone-macro-parentheses): a parameter list, and arguments that have their own
#define NOTED(note, Name, Parameters, Arguments)                                                                       \
    NEXT(int, Name, Parameters)                                                                                        \
    int Name Parameters {                                                                                              \
        find_##Name();                                                                                                 \
        return note(own_##Name Arguments);                                                                             \
    }
// NOLINTEND(bugprone-macro-parentheses)

NOTED(note_descriptor, dup, (int descriptor), (descriptor))
NOTED(note_descriptor, dup2, (int descriptor, int wanted), (descriptor, wanted))
NOTED(note_descriptor, dup3, (int descriptor, int wanted, int flags), (descriptor, wanted, flags))
NOTED(note_descriptor, epoll_create1, (int flags), (flags))
NOTED(note_descriptor, memfd_create, (const char *name, unsigned flags), (name, flags))
NOTED(note_descriptor, eventfd, (unsigned count, int flags), (count, flags))
NOTED(note_descriptor, timerfd_create, (int clock, int flags), (clock, flags))

/* Own names, because the headers rename fcntl() on some machines. */
int tl_noted_fcntl(int descriptor, int command, ...) __asm__("fcntl");
int tl_noted_fcntl64(int descriptor, int command, ...) __asm__("fcntl64");

/* The C library also reads a pointer as third argument, whatever the command is. */
static int note_duplicate(int command, int result) {
    return command == F_DUPFD || command == F_DUPFD_CLOEXEC ? note_descriptor(result) : result;
}

int tl_noted_fcntl(int descriptor, int command, ...) {
    va_list arguments;
    va_start(arguments, command);
    void *argument = va_arg(arguments, void *);
    va_end(arguments);
    find_fcntl();
    return note_duplicate(command, own_fcntl(descriptor, command, argument));
}

int tl_noted_fcntl64(int descriptor, int command, ...) {
    va_list arguments;
    va_start(arguments, command);
    void *argument = va_arg(arguments, void *);
    va_end(arguments);
    find_fcntl64();
    return note_duplicate(command, own_fcntl64(descriptor, command, argument));
}

int socketpair(int domain, int type, int protocol, int ends[2]) {
    find_socketpair();
    return note_pipe(own_socketpair(domain, type, protocol, ends), ends);
}

/* ---- files by name ---- */

/* A rollback does not undo these. */
static int note_written(int result) {
    if (result >= 0 && tl_fmu_libc_heap != NULL) {
        tl_fmu_libc_heap->writes_files = true;
    }
    return result;
}

NOTED(note_written, mkdir, (const char *path, mode_t mode), (path, mode))
NOTED(note_written, mkdirat, (int folder, const char *path, mode_t mode), (folder, path, mode))
NOTED(note_written, rmdir, (const char *path), (path))
NOTED(note_written, unlink, (const char *path), (path))
NOTED(note_written, unlinkat, (int folder, const char *path, int flags), (folder, path, flags))
NOTED(note_written, remove, (const char *path), (path))
NOTED(note_written, rename, (const char *from, const char *to), (from, to))
NOTED(note_written, renameat, (int folder, const char *from, int other, const char *to), (folder, from, other, to))

/* Own names, because the headers rename creat() on all machines. */
int tl_noted_creat(const char *path, mode_t mode) __asm__("creat");
int tl_noted_creat64(const char *path, mode_t mode) __asm__("creat64");

int tl_noted_creat(const char *path, mode_t mode) {
    find_creat();
    return note_written(own_creat(path, mode));
}

int tl_noted_creat64(const char *path, mode_t mode) {
    find_creat64();
    return note_written(own_creat64(path, mode));
}

/* ---- libraries ---- */

/* With `opens_outside`, constructors of the library allocate outside of the heap, because earlier
 * copies do not contain their memory. */
static void *open_and_report(tl_fmu_heap *heap, const char *path, int mode) {
    (void)tl_fmu_libc_enter(NULL);
    heap->note_opening(heap->context, TL_FMU_LIBRARY_OPENS, NULL);
    (void)tl_fmu_libc_enter(heap->opens_outside ? NULL : heap);
    opening_heap = heap->opens_outside ? heap : NULL;
    void *library = own_dlopen(path, mode);
    opening_heap = NULL;
    (void)tl_fmu_libc_enter(NULL);
    heap->note_opening(heap->context, TL_FMU_LIBRARY_OPENED, library);
    (void)tl_fmu_libc_enter(heap);
    return library;
}

static bool find_in(const char *folder, int length, const char *name, char path[PATH_MAX]) {
    int written = snprintf(path, PATH_MAX, "%.*s/%s", length, folder, name);
    return written > 0 && written < PATH_MAX && access(path, R_OK) == 0;
}

/* Searches in the folders that the loader would search for this library. */
static bool find_in_search_path(void *library, const char *name, char path[PATH_MAX]) {
    Dl_serinfo size;
    bool is_found = false;
    if (dlinfo(library, RTLD_DI_SERINFOSIZE, &size) != 0) {
        return false;
    }
    Dl_serinfo *folders = own_malloc(size.dls_size);
    if (folders != NULL && dlinfo(library, RTLD_DI_SERINFOSIZE, folders) == 0 &&
        dlinfo(library, RTLD_DI_SERINFO, folders) == 0) {
        for (unsigned i = 0; i < folders->dls_cnt && !is_found; i++) {
            const char *folder = folders->dls_serpath[i].dls_name;
            is_found = find_in(folder, (int)strlen(folder), name, path);
        }
    }
    own_free(folders);
    return is_found;
}

/* True if the loader has a library of this name already. */
static bool is_loaded(const char *name) {
    void *library = own_dlopen(name, RTLD_LAZY | RTLD_NOLOAD);
    return library != NULL && dlclose(library) == 0;
}

/* Returns the path of a library that an FMU opens: one beside the library of the caller, as an
 * FMU's own libraries are, or one in its search path. NULL: the C library must search it. */
static const char *search_library(const void *caller, const char *name) {
    static __thread char path[PATH_MAX]; /* not on the stack of dlopen(), see there */
    Dl_info info;
    if (name == NULL || strchr(name, '/') != NULL) {
        return name;
    }
    const char *end = dladdr(caller, &info) != 0 ? strrchr(info.dli_fname, '/') : NULL;
    if (end == NULL || find_in(info.dli_fname, (int)(end - info.dli_fname), name, path)) {
        return end == NULL ? NULL : path;
    }
    void *library = is_loaded(name) ? NULL : own_dlopen(info.dli_fname, RTLD_LAZY | RTLD_NOLOAD);
    bool is_found = library != NULL && find_in_search_path(library, name, path);
    if (library != NULL) {
        (void)dlclose(library);
    }
    return is_found ? path : NULL;
}

/* Errors of the loader must not lie in the heap. Not inlined, so that dlopen() can end with a jump.
 */
static const char *__attribute__((noinline)) find_library(const void *caller, const char *name) {
    tl_fmu_heap *heap = tl_fmu_libc_enter(NULL);
    const char *found = search_library(caller, name);
    (void)tl_fmu_libc_enter(heap);
    return found;
}

/* A name without a slash is searched in the folders of the caller, so the C library must see that
 * caller: the last call here is a jump (-O2, and no variable of this function has an address). */
void *dlopen(const char *path, int mode) {
    tl_fmu_heap *heap = tl_fmu_libc_heap;
    if (own_dlopen == NULL) {
        find_dlopen();
    }
    const char *found = heap == NULL || heap->note_opening == NULL ? NULL : find_library(CALLER, path);
    return found == NULL ? own_dlopen(path, mode) : open_and_report(heap, found, mode);
}

/* In another namespace, the library uses another copy of the C library, with its own allocator. The
 * last call here is a jump, see above. */
void *dlmopen(Lmid_t space, const char *path, int mode) {
    if (own_dlmopen == NULL) {
        find_dlmopen();
    }
    if (tl_fmu_libc_heap != NULL) {
        tl_fmu_libc_heap->has_outside_memory = true;
    }
    return own_dlmopen(space, path, mode);
}

/* Reports that the FMU has closed a library: another one may get its addresses. */
int dlclose(void *library) {
    find_dlclose();
    int failed = own_dlclose(library);
    tl_fmu_heap *heap = tl_fmu_libc_enter(NULL);
    if (heap != NULL && heap->note_opening != NULL) {
        heap->note_opening(heap->context, TL_FMU_LIBRARY_CLOSED, NULL);
    }
    (void)tl_fmu_libc_enter(heap);
    return failed;
}

/* ---- mapped memory ---- */

void *sbrk(intptr_t more) {
    find_sbrk();
    if (more != 0 && tl_fmu_libc_heap != NULL) {
        tl_fmu_libc_heap->has_outside_memory = true;
    }
    return own_sbrk(more);
}

/* Defines both symbols: mmap64 for 64-bit offsets, and mmap for offsets of type long. */
void *tl_fmu_libc_map(void *address, size_t size, int protection, int flags, int file, long offset) __asm__("mmap");

/* Serves private memory from the heap. Returns NULL for all other mappings; the heap notes writable
 * ones. */
static void *map_from_heap(const void *caller, size_t size, int protection, int flags) {
    tl_fmu_heap *heap = find_server(caller);
    if (heap == NULL || (protection & PROT_WRITE) == 0) {
        if (heap != NULL) {
            heap->has_reserved = true;
        }
        return NULL;
    }
    bool is_plain = protection == (PROT_READ | PROT_WRITE) && (flags & ~MAP_STACK) == (MAP_PRIVATE | MAP_ANONYMOUS);
    void *mapping = is_plain ? tl_fmu_heap_map(heap, size) : NULL;
    heap->has_outside_memory = heap->has_outside_memory || mapping == NULL;
    return mapping;
}

void *mmap(void *address, size_t size, int protection, int flags, int file, off_t offset) {
    find_mmap64();
    void *mapping = map_from_heap(CALLER, size, protection, flags);
    return mapping != NULL ? mapping : own_mmap64(address, size, protection, flags, file, offset);
}

void *tl_fmu_libc_map(void *address, size_t size, int protection, int flags, int file, long offset) {
    find_mmap();
    void *mapping = map_from_heap(CALLER, size, protection, flags);
    return mapping != NULL ? mapping : own_mmap(address, size, protection, flags, file, offset);
}

int munmap(void *address, size_t size) {
    find_munmap();
    tl_fmu_heap *owner = find_owner(address);
    if (owner == NULL) {
        return own_munmap(address, size);
    }
    tl_fmu_heap_unmap(owner, address, size);
    return 0;
}

void *mremap(void *address, size_t size, size_t new_size, int flags, ...) {
    find_mremap();
    tl_fmu_heap *owner = find_owner(address);
    if (owner == NULL) {
        va_list arguments;
        va_start(arguments, flags);
        void *wanted = (flags & MREMAP_FIXED) != 0 ? va_arg(arguments, void *) : NULL;
        va_end(arguments);
        return own_mremap(address, size, new_size, flags, wanted);
    }
    void *mapping = flags == MREMAP_MAYMOVE ? tl_fmu_heap_map(owner, new_size) : NULL;
    if (mapping == NULL) {
        errno = ENOMEM;
        return MAP_FAILED;
    }
    memcpy(mapping, address, size < new_size ? size : new_size);
    tl_fmu_heap_unmap(owner, address, size);
    return mapping;
}

/* Memory that is not writable cannot be restored. Neither can memory that the FMU has mapped
 * outside of its heap, and makes writable now. */
int mprotect(void *address, size_t size, int protection) {
    find_mprotect();
    tl_fmu_heap *owner = find_owner(address);
    if (owner != NULL && protection != (PROT_READ | PROT_WRITE)) {
        owner->has_outside_memory = true;
    }
    tl_fmu_heap *heap = find_server(CALLER);
    if (owner == NULL && heap != NULL && heap->has_reserved && (protection & PROT_WRITE) != 0) {
        heap->has_outside_memory = true;
    }
    return own_mprotect(address, size, protection);
}

/* Zeroes the pages itself, because pages that the kernel drops would not be found as changed.
 * Other advice is ignored. */
int madvise(void *address, size_t size, int advice) {
    find_madvise();
    if (find_owner(address) == NULL) {
        return own_madvise(address, size, advice);
    }
    if (advice == MADV_DONTNEED || advice == MADV_FREE) {
        memset(address, 0, size);
    }
    return 0;
}

/* ---- environment ---- */

NEXT(int, setenv, (const char *, const char *, int))
NEXT(int, unsetenv, (const char *))
NEXT(int, putenv, (char *))

/* The C library keeps the memory, so it must not be rolled back. */
static tl_fmu_heap *note_environment(void) {
    tl_fmu_heap *heap = tl_fmu_libc_enter(NULL);
    if (heap != NULL) {
        heap->changes_environment = true;
    }
    return heap;
}

int setenv(const char *name, const char *value, int replaces) {
    find_setenv();
    tl_fmu_heap *heap = note_environment();
    int failed = own_setenv(name, value, replaces);
    (void)tl_fmu_libc_enter(heap);
    return failed;
}

int unsetenv(const char *name) {
    find_unsetenv();
    tl_fmu_heap *heap = note_environment();
    int failed = own_unsetenv(name);
    (void)tl_fmu_libc_enter(heap);
    return failed;
}

int putenv(char *pair) {
    find_putenv();
    tl_fmu_heap *heap = note_environment();
    int failed = own_putenv(pair);
    (void)tl_fmu_libc_enter(heap);
    return failed;
}

// NOLINTEND(readability-inconsistent-declaration-parameter-name)

/* ---- memory that the C library keeps ---- */

/* These are macros in optimised builds. */
#undef textdomain
#undef bindtextdomain
#undef bind_textdomain_codeset
#undef dcgettext
#undef dgettext
#undef gettext

/* Defines a function that calls the C library's function of the same name outside of any heap. */
// NOLINTBEGIN(bugprone-macro-parentheses): a type, and lists that have their own
#define OUTSIDE(Result, Name, Parameters, Arguments)                                                                   \
    NEXT(Result, Name, Parameters)                                                                                     \
    Result Name Parameters {                                                                                           \
        tl_fmu_heap *heap = tl_fmu_libc_enter(NULL);                                                                   \
        find_##Name();                                                                                                 \
        Result answer = own_##Name Arguments;                                                                          \
        (void)tl_fmu_libc_enter(heap);                                                                                 \
        return answer;                                                                                                 \
    }
// NOLINTEND(bugprone-macro-parentheses)

// NOLINTBEGIN(readability-inconsistent-declaration-parameter-name,readability-identifier-naming,bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp): the names are the C library's

/* Called by compiled C++ and by atexit() of the C library; no header declares them. */
int __cxa_atexit(void (*function)(void *), void *context, void *library);
int __cxa_thread_atexit_impl(void (*function)(void *), void *context, void *library);
locale_t __newlocale(int mask, const char *locale, locale_t base);

/* The C library makes the character conversions of a locale when they are first used, and keeps
 * them for all users of this locale. */
static void make_conversions(locale_t locale) {
    enum { NOT_ASCII = 0xff };
    locale_t before = uselocale(locale); /* stays if newlocale() has failed */
    (void)btowc(NOT_ASCII);
    (void)uselocale(before);
}

NEXT(char *, setlocale, (int, const char *))
NEXT(locale_t, newlocale, (int, const char *, locale_t))

char *setlocale(int category, const char *locale) {
    tl_fmu_heap *heap = tl_fmu_libc_enter(NULL);
    find_setlocale();
    char *answer = own_setlocale(category, locale);
    if (heap != NULL) {
        make_conversions(LC_GLOBAL_LOCALE);
    }
    (void)tl_fmu_libc_enter(heap);
    return answer;
}

locale_t newlocale(int mask, const char *locale, locale_t base) {
    tl_fmu_heap *heap = tl_fmu_libc_enter(NULL);
    find_newlocale();
    locale_t answer = own_newlocale(mask, locale, base);
    if (heap != NULL) {
        make_conversions(answer);
    }
    (void)tl_fmu_libc_enter(heap);
    return answer;
}

/* libstdc++ calls it by this name. */
locale_t __newlocale(int mask, const char *locale, locale_t base) {
    return newlocale(mask, locale, base);
}

OUTSIDE(struct tm *, localtime, (const time_t *time), (time))
OUTSIDE(struct tm *, localtime_r, (const time_t *time, struct tm *result), (time, result))
OUTSIDE(struct tm *, gmtime, (const time_t *time), (time))
OUTSIDE(struct tm *, gmtime_r, (const time_t *time, struct tm *result), (time, result))
OUTSIDE(time_t, mktime, (struct tm * time), (time))
OUTSIDE(time_t, timelocal, (struct tm * time), (time))
OUTSIDE(char *, ctime, (const time_t *time), (time))
OUTSIDE(char *, ctime_r, (const time_t *time, char *text), (time, text))
OUTSIDE(size_t, strftime, (char *text, size_t size, const char *format, const struct tm *time),
        (text, size, format, time))
OUTSIDE(size_t, strftime_l, (char *text, size_t size, const char *format, const struct tm *time, locale_t locale),
        (text, size, format, time, locale))
OUTSIDE(size_t, wcsftime, (wchar_t * text, size_t size, const wchar_t *format, const struct tm *time),
        (text, size, format, time))
OUTSIDE(int, __cxa_atexit, (void (*function)(void *), void *context, void *library), (function, context, library))
OUTSIDE(int, __cxa_thread_atexit_impl, (void (*function)(void *), void *context, void *library),
        (function, context, library))
OUTSIDE(int, on_exit, (void (*function)(int, void *), void *context), (function, context))
OUTSIDE(iconv_t, iconv_open, (const char *to, const char *from), (to, from))
OUTSIDE(char *, textdomain, (const char *domain), (domain))
OUTSIDE(char *, bindtextdomain, (const char *domain, const char *folder), (domain, folder))
OUTSIDE(char *, bind_textdomain_codeset, (const char *domain, const char *codes), (domain, codes))
OUTSIDE(char *, dcgettext, (const char *domain, const char *text, int category), (domain, text, category))
OUTSIDE(char *, dgettext, (const char *domain, const char *text), (domain, text))
OUTSIDE(char *, gettext, (const char *text), (text))
OUTSIDE(struct passwd *, getpwnam, (const char *name), (name))
OUTSIDE(struct passwd *, getpwuid, (uid_t user), (user))
OUTSIDE(int, getpwnam_r, (const char *name, struct passwd *entry, char *bytes, size_t size, struct passwd **found),
        (name, entry, bytes, size, found))
OUTSIDE(int, getpwuid_r, (uid_t user, struct passwd *entry, char *bytes, size_t size, struct passwd **found),
        (user, entry, bytes, size, found))
OUTSIDE(struct group *, getgrnam, (const char *name), (name))
OUTSIDE(struct group *, getgrgid, (gid_t group), (group))
OUTSIDE(struct hostent *, gethostbyname, (const char *name), (name))
OUTSIDE(int, getgrnam_r, (const char *name, struct group *entry, char *bytes, size_t size, struct group **found),
        (name, entry, bytes, size, found))
OUTSIDE(int, getgrgid_r, (gid_t group, struct group *entry, char *bytes, size_t size, struct group **found),
        (group, entry, bytes, size, found))
OUTSIDE(struct passwd *, getpwent, (void), ())
OUTSIDE(struct group *, getgrent, (void), ())
OUTSIDE(int, getgrouplist, (const char *user, gid_t group, gid_t *groups, int *count), (user, group, groups, count))
OUTSIDE(int, gethostbyname_r,
        (const char *name, struct hostent *entry, char *bytes, size_t size, struct hostent **found, int *why),
        (name, entry, bytes, size, found, why))
OUTSIDE(struct hostent *, gethostbyaddr, (const void *address, socklen_t size, int type), (address, size, type))
OUTSIDE(struct servent *, getservbyname, (const char *name, const char *protocol), (name, protocol))
OUTSIDE(struct servent *, getservbyport, (int port, const char *protocol), (port, protocol))
OUTSIDE(struct protoent *, getprotobyname, (const char *name), (name))
OUTSIDE(int, getnameinfo,
        (const struct sockaddr *address, socklen_t size, char *host, socklen_t host_size, char *service,
         socklen_t service_size, int flags),
        (address, size, host, host_size, service, service_size, flags))
OUTSIDE(char *, strerror, (int number), (number))
OUTSIDE(int, getaddrinfo,
        (const char *node, const char *service, const struct addrinfo *hints, struct addrinfo **found),
        (node, service, hints, found))

/* The same for a function without a result. */
#define OUTSIDE_VOID(Name)                                                                                             \
    NEXT(void, Name, (void))                                                                                           \
    void Name(void) {                                                                                                  \
        tl_fmu_heap *heap = tl_fmu_libc_enter(NULL);                                                                   \
        find_##Name();                                                                                                 \
        own_##Name();                                                                                                  \
        (void)tl_fmu_libc_enter(heap);                                                                                 \
    }

OUTSIDE_VOID(tzset)
OUTSIDE_VOID(setpwent)
OUTSIDE_VOID(endpwent)
OUTSIDE_VOID(setgrent)
OUTSIDE_VOID(endgrent)

// NOLINTEND(readability-inconsistent-declaration-parameter-name,readability-identifier-naming,bugprone-reserved-identifier,cert-dcl37-c,cert-dcl51-cpp)

#endif
