/* Channels between threads and processes: batches, single messages, and a faulty peer. */
#include <errno.h>
#include <pthread.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/process/block.h"
#include "firmware/process/channel.h"
#include "tests/support/message.h"

enum { TICK = 1300, RESULT = 700, PAGE = 4096, LINE = 64, EXTRA = 1000 };

static const tl_channel_settings settings = {.sizes = {.bytes = {[TL_MESSAGE_TICK] = TICK,
                                                                 [TL_MESSAGE_FINISH] = TICK,
                                                                 [TL_MESSAGE_RESULT] = RESULT,
                                                                 [TL_MESSAGE_READY] = 4}},
                                             .extra = {[TL_CHILD] = EXTRA}};
static tl_block blocks[TL_SIDES];
static void *memory[TL_SIDES];
static tl_channel parent;
static tl_channel child;

void setUp(void) {
    for (int i = 0; i < TL_SIDES; i++) {
        size_t size = tl_channel_bytes(&settings, (tl_side)i);
        TEST_ASSERT_EQUAL_INT(
            TL_OK,
            tl_block_make("ring", size, i == TL_PARENT ? TL_BLOCK_WE_WRITE : TL_BLOCK_THEY_WRITE, &blocks[i], NULL));
        memory[i] = blocks[i].bytes;
    }
    tl_channel_open(&settings, TL_PARENT, memory, &parent);
    tl_channel_open(&settings, TL_CHILD, memory, &child);
}

void tearDown(void) {
    tl_block_close(&blocks[TL_PARENT]);
    tl_block_close(&blocks[TL_CHILD]);
}

/* Each message has different bytes. */
static void fill(uint8_t *payload, size_t size, uint32_t number) {
    for (size_t i = 0; i < size; i++) {
        payload[i] = (uint8_t)(number * 31 + i * 7 + (number >> 8));
    }
}

static bool is_filled(const uint8_t *payload, size_t size, uint32_t number) {
    uint8_t expected[TICK];
    fill(expected, size, number);
    return memcmp(payload, expected, size) == 0;
}

static tl_time in_seconds(int seconds) {
    return tl_clock_now(NULL) + seconds * TL_SECOND;
}

/* ---- the two ends of a replay ---- */

static bool send_one(tl_channel *channel, tl_message type, size_t size, uint32_t number) {
    uint8_t payload[TICK];
    fill(payload, size, number);
    return tl_channel_offer(channel, type, payload);
}

/* The child: answers each tick until the END message. Returns 0, or the number of the failed
 * check. */
static int answer(tl_channel *channel, uint32_t wanted) {
    uint8_t payload[TICK];
    tl_message type = TL_MESSAGES;
    uint32_t number = 0;
    uint32_t ready = 0;
    if (!tl_channel_offer(channel, TL_MESSAGE_READY, &ready) || !tl_channel_offer(channel, TL_MESSAGE_BUILT, NULL)) {
        return 1;
    }
    tl_channel_push(channel);
    for (;;) {
        tl_channel_event outcome = tl_channel_take(channel, &type, payload);
        if (outcome == TL_CHANNEL_BROKEN) {
            return 2;
        }
        if (outcome == TL_CHANNEL_NOTHING) {
            if (tl_channel_wait(channel, wanted, 0, in_seconds(20)) != TL_CHANNEL_SOMETHING) {
                return 3;
            }
            continue;
        }
        if (type == TL_MESSAGE_END) {
            return tl_channel_offer(channel, TL_MESSAGE_ENDED, NULL) ? (tl_channel_push(channel), 0) : 4;
        }
        if (!is_filled(payload, TICK, number)) {
            return 5;
        }
        while (!send_one(channel, TL_MESSAGE_RESULT, RESULT, number)) {
            if (tl_channel_wait(channel, 0, wanted, in_seconds(20)) != TL_CHANNEL_SOMETHING) {
                return 6;
            }
        }
        tl_channel_push(channel);
        number++;
    }
}

/* The parent: sends `count` ticks and checks the results. */
static void drive(tl_channel *channel, uint32_t count, uint32_t wanted) {
    uint8_t payload[TICK];
    tl_message type = TL_MESSAGES;
    uint32_t sent = 0;
    uint32_t received = 0;
    bool steps = false;
    bool has_sent_end = false;
    while (type != TL_MESSAGE_ENDED) {
        while (steps && sent < count && send_one(channel, TL_MESSAGE_TICK, TICK, sent)) {
            sent++;
            tl_channel_push(channel);
        }
        has_sent_end = has_sent_end || (received == count && tl_channel_offer(channel, TL_MESSAGE_END, NULL));
        uint32_t taken = 0;
        while (tl_channel_take(channel, &type, payload) == TL_CHANNEL_SOMETHING) {
            taken++;
            steps = steps || type == TL_MESSAGE_BUILT;
            if (type == TL_MESSAGE_RESULT) {
                TEST_ASSERT_TRUE(is_filled(payload, RESULT, received));
                received++;
            }
        }
        if (taken == 0) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_CHANNEL_SOMETHING, tl_channel_wait(channel, wanted, 0, in_seconds(20)),
                                          channel->fault.text);
        }
    }
    TEST_ASSERT_EQUAL_UINT32(count, received);
}

static uint32_t wanted_there;

static void *answer_in_thread(void *context) {
    static int result;
    result = answer(context, wanted_there);
    return &result;
}

static void between_threads(uint32_t wanted, uint32_t there, uint32_t count) {
    pthread_t thread;
    void *result = NULL;
    wanted_there = there;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, answer_in_thread, &child));
    drive(&parent, count, wanted);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, &result));
    TEST_ASSERT_EQUAL_INT(0, *(int *)result);
}

static void test_batches_between_threads(void) {
    between_threads(128, 128, 20011);
}

static void test_one_by_one_between_threads(void) {
    between_threads(1, 1, 5003);
}

static void test_a_wait_for_a_full_ring_gets_what_there_is(void) {
    between_threads(TL_CHANNEL_DEPTH, TL_CHANNEL_DEPTH, 1007);
}

static void test_one_side_waits_for_a_message_the_other_for_a_full_ring(void) {
    between_threads(1, TL_CHANNEL_DEPTH, 5003);
}

/* The child maps the parent's block read-only. */
static void test_two_processes(void) {
    int status = 0;
    pid_t pid = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, pid);
    if (pid == 0) {
        tl_block taken[TL_SIDES];
        bool ok = tl_block_take(dup(blocks[TL_PARENT].descriptor), blocks[TL_PARENT].size, TL_BLOCK_WE_WRITE,
                                &taken[TL_PARENT], NULL) == TL_OK &&
                  tl_block_take(dup(blocks[TL_CHILD].descriptor), blocks[TL_CHILD].size, TL_BLOCK_THEY_WRITE,
                                &taken[TL_CHILD], NULL) == TL_OK;
        void *const bytes[TL_SIDES] = {taken[TL_PARENT].bytes, taken[TL_CHILD].bytes};
        if (ok) {
            tl_channel_open(&settings, TL_CHILD, bytes, &child);
            memcpy(tl_channel_extra(&settings, TL_CHILD, bytes[TL_CHILD]), "account", 8);
        }
        _exit(ok ? answer(&child, 128) : 100);
    }
    drive(&parent, 20011, 128);
    TEST_ASSERT_EQUAL_INT(pid, waitpid(pid, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    TEST_ASSERT_EQUAL_STRING("account", tl_channel_extra(&settings, TL_CHILD, memory[TL_CHILD]));
}

/* ---- one thread, both ends ---- */

static void get_to_stepping(void) {
    uint8_t payload[TICK];
    tl_message type = TL_MESSAGES;
    uint32_t ready = 0;
    TEST_ASSERT_TRUE(tl_channel_offer(&child, TL_MESSAGE_READY, &ready));
    TEST_ASSERT_TRUE(tl_channel_offer(&child, TL_MESSAGE_BUILT, NULL));
    tl_channel_push(&child);
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_SOMETHING, tl_channel_take(&parent, &type, payload));
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_SOMETHING, tl_channel_take(&parent, &type, payload));
}

static void test_a_ring_is_full_and_empty_again(void) {
    uint8_t payload[TICK];
    tl_message type = TL_MESSAGES;
    get_to_stepping();
    for (uint32_t i = 0; i < TL_CHANNEL_DEPTH; i++) {
        TEST_ASSERT_TRUE(send_one(&parent, TL_MESSAGE_TICK, TICK, i));
    }
    TEST_ASSERT_FALSE(send_one(&parent, TL_MESSAGE_TICK, TICK, 0));
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_NOTHING, tl_channel_take(&child, &type, payload)); /* not pushed */
    tl_channel_push(&parent);
    for (uint32_t i = 0; i < TL_CHANNEL_DEPTH; i++) {
        TEST_ASSERT_EQUAL_INT(TL_CHANNEL_SOMETHING, tl_channel_take(&child, &type, payload));
        TEST_ASSERT_TRUE(type == TL_MESSAGE_TICK && is_filled(payload, TICK, i));
    }
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_NOTHING, tl_channel_take(&child, &type, payload));
    TEST_ASSERT_TRUE(send_one(&parent, TL_MESSAGE_TICK, TICK, 0));
}

static void test_a_wait_ends_in_time(void) {
    tl_time begin = tl_clock_now(NULL);
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_NOTHING, tl_channel_wait(&parent, 1, 0, begin + TL_SECOND / 20));
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(TL_SECOND / 20, tl_clock_now(NULL) - begin);
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_SOMETHING, tl_channel_wait(&parent, 0, 1, 0));
}

static void *nudge(void *context) {
    for (int i = 0; i < 200; i++) {
        tl_channel_nudge(context);
    }
    return NULL;
}

static void test_a_nudge_is_never_lost(void) {
    pthread_t thread;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, nudge, &parent));
    uint32_t seen = 0;
    while (__atomic_load_n(&parent.heeded, __ATOMIC_SEQ_CST) < 200) {
        TEST_ASSERT_EQUAL_INT(TL_CHANNEL_NUDGED, tl_channel_wait(&parent, 1, 0, in_seconds(20)));
        seen++;
    }
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_GREATER_THAN_UINT32(0, seen);
    tl_channel_nudge(&parent); /* a nudge before the wait counts, too */
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_NUDGED, tl_channel_wait(&parent, 1, 0, in_seconds(20)));
}

/* ---- a peer that breaks the protocol ---- */

static uint32_t *counter(tl_side side, size_t line) {
    return (uint32_t *)(void *)((uint8_t *)memory[side] + line * LINE);
}

static uint32_t *slot_of_child(uint32_t number) {
    return (uint32_t *)(void *)((uint8_t *)memory[TL_CHILD] + PAGE + number * ((RESULT + 8 + LINE - 1) / LINE * LINE));
}

static void expect_broken(const char *parts) {
    uint8_t payload[TICK];
    tl_message type = TL_MESSAGES;
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_BROKEN, tl_channel_take(&parent, &type, payload));
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, parent.fault.status);
    TL_EXPECT_PARTS(parts, parent.fault.text);
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_BROKEN, tl_channel_wait(&parent, 1, 0, in_seconds(1)));
    TEST_ASSERT_FALSE(tl_channel_offer(&parent, TL_MESSAGE_END, NULL));
    tl_channel_push(&parent); /* has no effect */
}

static void test_more_messages_than_a_ring_holds(void) {
    *counter(TL_CHILD, 0) = TL_CHANNEL_DEPTH + 1;
    expect_broken("1025|1024");
}

static void test_messages_taken_back(void) {
    get_to_stepping();
    *counter(TL_CHILD, 0) = 1;
    expect_broken("4294967295|1024");
}

static void test_more_taken_than_sent(void) {
    uint8_t payload[TICK] = {0};
    get_to_stepping();
    *counter(TL_CHILD, 1) = 1;
    for (uint32_t i = 0; i < TL_CHANNEL_DEPTH && parent.fault.status == TL_OK; i++) {
        (void)tl_channel_offer(&parent, TL_MESSAGE_TICK, payload);
    }
    *counter(TL_CHILD, 1) = 10000;
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_BROKEN, tl_channel_wait(&parent, 0, 1, in_seconds(1)));
    TEST_ASSERT_FALSE(tl_channel_offer(&parent, TL_MESSAGE_TICK, payload));
    expect_broken("4294958320|1024");
}

static void test_a_message_that_is_not_allowed(void) {
    *counter(TL_CHILD, 0) = 1;
    slot_of_child(0)[0] = TL_MESSAGE_RESULT;
    slot_of_child(0)[1] = RESULT;
    expect_broken("\"result\"|starting");
}

static void test_a_message_that_is_too_long(void) {
    *counter(TL_CHILD, 0) = 1;
    slot_of_child(0)[0] = TL_MESSAGE_READY;
    slot_of_child(0)[1] = UINT32_MAX;
    expect_broken("\"ready\"|4294967295 bytes|4 bytes");
}

static void *wake_for_nothing(void *context) {
    for (int i = 0; i < 2000; i++) {
        (void)__atomic_add_fetch(counter(TL_CHILD, 3), 1, __ATOMIC_SEQ_CST);
    }
    return context;
}

/* Spurious wake-ups do not extend the time limit of a wait. */
static void test_spurious_wake_ups(void) {
    pthread_t thread;
    *counter(TL_CHILD, 2) = 1; /* the child sleeps and waits for more messages than there are */
    counter(TL_CHILD, 2)[1] = UINT32_MAX;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, wake_for_nothing, NULL));
    TEST_ASSERT_EQUAL_INT(TL_CHANNEL_NOTHING, tl_channel_wait(&parent, 1, 0, tl_clock_now(NULL) + TL_SECOND / 20));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
}

static void test_layout(void) {
    tl_channel_settings none = {.extra = {0, 0}};
    TEST_ASSERT_NULL(tl_channel_extra(&settings, TL_PARENT, memory[TL_PARENT]));
    const uint8_t *extra = tl_channel_extra(&settings, TL_CHILD, memory[TL_CHILD]);
    TEST_ASSERT_EQUAL_size_t(0, (size_t)(extra - (const uint8_t *)memory[TL_CHILD]) % LINE);
    TEST_ASSERT_TRUE(extra + EXTRA <= (const uint8_t *)memory[TL_CHILD] + blocks[TL_CHILD].size);
    TEST_ASSERT_EQUAL_size_t(PAGE + TL_CHANNEL_DEPTH * LINE, tl_channel_bytes(&none, TL_CHILD));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_batches_between_threads);
    RUN_TEST(test_one_by_one_between_threads);
    RUN_TEST(test_a_wait_for_a_full_ring_gets_what_there_is);
    RUN_TEST(test_one_side_waits_for_a_message_the_other_for_a_full_ring);
    RUN_TEST(test_two_processes);
    RUN_TEST(test_a_ring_is_full_and_empty_again);
    RUN_TEST(test_a_wait_ends_in_time);
    RUN_TEST(test_a_nudge_is_never_lost);
    RUN_TEST(test_more_messages_than_a_ring_holds);
    RUN_TEST(test_messages_taken_back);
    RUN_TEST(test_more_taken_than_sent);
    RUN_TEST(test_a_message_that_is_not_allowed);
    RUN_TEST(test_a_message_that_is_too_long);
    RUN_TEST(test_spurious_wake_ups);
    RUN_TEST(test_layout);
    return UNITY_END();
}
