/* How long who guesses waits, and that remembering it is bounded. */
#include "firmware/door/penalties.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>

#include <unity.h>

static tl_penalties penalties;

void setUp(void) {
    memset(&penalties, 0, sizeof penalties);
}

void tearDown(void) {}

static tl_address address(unsigned number) {
    struct sockaddr_in socket = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(number)};
    return tl_address_of((const struct sockaddr *)&socket);
}

static double seconds_left(unsigned number, tl_time now) {
    tl_address from = address(number);
    return tl_seconds(tl_penalties_left(&penalties, &from, now));
}

static void add(unsigned number, unsigned times, tl_time now) {
    tl_address from = address(number);
    for (unsigned i = 0; i < times; i++) {
        tl_penalties_add(&penalties, &from, now);
    }
}

static void each_wrong_one_doubles_the_wait(void) {
    static const double waits[] = {0, 0, 0, 1, 2, 4, 8, 16, 32, 60, 60, 60};
    for (size_t i = 0; i < sizeof waits / sizeof waits[0]; i++) {
        add(1, 1, 0);
        TEST_ASSERT_EQUAL_DOUBLE(waits[i], seconds_left(1, 0));
    }
    TEST_ASSERT_EQUAL_DOUBLE(20, seconds_left(1, 40 * TL_SECOND));
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 60 * TL_SECOND));
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(2, 0));
}

static void a_right_one_forgets(void) {
    tl_address from = address(1);
    add(1, 5, 0);
    tl_penalties_forget(&penalties, &from);
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 0));
    add(1, 3, 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 0));
}

static void so_does_peace(void) {
    add(1, 8, 0);
    add(1, 1, 601 * TL_SECOND);
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 601 * TL_SECOND));
}

static void the_oldest_makes_room(void) {
    for (unsigned i = 0; i < 10 * TL_PENALTIES; i++) {
        add(i + 1, 4, i);
    }
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 0));
    TEST_ASSERT_TRUE(seconds_left(10 * TL_PENALTIES, 10 * TL_PENALTIES) > 0.0);
    TEST_ASSERT_TRUE(seconds_left(9 * TL_PENALTIES + 1, 10 * TL_PENALTIES) > 0.0);
}

static void a_network_of_ipv6_is_one(void) {
    struct sockaddr_in6 one = {.sin6_family = AF_INET6};
    struct sockaddr_in6 mapped = {.sin6_family = AF_INET6};
    TEST_ASSERT_EQUAL_INT(1, inet_pton(AF_INET6, "2001:db8:0:1::7", &one.sin6_addr));
    tl_address first = tl_address_of((const struct sockaddr *)&one);
    TEST_ASSERT_EQUAL_INT(1, inet_pton(AF_INET6, "2001:db8:0:1:ffff::9", &one.sin6_addr));
    tl_address second = tl_address_of((const struct sockaddr *)&one);
    TEST_ASSERT_EQUAL_INT(1, inet_pton(AF_INET6, "2001:db8:0:2::7", &one.sin6_addr));
    tl_address third = tl_address_of((const struct sockaddr *)&one);
    TEST_ASSERT_EQUAL_INT(1, inet_pton(AF_INET6, "::ffff:0.0.0.9", &mapped.sin6_addr));
    tl_address ipv4 = tl_address_of((const struct sockaddr *)&mapped);
    tl_address plain = address(9);
    TEST_ASSERT_TRUE(tl_address_is(&first, &second));
    TEST_ASSERT_FALSE(tl_address_is(&first, &third));
    TEST_ASSERT_TRUE(tl_address_is(&ipv4, &plain));
}

static void addresses_to_listen_on(void) {
    static const struct {
        const char *text;
        unsigned port; /* 0: none */
    } rows[] = {{"127.0.0.1:8443", 8443}, {"[::1]:1", 1},         {"[::]:65535", 65535},
                {"127.0.0.1", 0},         {"127.0.0.1:65536", 0}, {"::1:8443", 0},
                {"[::1:8443", 0},         {"box:8443", 0},        {":8443", 0},
                {"127.0.0.1:", 0},        {"127.0.0.1:x", 0},     {"[]:1", 0}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct sockaddr_storage socket;
        socklen_t size = 0;
        unsigned port = 0;
        char text[TL_ADDRESS_TEXT];
        bool is_one = tl_address_parse(rows[i].text, &socket, &size, &port);
        TEST_ASSERT_EQUAL_MESSAGE(rows[i].port != 0, is_one, rows[i].text);
        if (is_one) {
            tl_address_text((const struct sockaddr *)&socket, text);
            TEST_ASSERT_NOT_NULL(strstr(rows[i].text, text));
            TEST_ASSERT_EQUAL_UINT(rows[i].port, port);
        }
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(each_wrong_one_doubles_the_wait);
    RUN_TEST(a_right_one_forgets);
    RUN_TEST(so_does_peace);
    RUN_TEST(the_oldest_makes_room);
    RUN_TEST(a_network_of_ipv6_is_one);
    RUN_TEST(addresses_to_listen_on);
    return UNITY_END();
}
