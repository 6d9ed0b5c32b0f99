/* Start-up memory: zeroed, aligned, sealed, released as a whole. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "master/base/arena.h"

/* A type with the strictest alignment in C99. */
typedef union widest {
    long double number;
    int64_t integer;
    void *pointer;
} widest;

typedef struct probe {
    char first;
    widest second;
} probe;

static tl_arena arena;

void setUp(void) {
    tl_arena_init(&arena);
}

void tearDown(void) {
    tl_arena_release(&arena);
}

static void objects_are_zeroed_aligned_and_apart(void) {
    unsigned char *last_end = NULL;
    for (size_t size = 1; size < 200; size++) {
        unsigned char *object = tl_arena_take(&arena, 3, size);
        TEST_ASSERT_NOT_NULL(object);
        TEST_ASSERT_EQUAL_UINT64(0, (uintptr_t)object % offsetof(probe, second));
        for (size_t i = 0; i < 3 * size; i++) {
            TEST_ASSERT_EQUAL_UINT8(0, object[i]);
        }
        TEST_ASSERT_TRUE(last_end == NULL || object >= last_end || object + 3 * size <= last_end);
        memset(object, 0xA5, 3 * size); /* the next object must not see this */
        last_end = object + 3 * size;
    }
}

static void an_object_larger_than_a_block_fits_and_so_does_what_follows(void) {
    unsigned char *large = tl_arena_take(&arena, 5, TL_ARENA_BLOCK);
    unsigned char *small = tl_arena_take(&arena, 1, 8);
    TEST_ASSERT_NOT_NULL(large);
    TEST_ASSERT_NOT_NULL(small);
    memset(large, 0xFF, 5 * (size_t)TL_ARENA_BLOCK);
    TEST_ASSERT_EQUAL_UINT8(0, small[0]);
    TEST_ASSERT_TRUE(tl_arena_used(&arena) >= 5 * (size_t)TL_ARENA_BLOCK + 8);
}

static void nothing_of_nothing_is_still_a_pointer(void) {
    TEST_ASSERT_NOT_NULL(tl_arena_take(&arena, 0, 8));
    TEST_ASSERT_NOT_NULL(tl_arena_take(&arena, 8, 0));
}

static void a_size_that_overflows_is_refused(void) {
    TEST_ASSERT_NULL(tl_arena_take(&arena, SIZE_MAX / 2, 3));
    TEST_ASSERT_NULL(tl_arena_take(&arena, SIZE_MAX, 1));
    TEST_ASSERT_NULL(tl_arena_take(&arena, 1, SIZE_MAX));
    TEST_ASSERT_EQUAL_UINT64(0, tl_arena_used(&arena));
}

static void text_is_copied(void) {
    char text[] = "ω in rad/s";
    char *copy = tl_arena_text(&arena, text);
    text[0] = '?';
    TEST_ASSERT_EQUAL_STRING("ω in rad/s", copy);
}

static void a_sealed_arena_gives_nothing(void) {
    TEST_ASSERT_NOT_NULL(tl_arena_take(&arena, 1, 8));
    size_t used = tl_arena_used(&arena);
    tl_arena_seal(&arena);
    TEST_ASSERT_NULL(tl_arena_take(&arena, 1, 8));
    TEST_ASSERT_NULL(tl_arena_take(&arena, 0, 0));
    TEST_ASSERT_NULL(tl_arena_text(&arena, "x"));
    TEST_ASSERT_EQUAL_UINT64(used, tl_arena_used(&arena));
}

static void a_released_arena_can_be_used_again(void) {
    TEST_ASSERT_NOT_NULL(tl_arena_take(&arena, 1, 8));
    tl_arena_seal(&arena);
    tl_arena_release(&arena);
    TEST_ASSERT_EQUAL_UINT64(0, tl_arena_used(&arena));
    TEST_ASSERT_NOT_NULL(tl_arena_take(&arena, 1, 8));
    tl_arena_release(&arena);
    tl_arena_release(&arena); /* a second release has no effect */
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(objects_are_zeroed_aligned_and_apart);
    RUN_TEST(an_object_larger_than_a_block_fits_and_so_does_what_follows);
    RUN_TEST(nothing_of_nothing_is_still_a_pointer);
    RUN_TEST(a_size_that_overflows_is_refused);
    RUN_TEST(text_is_copied);
    RUN_TEST(a_sealed_arena_gives_nothing);
    RUN_TEST(a_released_arena_can_be_used_again);
    return UNITY_END();
}
