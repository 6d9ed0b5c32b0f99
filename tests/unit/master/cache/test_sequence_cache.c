/* A tree of input sequences: exact keys, a fixed pool, and reuse of dropped nodes. TL_TEST_WALKS
 * is the number of random walks. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "master/cache/sequence_cache.h"
#include "tests/support/random_numbers.h"

enum { ROOM = 8 };

static tl_arena arena;
static tl_sequence_cache cache;
static uint32_t root;

static void start(size_t key_size, size_t value_size, uint32_t capacity) {
    tl_arena_release(&arena);
    tl_arena_init(&arena);
    TEST_ASSERT_TRUE(tl_sequence_cache_init(&cache, &arena, key_size, value_size, capacity));
    root = tl_sequence_cache_create_root(&cache);
    TEST_ASSERT_NOT_EQUAL_UINT32(TL_NO_NODE, root);
}

void setUp(void) {
    tl_arena_init(&arena);
    start(sizeof(double), sizeof(double), ROOM);
}

void tearDown(void) {
    tl_arena_release(&arena);
}

static uint32_t add(uint32_t parent, double key) {
    double value = 100.0 + key;
    return tl_sequence_cache_add(&cache, parent, &key, &value);
}

static uint32_t find(uint32_t parent, double key) {
    return tl_sequence_cache_find(&cache, parent, &key);
}

static void assert_value(uint32_t node, double expected) {
    double value = 0.0;
    memcpy(&value, tl_sequence_cache_value(&cache, node), sizeof value);
    TEST_ASSERT_TRUE(value == expected);
}

/* ---- keys ---- */

static void a_sequence_is_found_by_its_inputs_in_order(void) {
    uint32_t one = add(root, 1.0);
    uint32_t two = add(one, 2.0);
    uint32_t other = add(root, 2.0);
    TEST_ASSERT_EQUAL_UINT32(one, find(root, 1.0));
    TEST_ASSERT_EQUAL_UINT32(two, find(one, 2.0));
    TEST_ASSERT_EQUAL_UINT32(other, find(root, 2.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(one, 1.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(other, 1.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, 3.0));
    assert_value(two, 102.0);
    assert_value(other, 102.0);
    TEST_ASSERT_EQUAL_UINT32(4, cache.count);
}

static void zeros_of_different_sign_are_different(void) {
    uint32_t positive = add(root, 0.0);
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, -0.0));
    uint32_t negative = add(root, -0.0);
    TEST_ASSERT_EQUAL_UINT32(positive, find(root, 0.0));
    TEST_ASSERT_EQUAL_UINT32(negative, find(root, -0.0));
}

static void the_next_number_is_another_one(void) {
    (void)add(root, 1.0);
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, nextafter(1.0, 2.0)));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, nextafter(1.0, 0.0)));
}

/* A NaN is found again only by the same bits. */
static void not_a_number_matches_its_own_bits_only(void) {
    static const uint64_t quiet = UINT64_C(0x7FF8000000000000);
    static const uint64_t other = UINT64_C(0x7FF8000000000001);
    static const uint64_t negative = UINT64_C(0xFFF8000000000000);
    double value = 0.0;
    uint32_t node = tl_sequence_cache_add(&cache, root, &quiet, &value);
    TEST_ASSERT_EQUAL_UINT32(node, tl_sequence_cache_find(&cache, root, &quiet));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, tl_sequence_cache_find(&cache, root, &other));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, tl_sequence_cache_find(&cache, root, &negative));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, 0.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, HUGE_VAL));
}

static void the_last_byte_of_a_long_key_counts(void) {
    unsigned char key[40] = {0};
    unsigned char value = 1;
    start(sizeof key, 1, ROOM);
    uint32_t node = tl_sequence_cache_add(&cache, root, key, &value);
    key[39] = 1;
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, tl_sequence_cache_find(&cache, root, key));
    key[39] = 0;
    TEST_ASSERT_EQUAL_UINT32(node, tl_sequence_cache_find(&cache, root, key));
}

/* A component without inputs has one sequence only. A component without outputs has no values. */
static void keys_and_values_may_be_empty(void) {
    start(0, 0, ROOM);
    uint32_t one = tl_sequence_cache_add(&cache, root, "", "");
    uint32_t two = tl_sequence_cache_add(&cache, one, "", "");
    TEST_ASSERT_EQUAL_UINT32(one, tl_sequence_cache_find(&cache, root, ""));
    TEST_ASSERT_EQUAL_UINT32(two, tl_sequence_cache_find(&cache, one, ""));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, tl_sequence_cache_find(&cache, two, ""));
}

/* ---- the pool ---- */

static void a_full_pool_refuses_and_stays_as_it_is(void) {
    uint32_t at = root;
    for (size_t i = 1; i < ROOM; i++) {
        at = add(at, (double)i);
        TEST_ASSERT_NOT_EQUAL_UINT32(TL_NO_NODE, at);
    }
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, add(at, 0.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, add(root, 0.0));
    TEST_ASSERT_EQUAL_UINT32(ROOM, cache.count);
    TEST_ASSERT_EQUAL_UINT32(ROOM, cache.peak);
    at = root;
    for (size_t i = 1; i < ROOM; i++) {
        at = find(at, (double)i);
        assert_value(at, 100.0 + (double)i);
    }
}

static void what_is_given_up_is_used_again(void) {
    for (size_t round = 0; round < 5; round++) {
        uint32_t one = add(root, 1.0);
        for (size_t i = 0; i < 3; i++) {
            TEST_ASSERT_NOT_EQUAL_UINT32(TL_NO_NODE, add(one, (double)i));
        }
        uint32_t two = add(root, 2.0);
        TEST_ASSERT_NOT_EQUAL_UINT32(TL_NO_NODE, add(two, 0.0));
        TEST_ASSERT_NOT_EQUAL_UINT32(TL_NO_NODE, add(two, 1.0));
        TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, add(two, 2.0));
        tl_sequence_cache_prune(&cache, root);
        TEST_ASSERT_EQUAL_UINT32(1, cache.count);
        TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, 1.0));
        TEST_ASSERT_TRUE(cache.nodes[root].used);
    }
    TEST_ASSERT_EQUAL_UINT32(ROOM, cache.peak);
}

/* The handle of a dropped node is reused for the next state, so there are no more handles than
 * kept states. */
static void handles_go_from_node_to_node(void) {
    int states[2];
    TEST_ASSERT_NULL(tl_sequence_cache_take_spare(&cache));
    uint32_t one = add(root, 1.0);
    cache.nodes[one].state = &states[0];
    cache.nodes[add(one, 1.0)].state = &states[1];
    (void)add(one, 2.0);
    tl_sequence_cache_prune(&cache, root);
    fmi2FMUstate first = tl_sequence_cache_take_spare(&cache);
    fmi2FMUstate second = tl_sequence_cache_take_spare(&cache);
    TEST_ASSERT_TRUE((first == &states[0] && second == &states[1]) || (first == &states[1] && second == &states[0]));
    TEST_ASSERT_NULL(tl_sequence_cache_take_spare(&cache));
    for (size_t i = 1; i < ROOM; i++) {
        TEST_ASSERT_NULL(cache.nodes[add(root, (double)i)].state);
    }
    tl_sequence_cache_put_spare(&cache, NULL);
    TEST_ASSERT_NULL(tl_sequence_cache_take_spare(&cache));
    tl_sequence_cache_put_spare(&cache, &states[0]);
    TEST_ASSERT_EQUAL_PTR(&states[0], tl_sequence_cache_take_spare(&cache));
}

/* ---- moving on ---- */

static void a_committed_root_keeps_what_is_below_it(void) {
    uint32_t one = add(root, 1.0);
    uint32_t two = add(root, 2.0);
    uint32_t below = add(one, 3.0);
    (void)add(two, 4.0);
    tl_sequence_cache_keep_only(&cache, one, one);
    TEST_ASSERT_EQUAL_UINT32(2, cache.count);
    TEST_ASSERT_EQUAL_UINT32(below, find(one, 3.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, cache.nodes[one].parent);
    TEST_ASSERT_FALSE(cache.nodes[root].used);
    TEST_ASSERT_FALSE(cache.nodes[two].used);
}

/* The path from the last state to the root is kept; branches beside it are not. */
static void the_way_back_to_an_ancestor_is_kept(void) {
    uint32_t one = add(root, 1.0);
    uint32_t two = add(one, 2.0);
    uint32_t three = add(two, 3.0);
    uint32_t below = add(three, 4.0);
    (void)add(one, 7.0);
    (void)add(two, 8.0);
    tl_sequence_cache_keep_only(&cache, one, three);
    TEST_ASSERT_EQUAL_UINT32(4, cache.count);
    TEST_ASSERT_EQUAL_UINT32(two, find(one, 2.0));
    TEST_ASSERT_EQUAL_UINT32(three, find(two, 3.0));
    TEST_ASSERT_EQUAL_UINT32(below, find(three, 4.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(one, 7.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(two, 8.0));
    TEST_ASSERT_EQUAL_UINT32(one, cache.nodes[two].parent);
}

/* Only the part below a node is dropped. */
static void a_branch_is_pruned_and_its_siblings_stay(void) {
    uint32_t one = add(root, 1.0);
    uint32_t two = add(root, 2.0);
    uint32_t three = add(one, 3.0);
    (void)add(three, 4.0);
    uint32_t five = add(two, 5.0);
    tl_sequence_cache_prune(&cache, one);
    TEST_ASSERT_EQUAL_UINT32(4, cache.count);
    TEST_ASSERT_EQUAL_UINT32(one, find(root, 1.0));
    TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(one, 3.0));
    TEST_ASSERT_EQUAL_UINT32(five, find(two, 5.0));
}

/* ---- compared with a list of all sequences ---- */

enum { MOST = 64, LONGEST = 24 };

/* The sequences that must be known, as texts from the root on. The values in the tree are their
 * numbers. */
typedef struct model {
    char sequences[MOST][LONGEST];
    double numbers[MOST];
    size_t count;
} model;

static model expected;
static char where[64];

static size_t look_up(const char *sequence) {
    size_t i = 0;
    while (i < expected.count && strcmp(expected.sequences[i], sequence) != 0) {
        i++;
    }
    return i;
}

/* The root moves to a child: sequences with another beginning are dropped. */
static void shift_model(char first) {
    size_t kept = 0;
    for (size_t i = 0; i < expected.count; i++) {
        if (expected.sequences[i][0] == first && expected.sequences[i][1] != '\0') {
            memmove(expected.sequences[kept], expected.sequences[i] + 1, LONGEST - 1);
            expected.numbers[kept++] = expected.numbers[i];
        }
    }
    expected.count = kept;
}

/* Walks a sequence and adds missing nodes. */
static void walk(tl_test_random *random, double *number) {
    char sequence[LONGEST] = "";
    uint32_t at = root;
    size_t length = tl_test_random_between(random, 1, 6);
    for (size_t i = 0; i < length; i++) {
        char key = (char)('a' + (char)tl_test_random_below(random, 3));
        sequence[i] = key;
        sequence[i + 1] = '\0';
        uint32_t next = tl_sequence_cache_find(&cache, at, &key);
        size_t known = look_up(sequence);
        TEST_ASSERT_EQUAL_INT_MESSAGE(known < expected.count, next != TL_NO_NODE, where);
        if (next == TL_NO_NODE) {
            *number += 1.0;
            next = tl_sequence_cache_add(&cache, at, &key, number);
            TEST_ASSERT_EQUAL_INT_MESSAGE(cache.capacity > expected.count + 1, next != TL_NO_NODE, where);
            if (next == TL_NO_NODE) {
                return;
            }
            memcpy(expected.sequences[expected.count], sequence, sizeof sequence);
            expected.numbers[expected.count++] = *number;
        } else {
            assert_value(next, expected.numbers[known]);
        }
        at = next;
    }
}

static void commit(tl_test_random *random) {
    char key = (char)('a' + (char)tl_test_random_below(random, 3));
    uint32_t next = tl_sequence_cache_find(&cache, root, &key);
    if (next != TL_NO_NODE) {
        root = next;
        tl_sequence_cache_keep_only(&cache, root, root);
        shift_model(key);
    }
}

static void random_walks_know_what_a_list_knows(void) {
    size_t walks = tl_test_campaign("TL_TEST_WALKS", 500);
    for (uint64_t seed = 1; seed <= walks; seed++) {
        tl_test_random random = {tl_test_mix(seed)};
        double number = 0.0;
        (void)snprintf(where, sizeof where, "seed %llu", (unsigned long long)seed);
        start(1, sizeof(double), (uint32_t)tl_test_random_between(&random, 2, MOST));
        expected.count = 0;
        for (size_t i = 0; i < 60; i++) {
            walk(&random, &number);
            if (tl_test_random_chance(&random, 20)) {
                commit(&random);
            }
            if (tl_test_random_chance(&random, 5)) {
                tl_sequence_cache_prune(&cache, root);
                expected.count = 0;
            }
            TEST_ASSERT_EQUAL_UINT32_MESSAGE(expected.count + 1, cache.count, where);
        }
    }
}

/* Whatever it contained: all nodes are free, and all handles are spare. */
static void a_cleared_tree_is_empty(void) {
    static int handles[ROOM];
    for (int round = 0; round < 3; round++) {
        uint32_t at = root;
        for (int i = 0; i < 3; i++) {
            uint32_t child = add(at, (double)i);
            (void)add(at, 10.0 + (double)i);
            fmi2FMUstate spare = tl_sequence_cache_take_spare(&cache);
            cache.nodes[child].state = spare != NULL ? spare : &handles[i];
            at = child;
        }
        tl_sequence_cache_keep_only(&cache, root, at);
        tl_sequence_cache_clear(&cache);
        TEST_ASSERT_EQUAL_UINT32(0, cache.count);
        TEST_ASSERT_EQUAL_UINT32(3, cache.spare_count);
        root = tl_sequence_cache_create_root(&cache);
        TEST_ASSERT_NOT_EQUAL_UINT32(TL_NO_NODE, root);
        TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, find(root, 0.0));
        for (int i = 1; i < ROOM; i++) {
            TEST_ASSERT_NOT_EQUAL_UINT32(TL_NO_NODE, add(root, (double)i));
        }
        TEST_ASSERT_EQUAL_UINT32(TL_NO_NODE, add(root, 99.0));
        tl_sequence_cache_prune(&cache, root);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_sequence_is_found_by_its_inputs_in_order);
    RUN_TEST(zeros_of_different_sign_are_different);
    RUN_TEST(the_next_number_is_another_one);
    RUN_TEST(not_a_number_matches_its_own_bits_only);
    RUN_TEST(the_last_byte_of_a_long_key_counts);
    RUN_TEST(keys_and_values_may_be_empty);
    RUN_TEST(a_full_pool_refuses_and_stays_as_it_is);
    RUN_TEST(what_is_given_up_is_used_again);
    RUN_TEST(handles_go_from_node_to_node);
    RUN_TEST(a_committed_root_keeps_what_is_below_it);
    RUN_TEST(the_way_back_to_an_ancestor_is_kept);
    RUN_TEST(a_branch_is_pruned_and_its_siblings_stay);
    RUN_TEST(a_cleared_tree_is_empty);
    RUN_TEST(random_walks_know_what_a_list_knows);
    return UNITY_END();
}
