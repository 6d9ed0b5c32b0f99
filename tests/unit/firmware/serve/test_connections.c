/* Connections: which are admitted, which are closed for others, and which time out. */
#include "firmware/serve/connections.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>

#include <unity.h>

static tl_connections guests;

void setUp(void) {
    memset(&guests, 0, sizeof guests);
}

void tearDown(void) {}

static tl_address address(unsigned number) {
    struct sockaddr_in socket = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(0x7F000000U + number)};
    return tl_address_of((const struct sockaddr *)&socket);
}

/* Returns the slot; `gives_way` is the connection that must be closed for it. */
static int admit(unsigned number, tl_time now, int gives_way) {
    tl_address from = address(number);
    int found = 0;
    int place = tl_connections_admit(&guests, &from, now, &found);
    TEST_ASSERT_EQUAL_INT(gives_way, found);
    return place;
}

static void fill(unsigned addresses, unsigned each, tl_time now) {
    for (unsigned i = 0; i < addresses * each; i++) {
        TEST_ASSERT_GREATER_OR_EQUAL_INT(0, admit(1 + i / each, now + i, -1));
    }
}

static void an_address_has_so_many_places(void) {
    fill(1, TL_CONNECTIONS_OF_ADDRESS, 0);
    TEST_ASSERT_EQUAL_INT(-1, admit(1, TL_SECOND / 2, -1));
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, admit(2, TL_SECOND / 2, -1));
}

static void its_oldest_stranger_gives_way_after_a_second(void) {
    fill(1, TL_CONNECTIONS_OF_ADDRESS, 0);
    TEST_ASSERT_EQUAL_INT(-1, admit(1, 2 * TL_SECOND, 0));
    guests.rows[0].is_known = true;
    TEST_ASSERT_EQUAL_INT(-1, admit(1, 2 * TL_SECOND, 1));
}

static void whoever_has_most_gives_way_at_once(void) {
    fill(TL_CONNECTIONS / TL_CONNECTIONS_OF_ADDRESS, TL_CONNECTIONS_OF_ADDRESS, 0);
    TEST_ASSERT_EQUAL_INT(-1, admit(100, TL_SECOND / 100, 0));
    tl_connections_leave(&guests, 0);
    TEST_ASSERT_EQUAL_INT(0, admit(100, TL_SECOND / 100, -1));
    TEST_ASSERT_EQUAL_INT(
        -1, admit(101, TL_SECOND / 100, TL_CONNECTIONS_OF_ADDRESS)); /* the first connection of the second address */
}

static void of_many_who_have_one_each_the_oldest_is_safe_for_a_second(void) {
    fill(TL_CONNECTIONS, 1, 0);
    TEST_ASSERT_EQUAL_INT(-1, admit(100, TL_SECOND / 2, -1));
    TEST_ASSERT_EQUAL_INT(-1, admit(100, TL_SECOND, 0));
}

static void who_is_known_never_gives_way(void) {
    fill(TL_CONNECTIONS, 1, 0);
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        guests.rows[i].is_known = true;
    }
    TEST_ASSERT_EQUAL_INT(-1, admit(100, 1000 * TL_SECOND, -1));
}

static void deadlines(void) {
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, tl_connections_next(&guests));
    fill(3, 1, 0);
    guests.rows[1].deadline = 5;
    guests.rows[2].deadline = 3;
    TEST_ASSERT_EQUAL_INT64(3, tl_connections_next(&guests));
    TEST_ASSERT_EQUAL_INT(-1, tl_connections_overdue(&guests, 0, 2));
    TEST_ASSERT_EQUAL_INT(2, tl_connections_overdue(&guests, 0, 4));
    TEST_ASSERT_EQUAL_INT(1, tl_connections_overdue(&guests, 0, 5));
    TEST_ASSERT_EQUAL_INT(2, tl_connections_overdue(&guests, 2, 5));
    tl_connections_leave(&guests, 2);
    TEST_ASSERT_EQUAL_INT(-1, tl_connections_overdue(&guests, 2, 5));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(an_address_has_so_many_places);
    RUN_TEST(its_oldest_stranger_gives_way_after_a_second);
    RUN_TEST(whoever_has_most_gives_way_at_once);
    RUN_TEST(of_many_who_have_one_each_the_oldest_is_safe_for_a_second);
    RUN_TEST(who_is_known_never_gives_way);
    RUN_TEST(deadlines);
    return UNITY_END();
}
