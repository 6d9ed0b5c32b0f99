/* SHA-256: the examples of FIPS 180-4, and the sizes at which padding needs another block. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/identity.h"

void setUp(void) {}

void tearDown(void) {}

static void expect_digest(const char *digest, const void *data, size_t size) {
    char text[TL_SHA256_TEXT];
    tl_sha256(data, size, text);
    TEST_ASSERT_EQUAL_STRING(digest, text);
}

static void test_examples_of_the_standard(void) {
    static const char *const two_blocks = "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq";
    static const char *const longer = "abcdefghbcdefghicdefghijdefghijkefghijklfghijklmghijklmnhijklmnoijklmnopjklmnopq"
                                      "klmnopqrlmnopqrsmnopqrstnopqrstu";
    expect_digest("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855", "", 0);
    expect_digest("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855", NULL, 0);
    expect_digest("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad", "abc", 3);
    expect_digest("248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1", two_blocks, 56);
    expect_digest("cf5b16a778af8380036ce59e7b0492370b249b11e8f07a51afac45037afee9d1", longer, 112);
}

static void test_a_million(void) {
    enum { MILLION = 1000000 };
    char *data = malloc(MILLION);
    TEST_ASSERT_NOT_NULL(data);
    memset(data, 'a', MILLION);
    expect_digest("cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0", data, MILLION);
    free(data);
}

static void test_sizes_around_a_block(void) {
    static const struct {
        size_t size;
        const char *digest;
    } cases[] = {
        {55, "244d3d8974834e5b49bb83c256e17ab69b29136f4075f6e273f6b2286982f303"},
        {56, "8f31f98406d6bd4056156009ce88579abef9eec23ae53dbe925b3af2435cebfe"},
        {63, "b45f54d639e167a75dc92de9609495b0ad0e168f3b66937ab1a4a48fb536521a"},
        {64, "305f9abbf73886e80de03ee90177ffc173d62c259f5f6abe25ebcb8c36470f40"},
        {65, "dda2565d87c312dfad21951120e826122222d9d68b8ae57ece478668ad63885c"},
        {119, "d83b5e10074ae40d9ea124ce3dc29de8487871f9f51e6123b46d3b2155ea791e"},
        {120, "a683e0c51b956410e53ec431ff3eaa54aa772b0184cf7078018b1b61a3a588fb"},
    };
    char data[128];
    memset(data, 0xF1, sizeof data);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        expect_digest(cases[i].digest, data, cases[i].size);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_examples_of_the_standard);
    RUN_TEST(test_a_million);
    RUN_TEST(test_sizes_around_a_block);
    return UNITY_END();
}
