/* The protocol: what each side may send in each phase, all others refused. */
#include <stdbool.h>
#include <string.h>

#include <unity.h>

#include "firmware/process/channel.h"

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

/* Those that a side may send now, in the order of tl_message, by their letters. */
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

static void test_a_whole_life(void) {
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "re");
    tl_protocol_go_on(&phases, TL_MESSAGE_READY);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "be");
    tl_protocol_go_on(&phases, TL_MESSAGE_BUILT);
    may_send(TL_PARENT, "TFSE");
    may_send(TL_CHILD, "Rse");
    tl_protocol_go_on(&phases, TL_MESSAGE_TICK);
    tl_protocol_go_on(&phases, TL_MESSAGE_RESULT);
    tl_protocol_go_on(&phases, TL_MESSAGE_SHOWN);
    tl_protocol_go_on(&phases, TL_MESSAGE_SEEN);
    may_send(TL_PARENT, "TFSE");
    may_send(TL_CHILD, "Rse");
    tl_protocol_go_on(&phases, TL_MESSAGE_FINISH);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "Rse");
    tl_protocol_go_on(&phases, TL_MESSAGE_ENDED);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "");
}

/* What the child reaches later does not bring it back. */
static void test_who_was_told_to_end_gets_no_ticks(void) {
    tl_protocol_go_on(&phases, TL_MESSAGE_END);
    tl_protocol_go_on(&phases, TL_MESSAGE_READY);
    tl_protocol_go_on(&phases, TL_MESSAGE_BUILT);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "Rse");
}

/* A child that ends leaves the parent where it was. */
static void test_a_child_that_fails_early(void) {
    tl_protocol_go_on(&phases, TL_MESSAGE_ENDED);
    may_send(TL_PARENT, "E");
    may_send(TL_CHILD, "");
}

static void refuse(tl_side side, uint32_t type, uint32_t length, const char *why) {
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_protocol_check(&sizes, &phases, side, type, length, &error));
    TEST_ASSERT_EQUAL_STRING(why, error.text);
}

static void test_what_is_said(void) {
    refuse(TL_CHILD, TL_MESSAGES, 0, "the process of the FMUs sent a message of no kind there is, 9");
    refuse(TL_CHILD, UINT32_MAX, 0, "the process of the FMUs sent a message of no kind there is, 4294967295");
    refuse(TL_CHILD, TL_MESSAGE_TICK, 100,
           "the process of the FMUs sent the message \"tick\" while starting, with 100 bytes: not allowed "
           "(expected 100 bytes of the program)");
    refuse(TL_PARENT, TL_MESSAGE_TICK, 100,
           "the program sent the message \"tick\" while starting, with 100 bytes: not allowed (expected 100 bytes "
           "of the program)");
    refuse(TL_CHILD, TL_MESSAGE_READY, 9,
           "the process of the FMUs sent the message \"ready\" while starting, with 9 bytes: not allowed "
           "(expected 8 bytes of the process of the FMUs)");
    refuse(TL_CHILD, TL_MESSAGE_READY, 7,
           "the process of the FMUs sent the message \"ready\" while starting, with 7 bytes: not allowed "
           "(expected 8 bytes of the process of the FMUs)");
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_protocol_check(&sizes, &phases, TL_PARENT, TL_MESSAGE_END, 1, NULL));
}

static void test_the_longest(void) {
    TEST_ASSERT_EQUAL_UINT32(100, tl_protocol_longest(&sizes, TL_PARENT));
    TEST_ASSERT_EQUAL_UINT32(700, tl_protocol_longest(&sizes, TL_CHILD));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_whole_life);
    RUN_TEST(test_who_was_told_to_end_gets_no_ticks);
    RUN_TEST(test_a_child_that_fails_early);
    RUN_TEST(test_what_is_said);
    RUN_TEST(test_the_longest);
    return UNITY_END();
}
