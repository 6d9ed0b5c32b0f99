/* The tuning block: what is written comes out whole or not at all, and nothing that a twin could not bear. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/block.h"
#include "firmware/twin/live_tuning.h"

enum { ROUNDS = 3000, UNREAD = 100, SEEN };

static tl_live_tuning block;
static tl_live_tuning_head head;
static tl_live_tuning_head found;
static char text[TL_CONFIG_MAX_BYTES + 1];
static char copy[TL_CONFIG_MAX_BYTES + 1];
static tl_error error;

/* Of this number all parts can be told. */
static void fill(unsigned number) {
    memset(&head, 0, sizeof head);
    memset(text, 'a' + (int)(number % 26), sizeof text);
    text[1000 + number % 5000] = '\0';
    head.size = (uint32_t)strlen(text);
    tl_sha256(text, head.size, head.hash);
    (void)snprintf(head.who, sizeof head.who, "who %u", number);
    (void)snprintf(head.origin, sizeof head.origin, "push");
    (void)snprintf(head.why, sizeof head.why, "because of %u \303\244", number);
    head.tuning = (tl_tuning){.matches = 1, .adjusts = 1, .evaluations = 1 + number, .margin = 0.5};
    head.tuning.match[0] = (tl_tuning_match){.tolerance = 1.0 + number, .weight = 1.0};
    head.tuning.adjust[0] = (tl_tuning_adjust){.lower = -HUGE_VAL, .upper = HUGE_VAL};
}

void setUp(void) {
    memset(&block, 0, sizeof block);
    fill(1);
}

void tearDown(void) {}

static void expect_same(uint32_t number) {
    head.number = number;
    TEST_ASSERT_EQUAL_MEMORY(&head, &found, sizeof head);
}

static void what_is_written_comes_out(void) {
    TEST_ASSERT_EQUAL_UINT32(0, tl_live_tuning_number(&block));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_live_tuning_read(&block, &found, &error));
    for (unsigned i = 1; i < 20; i++) {
        fill(i);
        TEST_ASSERT_EQUAL_UINT32(2 * i, tl_live_tuning_write(&block, &head, text));
        TEST_ASSERT_EQUAL_UINT32(2 * i, tl_live_tuning_number(&block));
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_live_tuning_read(&block, &found, &error), error.text);
        expect_same(2 * i);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_live_tuning_read_text(&block, &found, copy, &error), error.text);
        expect_same(2 * i);
        TEST_ASSERT_EQUAL_STRING(text, copy);
    }
}

static void the_largest_text_fits(void) {
    memset(text, 'x', TL_CONFIG_MAX_BYTES);
    text[TL_CONFIG_MAX_BYTES] = '\0';
    head.size = TL_CONFIG_MAX_BYTES;
    tl_sha256(text, head.size, head.hash);
    (void)tl_live_tuning_write(&block, &head, text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_live_tuning_read_text(&block, &found, copy, &error), error.text);
    TEST_ASSERT_EQUAL_STRING(text, copy);
}

/* Whoever died while it wrote has left nothing that anybody takes; the next one goes on from there. */
static void a_dead_writer_leaves_nothing(void) {
    (void)tl_live_tuning_write(&block, &head, text);
    block.head.number = 3;
    block.head.tuning.margin = 0.75;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_live_tuning_read(&block, &found, &error));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_live_tuning_read_text(&block, &found, copy, &error));
    fill(2);
    TEST_ASSERT_EQUAL_UINT32(4, tl_live_tuning_write(&block, &head, text));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_live_tuning_read(&block, &found, &error));
    expect_same(4);
}

#define REFUSED(change, words)                                                                                         \
    do {                                                                                                               \
        (void)tl_live_tuning_write(&block, &head, text);                                                               \
        change;                                                                                                        \
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, tl_live_tuning_read_text(&block, &found, copy, &error), words);     \
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, words), error.text);                                           \
        TEST_ASSERT_EQUAL_UINT32(tl_live_tuning_number(&block), found.number);                                         \
    } while (0)

static void what_cannot_be_is_refused(void) {
    const unsigned char turning[] = {0xE2, 0x80, 0xAE, 0}; /* the direction of text */
    REFUSED(block.head.hash[0] = 'g', "a digest that is none");
    REFUSED(block.head.hash[0] = '\0', "a digest that is none");
    REFUSED(memset(block.head.hash, 'a', sizeof block.head.hash), "a digest that is none");
    REFUSED(memset(block.head.who, 'a', sizeof block.head.who), "cannot be shown");
    REFUSED(block.head.origin[0] = '\n', "cannot be shown");
    REFUSED(memcpy(block.head.why, turning, sizeof turning), "cannot be shown");
    REFUSED(block.head.why[0] = (char)0xFF, "cannot be shown");
    REFUSED(block.head.size = TL_CONFIG_MAX_BYTES + 1, "expected at most 262144");
    REFUSED(block.head.size = UINT32_MAX, "expected at most 262144");
    REFUSED(block.head.size--, "not that of its digest");
    REFUSED(block.text[5] = '\0', "not that of its digest");
    REFUSED(block.text[5] ^= 1, "not that of its digest");
    REFUSED(block.head.hash[3] = block.head.hash[3] == 'a' ? 'b' : 'a', "not that of its digest");
    REFUSED(block.head.tuning.match[0].tolerance = 0.0, "tolerance of 0");
    REFUSED(block.head.tuning.matches = 17, "expected at most 16");
}

static void what_a_twin_says_is_read_whole(void) {
    tl_live_tuning_answer answer = {.number = 0};
    tl_live_tuning_answer heard;
    TEST_ASSERT_FALSE(tl_live_tuning_answered(&answer, 2, &heard));
    tl_live_tuning_answer_with(&answer, 2, 17, NULL);
    TEST_ASSERT_TRUE(tl_live_tuning_answered(&answer, 2, &heard));
    TEST_ASSERT_EQUAL_UINT32(0, heard.refused);
    TEST_ASSERT_EQUAL_INT64(17, heard.tick);
    TEST_ASSERT_EQUAL_STRING("", heard.why);
    tl_live_tuning_answer_with(&answer, 4, 19, "no");
    TEST_ASSERT_FALSE(tl_live_tuning_answered(&answer, 2, &heard));
    TEST_ASSERT_TRUE(tl_live_tuning_answered(&answer, 4, &heard));
    TEST_ASSERT_EQUAL_UINT32(1, heard.refused);
    TEST_ASSERT_EQUAL_STRING("no", heard.why);
    memset(answer.why, 'x', sizeof answer.why);
    TEST_ASSERT_TRUE(tl_live_tuning_answered(&answer, 4, &heard));
    TEST_ASSERT_EQUAL_size_t(sizeof heard.why - 1, strlen(heard.why));
}

/* ---- beside each other ---- */

static void *write_many(void *context) {
    (void)context;
    for (unsigned i = 1; i <= ROUNDS; i++) {
        fill(i);
        (void)tl_live_tuning_write(&block, &head, text);
    }
    return NULL;
}

/* Nobody ever sees a part of one with a part of another. */
static void no_half_is_ever_read(void) {
    pthread_t writer;
    uint32_t last = 0;
    unsigned taken = 0;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&writer, NULL, write_many, NULL));
    while (last != 2 * ROUNDS) {
        tl_status status = tl_live_tuning_read_text(&block, &found, copy, &error);
        TEST_ASSERT_TRUE_MESSAGE(status == TL_OK || status == TL_TRY_AGAIN, error.text);
        if (status == TL_OK) {
            unsigned number = found.number / 2;
            char who[TL_LIVE_TUNING_WHO];
            TEST_ASSERT_TRUE(found.number >= last);
            (void)snprintf(who, sizeof who, "who %u", number);
            TEST_ASSERT_EQUAL_STRING(who, found.who);
            TEST_ASSERT_EQUAL_UINT64(1 + number, found.tuning.evaluations);
            TEST_ASSERT_EQUAL_size_t(1000 + number % 5000, strlen(copy));
            last = found.number;
            taken++;
        }
    }
    TEST_ASSERT_EQUAL_INT(0, pthread_join(writer, NULL));
    TEST_ASSERT_TRUE(taken > 0);
}

/* What is hidden ends who touches it; the head can be read on. */
static void the_text_can_be_hidden(void) {
    tl_block made = {.descriptor = -1};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make("tuning", sizeof block, TL_BLOCK_WE_WRITE, &made, &error));
    (void)tl_live_tuning_write(made.bytes, &head, text);
    pid_t child = fork();
    if (child == 0) {
        tl_live_tuning_hide_text(&made);
        if (tl_live_tuning_read(made.bytes, &found, &error) != TL_OK) {
            _exit(UNREAD);
        }
        const volatile char *beyond = ((const tl_live_tuning *)made.bytes)->text;
        _exit(beyond[8000] == 'b' ? SEEN : SEEN + 1);
    }
    int status = 0;
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    bool crashed = WIFSIGNALED(status) || WEXITSTATUS(status) < UNREAD; /* a sanitizer ends it with a code of its own */
    TEST_ASSERT_TRUE_MESSAGE(crashed, "the text can be read");
    tl_block_close(&made);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(what_is_written_comes_out);
    RUN_TEST(the_largest_text_fits);
    RUN_TEST(a_dead_writer_leaves_nothing);
    RUN_TEST(what_cannot_be_is_refused);
    RUN_TEST(what_a_twin_says_is_read_whole);
    RUN_TEST(no_half_is_ever_read);
    RUN_TEST(the_text_can_be_hidden);
    return UNITY_END();
}
