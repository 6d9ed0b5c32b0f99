/* Queries of a network interface, here of "lo". tests/hil/box/test_live_can.py tests them with
 * CAN. */
#include <errno.h>
#include <net/if.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <unity.h>

#include "board/can/can_interface.h"
#include "tests/support/message.h"

static int any_socket;

void setUp(void) {
    any_socket = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    TEST_ASSERT_TRUE(any_socket >= 0);
}

void tearDown(void) {
    (void)close(any_socket);
}

static void test_its_number(void) {
    TEST_ASSERT_EQUAL_INT((int)if_nametoindex("lo"), tl_can_interface_index(any_socket, "lo"));
    TEST_ASSERT_NOT_EQUAL(0, tl_can_interface_index(any_socket, "lo"));
}

static void test_none_of_that_name(void) {
    tl_can_state state;
    TEST_ASSERT_EQUAL_INT(0, tl_can_interface_index(any_socket, "nowhere0"));
    TEST_ASSERT_EQUAL_INT(ENODEV, errno);
    TEST_ASSERT_FALSE(tl_can_interface_probe(any_socket, "nowhere0", &state));
}

/* The frames of "lo" are long enough for CAN FD. */
static void test_its_state(void) {
    tl_can_state state = {.up = false};
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("not in an emulator");
    }
    TEST_ASSERT_TRUE(tl_can_interface_probe(any_socket, "lo", &state));
    TEST_ASSERT_EQUAL_INT(state.up, state.running);
    TEST_ASSERT_TRUE(state.fd);
}

static void test_a_socket_that_is_not_of_can(void) {
    TEST_ASSERT_FALSE(tl_can_interface_bind(any_socket, tl_can_interface_index(any_socket, "lo")));
}

static void test_why_there_is_no_socket(void) {
    TL_EXPECT_PARTS("CAN|modprobe can-raw", tl_can_interface_failure(EAFNOSUPPORT));
    TL_EXPECT_PARTS("CAN|modprobe can-raw", tl_can_interface_failure(EPROTONOSUPPORT));
    TEST_ASSERT_EQUAL_STRING(strerror(EMFILE), tl_can_interface_failure(EMFILE));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_its_number);
    RUN_TEST(test_none_of_that_name);
    RUN_TEST(test_its_state);
    RUN_TEST(test_a_socket_that_is_not_of_can);
    RUN_TEST(test_why_there_is_no_socket);
    return UNITY_END();
}
