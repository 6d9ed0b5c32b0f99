/* The protocol: the messages that each side may send in each phase. All others are rejected. */
#include <stdbool.h>
#include <string.h>

#include <unity.h>

#include "firmware/process/channel.h"
#include "tests/support/message.h"

static const tl_protocol_sizes sizes = {.bytes = {[TL_MESSAGE_TICK] = 100,
                                                  [TL_MESSAGE_FINISH] = 100,
                                                  [TL_MESSAGE_SEEN] = 4,
                                                  [TL_MESSAGE_READY] = 8,
                                                  [TL_MESSAGE_BUILT] = 4,
                                                  [TL_MESSAGE_RESULT] = 700,
                                                  [TL_MESSAGE_ENDED] = 16}};
static tl_protocol_phases phases;
static tl_error error;

void setUp(void) {
    phases = (tl_protocol_phases){{TL_STARTING, TL_STARTING}};
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {}

/* Expects the messages that a side may send now: a letter each, in the order of tl_message. */
static void may_send(tl_side side, const char *expected) {
    static const char letters[] = "TFSErbRse";
    char found[TL_MESSAGES + 1] = "";
    size_t count = 0;
    for (uint32_t type = 0; type < TL_MESSAGES; type++) {
        if (tl_protocol_check(&sizes, &phases, side, type, sizes.bytes[type], &error) == TL_OK) {
            found[count++] = letters[type];
        }
    }
    TEST_ASSERT_EQUAL_STRING(expected, found);
}

static void test_all_phases(void) {
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "re");
    tl_protocol_continue(&phases, TL_MESSAGE_READY);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "be");
    tl_protocol_continue(&phases, TL_MESSAGE_BUILT);
    may_send(TL_PARENT, "TFSE");
    may_send(TL_CHILD, "Rse");
    tl_protocol_continue(&phases, TL_MESSAGE_TICK);
    tl_protocol_continue(&phases, TL_MESSAGE_RESULT);
    tl_protocol_continue(&phases, TL_MESSAGE_SHOWN);
    tl_protocol_continue(&phases, TL_MESSAGE_SEEN);
    may_send(TL_PARENT, "TFSE");
    may_send(TL_CHILD, "Rse");
    tl_protocol_continue(&phases, TL_MESSAGE_FINISH);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "Rse");
    tl_protocol_continue(&phases, TL_MESSAGE_ENDED);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "");
}

/* The child's later phases do not reset the phase of the parent. */
static void test_after_the_end_message_there_are_no_ticks(void) {
    tl_protocol_continue(&phases, TL_MESSAGE_END);
    tl_protocol_continue(&phases, TL_MESSAGE_READY);
    tl_protocol_continue(&phases, TL_MESSAGE_BUILT);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "Rse");
}

/* The end of the child does not change the phase of the parent. */
static void test_a_child_that_fails_early(void) {
    tl_protocol_continue(&phases, TL_MESSAGE_ENDED);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "");
}

static void refuse(tl_side side, uint32_t type, uint32_t length, const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_protocol_check(&sizes, &phases, side, type, length, &error));
    TL_EXPECT_PARTS(parts, error.text);
}

static void test_messages_of_rejections(void) {
    refuse(TL_CHILD, TL_MESSAGES, 0, "message|9");
    refuse(TL_CHILD, UINT32_MAX, 0, "message|4294967295");
    refuse(TL_CHILD, TL_MESSAGE_TICK, 100, "message|\"tick\"|starting|100 bytes");
    const tl_error of_child = error;
    refuse(TL_PARENT, TL_MESSAGE_TICK, 100, "message|\"tick\"|starting|100 bytes");
    TEST_ASSERT_TRUE_MESSAGE(strcmp(of_child.text, error.text) != 0, "both messages name the same sender");
    refuse(TL_CHILD, TL_MESSAGE_READY, 9, "message|\"ready\"|starting|9 bytes|8 bytes");
    refuse(TL_CHILD, TL_MESSAGE_READY, 7, "message|\"ready\"|starting|7 bytes|8 bytes");
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_protocol_check(&sizes, &phases, TL_PARENT, TL_MESSAGE_END, 1, NULL));
}

static void test_the_longest(void) {
    TEST_ASSERT_EQUAL_UINT32(100, tl_protocol_longest(&sizes, TL_PARENT));
    TEST_ASSERT_EQUAL_UINT32(700, tl_protocol_longest(&sizes, TL_CHILD));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_phases);
    RUN_TEST(test_after_the_end_message_there_are_no_ticks);
    RUN_TEST(test_a_child_that_fails_early);
    RUN_TEST(test_messages_of_rejections);
    RUN_TEST(test_the_longest);
    return UNITY_END();
}
