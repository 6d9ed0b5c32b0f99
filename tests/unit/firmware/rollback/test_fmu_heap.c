/* An FMU's heap: blocks like those of malloc(), the same addresses for the same calls, all in one
 * range of bytes. */
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include <unity.h>

#include "firmware/rollback/fmu_heap.h"
#include "tests/support/random_numbers.h"

enum { RESERVE = 8 * 1024 * 1024, BLOCKS = 300, ROUNDS = 20000 };

typedef struct block {
    unsigned char *bytes;
    size_t size;
    unsigned char mark;
} block;

static tl_fmu_heap heap;
static block blocks[BLOCKS];
static tl_test_random dice;

void setUp(void) {
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_heap_open(&heap, RESERVE, &error));
    memset(blocks, 0, sizeof blocks);
    dice = (tl_test_random){20261123};
}

void tearDown(void) {
    (void)munmap(heap.base, heap.reserved);
}

static void expect_marked(const block *one) {
    for (size_t i = 0; i < one->size; i++) {
        TEST_ASSERT_EQUAL_HEX8(one->mark, one->bytes[i]);
    }
}

static size_t any_size(void) {
    return tl_test_random_below(&dice, tl_test_random_chance(&dice, 10) ? 20000 : 300);
}

static void take(block *one) {
    size_t alignment = (size_t)16 << tl_test_random_below(&dice, tl_test_random_chance(&dice, 5) ? 9 : 1);
    one->size = any_size();
    one->mark = (unsigned char)tl_test_random_below(&dice, 256);
    one->bytes = tl_fmu_heap_allocate(&heap, one->size, alignment);
    TEST_ASSERT_NOT_NULL(one->bytes);
    TEST_ASSERT_EQUAL_UINT64(0, (uintptr_t)one->bytes % alignment);
    TEST_ASSERT_TRUE(tl_fmu_heap_holds(&heap, one->bytes));
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(one->size, tl_fmu_heap_size(one->bytes));
    memset(one->bytes, one->mark, one->size);
}

/* Allocates or frees a random block. */
static void change_one(void) {
    block *one = &blocks[tl_test_random_below(&dice, BLOCKS)];
    if (one->bytes == NULL) {
        take(one);
        return;
    }
    expect_marked(one);
    tl_fmu_heap_release(&heap, one->bytes);
    one->bytes = NULL;
}

static void test_no_block_touches_another(void) {
    for (int i = 0; i < ROUNDS; i++) {
        change_one();
    }
    for (size_t i = 0; i < BLOCKS; i++) {
        if (blocks[i].bytes != NULL) {
            expect_marked(&blocks[i]);
        }
    }
    TEST_ASSERT_LESS_THAN_UINT64(RESERVE / 2, tl_fmu_heap_used(&heap)); /* freed memory is reused */
}

static void test_it_is_in_its_bytes(void) {
    static block then[BLOCKS];
    static unsigned char *first[100];
    tl_test_random dice_then;
    for (int i = 0; i < 1000; i++) {
        change_one();
    }
    size_t used = tl_fmu_heap_used(&heap);
    unsigned char *saved = malloc(used);
    TEST_ASSERT_NOT_NULL(saved);
    memcpy(saved, heap.base, used);
    memcpy(then, blocks, sizeof then);
    dice_then = dice;
    for (int time = 0; time < 3; time++) {
        for (int i = 0; i < 100; i++) {
            unsigned char *taken = tl_fmu_heap_allocate(&heap, any_size(), 16);
            TEST_ASSERT_TRUE(time == 0 || first[i] == taken);
            first[i] = taken;
        }
        for (int i = 0; i < 1000; i++) {
            change_one();
        }
        memcpy(heap.base, saved, used);
        tl_fmu_heap_restored(&heap, used);
        TEST_ASSERT_EQUAL_UINT64(used, tl_fmu_heap_used(&heap));
        memcpy(blocks, then, sizeof blocks);
        dice = dice_then;
    }
    free(saved);
    for (size_t i = 0; i < BLOCKS; i++) {
        if (blocks[i].bytes != NULL) {
            expect_marked(&blocks[i]);
        }
    }
}

static void test_what_lies_behind_is_zero(void) {
    size_t used = tl_fmu_heap_used(&heap);
    unsigned char *saved = malloc(used);
    TEST_ASSERT_NOT_NULL(saved);
    memcpy(saved, heap.base, used);
    memset(tl_fmu_heap_allocate(&heap, 100000, 16), 0xAA, 100000);
    memcpy(heap.base, saved, used);
    tl_fmu_heap_restored(&heap, used);
    free(saved);
    const unsigned char *again = tl_fmu_heap_allocate(&heap, 100000, 16);
    for (size_t i = 0; i < 100000; i++) {
        TEST_ASSERT_EQUAL_HEX8(0, again[i]);
    }
}

/* Restores a smaller heap, then a larger one. */
static void test_in_any_order(void) {
    size_t small = tl_fmu_heap_used(&heap);
    unsigned char *saved = malloc(RESERVE);
    TEST_ASSERT_NOT_NULL(saved);
    memset(tl_fmu_heap_allocate(&heap, 100000, 16), 0xAA, 100000);
    size_t large = tl_fmu_heap_used(&heap);
    memcpy(saved, heap.base, large);
    tl_fmu_heap_restored(&heap, small);
    memcpy(heap.base, saved, large);
    tl_fmu_heap_restored(&heap, large);
    TEST_ASSERT_EQUAL_UINT64(large, tl_fmu_heap_used(&heap));
    TEST_ASSERT_EQUAL_MEMORY(saved, heap.base, large);
    free(saved);
}

static void test_a_class_wastes_a_quarter_at_most(void) {
    for (size_t size = 1; size < RESERVE / 4; size += 1 + size / 7) {
        void *taken = tl_fmu_heap_allocate(&heap, size, 16);
        TEST_ASSERT_NOT_NULL(taken);
        TEST_ASSERT_LESS_OR_EQUAL_UINT64(size + size / 4 + 16, tl_fmu_heap_size(taken));
        TEST_ASSERT_GREATER_OR_EQUAL_UINT64(size, tl_fmu_heap_size(taken));
        tl_fmu_heap_release(&heap, taken);
        if (tl_fmu_heap_used(&heap) > RESERVE / 2) {
            tearDown();
            setUp();
        }
    }
}

static void test_no_room(void) {
    size_t used = tl_fmu_heap_used(&heap);
    TEST_ASSERT_NULL(tl_fmu_heap_allocate(&heap, RESERVE, 16));
    TEST_ASSERT_NULL(tl_fmu_heap_allocate(&heap, SIZE_MAX, 16));
    TEST_ASSERT_NULL(tl_fmu_heap_allocate(&heap, SIZE_MAX / 2, 4096));
    TEST_ASSERT_NULL(tl_fmu_heap_allocate(&heap, 16, (size_t)1 << (8 * sizeof(size_t) - 1)));
    TEST_ASSERT_EQUAL_UINT64(used, tl_fmu_heap_used(&heap));
    while (tl_fmu_heap_allocate(&heap, 1000000, 16) != NULL) {
    }
    TEST_ASSERT_NOT_NULL(tl_fmu_heap_allocate(&heap, 100, 16));
}

/* An FMU that writes before its block. */
static void test_a_destroyed_head(void) {
    unsigned char *taken = tl_fmu_heap_allocate(&heap, 100, 16);
    memset(taken - 16, 0xFF, 16);
    TEST_ASSERT_EQUAL_UINT64(0, tl_fmu_heap_size(taken));
    tl_fmu_heap_release(&heap, taken);
    TEST_ASSERT_NOT_NULL(tl_fmu_heap_allocate(&heap, 100, 16));
    memset(heap.base, 0xFF, 8); /* the field with the used size */
    TEST_ASSERT_LESS_OR_EQUAL_UINT64(RESERVE, tl_fmu_heap_used(&heap));
    TEST_ASSERT_NULL(tl_fmu_heap_allocate(&heap, 5000, 16));
}

/* Each thread allocates, marks, checks and frees: no two threads get the same block. */
static void *work_beside(void *failures) {
    for (int i = 0; i < ROUNDS; i++) {
        unsigned char *own[8];
        for (size_t k = 0; k < 8; k++) {
            own[k] = tl_fmu_heap_allocate(&heap, 64, 16);
            memset(own[k], (int)((uintptr_t)failures / sizeof(int) % 200 + k), 64);
        }
        for (size_t k = 0; k < 8; k++) {
            *(int *)failures +=
                own[k][0] != own[k][63] || own[k][0] != (unsigned char)((uintptr_t)failures / sizeof(int) % 200 + k);
            tl_fmu_heap_release(&heap, own[k]);
        }
    }
    return NULL;
}

static void test_threads_take_and_give_back(void) {
    static int failures[3];
    pthread_t threads[3];
    for (size_t i = 0; i < 3; i++) {
        failures[i] = 0;
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, work_beside, &failures[i]));
    }
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_join(threads[i], NULL));
        TEST_ASSERT_EQUAL_INT(0, failures[i]);
    }
    TEST_ASSERT_LESS_THAN_UINT64(8192, tl_fmu_heap_used(&heap)); /* room for 24 blocks */
}

static void test_no_addresses(void) {
    tl_fmu_heap other;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_fmu_heap_open(&other, SIZE_MAX - ((size_t)1 << 20), &error));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_no_block_touches_another);
    RUN_TEST(test_it_is_in_its_bytes);
    RUN_TEST(test_what_lies_behind_is_zero);
    RUN_TEST(test_in_any_order);
    RUN_TEST(test_a_class_wastes_a_quarter_at_most);
    RUN_TEST(test_no_room);
    RUN_TEST(test_a_destroyed_head);
    RUN_TEST(test_threads_take_and_give_back);
    RUN_TEST(test_no_addresses);
    return UNITY_END();
}
