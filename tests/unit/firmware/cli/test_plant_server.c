/* The emulated Modbus device, byte by byte: answers, exceptions and counters. */
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/cli/plant_server.h"
#include "tests/support/device_value.h"
#include "tests/support/message.h"

static tl_plant_server *server;
static tl_error error;
static int client;

static const tl_modbus_channel CHANNELS[] = {
    {.unit_id = 1, .table = TL_MODBUS_HOLDING, .address = 10, .type = TL_MODBUS_UINT16, .scale = 1},
    {.unit_id = 1, .table = TL_MODBUS_HOLDING, .address = 13, .type = TL_MODBUS_FLOAT32, .scale = 1},
    {.unit_id = 1, .table = TL_MODBUS_INPUT, .address = 0, .type = TL_MODBUS_INT32, .scale = 0.5, .offset = 1},
    {.unit_id = 1, .table = TL_MODBUS_COIL, .address = 100, .type = TL_MODBUS_BIT, .scale = 1},
    {.unit_id = 1, .table = TL_MODBUS_COIL, .address = 110, .type = TL_MODBUS_BIT, .scale = 1},
    {.unit_id = 7, .table = TL_MODBUS_DISCRETE, .address = 65535, .type = TL_MODBUS_BIT, .scale = 1},
    {.unit_id = 7, .table = TL_MODBUS_HOLDING, .address = 0, .type = TL_MODBUS_UINT32, .scale = 1},
    {.unit_id = 7, .table = TL_MODBUS_HOLDING, .address = 5, .type = TL_MODBUS_FLOAT64, .scale = 1},
};
enum { CHANNEL_COUNT = sizeof CHANNELS / sizeof CHANNELS[0] };

static int dial(void) {
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(tl_plant_server_port(server)), .sin_addr = {htonl(INADDR_LOOPBACK)}};
    int descriptor = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    TEST_ASSERT_TRUE(descriptor >= 0);
    TEST_ASSERT_EQUAL_INT(0, connect(descriptor, (struct sockaddr *)&address, sizeof address));
    return descriptor;
}

static tl_status start_at(const char *host, uint16_t port, const tl_modbus_channel *channels, size_t count) {
    const tl_plant_server_settings settings = {
        .host = host, .port = port, .channels = channels, .channel_count = count};
    return tl_plant_server_start(&settings, &server, &error);
}

void setUp(void) {
    server = NULL;
    error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_OK, start_at("127.0.0.1", 0, CHANNELS, CHANNEL_COUNT));
    TEST_ASSERT_TRUE(tl_plant_server_port(server) != 0);
    client = dial();
}

void tearDown(void) {
    (void)close(client);
    if (server != NULL) {
        tl_plant_server_stop(server);
    }
}

static void put(const uint8_t *bytes, size_t size) {
    TEST_ASSERT_EQUAL_INT((int)size, (int)send(client, bytes, size, MSG_NOSIGNAL));
}

/* True if data arrives or the connection ends within the time. */
static bool comes(int descriptor, int ms) {
    struct pollfd one = {.fd = descriptor, .events = POLLIN};
    return poll(&one, 1, ms) > 0;
}

/* Expects exactly these bytes. */
static void expect_bytes(const uint8_t *bytes, size_t size) {
    uint8_t got[512];
    size_t count = 0;
    while (count < size) {
        TEST_ASSERT_TRUE_MESSAGE(comes(client, 30000), "no answer");
        ssize_t more = recv(client, got + count, size - count, 0);
        TEST_ASSERT_TRUE_MESSAGE(more > 0, "hung up");
        count += (size_t)more;
    }
    TEST_ASSERT_EQUAL_HEX8_ARRAY(bytes, got, size);
    TEST_ASSERT_FALSE(comes(client, 0));
}

static void expect_hung_up(int descriptor) {
    uint8_t byte;
    TEST_ASSERT_TRUE_MESSAGE(comes(descriptor, 30000), "still connected");
    TEST_ASSERT_TRUE(recv(descriptor, &byte, 1, 0) <= 0);
}

/* Sends a request to a unit. The answer must be these bytes in the same transaction. */
static void expect_answer(uint8_t unit, const uint8_t *pdu, size_t pdu_size, const uint8_t *answer, size_t size) {
    static uint8_t transaction;
    uint8_t request[300] = {0x12, ++transaction, 0, 0, 0, (uint8_t)(1 + pdu_size), unit};
    uint8_t reply[300] = {0x12, transaction, 0, 0, 0, (uint8_t)(1 + size), unit};
    memcpy(request + 7, pdu, pdu_size);
    memcpy(reply + 7, answer, size);
    put(request, 7 + pdu_size);
    expect_bytes(reply, 7 + size);
}

#define ANSWER(unit, request, answer)                                                                                  \
    do {                                                                                                               \
        const uint8_t asked[] = request;                                                                               \
        const uint8_t answered[] = answer;                                                                             \
        expect_answer(unit, asked, sizeof asked, answered, sizeof answered);                                           \
    } while (0)
#define BYTES(...)                                                                                                     \
    { __VA_ARGS__ }

/* ---- reading ---- */

static void test_holding_registers(void) {
    tl_test_set_value(server, 0, 258);
    tl_test_set_value(server, 1, 1);
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 1, 2));
    ANSWER(1, BYTES(3, 0, 10, 0, 5),
           BYTES(3, 10, 1, 2, 0, 0, 0, 0, 0x3F, 0x80, 0, 0)); /* registers without a channel are 0 */
    ANSWER(1, BYTES(3, 0, 13, 0, 2), BYTES(3, 4, 0x3F, 0x80, 0, 0));
}

static void test_input_registers(void) {
    ANSWER(1, BYTES(4, 0, 0, 0, 2), BYTES(4, 4, 0, 0, 0, 0)); /* raw 0 before the first value */
    tl_test_set_value(server, 2, 0);
    ANSWER(1, BYTES(4, 0, 0, 0, 2), BYTES(4, 4, 0xFF, 0xFF, 0xFF, 0xFE));
}

static void test_coils(void) {
    tl_test_set_value(server, 3, 1);
    ANSWER(1, BYTES(1, 0, 100, 0, 11), BYTES(1, 2, 0x01, 0x00));
    tl_test_set_value(server, 4, 1);
    ANSWER(1, BYTES(1, 0, 100, 0, 11), BYTES(1, 2, 0x01, 0x04));
    tl_test_set_value(server, 3, 0);
    ANSWER(1, BYTES(1, 0, 100, 0, 8), BYTES(1, 1, 0x00));
    ANSWER(1, BYTES(1, 0, 110, 0, 1), BYTES(1, 1, 0x01));
}

static void test_discrete_inputs(void) {
    tl_test_set_value(server, 5, 1);
    ANSWER(7, BYTES(2, 0xFF, 0xFF, 0, 1), BYTES(2, 1, 1));
}

static void test_set_all(void) {
    const double values[CHANNEL_COUNT] = {1, 0, 0, 1, 0, 0, 3, 0};
    const bool present[CHANNEL_COUNT] = {true, false, false, false, false, false, true, false};
    tl_test_set_value(server, 3, 0);
    tl_plant_server_set_all(server, values, present);
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 1));
    ANSWER(1, BYTES(1, 0, 100, 0, 1), BYTES(1, 1, 0)); /* not present: unchanged */
    ANSWER(7, BYTES(3, 0, 0, 0, 2), BYTES(3, 4, 0, 0, 0, 3));
    tl_plant_server_set_all(server, values, NULL);
    ANSWER(1, BYTES(1, 0, 100, 0, 1), BYTES(1, 1, 1));
}

static void test_a_channel_that_is_none(void) {
    tl_test_set_value(server, CHANNEL_COUNT, 1);
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 0));
}

static void test_the_largest_answers(void) {
    static tl_modbus_channel many[2];
    many[0] = (tl_modbus_channel){.unit_id = 1, .table = TL_MODBUS_INPUT, .address = 200, .type = TL_MODBUS_INT16};
    many[1] = (tl_modbus_channel){.unit_id = 1, .table = TL_MODBUS_INPUT, .address = 0, .type = TL_MODBUS_INT16};
    many[0].scale = many[1].scale = 1;
    (void)close(client);
    tl_plant_server_stop(server);
    TEST_ASSERT_EQUAL_INT(TL_OK, start_at("127.0.0.1", 0, many, 2));
    client = dial();
    tl_test_set_value(server, 1, 5);
    const uint8_t most[] = {4, 0, 0, 0, 125};
    uint8_t answer[252] = {4, 250, 0, 5};
    expect_answer(1, most, sizeof most, answer, sizeof answer);
    ANSWER(1, BYTES(4, 0, 0, 0, 126), BYTES(0x84, 3));
}

/* ---- refusing ---- */

static void test_addresses_outside(void) {
    ANSWER(1, BYTES(3, 0, 9, 0, 1), BYTES(0x83, 2));
    ANSWER(1, BYTES(3, 0, 14, 0, 2), BYTES(0x83, 2));
    ANSWER(1, BYTES(1, 0, 100, 0, 12), BYTES(0x81, 2));
    ANSWER(1, BYTES(2, 0, 0, 0, 1), BYTES(0x82, 2)); /* the unit has no discrete inputs */
    ANSWER(7, BYTES(2, 0xFF, 0xFF, 0, 2), BYTES(0x82, 2));
}

static void test_counts_outside(void) {
    ANSWER(1, BYTES(3, 0, 10, 0, 0), BYTES(0x83, 3));
    ANSWER(1, BYTES(3, 0, 10, 0, 126), BYTES(0x83, 3));
    ANSWER(1, BYTES(1, 0, 100, 7, 0xD1), BYTES(0x81, 3)); /* 2001 */
    ANSWER(1, BYTES(1, 0, 100, 7, 0xD0), BYTES(0x81, 2)); /* 2000: too many for this device only */
    ANSWER(1, BYTES(3, 0, 10, 0), BYTES(0x83, 3));        /* a request that is too short */
    ANSWER(1, BYTES(3, 0, 10, 0, 1, 0), BYTES(0x83, 3));  /* a request that is too long */
    ANSWER(1, BYTES(3), BYTES(0x83, 3));
}

static void test_units_outside(void) {
    ANSWER(2, BYTES(3, 0, 10, 0, 1), BYTES(0x83, 11));
    ANSWER(0, BYTES(3, 0, 10, 0, 1), BYTES(0x83, 11));
}

static void test_writes_are_refused_and_counted(void) {
    tl_test_set_value(server, 0, 77);
    ANSWER(1, BYTES(5, 0, 100, 0xFF, 0), BYTES(0x85, 1));
    ANSWER(1, BYTES(6, 0, 10, 0, 1), BYTES(0x86, 1));
    ANSWER(1, BYTES(15, 0, 100, 0, 8, 1, 0xFF), BYTES(0x8F, 1));
    ANSWER(1, BYTES(16, 0, 10, 0, 1, 2, 0, 1), BYTES(0x90, 1));
    ANSWER(1, BYTES(22, 0, 10, 0, 0, 0, 1), BYTES(0x96, 1));
    ANSWER(1, BYTES(23, 0, 10, 0, 1, 0, 10, 0, 1, 2, 0, 1), BYTES(0x97, 1));
    TEST_ASSERT_EQUAL_UINT64(6, tl_plant_server_count(server).refused_writes);
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 77));
    ANSWER(1, BYTES(1, 0, 100, 0, 8), BYTES(1, 1, 0));
    TEST_ASSERT_EQUAL_UINT64(6, tl_plant_server_count(server).refused_writes);
    TEST_ASSERT_EQUAL_UINT64(8, tl_plant_server_count(server).requests);
}

static void test_other_functions_are_refused(void) {
    ANSWER(1, BYTES(7), BYTES(0x87, 1));
    ANSWER(1, BYTES(17), BYTES(0x91, 1));
    ANSWER(1, BYTES(0), BYTES(0x80, 1));
    ANSWER(1, BYTES(43, 14, 1, 0), BYTES(0xAB, 1));
    TEST_ASSERT_EQUAL_UINT64(0, tl_plant_server_count(server).refused_writes);
    TEST_ASSERT_EQUAL_UINT64(4, tl_plant_server_count(server).requests);
}

/* ---- frames ---- */

static void test_requests_in_pieces_and_in_one(void) {
    const uint8_t two[] = {0, 1, 0, 0, 0, 6, 1, 3, 0, 10, 0, 1, 0, 2, 0, 0, 0, 6, 7, 3, 0, 0, 0, 1};
    const uint8_t answers[] = {0, 1, 0, 0, 0, 5, 1, 3, 2, 0, 0, 0, 2, 0, 0, 0, 5, 7, 3, 2, 0, 0};
    put(two, 3);
    TEST_ASSERT_FALSE(comes(client, 20));
    put(two + 3, 6);
    TEST_ASSERT_FALSE(comes(client, 20));
    put(two + 9, sizeof two - 9);
    expect_bytes(answers, sizeof answers);
}

static void test_what_is_no_modbus_is_disconnected(void) {
    static const uint8_t FRAMES[][7] = {
        {0, 1, 0, 1, 0, 6, 1},   /* another protocol */
        {0, 1, 0, 0, 0, 0, 1},   /* no length */
        {0, 1, 0, 0, 0, 1, 1},   /* no function */
        {0, 1, 0, 0, 0, 255, 1}, /* too long */
        {'G', 'E', 'T', ' ', '/', ' ', 'H'},
    };
    for (size_t i = 0; i < sizeof FRAMES / sizeof FRAMES[0]; i++) {
        put(FRAMES[i], 7);
        expect_hung_up(client);
        (void)close(client);
        client = dial();
    }
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 0));
    TEST_ASSERT_EQUAL_UINT64(1, tl_plant_server_count(server).requests);
}

/* ---- clients ---- */

static void expect_served(int other) {
    int first = client;
    client = other;
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 0));
    client = first;
}

static void test_eight_clients_and_no_more(void) {
    int more[TL_PLANT_SERVER_CLIENTS];
    expect_served(client);
    for (size_t i = 1; i < TL_PLANT_SERVER_CLIENTS; i++) {
        more[i] = dial();
        expect_served(more[i]);
    }
    int ninth = dial();
    expect_hung_up(ninth);
    (void)close(ninth);
    (void)close(more[3]); /* one disconnects: the others stay, and another one can connect */
    more[3] = dial();
    for (size_t i = 1; i < TL_PLANT_SERVER_CLIENTS; i++) {
        expect_served(more[i]);
        (void)close(more[i]);
    }
}

/* A client sends requests and never reads. The device disconnects it instead of waiting. */
static void test_a_client_that_does_not_listen(void) {
    const uint8_t request[] = {0, 1, 0, 0, 0, 6, 1, 3, 0, 10, 0, 5};
    tl_time deadline = tl_clock_now(NULL) + 60 * TL_SECOND;
    int greedy = dial();
    for (ssize_t sent = 0; sent >= 0;) {
        TEST_ASSERT_TRUE(tl_clock_now(NULL) < deadline);
        sent = send(greedy, request, sizeof request, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent < 0 && errno == EAGAIN) {
            (void)poll(NULL, 0, 1);
            sent = 0;
        }
    }
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 0));
    (void)close(greedy);
}

static void test_half_a_request_blocks_no_other_client(void) {
    int slow = dial();
    const uint8_t half[] = {0, 1, 0, 0, 0, 6, 1, 3};
    TEST_ASSERT_EQUAL_INT((int)sizeof half, (int)send(slow, half, sizeof half, MSG_NOSIGNAL));
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 0));
    (void)close(slow);
}

/* ---- threads ---- */

static bool stop; /* atomic */

/* Writes the same number to both values of unit 7. All bytes of the 32-bit value change. */
static void *set_often(void *context) {
    double values[CHANNEL_COUNT] = {0};
    (void)context;
    for (uint32_t i = 0; !__atomic_load_n(&stop, __ATOMIC_ACQUIRE); i++) {
        values[6] = (double)(i % 256 * 0x01010101u);
        values[7] = values[6];
        tl_plant_server_set_all(server, values, NULL);
    }
    return NULL;
}

static void test_no_value_and_no_row_is_torn(void) {
    pthread_t thread;
    const tl_modbus_channel *number = &CHANNELS[7];
    const uint8_t request[] = {0, 1, 0, 0, 0, 6, 7, 3, 0, 0, 0, 9};
    __atomic_store_n(&stop, false, __ATOMIC_RELEASE);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, set_often, NULL));
    for (int i = 0; i < 2000; i++) {
        uint8_t reply[27];
        size_t got = 0;
        put(request, sizeof request);
        while (got < sizeof reply) {
            ssize_t more = recv(client, reply + got, sizeof reply - got, 0);
            TEST_ASSERT_TRUE(more > 0);
            got += (size_t)more;
        }
        uint16_t words[9];
        for (size_t w = 0; w < 9; w++) {
            words[w] = (uint16_t)(reply[9 + 2 * w] * 256 + reply[10 + 2 * w]);
        }
        double value = -1;
        TEST_ASSERT_EQUAL_HEX16(words[0], words[1]);
        TEST_ASSERT_TRUE(tl_modbus_decode(number, words + 5, &value));
        TEST_ASSERT_EQUAL_DOUBLE((double)(words[0] * 65536u + words[1]), value);
    }
    __atomic_store_n(&stop, true, __ATOMIC_RELEASE);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
}

static void test_stop_hangs_up_and_frees_the_port(void) {
    uint16_t port = tl_plant_server_port(server);
    ANSWER(1, BYTES(3, 0, 10, 0, 1), BYTES(3, 2, 0, 0));
    tl_time begin = tl_clock_now(NULL);
    tl_plant_server_stop(server);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begin < 10 * TL_SECOND);
    expect_hung_up(client);
    server = NULL;
    tl_status status = start_at("127.0.0.1", port, CHANNELS, CHANNEL_COUNT);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    TEST_ASSERT_EQUAL_UINT16(port, tl_plant_server_port(server));
}

/* ---- settings ---- */

/* A second device cannot start. The first one is not affected. */
static void expect_refused(tl_status status, const char *host, uint16_t port, const tl_modbus_channel *channels,
                           const char *parts) {
    tl_plant_server *first = server;
    TEST_ASSERT_EQUAL_INT(status, start_at(host, port, channels, 1));
    TEST_ASSERT_EQUAL_PTR(first, server);
    TEST_ASSERT_EQUAL_INT(status, error.status);
    TL_EXPECT_PARTS(parts, error.text);
}

static void test_a_port_that_is_taken(void) {
    expect_refused(TL_TRY_AGAIN, "127.0.0.1", tl_plant_server_port(server), CHANNELS, "127.0.0.1|in use");
}

static void test_hosts_of_other_machines(void) {
    char name[80];
    memset(name, 'x', sizeof name - 1); /* a label of this length is invalid, so no name server is asked */
    name[sizeof name - 1] = '\0';
    expect_refused(TL_BAD_DATA, name, 0, CHANNELS, name);
    expect_refused(TL_TRY_AGAIN, "192.0.2.1", 0, CHANNELS, "192.0.2.1");
}

static void test_a_device_without_channels(void) {
    (void)close(client);
    tl_plant_server_stop(server);
    TEST_ASSERT_EQUAL_INT(TL_OK, start_at("localhost", 0, NULL, 0));
    tl_plant_server_set_all(server, NULL, NULL);
    tl_plant_server_stop(server);
    server = NULL;
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_holding_registers);
    RUN_TEST(test_input_registers);
    RUN_TEST(test_coils);
    RUN_TEST(test_discrete_inputs);
    RUN_TEST(test_set_all);
    RUN_TEST(test_a_channel_that_is_none);
    RUN_TEST(test_the_largest_answers);
    RUN_TEST(test_addresses_outside);
    RUN_TEST(test_counts_outside);
    RUN_TEST(test_units_outside);
    RUN_TEST(test_writes_are_refused_and_counted);
    RUN_TEST(test_other_functions_are_refused);
    RUN_TEST(test_requests_in_pieces_and_in_one);
    RUN_TEST(test_what_is_no_modbus_is_disconnected);
    RUN_TEST(test_a_client_that_does_not_listen);
    RUN_TEST(test_eight_clients_and_no_more);
    RUN_TEST(test_half_a_request_blocks_no_other_client);
    RUN_TEST(test_no_value_and_no_row_is_torn);
    RUN_TEST(test_stop_hangs_up_and_frees_the_port);
    RUN_TEST(test_a_port_that_is_taken);
    RUN_TEST(test_hosts_of_other_machines);
    RUN_TEST(test_a_device_without_channels);
    return UNITY_END();
}
