/* The Modbus TCP driver with an emulated device, and with a peer that misbehaves on purpose.
 *
 * All traffic stays on 127.0.0.1, at ports that the system chooses. The peer records all that the
 * driver sends, and tearDown() checks that these are read requests only.
 */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#include <unity.h>

#include "board/modbus/modbus.h"
#include "firmware/cli/plant_server.h"
#include "tests/support/device_value.h"
#include "tests/support/driver_probe.h"
#include "tests/support/message.h"
#include "tests/support/modbus_peer.h"
#include "tests/support/real_time.h"

enum { CHANNELS = 2200 };

/* ---- a peer with the answers of a test ---- */

enum { NO_ANSWER = 0, HANG_UP = -1, FRAME = 300 };

/* Makes the reply to a request; returns its size, NO_ANSWER or HANG_UP. Runs in the peer's
 * thread. */
typedef int answer_function(const uint8_t *request, uint8_t *reply);

static tl_modbus_peer other = TL_MODBUS_PEER;
static answer_function *answer_now; /* guarded by the lock of the peer */

static answer_function *note_request(const uint8_t *request, size_t size) {
    (void)pthread_mutex_lock(&other.lock);
    tl_modbus_peer_note(&other, request, size);
    answer_function *answer = answer_now;
    (void)pthread_mutex_unlock(&other.lock);
    return answer;
}

/* A gateway that forwards frames of a line. The answers of a test have the prefix of TCP in either
 * case. `wrong_sums`: so many answers have a wrong check sum. */
static bool framed;
static int wrong_sums;

enum { PREFIX = 6, SUM = 2 };

static bool serve_framed(int client) {
    uint8_t request[FRAME] = {0, 0, 0, 0, 0, PREFIX};
    uint8_t reply[FRAME + SUM];
    ssize_t size = recv(client, request + PREFIX, sizeof request - PREFIX, 0);
    if (size != 8 || tl_modbus_peer_sum(request + PREFIX, 8) != 0) { /* 0: over the sum, too */
        return false;
    }
    int length = note_request(request, 12)(request, reply);
    if (length == HANG_UP) {
        return false;
    }
    if (length > PREFIX) {
        unsigned sum = tl_modbus_peer_sum(reply + PREFIX, (size_t)length - PREFIX) ^ (wrong_sums-- > 0 ? 0x10U : 0U);
        reply[length] = (uint8_t)(sum & 0xFF);
        reply[length + 1] = (uint8_t)(sum >> 8);
        length += SUM - PREFIX;
        return send(client, reply + PREFIX, (size_t)length, MSG_NOSIGNAL) == length;
    }
    return true;
}

/* false: close the connection. */
static bool serve(int client) {
    if (framed) {
        return serve_framed(client);
    }
    uint8_t request[FRAME];
    uint8_t reply[FRAME];
    ssize_t size = recv(client, request, sizeof request, 0);
    if (size <= 0) {
        return false;
    }
    int length = note_request(request, (size_t)size)(request, reply);
    return length == NO_ANSWER || (length > 0 && send(client, reply, (size_t)length, MSG_NOSIGNAL) == length);
}

static void set_answer(answer_function *answer) {
    (void)pthread_mutex_lock(&other.lock);
    answer_now = answer;
    (void)pthread_mutex_unlock(&other.lock);
}

static void start_peer(answer_function *answer) {
    set_answer(answer);
    tl_modbus_peer_listen(&other, serve);
}

/* Transaction, protocol, length, unit, function; then the data of the caller. */
static int reply_with(const uint8_t *request, uint8_t *reply, uint8_t function, const uint8_t *data, size_t size) {
    memcpy(reply, request, 7);
    reply[4] = 0;
    reply[5] = (uint8_t)(2 + size);
    reply[7] = function;
    memcpy(reply + 8, data, size);
    return (int)(8 + size);
}

static unsigned address_of(const uint8_t *request) {
    return (unsigned)request[8] * 256 + request[9];
}

static unsigned count_of(const uint8_t *request) {
    return (unsigned)request[10] * 256 + request[11];
}

/* ---- answers ---- */

/* Each register holds its own address; a bit is 1 if its address is odd. */
static int sane(const uint8_t *request, uint8_t *reply) {
    uint8_t data[256];
    size_t size = tl_modbus_peer_values(request[7], address_of(request), count_of(request), data);
    return reply_with(request, reply, request[7], data, size);
}

static int silent(const uint8_t *request, uint8_t *reply) {
    (void)request;
    (void)reply;
    return NO_ANSWER;
}

static int hang_up(const uint8_t *request, uint8_t *reply) {
    (void)request;
    (void)reply;
    return HANG_UP;
}

static int exception(const uint8_t *request, uint8_t *reply, uint8_t code) {
    return reply_with(request, reply, request[7] | 0x80, &code, 1);
}

static int garbage(const uint8_t *request, uint8_t *reply) {
    (void)request;
    for (int i = 0; i < 40; i++) {
        reply[i] = (uint8_t)(251 * i + 17);
    }
    return 40;
}

static int half_a_frame(const uint8_t *request, uint8_t *reply) {
    return sane(request, reply) / 2;
}

static int another_transaction(const uint8_t *request, uint8_t *reply) {
    int size = sane(request, reply);
    reply[1] ^= 1;
    return size;
}

static int always_transaction_7(const uint8_t *request, uint8_t *reply) {
    int size = sane(request, reply);
    reply[0] = 0;
    reply[1] = 7;
    return size;
}

/* Answers the first request after its time-out. */
static bool was_late; /* used by the thread of the peer */

static int late_at_first(const uint8_t *request, uint8_t *reply) {
    if (!was_late) {
        tl_test_pause_ms(100);
    }
    was_late = true;
    return always_transaction_7(request, reply);
}

static int another_function(const uint8_t *request, uint8_t *reply) {
    int size = sane(request, reply);
    reply[7] ^= 7; /* 3 becomes 4 */
    return size;
}

static int too_few_values(const uint8_t *request, uint8_t *reply) {
    const uint8_t data[3] = {2, 0, 0};
    return reply_with(request, reply, request[7], data, sizeof data);
}

static int talkative(const uint8_t *request, uint8_t *reply) {
    int size = sane(request, reply);
    memset(reply + size, 0xEE, 5);
    return size + 5;
}

static int not_a_number(const uint8_t *request, uint8_t *reply) {
    const uint8_t data[5] = {4, 0x7F, 0xC0, 0, 0};
    return reply_with(request, reply, request[7], data, sizeof data);
}

static int unit_2_fails(const uint8_t *request, uint8_t *reply) {
    return request[6] == 2 ? exception(request, reply, 4) : sane(request, reply);
}

static int unit_2_fails_strangely(const uint8_t *request, uint8_t *reply) {
    return request[6] == 2 ? exception(request, reply, 0x50) : sane(request, reply);
}

static int unit_2_is_silent(const uint8_t *request, uint8_t *reply) {
    return request[6] == 2 ? NO_ANSWER : sane(request, reply);
}

static int units_1_and_3_are_silent(const uint8_t *request, uint8_t *reply) {
    return request[6] == 1 || request[6] == 3 ? NO_ANSWER : sane(request, reply);
}

/* As many bytes as a value would have had. */
static int exception_and_more(const uint8_t *request, uint8_t *reply) {
    int size = exception(request, reply, 4);
    memset(reply + size, 0xEE, 2);
    return size + 2;
}

/* Registers 4 to 9 do not exist. */
static int has_a_hole(const uint8_t *request, uint8_t *reply) {
    unsigned end = address_of(request) + count_of(request);
    return end > 4 && address_of(request) < 10 ? exception(request, reply, 2) : sane(request, reply);
}

/* Register 4 does not exist. */
static bool has_4(const uint8_t *request) {
    return address_of(request) <= 4 && address_of(request) + count_of(request) > 4;
}

static int fails_at_4(const uint8_t *request, uint8_t *reply) {
    return has_4(request) ? exception(request, reply, 4) : sane(request, reply);
}

static int is_silent_at_4(const uint8_t *request, uint8_t *reply) {
    return has_4(request) ? NO_ANSWER : sane(request, reply);
}

/* The first `busy_left` requests find a busy device. `answered`: time of the last answer. */
static int busy_left;
static tl_time answered;
static tl_time shortest_pause; /* from an answer to the next request */

static int is_busy(const uint8_t *request, uint8_t *reply) {
    tl_time pause = tl_test_now() - answered;
    shortest_pause = pause < shortest_pause ? pause : shortest_pause;
    int size = busy_left-- > 0 ? exception(request, reply, 6) : sane(request, reply);
    answered = tl_test_now();
    return size;
}

/* At most two registers per request. */
static int is_narrow(const uint8_t *request, uint8_t *reply) {
    return count_of(request) > 2 ? exception(request, reply, 3) : sane(request, reply);
}

/* ---- the driver under test ---- */

static tl_driver_probe probe;
static tl_modbus_channel channels[CHANNELS];
static size_t channel_count;

static void add_of(uint8_t unit_id, tl_modbus_table table, unsigned address, tl_modbus_type type) {
    channels[channel_count] =
        (tl_modbus_channel){.unit_id = unit_id, .table = table, .address = (uint16_t)address, .type = type, .scale = 1};
    channel_count++;
}

static void add(unsigned address) {
    add_of(1, TL_MODBUS_HOLDING, address, TL_MODBUS_UINT16);
}

static tl_modbus_settings settings_for(const char *host, uint16_t port, double timeout_s) {
    return (tl_modbus_settings){
        .host = host, .port = port, .timeout_s = timeout_s, .channels = channels, .channel_count = channel_count};
}

static void open_driver(const char *host, uint16_t port, double timeout_s) {
    const tl_modbus_settings settings = settings_for(host, port, timeout_s);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
}

static void open_driver_that_pauses(double pause_s, double period_s) {
    tl_modbus_settings settings = settings_for("127.0.0.1", other.port, 10);
    settings.pause_s = pause_s;
    settings.period_s = period_s;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
}

static void start_busy_peer(int times) {
    busy_left = times;
    answered = tl_test_now(); /* before the connection */
    shortest_pause = TL_SECOND;
    start_peer(is_busy);
}

static void open_driver_that_splits(double timeout_s) {
    tl_modbus_settings settings = settings_for("127.0.0.1", other.port, timeout_s);
    settings.split_failed = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
}

void setUp(void) {
    tl_probe_begin(&probe, &tl_modbus_driver);
    memset(channels, 0, sizeof channels);
    channel_count = 0;
    tl_modbus_peer_forget(&other);
    framed = false;
}

/* The driver sent only whole requests of functions 1 to 4, within the limits of the protocol. */
static void expect_only_reads_on_the_wire(void) {
    TEST_ASSERT_EQUAL_size_t(0, other.recorded % 12);
    for (size_t at = 0; at < other.recorded; at += 12) {
        const uint8_t *request = other.record + at;
        unsigned count = count_of(request);
        TEST_ASSERT_EQUAL_HEX8(0, request[2]);
        TEST_ASSERT_EQUAL_HEX8(0, request[3]);
        TEST_ASSERT_EQUAL_HEX8(0, request[4]);
        TEST_ASSERT_EQUAL_HEX8(6, request[5]);
        TEST_ASSERT_TRUE(request[7] >= 1 && request[7] <= 4);
        TEST_ASSERT_TRUE(count >= 1 && count <= (request[7] <= 2 ? 2000 : 125));
        TEST_ASSERT_TRUE(address_of(request) + count <= 65536);
    }
}

void tearDown(void) {
    tl_probe_end(&probe);
    tl_modbus_peer_stop(&other);
    expect_only_reads_on_the_wire();
}

/* ---- values ---- */

static tl_plant_server *start_device(uint16_t port) {
    const tl_plant_server_settings settings = {
        .host = "127.0.0.1", .port = port, .channels = channels, .channel_count = channel_count};
    tl_plant_server *device = NULL;
    tl_time deadline = tl_test_now() + 30 * TL_SECOND;
    while (tl_plant_server_start(&settings, &device, &probe.error) != TL_OK) {
        TEST_ASSERT_TRUE_MESSAGE(tl_test_now() < deadline, probe.error.text);
        tl_test_pause_ms(5); /* a stopped device may still hold the port */
    }
    return device;
}

static void test_every_type_order_and_table(void) {
    static const tl_modbus_type TYPES[] = {TL_MODBUS_INT16,  TL_MODBUS_UINT16,  TL_MODBUS_INT32,
                                           TL_MODBUS_UINT32, TL_MODBUS_FLOAT32, TL_MODBUS_FLOAT64};
    double values[128];
    unsigned address = 7;
    for (int table = TL_MODBUS_HOLDING; table <= TL_MODBUS_INPUT; table++) {
        for (int order = 0; order < 4; order++) {
            for (size_t i = 0; i < 6; i++) {
                add_of((uint8_t)(order % 2), (tl_modbus_table)table, address, TYPES[i]);
                channels[channel_count - 1].words_little = order % 2 != 0;
                channels[channel_count - 1].bytes_little = order / 2 != 0;
                channels[channel_count - 1].scale = 0.5;
                channels[channel_count - 1].offset = -100;
                address += (unsigned)tl_modbus_registers(TYPES[i]);
            }
        }
    }
    for (unsigned i = 0; i < 20; i++) {
        add_of(255, i % 2 == 0 ? TL_MODBUS_COIL : TL_MODBUS_DISCRETE, 3 * i, TL_MODBUS_BIT);
    }
    tl_plant_server *device = start_device(0);
    for (size_t i = 0; i < channel_count; i++) {
        values[i] = channels[i].type == TL_MODBUS_BIT ? (double)(i / 3 % 2) : 50.5 + (double)i;
    }
    tl_plant_server_set_all(device, values, NULL);
    open_driver("127.0.0.1", tl_plant_server_port(device), 10);
    tl_time before = tl_test_now();
    tl_probe_poll(&probe);
    tl_time after = tl_test_now();
    for (size_t i = 0; i < channel_count; i++) {
        tl_probe_expect(&probe, i, values[i], TL_GOOD);
        TEST_ASSERT_EQUAL_size_t(1, probe.posts[i]);
        TEST_ASSERT_TRUE(probe.newest[i].stamp >= before && probe.newest[i].stamp <= after);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    tl_probe_expect_link(&probe, true, "connected");
    TEST_ASSERT_EQUAL_UINT64(0, tl_plant_server_count(device).refused_writes);
    /* 2 units x 2 tables, coils, discretes */
    TEST_ASSERT_EQUAL_UINT64(6, tl_plant_server_count(device).requests);
    tl_plant_server_stop(device);
}

static void test_more_than_one_request_holds(void) {
    for (unsigned i = 0; i < 40; i++) {
        add_of(1, TL_MODBUS_INPUT, 4 * i, TL_MODBUS_FLOAT64);
    }
    for (unsigned i = 0; i < 2100; i++) {
        add_of(1, TL_MODBUS_DISCRETE, i, TL_MODBUS_BIT);
    }
    tl_plant_server *device = start_device(0);
    for (size_t i = 0; i < channel_count; i++) {
        tl_test_set_value(device, i, i < 40 ? 1.0 / (double)(i + 1) : (double)(i % 3 == 0));
    }
    open_driver("127.0.0.1", tl_plant_server_port(device), 10);
    tl_probe_poll(&probe);
    for (size_t i = 0; i < channel_count; i++) {
        tl_probe_expect(&probe, i, i < 40 ? 1.0 / (double)(i + 1) : (double)(i % 3 == 0), TL_GOOD);
    }
    TEST_ASSERT_EQUAL_UINT64(4, tl_plant_server_count(device).requests);
    tl_plant_server_stop(device);
}

static void test_a_float_that_is_no_number(void) {
    add_of(1, TL_MODBUS_INPUT, 0, TL_MODBUS_FLOAT32);
    start_peer(not_a_number);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NOT_A_NUMBER);
    tl_probe_expect_link(&probe, true, "connected");
}

/* Its neighbours in the same request are good. */
static void test_a_value_that_is_not_available(void) {
    add(257);
    add(258);
    add_of(1, TL_MODBUS_HOLDING, 259, TL_MODBUS_BCD16); /* 0x0103 */
    add_of(1, TL_MODBUS_HOLDING, 266, TL_MODBUS_BCD16); /* 0x010A has no digit */
    channels[1].codes[0] = 258;
    channels[1].code_count = 1;
    start_peer(sane);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 257, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NOT_A_NUMBER);
    tl_probe_expect(&probe, 2, 103, TL_GOOD);
    tl_probe_expect(&probe, 3, 0, TL_NOT_A_NUMBER);
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_requests(&other));
}

static void test_the_request_as_it_is_written(void) {
    /* after the transaction */
    static const uint8_t EXPECTED[] = {0, 0, 0, 6, 17, 4, 0x12, 0x34, 0, 4};
    add_of(17, TL_MODBUS_INPUT, 0x1234, TL_MODBUS_FLOAT64);
    start_peer(sane);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_requests(&other));
    TEST_ASSERT_EQUAL_HEX8_ARRAY(EXPECTED, other.record + 2, sizeof EXPECTED);
}

static void test_no_channels(void) {
    start_peer(sane);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(0, tl_modbus_peer_requests(&other));
}

/* ---- an absent server, a server that stops and returns ---- */

static void test_an_absent_server_that_comes(void) {
    add(1);
    add(2);
    tl_modbus_peer_bind(&other); /* reserves the port; nothing listens yet */
    open_driver("127.0.0.1", other.port, 10);
    for (size_t i = 1; i <= 20; i++) {
        tl_probe_poll(&probe);
        /* also while the driver waits for the next attempt */
        TEST_ASSERT_EQUAL_size_t(i, probe.posts[0]);
        TEST_ASSERT_EQUAL_size_t(i, probe.posts[1]);
    }
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    tl_probe_expect_link(&probe, false, "127.0.0.1:|refused");
    start_peer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 1, 2, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    tl_probe_expect_link(&probe, true, "connected");
}

static void test_a_server_that_dies_and_returns(void) {
    add(5);
    tl_plant_server *device = start_device(0);
    uint16_t port = tl_plant_server_port(device);
    tl_test_set_value(device, 0, 11);
    open_driver("127.0.0.1", port, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 11, TL_GOOD);
    tl_plant_server_stop(device);
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    tl_probe_expect_link(&probe, false, "refused");
    device = start_device(port);
    tl_test_set_value(device, 0, 12);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 12, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(3, probe.links);
    tl_probe_expect_link(&probe, true, "connected");
    tl_plant_server_stop(device);
}

static void test_attempts_are_paused(void) {
    add(0);
    start_peer(hang_up);
    open_driver("127.0.0.1", other.port, 10);
    tl_time begin = tl_test_now();
    size_t polls = 0;
    while (tl_test_now() < begin + TL_SECOND) {
        tl_probe_poll(&probe);
        polls++;
        tl_test_pause_ms(5);
    }
    /* 0.1, 0.3, 0.7 s: four attempts in the first second. */
    TEST_ASSERT_TRUE(tl_modbus_peer_connections(&other) >= 1 && tl_modbus_peer_connections(&other) <= 4);
    TEST_ASSERT_EQUAL_size_t(polls, probe.posts[0]);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    tl_probe_expect_link(&probe, false, "Connection reset");
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
}

/* After an answer the pauses start at 0.1 s again. */
static void test_pauses_are_reset_by_an_answer(void) {
    add(0);
    start_peer(hang_up);
    open_driver("127.0.0.1", other.port, 10);
    /* pauses of 0.1, 0.2 and 0.4 s; the next is 0.8 s */
    for (size_t wanted = 1; wanted <= 4; wanted++) {
        while (tl_modbus_peer_connections(&other) < wanted) {
            tl_probe_poll(&probe);
            tl_test_pause_ms(5);
        }
    }
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    set_answer(hang_up);
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    tl_time begin = tl_test_now();
    size_t before = tl_modbus_peer_connections(&other);
    while (tl_modbus_peer_connections(&other) == before) {
        tl_probe_poll(&probe);
        tl_test_pause_ms(5);
    }
    TEST_ASSERT_TRUE(tl_test_now() - begin < TL_SECOND); /* 0.1 s; without the reset 1.6 s */
}

static void test_a_name(void) {
    add(3);
    start_peer(sane);
    open_driver("localhost", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
}

static void test_an_unknown_name(void) {
    char name[80];
    memset(name, 'x', sizeof name - 1); /* too long for a label, so no server is asked */
    name[sizeof name - 1] = '\0';
    add(3);
    open_driver(name, 502, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, name);
    tl_probe_expect_link(&probe, false, "502|resolved");
}

/* ---- wrong answers ---- */

/* The peer gives this answer; the poll reports no link, with these parts. Then the peer gives right
 * answers. */
static void expect_down_and_up(answer_function *answer, double timeout_s, const char *parts) {
    add(1);
    add(2);
    start_peer(answer);
    open_driver("127.0.0.1", other.port, timeout_s);
    tl_probe_poll_down(&probe, 2, parts);
    set_answer(sane);
    tl_probe_poll_up(&probe, 2, (const double[]){1, 2});
    /* a new connection, so that the driver cannot take an old answer for the next one */
    TEST_ASSERT_TRUE(tl_modbus_peer_connections(&other) >= 2);
}

/* The same after right answers. */
static void expect_lost_and_found(answer_function *answer, double timeout_s) {
    add(1);
    start_peer(sane);
    open_driver("127.0.0.1", other.port, timeout_s);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    set_answer(answer);
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_size_t(1, probe.downs);
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(1, probe.downs);
    TEST_ASSERT_EQUAL_size_t(3, probe.links);
}

static void test_silence(void) {
    tl_time begin = tl_test_now();
    expect_down_and_up(silent, 0.4, "0.4 s");
    TEST_ASSERT_TRUE(tl_test_now() >= begin + 400000000);
}

static void test_silence_later(void) {
    expect_lost_and_found(silent, 0.4);
}

static void test_half_a_frame(void) {
    expect_down_and_up(half_a_frame, 0.4, "0.4 s");
}

static void test_hanging_up(void) {
    expect_down_and_up(hang_up, 10, "Connection reset");
}

static void test_garbage(void) {
    expect_down_and_up(garbage, 10, "transaction|4364|1");
}

static void test_garbage_later(void) {
    expect_lost_and_found(garbage, 10);
}

static void test_another_transaction(void) {
    expect_down_and_up(another_transaction, 10, "transaction|0|1");
}

static void test_a_device_that_always_sends_the_same_transaction(void) {
    add(1);
    add(1000);
    start_peer(always_transaction_7);
    tl_modbus_settings settings = settings_for("127.0.0.1", other.port, 10);
    settings.any_transaction_id = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
    for (int i = 0; i < 5; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD);
        tl_probe_expect(&probe, 1, 1000, TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_connections(&other));
}

/* Late answers are lost with their connection: none is taken for the answer to another request. */
static void test_late_answers_with_the_same_transaction(void) {
    add(1);
    add(1000);
    start_peer(late_at_first);
    tl_modbus_settings settings = settings_for("127.0.0.1", other.port, 0.05);
    settings.any_transaction_id = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
    tl_probe_poll_down(&probe, 2, "0.05 s");
    for (size_t i = 0; i < 2; i++) {
        tl_probe_poll_until(&probe, i, TL_GOOD);
        tl_probe_expect(&probe, i, i == 0 ? 1 : 1000, TL_GOOD);
    }
}

static void test_another_function(void) {
    expect_down_and_up(another_function, 10, "function|4|3");
}

static void test_too_few_values(void) {
    expect_down_and_up(too_few_values, 10, "bytes|2|4");
}

/* One byte per 40 ms of an answer of 259 bytes: the timeout limits the whole answer, not the next
 * byte. */
static int trickle_client = -1;

static void *trickle(void *context) {
    uint8_t request[FRAME];
    int listener = *(const int *)context;
    int client = accept(listener, NULL, NULL);
    uint8_t reply[FRAME];
    if (client >= 0 && recv(client, request, sizeof request, 0) == 12) {
        int size = sane(request, reply);
        for (int i = 0; i < size && send(client, reply + i, 1, MSG_NOSIGNAL) == 1; i++) {
            tl_test_pause_ms(40);
        }
    }
    trickle_client = client;
    return NULL;
}

static void test_an_answer_that_trickles(void) {
    pthread_t thread;
    for (unsigned i = 0; i < 125; i++) {
        add(i);
    }
    tl_modbus_peer_bind(&other);
    TEST_ASSERT_EQUAL_INT(0, listen(other.listener, 1));
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, trickle, &other.listener));
    open_driver("127.0.0.1", other.port, 0.2);
    tl_time begin = tl_test_now();
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(tl_test_now() - begin < 5 * TL_SECOND);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, "0.2 s");
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    (void)close(trickle_client);
}

static void test_more_than_was_asked_for(void) {
    add(1);
    start_peer(talkative);
    open_driver("127.0.0.1", other.port, 10);
    for (int i = 0; i < 5; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD); /* surplus bytes are never taken for an answer */
        tl_test_pause_ms(5);
    }
    TEST_ASSERT_EQUAL_size_t(2, probe.links); /* connected, and one report of surplus bytes */
    tl_probe_expect_part(&probe, "gateway");
    TEST_ASSERT_TRUE(tl_modbus_peer_connections(&other) > 1);
}

static int answers_left; /* used by the thread of the peer only */

static int answers_once(const uint8_t *request, uint8_t *reply) {
    answers_left--;
    return answers_left >= 0 ? sane(request, reply) : NO_ANSWER;
}

/* A device that closes idle connections. */
static void test_a_connection_that_was_closed_between_polls(void) {
    add(1);
    start_peer(sane);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    for (int i = 0; i < 3; i++) {
        int extra = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        struct sockaddr_in address = {
            .sin_family = AF_INET, .sin_port = htons(other.port), .sin_addr = {htonl(INADDR_LOOPBACK)}};
        /* the peer drops the driver for this client, and accepts again when this client closes */
        TEST_ASSERT_EQUAL_INT(0, connect(extra, (struct sockaddr *)&address, sizeof address));
        size_t wanted = tl_modbus_peer_connections(&other);
        while (wanted < 2 + 2 * (size_t)i) {
            tl_test_pause_ms(1);
            wanted = tl_modbus_peer_connections(&other);
        }
        tl_test_pause_ms(5);
        (void)close(extra);
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.links); /* not reported, because no value was lost */
}

static size_t answered_connection; /* used by the thread of the peer only */

static int answers_once_per_connection(const uint8_t *request, uint8_t *reply) {
    const bool is_first = tl_modbus_peer_connections(&other) != answered_connection;
    answered_connection = tl_modbus_peer_connections(&other);
    return is_first ? sane(request, reply) : HANG_UP;
}

/* No value is lost, and nothing is reported. */
static void test_a_device_that_closes_after_each_answer(void) {
    add(0);
    add(1000);
    answered_connection = 0;
    start_peer(answers_once_per_connection);
    open_driver("127.0.0.1", other.port, 10);
    for (size_t i = 1; i <= 5; i++) {
        tl_probe_poll(&probe);
        TEST_ASSERT_EQUAL_size_t(i, probe.posts[0]);
        TEST_ASSERT_EQUAL_size_t(i, probe.posts[1]);
        tl_probe_expect(&probe, 0, 0, TL_GOOD);
        tl_probe_expect(&probe, 1, 1000, TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    TEST_ASSERT_EQUAL_size_t(10, tl_modbus_peer_connections(&other));
    tl_modbus_peer_stop(&other); /* now it cannot connect again */
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    TEST_ASSERT_FALSE(probe.link_up);
}

/* The peer goes silent in the middle of a poll. */
static void test_a_poll_that_is_half_answered(void) {
    add(0);
    add(1000);
    answers_left = 1;
    start_peer(answers_once);
    open_driver("127.0.0.1", other.port, 0.4);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect_part(&probe, "unit 1|holding|1000|0.4 s");
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, "0.4 s");
    set_answer(sane);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 1, 1000, TL_GOOD);
}

/* ---- exceptions ---- */

static void add_three_units(void) {
    for (uint8_t unit = 1; unit <= 3; unit++) {
        add_of(unit, TL_MODBUS_HOLDING, unit, TL_MODBUS_UINT16);
    }
}

static void test_an_exception_affects_its_own_channels_only(void) {
    add_three_units();
    start_peer(unit_2_fails);
    open_driver("127.0.0.1", other.port, 10);
    for (int i = 0; i < 3; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD);
        tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
        tl_probe_expect(&probe, 2, 3, TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(2, probe.links); /* connected, and one report of the exception */
    tl_probe_expect_part(&probe, "unit 2|holding|Slave device or server failure");
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_connections(&other));
    set_answer(sane);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 1, 2, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(3, probe.links);
    tl_probe_expect_link(&probe, true, "unit 2|holding|again");
}

static void test_an_undefined_exception(void) {
    add_three_units();
    start_peer(unit_2_fails_strangely);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 3, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_connections(&other));
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    tl_probe_expect_part(&probe, "unit 2|holding|exception 80");
}

/* The bytes are received with the exception, because a value was expected. */
static void test_more_than_an_exception(void) {
    add(1);
    start_peer(exception_and_more);
    open_driver("127.0.0.1", other.port, 10);
    for (int i = 0; i < 3; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
        tl_test_pause_ms(5);
    }
    TEST_ASSERT_EQUAL_size_t(3, probe.links); /* connected, the exception, and one report of surplus bytes */
    tl_probe_expect_part(&probe, "gateway");
    TEST_ASSERT_EQUAL_size_t(3, tl_modbus_peer_connections(&other));
    set_answer(sane);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

static void test_a_hole_is_not_read(void) {
    add(0);
    add(3);
    add(10);
    add(11);
    start_peer(has_a_hole);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    const double values[] = {0, 3, 10, 11};
    for (size_t i = 0; i < 4; i++) {
        tl_probe_expect(&probe, i, values[i], TL_GOOD);
    }
    /* one for all, then 0, 3, and 10 with 11 */
    TEST_ASSERT_EQUAL_size_t(4, tl_modbus_peer_requests(&other));
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(7, tl_modbus_peer_requests(&other));
    TEST_ASSERT_EQUAL_size_t(1, probe.links); /* not reported */
}

/* If requests before the first one of a poll are split, the driver still sends all of them. */
static void test_a_hole_behind_the_beginning(void) {
    add(0);
    add(3);
    add(10);
    add_of(2, TL_MODBUS_HOLDING, 0, TL_MODBUS_UINT16);
    start_peer(silent);
    open_driver("127.0.0.1", other.port, 0.4);
    tl_probe_poll(&probe); /* the next poll starts with unit 2 */
    tl_probe_expect_link(&probe, false, "0.4 s");
    set_answer(has_a_hole);
    tl_probe_poll_until(&probe, 3, TL_GOOD);
    tl_probe_expect(&probe, 0, 0, TL_GOOD);
    tl_probe_expect(&probe, 1, 3, TL_GOOD);
    tl_probe_expect(&probe, 2, 10, TL_GOOD);
}

static void test_one_wrong_address_does_not_spoil_its_neighbours(void) {
    add(2);
    add(3);
    add(4); /* is in the hole */
    start_peer(has_a_hole);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 2, TL_GOOD);
    tl_probe_expect(&probe, 1, 3, TL_GOOD);
    tl_probe_expect(&probe, 2, 0, TL_NO_LINK);
    tl_probe_expect_part(&probe, "unit 1|holding|4|Illegal data address|0|40003|2");
}

static void test_a_busy_device_is_asked_again(void) {
    add(1);
    add(1000);
    start_busy_peer(3);
    open_driver_that_pauses(0.02, 60);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 1000, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(5, tl_modbus_peer_requests(&other));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_connections(&other));
    TEST_ASSERT_EQUAL_size_t(1, probe.links); /* connected; not reported */
    tl_probe_poll(&probe);
    tl_modbus_peer_stop(&other);
    TEST_ASSERT_TRUE(shortest_pause >= TL_SECOND / 50); /* also after connecting and between polls */
}

static void test_a_pause_after_each_of_many_connections(void) {
    add(0);
    add(1000);
    start_peer(answers_once_per_connection);
    open_driver_that_pauses(0.01, 0);
    tl_time begin = tl_test_now();
    for (int i = 0; i < 3; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 0, TL_GOOD);
        tl_probe_expect(&probe, 1, 1000, TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(6, tl_modbus_peer_connections(&other));
    TEST_ASSERT_TRUE(tl_test_now() - begin >= 6 * (TL_SECOND / 100));
}

static void test_a_device_that_stays_busy(void) {
    add(1);
    start_busy_peer(1000000);
    open_driver_that_pauses(0.01, 0.1);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_part(&probe, "unit 1|holding|1 to 1|busy");
    TEST_ASSERT_TRUE(probe.link_up);
}

static void test_a_busy_device_without_a_pause(void) {
    add(1);
    start_busy_peer(1);
    open_driver_that_pauses(0, 60);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_requests(&other));
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

static void test_a_failure_at_one_address(void) {
    add(3);
    add(4);
    add(5);
    start_peer(fails_at_4);
    open_driver_that_splits(10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 5, TL_GOOD);
    tl_probe_expect_part(&probe, "unit 1|holding|4 to 4|server failure");
}

static void test_a_failure_at_one_address_is_not_split_by_default(void) {
    add(3);
    add(4);
    start_peer(fails_at_4);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_peer_requests(&other));
}

static void poll_until_both_are_good(size_t a, size_t b) {
    tl_time deadline = tl_test_now() + 60 * TL_SECOND;
    do {
        TEST_ASSERT_TRUE_MESSAGE(tl_test_now() < deadline, probe.link_text);
        tl_probe_poll(&probe);
        tl_test_pause_ms(5);
    } while (probe.newest[a].quality != TL_GOOD || probe.newest[b].quality != TL_GOOD);
}

/* Another request is answered, so that the link stays up. */
static void test_silence_at_one_address(void) {
    add(3);
    add(4);
    add(5);
    add(1000);
    start_peer(is_silent_at_4);
    open_driver_that_splits(0.2);
    poll_until_both_are_good(0, 2);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 5, TL_GOOD);
    set_answer(sane);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 4, TL_GOOD);
}

/* No request is answered as long as the address is in the only one. */
static void test_silence_at_one_address_of_the_only_request(void) {
    add(4);
    add(5);
    add(6);
    start_peer(is_silent_at_4);
    open_driver_that_splits(0.2);
    poll_until_both_are_good(1, 2);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 1, 5, TL_GOOD);
    tl_probe_expect(&probe, 2, 6, TL_GOOD);
}

/* After each value was tried, the driver joins them again. */
static void test_a_device_that_is_silent_for_long(void) {
    add(0);
    add(1);
    start_peer(silent);
    open_driver_that_splits(0.02);
    while (tl_modbus_peer_requests(&other) < 5) {
        tl_probe_poll(&probe);
        tl_test_pause_ms(5);
    }
    static const uint8_t COUNTS[] = {2, 2, 1, 1, 2};
    static const uint8_t ADDRESSES[] = {0, 0, 0, 1, 0};
    for (size_t i = 0; i < 5; i++) {
        TEST_ASSERT_EQUAL_UINT(COUNTS[i], count_of(other.record + 12 * i));
        TEST_ASSERT_EQUAL_UINT(ADDRESSES[i], address_of(other.record + 12 * i));
    }
}

static void test_a_device_that_wants_small_requests(void) {
    add_of(1, TL_MODBUS_INPUT, 0, TL_MODBUS_UINT32);
    add_of(1, TL_MODBUS_INPUT, 2, TL_MODBUS_UINT32);
    /* needs four registers, and a value is never split */
    add_of(1, TL_MODBUS_INPUT, 4, TL_MODBUS_FLOAT64);
    start_peer(is_narrow);
    open_driver("127.0.0.1", other.port, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 0x00020003, TL_GOOD);
    tl_probe_expect(&probe, 2, 0, TL_NO_LINK);
    tl_probe_expect_part(&probe, "unit 1|input|4|7|Illegal data value");
}

/* After an outage the device may be another one, so the driver tries large requests again. */
static void test_a_new_device_gets_the_large_requests(void) {
    add(0);
    add(1);
    add(2);
    start_peer(is_narrow);
    open_driver("127.0.0.1", other.port, 0.4);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 2, 2, TL_GOOD);
    set_answer(silent);
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    size_t before = tl_modbus_peer_requests(&other);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(before + 1, tl_modbus_peer_requests(&other));
}

/* ---- a silent unit behind a gateway ---- */

/* Polls for a second. True if channels `a` and `b` were always good and `c` never, the link was not
 * reported, and the silence delayed few polls. */
static bool is_steady(size_t a, size_t b, size_t c) {
    size_t links_before = probe.links;
    size_t polls = 0;
    bool steady = true;
    tl_time end = tl_test_now() + TL_SECOND;
    for (; tl_test_now() < end; polls++) {
        tl_probe_poll(&probe);
        steady = steady && probe.newest[a].quality == TL_GOOD && probe.newest[b].quality == TL_GOOD;
        TEST_ASSERT_EQUAL_INT(TL_NO_LINK, probe.newest[c].quality);
        tl_test_pause_ms(5);
    }
    return steady && polls >= 20 && probe.link_up && probe.links == links_before;
}

/* On a busy machine the first attempts may fail. */
static void expect_steady(size_t a, size_t b, size_t c) {
    bool steady = false;
    for (int i = 0; i < 20 && !steady; i++) {
        steady = is_steady(a, b, c);
    }
    TEST_ASSERT_TRUE_MESSAGE(steady, probe.link_text);
}

static void test_a_silent_unit_does_not_stop_the_others(void) {
    add_three_units();
    start_peer(unit_2_is_silent);
    open_driver("127.0.0.1", other.port, 0.2);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_poll_until(&probe, 2, TL_GOOD);
    expect_steady(0, 2, 1);
    size_t before = probe.links;
    set_answer(sane);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 2, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(before + 1, probe.links);
    tl_probe_expect_link(&probe, true, "unit 2|holding|again");
}

static void test_silent_units_that_are_asked_first(void) {
    add_three_units();
    add_of(4, TL_MODBUS_HOLDING, 4, TL_MODBUS_UINT16);
    start_peer(units_1_and_3_are_silent);
    open_driver("127.0.0.1", other.port, 0.2);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    tl_probe_poll_until(&probe, 3, TL_GOOD);
    expect_steady(1, 3, 0);
    tl_probe_expect(&probe, 2, 0, TL_NO_LINK);
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_poll_until(&probe, 2, TL_GOOD);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 2, 3, TL_GOOD);
}

/* ---- frames of a line by TCP ---- */

static void open_framed_driver(answer_function *answer, double timeout_s) {
    framed = true;
    start_peer(answer);
    tl_modbus_settings settings = settings_for("127.0.0.1", other.port, timeout_s);
    settings.rtu_framing = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
}

static void add_every_table(void) {
    add_of(1, TL_MODBUS_COIL, 1, TL_MODBUS_BIT);
    add_of(2, TL_MODBUS_DISCRETE, 65535, TL_MODBUS_BIT);
    add_of(3, TL_MODBUS_HOLDING, 1000, TL_MODBUS_UINT16);
    add_of(3, TL_MODBUS_INPUT, 1, TL_MODBUS_UINT32);
    for (unsigned i = 0; i < TL_MODBUS_MAX_REGISTERS; i++) {
        add_of(4, TL_MODBUS_INPUT, i, TL_MODBUS_UINT16);
    }
}

static void test_framed_values(void) {
    add_every_table();
    open_framed_driver(sane, 10);
    for (int i = 0; i < 3; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD);
        tl_probe_expect(&probe, 1, 1, TL_GOOD);
        tl_probe_expect(&probe, 2, 1000, TL_GOOD);
        tl_probe_expect(&probe, 3, 65538, TL_GOOD);
        tl_probe_expect(&probe, 3 + TL_MODBUS_MAX_REGISTERS, TL_MODBUS_MAX_REGISTERS - 1, TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(15, tl_modbus_peer_requests(&other));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_connections(&other));
}

static void test_a_framed_answer_with_a_wrong_sum(void) {
    add(1);
    wrong_sums = 1;
    open_framed_driver(sane, 10);
    tl_probe_poll_down(&probe, 1, "CRC|framing");
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_peer_connections(&other)); /* late bytes are lost with the first one */
}

static void test_framed_silence(void) {
    add(1);
    open_framed_driver(silent, 0.2);
    tl_probe_poll_down(&probe, 1, "0.2 s|framing");
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
}

static void test_half_of_a_framed_answer(void) {
    add(1);
    add(2);
    open_framed_driver(half_a_frame, 0.2);
    tl_probe_poll_down(&probe, 2, "0.2 s");
}

static void test_framed_exceptions(void) {
    add_three_units();
    open_framed_driver(unit_2_fails, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 3, TL_GOOD);
    tl_probe_expect_part(&probe, "unit 2|holding|Slave device or server failure");
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_connections(&other));
}

static void test_a_hole_behind_a_gateway(void) {
    add(3);
    add(10);
    open_framed_driver(has_a_hole, 10);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    tl_probe_expect(&probe, 1, 10, TL_GOOD);
}

static void test_more_than_a_framed_answer(void) {
    add(1);
    open_framed_driver(talkative, 10);
    tl_probe_poll_down(&probe, 1, "CRC"); /* the sum is at the end of all bytes */
}

/* A gateway with the other framing. */
static void test_the_wrong_framing(void) {
    add(1);
    start_peer(silent);
    tl_modbus_settings settings = settings_for("127.0.0.1", other.port, 0.2);
    settings.rtu_framing = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
    tl_probe_poll_down(&probe, 1, "framing");
    tl_modbus_peer_stop(&other);
    TEST_ASSERT_EQUAL_size_t(8, other.recorded);
    tl_modbus_peer_forget(&other); /* no request of Modbus TCP */
}

/* ---- interrupt ---- */

static bool polling; /* atomic */

static void *poll_in_thread(void *context) {
    (void)context;
    tl_modbus_driver.poll(probe.io, &probe.sink);
    __atomic_store_n(&polling, false, __ATOMIC_RELEASE);
    return NULL;
}

/* Interrupts a poll that would wait for a minute. */
static void expect_interruptible(void) {
    pthread_t thread;
    __atomic_store_n(&polling, true, __ATOMIC_RELEASE);
    size_t asked = tl_modbus_peer_requests(&other);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, poll_in_thread, NULL));
    for (int i = 0; i < 100 && tl_modbus_peer_requests(&other) == asked; i++) {
        /* until the driver waits for the answer, or for 100 ms while it connects */
        tl_test_pause_ms(1);
    }
    TEST_ASSERT_TRUE(__atomic_load_n(&polling, __ATOMIC_ACQUIRE));
    tl_time begin = tl_test_now();
    tl_modbus_driver.interrupt(probe.io);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_TRUE(tl_test_now() - begin < 10 * TL_SECOND);
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]); /* nothing is posted or reported */
    TEST_ASSERT_EQUAL_size_t(0, probe.links);
}

static void test_interrupt_while_it_waits_for_an_answer(void) {
    add(1);
    start_peer(silent);
    open_driver("127.0.0.1", other.port, 60);
    expect_interruptible();
    set_answer(sane);
    tl_probe_poll(&probe); /* no longer interrupted, and without a pause */
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(0, probe.downs);
}

static void test_interrupt_during_a_pause(void) {
    add(1);
    start_peer(sane);
    open_driver_that_pauses(60, 60);
    expect_interruptible();
    TEST_ASSERT_EQUAL_size_t(0, tl_modbus_peer_requests(&other));
}

enum { BACKLOG = 16 };

/* Fills the queue of a listener that never accepts, so that the next connection waits. */
static void fill_backlog(int *fillers) {
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(other.port), .sin_addr = {htonl(INADDR_LOOPBACK)}};
    TEST_ASSERT_EQUAL_INT(0, listen(other.listener, 0));
    for (int i = 0; i < BACKLOG; i++) {
        fillers[i] = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
        struct pollfd done = {.fd = fillers[i], .events = POLLOUT};
        TEST_ASSERT_TRUE(fillers[i] >= 0);
        (void)connect(fillers[i], (struct sockaddr *)&address, sizeof address);
        if (poll(&done, 1, 100) == 0) {
            return;
        }
    }
    TEST_IGNORE_MESSAGE("no limit of connections here");
}

static void close_fillers(const int *fillers) {
    for (int i = 0; i < BACKLOG; i++) {
        if (fillers[i] >= 0) {
            (void)close(fillers[i]);
        }
    }
}

static void test_interrupt_while_it_connects(void) {
    int fillers[BACKLOG];
    memset(fillers, -1, sizeof fillers);
    add(1);
    tl_modbus_peer_bind(&other);
    fill_backlog(fillers);
    open_driver("127.0.0.1", other.port, 60);
    expect_interruptible();
    close_fillers(fillers);
}

static void test_connecting_takes_no_longer_than_the_timeout(void) {
    int fillers[BACKLOG];
    memset(fillers, -1, sizeof fillers);
    add(1);
    tl_modbus_peer_bind(&other);
    fill_backlog(fillers);
    open_driver("127.0.0.1", other.port, 0.1);
    tl_time begin = tl_test_now();
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(tl_test_now() - begin >= 100000000);
    TEST_ASSERT_TRUE(tl_test_now() - begin < 10 * TL_SECOND);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, "timed out");
    close_fillers(fillers);
}

static void test_an_interrupt_is_not_lost(void) {
    add(1);
    start_peer(sane);
    open_driver("127.0.0.1", other.port, 10);
    tl_modbus_driver.interrupt(probe.io);
    tl_modbus_driver.interrupt(probe.io);
    tl_probe_poll(&probe); /* this one returns at once */
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_modbus_driver.interrupt(probe.io); /* closes the connection */
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, probe.posts[0]);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[0]);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

static void *interrupt_often(void *context) {
    (void)context;
    while (__atomic_load_n(&polling, __ATOMIC_ACQUIRE)) {
        tl_modbus_driver.interrupt(probe.io);
        tl_test_pause_ms(1);
    }
    return NULL;
}

/* For ThreadSanitizer. The driver works after an interrupt at any point. */
static void test_interrupts_at_any_time(void) {
    pthread_t thread;
    add(1);
    tl_plant_server *device = start_device(0);
    tl_test_set_value(device, 0, 9);
    open_driver("127.0.0.1", tl_plant_server_port(device), 10);
    __atomic_store_n(&polling, true, __ATOMIC_RELEASE);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, interrupt_often, NULL));
    tl_time end = tl_test_now() + TL_SECOND / 5;
    while (tl_test_now() < end) {
        tl_probe_poll(&probe);
    }
    __atomic_store_n(&polling, false, __ATOMIC_RELEASE);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    tl_probe_poll(&probe);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 9, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(0, probe.downs);
    tl_plant_server_stop(device);
}

/* ---- resources and settings ---- */

static void test_descriptors_beyond_those_of_select(void) {
    static int many[FD_SETSIZE];
    struct rlimit before;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &before));
    struct rlimit wanted = before;
    wanted.rlim_cur = (rlim_t)2 * FD_SETSIZE;
    if (wanted.rlim_cur > before.rlim_max || setrlimit(RLIMIT_NOFILE, &wanted) != 0) {
        TEST_IGNORE_MESSAGE("too few descriptors");
    }
    add(1);
    start_peer(sane);
    open_driver("127.0.0.1", other.port, 10);
    size_t count = 0;
    do {
        many[count] = open("/dev/null", O_RDONLY | O_CLOEXEC);
        TEST_ASSERT_TRUE(many[count] >= 0);
        count++;
    } while (many[count - 1] < FD_SETSIZE);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    while (count > 0) {
        count--;
        (void)close(many[count]);
    }
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &before));
}

static void expect_refused(const tl_modbus_settings *settings, const char *parts) {
    tl_plant_io *none = NULL;
    probe.error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_modbus_open(settings, &none, &probe.error));
    TEST_ASSERT_NULL(none);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, probe.error.status);
    TL_EXPECT_PARTS(parts, probe.error.text);
}

static void test_settings_that_are_wrong(void) {
    tl_modbus_settings settings = {.host = "127.0.0.1", .port = 502, .timeout_s = 1};
    settings.host = "";
    expect_refused(&settings, "address");
    settings.host = NULL;
    expect_refused(&settings, "address");
    settings.host = "127.0.0.1";
    settings.timeout_s = 0;
    expect_refused(&settings, "timeout_s|0|0.001|3600");
    settings.timeout_s = (double)NAN;
    expect_refused(&settings, "timeout_s|nan|0.001|3600");
    settings.timeout_s = HUGE_VAL;
    expect_refused(&settings, "timeout_s|inf|0.001|3600");
    settings.timeout_s = 1;
    settings.most_registers = 126;
    expect_refused(&settings, "most_registers|126|1|125");
    settings.most_registers = 0;
    settings.pause_s = -1;
    expect_refused(&settings, "pause_s|-1|0|60");
    settings.pause_s = (double)NAN;
    expect_refused(&settings, "pause_s|nan|0|60");
}

static void test_channels_that_are_wrong(void) {
    const tl_modbus_channel good = {
        .unit_id = 1, .table = TL_MODBUS_HOLDING, .address = 0, .type = TL_MODBUS_INT16, .scale = 1};
    tl_modbus_channel pair[2] = {good, good};
    const tl_modbus_settings settings = {
        .host = "127.0.0.1", .port = 502, .timeout_s = 1, .channels = pair, .channel_count = 2};
    pair[1].table = (tl_modbus_table)5;
    expect_refused(&settings, "channel 1|table|5");
    pair[1].table = (tl_modbus_table)0;
    expect_refused(&settings, "channel 1|table|0");
    pair[1].table = TL_MODBUS_COIL;
    expect_refused(&settings, "channel 1|coils|bits");
    pair[1] = good;
    pair[1].type = TL_MODBUS_BIT;
    expect_refused(&settings, "channel 1|registers|bits");
    pair[1] = good;
    pair[1].unit_id = 248;
    expect_refused(&settings, "channel 1|248|247|255");
    pair[1] = good;
    pair[1].type = TL_MODBUS_FLOAT64;
    pair[1].address = 65533;
    expect_refused(&settings, "channel 1|65535");
    pair[1] = good;
    pair[1].bit = 1;
    expect_refused(&settings, "channel 1|bit is 1|at most 0");
    pair[1].type = TL_MODBUS_REGISTER_BIT;
    pair[1].bit = 16;
    expect_refused(&settings, "channel 1|bit is 16|at most 15");
    pair[1].type = TL_MODBUS_UINT8;
    pair[1].bit = 9;
    expect_refused(&settings, "channel 1|bit is 9|at most 8");
    pair[1] = good;
    pair[1].scale = 0;
    expect_refused(&settings, "channel 1|scale");
    pair[1].scale = HUGE_VAL;
    expect_refused(&settings, "channel 1|scale");
    pair[1] = good;
    pair[1].offset = (double)NAN;
    expect_refused(&settings, "channel 1|offset");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_every_type_order_and_table);
    RUN_TEST(test_more_than_one_request_holds);
    RUN_TEST(test_a_float_that_is_no_number);
    RUN_TEST(test_a_value_that_is_not_available);
    RUN_TEST(test_the_request_as_it_is_written);
    RUN_TEST(test_no_channels);
    RUN_TEST(test_an_absent_server_that_comes);
    RUN_TEST(test_a_server_that_dies_and_returns);
    RUN_TEST(test_attempts_are_paused);
    RUN_TEST(test_pauses_are_reset_by_an_answer);
    RUN_TEST(test_a_name);
    RUN_TEST(test_an_unknown_name);
    RUN_TEST(test_silence);
    RUN_TEST(test_silence_later);
    RUN_TEST(test_half_a_frame);
    RUN_TEST(test_hanging_up);
    RUN_TEST(test_garbage);
    RUN_TEST(test_garbage_later);
    RUN_TEST(test_another_transaction);
    RUN_TEST(test_a_device_that_always_sends_the_same_transaction);
    RUN_TEST(test_late_answers_with_the_same_transaction);
    RUN_TEST(test_another_function);
    RUN_TEST(test_too_few_values);
    RUN_TEST(test_an_answer_that_trickles);
    RUN_TEST(test_more_than_was_asked_for);
    RUN_TEST(test_a_connection_that_was_closed_between_polls);
    RUN_TEST(test_a_device_that_closes_after_each_answer);
    RUN_TEST(test_a_poll_that_is_half_answered);
    RUN_TEST(test_an_exception_affects_its_own_channels_only);
    RUN_TEST(test_an_undefined_exception);
    RUN_TEST(test_more_than_an_exception);
    RUN_TEST(test_a_hole_is_not_read);
    RUN_TEST(test_a_hole_behind_the_beginning);
    RUN_TEST(test_one_wrong_address_does_not_spoil_its_neighbours);
    RUN_TEST(test_a_busy_device_is_asked_again);
    RUN_TEST(test_a_pause_after_each_of_many_connections);
    RUN_TEST(test_a_device_that_stays_busy);
    RUN_TEST(test_a_busy_device_without_a_pause);
    RUN_TEST(test_a_failure_at_one_address);
    RUN_TEST(test_a_failure_at_one_address_is_not_split_by_default);
    RUN_TEST(test_silence_at_one_address);
    RUN_TEST(test_silence_at_one_address_of_the_only_request);
    RUN_TEST(test_a_device_that_is_silent_for_long);
    RUN_TEST(test_a_device_that_wants_small_requests);
    RUN_TEST(test_a_new_device_gets_the_large_requests);
    RUN_TEST(test_a_silent_unit_does_not_stop_the_others);
    RUN_TEST(test_silent_units_that_are_asked_first);
    RUN_TEST(test_framed_values);
    RUN_TEST(test_a_framed_answer_with_a_wrong_sum);
    RUN_TEST(test_framed_silence);
    RUN_TEST(test_half_of_a_framed_answer);
    RUN_TEST(test_framed_exceptions);
    RUN_TEST(test_a_hole_behind_a_gateway);
    RUN_TEST(test_more_than_a_framed_answer);
    RUN_TEST(test_the_wrong_framing);
    RUN_TEST(test_interrupt_while_it_waits_for_an_answer);
    RUN_TEST(test_interrupt_during_a_pause);
    RUN_TEST(test_interrupt_while_it_connects);
    RUN_TEST(test_connecting_takes_no_longer_than_the_timeout);
    RUN_TEST(test_an_interrupt_is_not_lost);
    RUN_TEST(test_interrupts_at_any_time);
    RUN_TEST(test_descriptors_beyond_those_of_select);
    RUN_TEST(test_settings_that_are_wrong);
    RUN_TEST(test_channels_that_are_wrong);
    return UNITY_END();
}
