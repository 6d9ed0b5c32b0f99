/* The tuning block: readers get a complete and valid tuning, or an error. */
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
#include "tests/support/message.h"

enum { ROUNDS = 3000, UNREAD = 100, SEEN };

static tl_live_tuning block;
static tl_live_tuning_head head;
static tl_live_tuning_head found;
static char text[TL_CONFIG_MAX_BYTES + 1];
static char copy[TL_CONFIG_MAX_BYTES + 1];
static tl_error error;

/* All parts depend on the number. */
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

static void a_written_tuning_is_read(void) {
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

/* Readers skip an interrupted write. The next writer continues with the next number. */
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

#define REFUSED(change, parts)                                                                                         \
    do {                                                                                                               \
        (void)tl_live_tuning_write(&block, &head, text);                                                               \
        change;                                                                                                        \
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, tl_live_tuning_read_text(&block, &found, copy, &error), parts);     \
        TL_EXPECT_PARTS(parts, error.text);                                                                            \
        TEST_ASSERT_EQUAL_UINT32(tl_live_tuning_number(&block), found.number);                                         \
    } while (0)

/* The head alone is invalid. */
#define HEAD_REFUSED(change, parts)                                                                                    \
    do {                                                                                                               \
        REFUSED(change, parts);                                                                                        \
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_live_tuning_read(&block, &found, &error));                               \
    } while (0)

/* The head is valid, but not its text. */
#define TEXT_REFUSED(change, parts)                                                                                    \
    do {                                                                                                               \
        REFUSED(change, parts);                                                                                        \
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_live_tuning_read(&block, &found, &error));                                     \
    } while (0)

static void invalid_blocks_are_rejected(void) {
    const unsigned char turning[] = {0xE2, 0x80, 0xAE, 0}; /* reverses the direction of text */
    HEAD_REFUSED(block.head.hash[0] = 'g', "hash");
    HEAD_REFUSED(block.head.hash[0] = '\0', "hash");
    HEAD_REFUSED(memset(block.head.hash, 'a', sizeof block.head.hash), "hash");
    HEAD_REFUSED(memset(block.head.who, 'a', sizeof block.head.who), "text");
    HEAD_REFUSED(block.head.origin[0] = '\n', "text");
    HEAD_REFUSED(memcpy(block.head.why, turning, sizeof turning), "text");
    HEAD_REFUSED(block.head.why[0] = (char)0xFF, "text");
    HEAD_REFUSED(block.head.size = TL_CONFIG_MAX_BYTES + 1, "262145|262144");
    HEAD_REFUSED(block.head.size = UINT32_MAX, "4294967295|262144");
    TEXT_REFUSED(block.head.size--, "text|hash");
    TEXT_REFUSED(block.text[5] = '\0', "text|hash");
    TEXT_REFUSED(block.text[5] ^= 1, "text|hash");
    TEXT_REFUSED(block.head.hash[3] = block.head.hash[3] == 'a' ? 'b' : 'a', "text|hash");
    HEAD_REFUSED(block.head.tuning.match[0].tolerance = 0.0, "tolerance|0");
    HEAD_REFUSED(block.head.tuning.matches = 65, "65|64");
}

static void an_answer_is_read_completely(void) {
    tl_live_tuning_answer answer = {.number = 0};
    tl_live_tuning_answer received;
    TEST_ASSERT_FALSE(tl_live_tuning_answered(&answer, 2, &received));
    tl_live_tuning_answer_with(&answer, 2, 17, NULL);
    TEST_ASSERT_TRUE(tl_live_tuning_answered(&answer, 2, &received));
    TEST_ASSERT_EQUAL_UINT32(0, received.refused);
    TEST_ASSERT_EQUAL_INT64(17, received.tick);
    TEST_ASSERT_EQUAL_STRING("", received.why);
    tl_live_tuning_answer_with(&answer, 4, 19, "no");
    TEST_ASSERT_FALSE(tl_live_tuning_answered(&answer, 2, &received));
    TEST_ASSERT_TRUE(tl_live_tuning_answered(&answer, 4, &received));
    TEST_ASSERT_EQUAL_UINT32(1, received.refused);
    TEST_ASSERT_EQUAL_STRING("no", received.why);
    memset(answer.why, 'x', sizeof answer.why);
    TEST_ASSERT_TRUE(tl_live_tuning_answered(&answer, 4, &received));
    TEST_ASSERT_EQUAL_size_t(sizeof received.why - 1, strlen(received.why));
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

/* No reader sees a mixture of two tunings. */
static void no_mixture_is_ever_read(void) {
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

/* An access to the hidden text ends the process; the head stays readable. */
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
    bool crashed = WIFSIGNALED(status) || WEXITSTATUS(status) < UNREAD; /* of a sanitizer */
    TEST_ASSERT_TRUE_MESSAGE(crashed, "the text can be read");
    tl_block_close(&made);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_written_tuning_is_read);
    RUN_TEST(the_largest_text_fits);
    RUN_TEST(a_dead_writer_leaves_nothing);
    RUN_TEST(invalid_blocks_are_rejected);
    RUN_TEST(an_answer_is_read_completely);
    RUN_TEST(no_mixture_is_ever_read);
    RUN_TEST(the_text_can_be_hidden);
    return UNITY_END();
}
