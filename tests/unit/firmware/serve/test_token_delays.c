/* Delays after wrong tokens, the bound of their table, and addresses. */
#include "firmware/serve/tokens.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>

#include <unity.h>

static tl_token_delays delays;

void setUp(void) {
    memset(&delays, 0, sizeof delays);
}

void tearDown(void) {}

static tl_address address(unsigned number) {
    struct sockaddr_in socket = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(number)};
    return tl_address_of((const struct sockaddr *)&socket);
}

static double seconds_left(unsigned number, tl_time now) {
    tl_address from = address(number);
    return tl_seconds(tl_token_delays_left(&delays, &from, now));
}

static void add(unsigned number, unsigned times, tl_time now) {
    tl_address from = address(number);
    for (unsigned i = 0; i < times; i++) {
        tl_token_delays_add(&delays, &from, now);
    }
}

static void each_wrong_token_doubles_the_delay(void) {
    static const double waits[] = {0, 0, 0, 1, 2, 4, 8, 16, 32, 64, 64, 64};
    for (size_t i = 0; i < sizeof waits / sizeof waits[0]; i++) {
        add(1, 1, 0);
        TEST_ASSERT_EQUAL_DOUBLE(waits[i], seconds_left(1, 0));
    }
    TEST_ASSERT_EQUAL_DOUBLE(24, seconds_left(1, 40 * TL_SECOND));
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 64 * TL_SECOND));
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(2, 0));
}

static void ten_minutes_without_a_wrong_token_reset_it(void) {
    add(1, 8, 0);
    add(1, 1, 600 * TL_SECOND);
    TEST_ASSERT_EQUAL_DOUBLE(32, seconds_left(1, 600 * TL_SECOND));
    add(1, 1, 1201 * TL_SECOND);
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 1201 * TL_SECOND));
}

static void a_full_table_drops_the_oldest(void) {
    for (unsigned i = 0; i < 10 * TL_TOKEN_DELAYS; i++) {
        add(i + 1, 4, i);
    }
    TEST_ASSERT_EQUAL_DOUBLE(0, seconds_left(1, 0));
    TEST_ASSERT_TRUE(seconds_left(10 * TL_TOKEN_DELAYS, 10 * TL_TOKEN_DELAYS) > 0.0);
    TEST_ASSERT_TRUE(seconds_left(9 * TL_TOKEN_DELAYS + 1, 10 * TL_TOKEN_DELAYS) > 0.0);
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
    } rows[] = {
        {"127.0.0.1:8443", 8443}, {"[::1]:1", 1},   {"[::]:65535", 65535}, {"127.0.0.1", 0},  {"127.0.0.1:65536", 0},
        {"::1:8443", 0},          {"[::1:8443", 0}, {"box:8443", 0},       {":8443", 0},      {"127.0.0.1:", 0},
        {"127.0.0.1:x", 0},       {"[]:1", 0},      {"0:8443", 0},         {"127.1:8443", 0}, {"010.0.0.5:8443", 0}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct sockaddr_storage socket;
        socklen_t size = 0;
        char text[TL_ADDRESS_TEXT];
        bool is_one = tl_address_parse(rows[i].text, &socket, &size);
        TEST_ASSERT_EQUAL_MESSAGE(rows[i].port != 0, is_one, rows[i].text);
        if (is_one) {
            tl_address_text((const struct sockaddr *)&socket, text);
            TEST_ASSERT_NOT_NULL(strstr(rows[i].text, text));
            TEST_ASSERT_EQUAL_UINT(rows[i].port, ntohs(((const struct sockaddr_in *)(const void *)&socket)->sin_port));
        }
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(each_wrong_token_doubles_the_delay);
    RUN_TEST(ten_minutes_without_a_wrong_token_reset_it);
    RUN_TEST(a_full_table_drops_the_oldest);
    RUN_TEST(a_network_of_ipv6_is_one);
    RUN_TEST(addresses_to_listen_on);
    return UNITY_END();
}
