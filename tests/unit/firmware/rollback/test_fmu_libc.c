/* malloc() and related functions, inside and outside of an FMU's call, and random numbers of
 * both. */
#include <errno.h>
#include <malloc.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/rollback/fmu_heap.h"
#include "firmware/rollback/fmu_libc.h"
#include "tests/support/message.h"

enum { SKIPPED = 77 };

static tl_fmu_heap *heaps[2];

/* Volatile, because a compiler may remove unused allocations. */
static void *(*volatile take)(size_t size) = malloc;
static void *(*volatile take_zeroed)(size_t count, size_t size) = calloc;
static void *(*volatile take_aligned)(size_t alignment, size_t size) = aligned_alloc;
static void *(*volatile take_again)(void *block, size_t size) = realloc;

void setUp(void) {
    tl_error error;
    for (size_t i = 0; i < 2; i++) {
        heaps[i] = tl_fmu_libc_open(1 << 22, &error);
        TEST_ASSERT_TRUE(heaps[i] != NULL);
    }
}

void tearDown(void) {
    (void)tl_fmu_libc_enter(NULL);
}

static bool is_in(const tl_fmu_heap *heap, const void *block) {
    return tl_fmu_heap_holds(heap, block);
}

/* Also shrinks a block. */
static void *grow(void *block, size_t size) {
    void *grown = realloc(block, size);
    TEST_ASSERT_NOT_NULL(grown);
    return grown;
}

static void test_each_fmu_has_its_own_heap(void) {
    volatile size_t odd = 48; /* memalign() rounds it up to 64 */
    for (size_t i = 0; i < 2; i++) {
        void *block = NULL;
        TEST_ASSERT_NULL(tl_fmu_libc_enter(heaps[i]));
        void *const taken[] = {malloc(10),        calloc(3, 7), realloc(NULL, 50), aligned_alloc(64, 128),
                               memalign(odd, 10), valloc(10),   pvalloc(10),       strdup("a text")};
        TEST_ASSERT_EQUAL_INT(0, posix_memalign(&block, 256, 10));
        TEST_ASSERT_EQUAL_PTR(heaps[i], tl_fmu_libc_enter(NULL));
        for (size_t k = 0; k < sizeof taken / sizeof taken[0]; k++) {
            TEST_ASSERT_TRUE(is_in(heaps[i], taken[k]));
            free(taken[k]);
        }
        TEST_ASSERT_TRUE(is_in(heaps[i], block) && (uintptr_t)block % 256 == 0);
        TEST_ASSERT_EQUAL_UINT64(0, (uintptr_t)taken[3] % 64);
        TEST_ASSERT_EQUAL_UINT64(0, (uintptr_t)taken[4] % 64);
        TEST_ASSERT_EQUAL_UINT64(0, (uintptr_t)taken[5] % (uintptr_t)sysconf(_SC_PAGESIZE));
        free(block);
    }
    void *const outside[] = {malloc(10), calloc(3, 7), aligned_alloc(64, 128), valloc(10), pvalloc(10)};
    for (size_t k = 0; k < sizeof outside / sizeof outside[0]; k++) {
        TEST_ASSERT_FALSE(is_in(heaps[0], outside[k]) || is_in(heaps[1], outside[k]));
        TEST_ASSERT_GREATER_OR_EQUAL_UINT64(10, malloc_usable_size(outside[k]));
        free(outside[k]);
    }
}

static void test_a_block_goes_where_it_came_from(void) {
    char *outside = malloc(20);
    (void)tl_fmu_libc_enter(heaps[0]);
    char *inside = malloc(20);
    memcpy(inside, "inside", sizeof "inside");
    memcpy(outside, "outside", sizeof "outside");
    outside = grow(outside, 100000);
    TEST_ASSERT_FALSE(is_in(heaps[0], outside));
    TEST_ASSERT_EQUAL_STRING("outside", outside);
    (void)tl_fmu_libc_enter(heaps[1]);
    inside = grow(inside, 3000);
    TEST_ASSERT_TRUE(is_in(heaps[0], inside));
    TEST_ASSERT_EQUAL_STRING("inside", inside);
    (void)tl_fmu_libc_enter(NULL);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(3000, malloc_usable_size(inside));
    volatile size_t none = 0;
    TEST_ASSERT_NULL(realloc(inside, none)); // NOLINT(clang-analyzer-optin.portability.UnixAPI): as it is here
    free(outside);
    free(NULL);
    TEST_ASSERT_EQUAL_UINT64(0, malloc_usable_size(NULL));
}

static void test_realloc_keeps_what_there_was(void) {
    (void)tl_fmu_libc_enter(heaps[0]);
    unsigned char *block = malloc(1);
    block[0] = 7;
    for (size_t size = 2; size < 200000; size += size / 3 + 1) {
        block = grow(block, size);
        TEST_ASSERT_EQUAL_UINT8(7, block[0]);
        block[size - 1] = 1;
    }
    for (size_t size = 100000; size > 1; size /= 2) {
        block = grow(block, size);
        TEST_ASSERT_EQUAL_UINT8(7, block[0]);
    }
    free(block);
}

static void test_calloc_is_zero_wherever_it_comes_from(void) {
    (void)tl_fmu_libc_enter(heaps[0]);
    for (int i = 0; i < 10; i++) {
        unsigned char *block = calloc(100, 10);
        for (size_t k = 0; k < 1000; k++) {
            TEST_ASSERT_EQUAL_UINT8(0, block[k]);
        }
        memset(block, 0xFF, 1000);
        free(block);
    }
}

static void test_impossible_requests(void) {
    volatile size_t huge = SIZE_MAX / 2 + 1;
    void *block = &block;
    for (size_t i = 0; i < 2; i++) {
        (void)tl_fmu_libc_enter(i == 0 ? heaps[0] : NULL);
        errno = 0;
        TEST_ASSERT_NULL(take(huge));
        TEST_ASSERT_EQUAL_INT(ENOMEM, errno);
        errno = 0;
        TEST_ASSERT_NULL(take_zeroed(huge, 3));
        TEST_ASSERT_EQUAL_INT(ENOMEM, errno);
        TEST_ASSERT_NULL(take_again(NULL, huge));
        TEST_ASSERT_NULL(pvalloc(SIZE_MAX - (i == 0 ? 1 : 2)));
        TEST_ASSERT_EQUAL_INT(EINVAL, posix_memalign(&block, 24, 10));
        TEST_ASSERT_EQUAL_INT(EINVAL, posix_memalign(&block, 2, 10));
        TEST_ASSERT_EQUAL_INT(ENOMEM, posix_memalign(&block, 64, huge));
        TEST_ASSERT_EQUAL_PTR(&block, block);
        errno = 0;
        volatile size_t odd = 24;
        TEST_ASSERT_NULL(take_aligned(odd, 10));
        TEST_ASSERT_EQUAL_INT(EINVAL, errno);
    }
}

static void test_the_number_of_heaps_is_limited(void) {
    tl_error error;
    size_t opened = 0;
    while (opened <= TL_FMU_LIBC_HEAPS && tl_fmu_libc_open(1 << 16, &error) != NULL) {
        opened++;
    }
    TEST_ASSERT_LESS_THAN_UINT64(TL_FMU_LIBC_HEAPS, opened);
    TL_EXPECT_PARTS("256", error.text);
}

static void test_a_heap_that_is_full(void) {
    (void)tl_fmu_libc_enter(heaps[0]);
    void *small = take(100);
    TEST_ASSERT_FALSE(heaps[0]->has_outside_memory);
    unsigned char *large = take_zeroed(3, 2 << 20); /* the heap has 4 MiB */
    void *aligned = take_aligned(4096, 8 << 20);
    TEST_ASSERT_TRUE(heaps[0]->has_outside_memory);
    TEST_ASSERT_FALSE(is_in(heaps[0], large) || is_in(heaps[0], aligned));
    TEST_ASSERT_EQUAL_UINT64(0, (uintptr_t)aligned % 4096);
    TEST_ASSERT_EQUAL_UINT8(0, large[(6 << 20) - 1]);
    large = grow(large, 7 << 20);
    free(aligned);
    free(large);
    free(small);
}

static void *allocate_besides(void *context) {
    const int *pipe = context;
    char byte = 0;
    bool is_woken = pipe == NULL || read(pipe[0], &byte, 1) == 1;
    return malloc(is_woken ? 100 : 1);
}

static void test_another_thread_is_in_no_call(void) {
    pthread_t thread;
    void *block = NULL;
    (void)tl_fmu_libc_enter(heaps[0]);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, allocate_besides, NULL));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, &block));
    TEST_ASSERT_FALSE(is_in(heaps[0], block));
    free(block);
}

static void sleep_shortly(void) {
    TEST_ASSERT_EQUAL_INT(0, usleep(1000));
}

/* An allowed thread has not run as long as it sleeps, and has run when it was woken. */
static void test_a_thread_that_is_allowed(void) {
    pthread_t thread;
    void *block = NULL;
    int pipes[2];
    TEST_ASSERT_EQUAL_INT(0, pipe(pipes));
    heaps[0]->allows_threads = true;
    (void)tl_fmu_libc_enter(heaps[0]);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, allocate_besides, pipes));
    (void)tl_fmu_libc_enter(NULL);
    while (tl_fmu_libc_threads_ran(heaps[0])) {
        sleep_shortly();
    }
    TEST_ASSERT_EQUAL_UINT32(1, tl_fmu_libc_threads_alive(heaps[0]));
    TEST_ASSERT_FALSE(tl_fmu_libc_threads_ran(heaps[0]));
    TEST_ASSERT_EQUAL_INT(1, write(pipes[1], "x", 1));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, &block));
    TEST_ASSERT_TRUE(tl_fmu_libc_threads_ran(heaps[0]));
    while (tl_fmu_libc_threads_alive(heaps[0]) > 0) { /* the kernel needs some time to end it */
        sleep_shortly();
        (void)tl_fmu_libc_threads_ran(heaps[0]);
    }
    TEST_ASSERT_FALSE(tl_fmu_libc_threads_ran(heaps[0]));
    TEST_ASSERT_TRUE(is_in(heaps[0], block));
    TEST_ASSERT_FALSE(heaps[0]->has_threads);
    TEST_ASSERT_EQUAL_INT(0, close(pipes[0]) + close(pipes[1]));
    free(block);
}

static void test_more_threads_than_are_watched(void) {
    heaps[0]->allows_threads = true;
    for (int i = 0; i <= TL_FMU_HEAP_THREADS; i++) {
        pthread_t thread;
        void *block = NULL;
        TEST_ASSERT_FALSE(heaps[0]->has_threads);
        (void)tl_fmu_libc_enter(heaps[0]);
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, allocate_besides, NULL));
        (void)tl_fmu_libc_enter(NULL);
        TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, &block));
        free(block);
    }
    TEST_ASSERT_TRUE(heaps[0]->has_threads);
}

/* The volatile sizes keep the compiler from merging or removing the calls. */
static unsigned char *map_private(volatile size_t size) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *mapping = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(mapping != MAP_FAILED);
    return mapping;
}

static void expect_bytes(unsigned char wanted, const unsigned char *bytes, size_t count) {
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_UINT8(wanted, bytes[i]);
    }
}

static void test_private_mappings_are_in_the_heap(void) {
    enum { SIZE = 10000, PAGES = 3 * 4096 };
    (void)tl_fmu_libc_enter(heaps[0]);
    unsigned char *first = map_private(SIZE);
    unsigned char *second = map_private(SIZE);
    TEST_ASSERT_TRUE(is_in(heaps[0], first) && is_in(heaps[0], second) && first != second);
    TEST_ASSERT_EQUAL_UINT64(0, (uintptr_t)first % 4096);
    memset(first, 1, SIZE);
    memset(second, 2, SIZE);
    TEST_ASSERT_EQUAL_INT(0, munmap(second + 4096, 4096)); /* a part stays */
    expect_bytes(2, second, SIZE);
    TEST_ASSERT_EQUAL_INT(0, munmap(first, SIZE));
    unsigned char *third = map_private(SIZE); /* the same memory, but zeroed */
    TEST_ASSERT_EQUAL_PTR(first, third);
    expect_bytes(0, third, PAGES);
    unsigned char *larger = mremap(second, SIZE, 4 * SIZE, MREMAP_MAYMOVE);
    TEST_ASSERT_TRUE(is_in(heaps[0], larger));
    expect_bytes(2, larger, SIZE);
    expect_bytes(0, larger + SIZE, 3 * SIZE);
    TEST_ASSERT_TRUE(mremap(larger, SIZE, 8 * SIZE, 0) == MAP_FAILED && errno == ENOMEM);
    TEST_ASSERT_EQUAL_INT(0, madvise(larger, 4096, MADV_WILLNEED));
    expect_bytes(2, larger, 4096);
    TEST_ASSERT_EQUAL_INT(0, madvise(larger, 4096, MADV_DONTNEED));
    expect_bytes(0, larger, 4096);
    TEST_ASSERT_FALSE(heaps[0]->has_outside_memory);
    TEST_ASSERT_EQUAL_INT(0, mprotect(third, 4096, PROT_READ));
    TEST_ASSERT_TRUE(heaps[0]->has_outside_memory);
    TEST_ASSERT_EQUAL_INT(0, mprotect(third, 4096, PROT_READ | PROT_WRITE));
}

/* Maps and unmaps without growing, in an order that is not that of the list. */
static void test_mappings_are_used_again(void) {
    unsigned char *mappings[8];
    size_t used = 0;
    (void)tl_fmu_libc_enter(heaps[0]);
    for (int round = 0; round < 100; round++) {
        for (size_t i = 0; i < 8; i++) {
            mappings[i] = map_private(4096);
        }
        for (size_t i = 0; i < 8; i++) {
            TEST_ASSERT_EQUAL_INT(0, munmap(mappings[(5 * i + (size_t)round) % 8], 4096));
        }
        used = round == 0 ? tl_fmu_heap_used(heaps[0]) : used;
    }
    TEST_ASSERT_EQUAL_size_t(used, tl_fmu_heap_used(heaps[0]));
}

static void test_memory_that_it_maps_is_noted(void) {
    (void)tl_fmu_libc_enter(heaps[0]);
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *constant = mmap(NULL, 4096, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_FALSE(heaps[0]->has_outside_memory);
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *own = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    (void)tl_fmu_libc_enter(NULL);
    TEST_ASSERT_TRUE(heaps[0]->has_outside_memory);
    TEST_ASSERT_FALSE(heaps[1]->has_outside_memory);
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *ours = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_EQUAL_INT(0, munmap(constant, 4096) + munmap(own, 4096) + munmap(ours, 4096));
}

// NOLINTBEGIN(cert-msc30-c,cert-msc50-cpp,cert-msc32-c,cert-msc51-cpp): these are what is tested
/* ---- random numbers ---- */

/* The first random numbers of a new program. */
static void expect_the_first(void) {
    TEST_ASSERT_EQUAL_INT(1804289383, rand());
    TEST_ASSERT_EQUAL_INT64(846930886, random());
    double word = drand48();
    TEST_ASSERT_EQUAL_DOUBLE(3.907985046680551e-14, word);
}

static void test_each_has_its_own_random_numbers(void) {
    expect_the_first();
    for (size_t i = 0; i < 2; i++) {
        (void)tl_fmu_libc_enter(heaps[i]);
        expect_the_first();
        srand(5);
        srand48(5);
    }
    long of_other = random();
    double word_of_other = drand48();
    (void)tl_fmu_libc_enter(heaps[0]);
    TEST_ASSERT_EQUAL_INT64(of_other, random());
    double word = drand48();
    TEST_ASSERT_EQUAL_DOUBLE(word_of_other, word);
    (void)tl_fmu_libc_enter(NULL);
    TEST_ASSERT_EQUAL_INT(1681692777, rand()); /* the third number of the sequence */
}

static void test_all_kinds_of_random_numbers(void) {
    char bytes[64];
    unsigned short words[3] = {1, 2, 3};
    unsigned short parameters[7] = {1, 2, 3, 4, 5, 6, 7};
    (void)tl_fmu_libc_enter(heaps[0]);
    srandom(9);
    long first = random();
    char *before = initstate(9, bytes, sizeof bytes);
    TEST_ASSERT_NOT_NULL(before);
    (void)random();
    TEST_ASSERT_EQUAL_PTR(bytes, setstate(before));
    long second = random();
    srandom(9);
    TEST_ASSERT_EQUAL_INT64(first, random());
    TEST_ASSERT_EQUAL_INT64(second, random());
    (void)seed48(words);
    long of_words = lrand48();
    TEST_ASSERT_EQUAL_INT64(of_words, nrand48(words));
    long signed_of_state = mrand48();
    long signed_of_caller = jrand48(words);
    TEST_ASSERT_EQUAL_INT64(signed_of_state, signed_of_caller);
    double of_state = drand48(); /* the assertion may evaluate its argument twice */
    double of_caller = erand48(words);
    TEST_ASSERT_EQUAL_DOUBLE(of_state, of_caller);
    lcong48(parameters);
    long other = lrand48();
    TEST_ASSERT_NOT_EQUAL_INT64(of_words, other);
}

// NOLINTEND(cert-msc30-c,cert-msc50-cpp,cert-msc32-c,cert-msc51-cpp)

int main(void) {
    if (!tl_fmu_libc_serves()) {
        printf("skipped: not with a sanitizer\n");
        return SKIPPED;
    }
    UNITY_BEGIN();
    RUN_TEST(test_each_fmu_has_its_own_heap);
    RUN_TEST(test_a_block_goes_where_it_came_from);
    RUN_TEST(test_realloc_keeps_what_there_was);
    RUN_TEST(test_calloc_is_zero_wherever_it_comes_from);
    RUN_TEST(test_impossible_requests);
    RUN_TEST(test_a_heap_that_is_full);
    RUN_TEST(test_another_thread_is_in_no_call);
    RUN_TEST(test_a_thread_that_is_allowed);
    RUN_TEST(test_more_threads_than_are_watched);
    RUN_TEST(test_private_mappings_are_in_the_heap);
    RUN_TEST(test_mappings_are_used_again);
    RUN_TEST(test_memory_that_it_maps_is_noted);
    RUN_TEST(test_each_has_its_own_random_numbers);
    RUN_TEST(test_all_kinds_of_random_numbers);
    RUN_TEST(test_the_number_of_heaps_is_limited); /* last, because heaps are never closed */
    return UNITY_END();
}
