/* The Modbus driver with a TCP server that sends wrong answers: each field is forged, for each
 * function that reads.
 *
 * The driver posts no value of a wrong answer and reports the error once. It never takes a late or
 * second answer for the answer to a later request. tearDown() checks that the driver sent read
 * requests only.
 */
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <modbus.h>
#include <unity.h>

#include "board/modbus/modbus.h"
#include "tests/support/driver_probe.h"
#include "tests/support/message.h"
#include "tests/support/modbus_peer.h"
#include "tests/support/real_time.h"

enum { REQUEST = 12, FRAME = 1024, VALUES = 5, CHANNELS = 3 * VALUES };

/* ---- the server ---- */

/* Changes a right answer of `size` bytes; returns the new size. Runs in the thread of the
 * server. */
typedef size_t lie_function(const uint8_t *request, uint8_t *answer, size_t size);

static tl_modbus_peer server = TL_MODBUS_PEER;

/* How the server answers; guarded by its lock. */
static struct {
    lie_function *lie;
    size_t piece;  /* bytes per send(); 0: all */
    long pause_ms; /* between them */
} manner;

static bool is_of_bits(unsigned function) {
    return function <= TL_MODBUS_DISCRETE;
}

/* A register holds its address + 1, so that no value is 0; a bit is 1. */
static size_t right_answer(const uint8_t *request, uint8_t *answer) {
    unsigned address = (unsigned)request[8] * 256 + request[9];
    unsigned count = (unsigned)request[10] * 256 + request[11];
    unsigned bytes = is_of_bits(request[7]) ? (count + 7) / 8 : 2 * count;
    memset(answer, 0xFF, FRAME);
    memcpy(answer, request, 8);
    answer[4] = 0;
    answer[5] = (uint8_t)(3 + bytes);
    answer[8] = (uint8_t)bytes;
    for (unsigned i = 0; i < count && !is_of_bits(request[7]); i++) {
        answer[9 + 2 * i] = (uint8_t)((address + i + 1) / 256);
        answer[10 + 2 * i] = (uint8_t)((address + i + 1) % 256);
    }
    return 9 + bytes;
}

static bool send_all(int client, const uint8_t *bytes, size_t size, size_t piece, long pause) {
    bool sent = true;
    for (size_t at = 0; sent && at < size; at += piece) {
        size_t some = size - at < piece ? size - at : piece;
        sent = send(client, bytes + at, some, MSG_NOSIGNAL) == (ssize_t)some;
        if (pause > 0) {
            tl_test_pause_ms(pause);
        }
    }
    return sent;
}

/* false: close the connection. */
static bool serve(int client) {
    uint8_t request[REQUEST];
    uint8_t answer[FRAME];
    if (recv(client, request, sizeof request, MSG_WAITALL) != (ssize_t)sizeof request) {
        return false;
    }
    (void)pthread_mutex_lock(&server.lock);
    tl_modbus_peer_note(&server, request, REQUEST);
    lie_function *lie = manner.lie;
    size_t piece = manner.piece > 0 ? manner.piece : FRAME;
    long pause = manner.pause_ms;
    (void)pthread_mutex_unlock(&server.lock);
    size_t size = right_answer(request, answer);
    return send_all(client, answer, lie(request, answer, size), piece, pause);
}

static void set_lie(lie_function *lie) {
    (void)pthread_mutex_lock(&server.lock);
    manner.lie = lie;
    (void)pthread_mutex_unlock(&server.lock);
}

/* ---- lies ---- */

static size_t truth(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    (void)answer;
    return size;
}

/* The present lie: bytes `at` to `at + count - 1` of the answer become `number`. Set while the
 * server waits. */
static struct {
    size_t at;
    size_t count;
    unsigned number;
} forged;

static size_t forge(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    for (size_t i = 0; i < forged.count; i++) {
        answer[forged.at + i] = (uint8_t)(forged.number >> 8 * (forged.count - 1 - i));
    }
    return size;
}

static void set_forged(size_t at, size_t count, unsigned number) {
    (void)pthread_mutex_lock(&server.lock);
    forged.at = at;
    forged.count = count;
    forged.number = number;
    manner.lie = forge;
    (void)pthread_mutex_unlock(&server.lock);
}

/* A consistent answer, but with another number of values. */
static size_t shaped(uint8_t *answer, size_t bytes) {
    answer[4] = 0;
    answer[5] = (uint8_t)(3 + bytes);
    answer[8] = (uint8_t)bytes;
    return 9 + bytes;
}

static size_t more_values(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    return shaped(answer, size - 9 + 2);
}

static size_t fewer_values(const uint8_t *request, uint8_t *answer, size_t size) {
    return shaped(answer, is_of_bits(request[7]) ? 0 : size - 9 - 2);
}

static size_t as_many_as_there_can_be(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    (void)size;
    return shaped(answer, 251);
}

static unsigned exception_code;

static size_t exception(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)size;
    answer[5] = 3;
    answer[7] = (uint8_t)(request[7] | 0x80U);
    answer[8] = (uint8_t)exception_code;
    return 9;
}

static size_t another_exception_each_time(const uint8_t *request, uint8_t *answer, size_t size) {
    exception_code = (exception_code + 1) % 256;
    return exception(request, answer, size);
}

static size_t long_exception(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)exception(request, answer, size);
    answer[5] = 4;
    return 10;
}

static size_t exception_of_another_function(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)exception(request, answer, size);
    answer[7] = 0x90;
    return 9;
}

/* Ends with the header. */
static size_t bare_header(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    (void)size;
    answer[5] = 1;
    return 7;
}

static size_t unit_and_function(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    (void)size;
    answer[5] = 2;
    return 8;
}

static size_t trailing_bytes(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    memset(answer + size, 0xEE, 7);
    return size + 7;
}

/* A second answer follows, as if to the next request, with other values. */
static size_t two_answers(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    memcpy(answer + size, answer, size);
    answer[size + 1]++;
    memset(answer + size + 9, 0xAA, size - 9);
    return 2 * size;
}

static size_t two_answers_but_refuses_large_requests(const uint8_t *request, uint8_t *answer, size_t size) {
    if (request[11] > 1) {
        exception_code = 3;
        size = exception(request, answer, size);
    }
    return two_answers(request, answer, size);
}

/* Always the right answer to the request before. */
static size_t one_behind(const uint8_t *request, uint8_t *answer, size_t size) {
    static uint8_t last[FRAME];
    static size_t last_size;
    uint8_t own[FRAME];
    size_t answered = last_size;
    (void)request;
    memcpy(own, answer, size);
    memcpy(answer, last, last_size);
    memcpy(last, own, size);
    last_size = size;
    return answered;
}

/* Unit 2 answers with another unit id each time. */
static size_t unit_2_has_a_wrong_unit_id(const uint8_t *request, uint8_t *answer, size_t size) {
    static uint8_t count;
    if (request[6] == 2) {
        count = (uint8_t)(count % 200 + 1);
        answer[6] = (uint8_t)(2 + count);
    }
    return size;
}

static size_t half(const uint8_t *request, uint8_t *answer, size_t size) {
    (void)request;
    (void)answer;
    return size / 2;
}

/* ---- the driver under test ---- */

static tl_driver_probe probe;
static tl_modbus_channel channels[CHANNELS];
static size_t channel_count;
static size_t good_ones;
static size_t surplus_reports; /* reports that the server sends too many bytes */

static void on_post(void *context, size_t channel, const tl_reading *reading) {
    tl_probe_post(context, channel, reading);
    good_ones += reading->quality == TL_GOOD ? 1 : 0;
}

static void on_link(void *context, bool up, const char *text) {
    tl_probe_link(context, up, text);
    surplus_reports += tl_test_has_parts(text, "gateway") ? 1 : 0;
}

static void close_driver(void) {
    tl_probe_end(&probe);
    tl_probe_forget(&probe);
    channel_count = 0;
    surplus_reports = 0;
    good_ones = 0;
}

static void add_of(uint8_t unit_id, unsigned function, unsigned address) {
    channels[channel_count] = (tl_modbus_channel){.unit_id = unit_id,
                                                  .table = (tl_modbus_table)function,
                                                  .address = (uint16_t)address,
                                                  .type = is_of_bits(function) ? TL_MODBUS_BIT : TL_MODBUS_UINT16,
                                                  .scale = 1};
    channel_count++;
}

static double value_of(size_t channel) {
    return is_of_bits((unsigned)channels[channel].table) ? 1 : channels[channel].address + 1.0;
}

static void open_with(double timeout_s, bool any_unit_id) {
    const tl_modbus_settings settings = {.host = "127.0.0.1",
                                         .port = server.port,
                                         .any_unit_id = any_unit_id,
                                         .timeout_s = timeout_s,
                                         .channels = channels,
                                         .channel_count = channel_count};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
}

/* One request, for VALUES values of a table of unit 1. */
static void open_for(unsigned function, double timeout_s, bool any_unit_id) {
    close_driver();
    for (unsigned i = 0; i < VALUES; i++) {
        add_of(1, function, 300 + i);
    }
    open_with(timeout_s, any_unit_id);
}

static void expect_values(void) {
    for (size_t i = 0; i < channel_count; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_GOOD, probe.newest[i].quality, probe.link_text);
        TEST_ASSERT_EQUAL_DOUBLE(value_of(i), probe.newest[i].value);
    }
}

static void expect_text(const char *parts) {
    TL_EXPECT_PARTS(parts, probe.link_text);
}

/* The poll posts no values and reports the link as down, with these parts. */
static void expect_disbelief(unsigned function, const char *parts) {
    open_for(function, 10, false);
    tl_probe_poll(&probe);
    for (size_t i = 0; i < channel_count; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_NO_LINK, probe.newest[i].quality, parts);
        TEST_ASSERT_EQUAL_DOUBLE(0, probe.newest[i].value);
        TEST_ASSERT_EQUAL_size_t(1, probe.posts[i]);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    TEST_ASSERT_FALSE(probe.link_up);
    expect_text(parts);
}

static void expect_disbelief_of_all(const char *parts) {
    for (unsigned function = 1; function <= 4; function++) {
        expect_disbelief(function, parts);
    }
}

void setUp(void) {
    manner.lie = truth;
    manner.piece = 0;
    manner.pause_ms = 0;
    tl_modbus_peer_forget(&server);
    tl_probe_begin(&probe, &tl_modbus_driver);
    probe.sink.post = on_post;
    probe.sink.link = on_link;
    close_driver();
    tl_modbus_peer_listen(&server, serve);
}

/* The driver sent only whole requests of functions 1 to 4. */
static void expect_only_reads_on_the_wire(void) {
    for (size_t at = 0; at < server.recorded; at += REQUEST) {
        static const uint8_t HEAD[] = {0, 0, 0, 6};
        TEST_ASSERT_EQUAL_HEX8_ARRAY(HEAD, server.record + at + 2, sizeof HEAD);
        TEST_ASSERT_TRUE(server.record[at + 7] >= 1 && server.record[at + 7] <= 4);
    }
}

void tearDown(void) {
    close_driver();
    tl_modbus_peer_stop(&server);
    expect_only_reads_on_the_wire();
}

/* ---- each field of an answer ---- */

static void test_the_truth_is_believed(void) {
    for (unsigned function = 1; function <= 4; function++) {
        open_for(function, 10, false);
        tl_probe_poll(&probe);
        tl_probe_poll(&probe);
        expect_values();
        TEST_ASSERT_EQUAL_size_t(1, probe.links);
    }
    TEST_ASSERT_EQUAL_size_t(4, tl_modbus_peer_connections(&server));
}

static void test_another_transaction(void) {
    set_forged(0, 2, 0);
    expect_disbelief_of_all("transaction|0|1");
    set_forged(0, 2, 2); /* that of the next request */
    expect_disbelief_of_all("transaction|2|1");
}

static void test_another_protocol(void) {
    set_forged(2, 2, 1);
    expect_disbelief_of_all("protocol|1|0");
    set_forged(2, 2, 0x0100);
    expect_disbelief_of_all("protocol|256|0");
    set_forged(2, 2, 0xFFFF);
    expect_disbelief_of_all("protocol|65535|0");
}

static void test_another_length(void) {
    static const unsigned LENGTHS[] = {0, 1, 2, 3, 255, 256 + 4, 65535};
    for (size_t i = 0; i < sizeof LENGTHS / sizeof LENGTHS[0]; i++) {
        char why[64];
        set_forged(4, 2, LENGTHS[i]);
        (void)snprintf(why, sizeof why, "length|%u|4", LENGTHS[i]);
        expect_disbelief(1, why);
        expect_disbelief(2, why);
        (void)snprintf(why, sizeof why, "length|%u|13", LENGTHS[i]);
        expect_disbelief(3, why);
        expect_disbelief(4, why);
    }
    set_forged(4, 2, 14);
    expect_disbelief(3, "length|14|13");
    set_forged(4, 2, 12);
    expect_disbelief(4, "length|12|13");
}

static void test_an_answer_that_ends_early(void) {
    set_lie(bare_header);
    expect_disbelief(3, "length|1|13");
    set_lie(unit_and_function);
    expect_disbelief(3, "length|2|13");
}

static void test_another_unit(void) {
    set_forged(6, 1, 7);
    expect_disbelief_of_all("unit|7|1|\"any_unit_id\": true");
    set_forged(6, 1, 0);
    expect_disbelief_of_all("unit|0|1|any_unit_id");
    set_forged(6, 1, 255);
    expect_disbelief_of_all("unit|255|1|any_unit_id");
}

static void test_another_function(void) {
    for (unsigned function = 1; function <= 4; function++) {
        static const unsigned OTHERS[] = {0, 5, 16, 0x2B, 0x80, 0x90, 255};
        char why[64];
        set_forged(7, 1, function ^ 1U);
        (void)snprintf(why, sizeof why, "function|%u|%u", function ^ 1U, function);
        expect_disbelief(function, why);
        set_forged(7, 1, function ^ 7U);
        (void)snprintf(why, sizeof why, "function|%u|%u", function ^ 7U, function);
        expect_disbelief(function, why);
        for (size_t i = 0; i < sizeof OTHERS / sizeof OTHERS[0]; i++) {
            set_forged(7, 1, OTHERS[i]);
            (void)snprintf(why, sizeof why, "function|%u|%u", OTHERS[i], function);
            expect_disbelief(function, why);
        }
    }
}

static void test_another_number_of_bytes(void) {
    static const unsigned NUMBERS[] = {0, 9, 11, 250, 255};
    for (size_t i = 0; i < sizeof NUMBERS / sizeof NUMBERS[0]; i++) {
        char why[64];
        set_forged(8, 1, NUMBERS[i]);
        (void)snprintf(why, sizeof why, "bytes|%u|1", NUMBERS[i]);
        expect_disbelief(1, why);
        expect_disbelief(2, why);
        (void)snprintf(why, sizeof why, "bytes|%u|10", NUMBERS[i]);
        expect_disbelief(3, why);
        expect_disbelief(4, why);
    }
}

static void test_another_number_of_values(void) {
    set_lie(more_values);
    expect_disbelief(1, "bytes|3|1");
    expect_disbelief(2, "bytes|3|1");
    expect_disbelief(3, "bytes|12|10");
    expect_disbelief(4, "bytes|12|10");
    set_lie(fewer_values);
    expect_disbelief(1, "bytes|0|1");
    expect_disbelief(4, "bytes|8|10");
    set_lie(as_many_as_there_can_be);
    for (unsigned function = 1; function <= 4; function++) {
        expect_disbelief(function, is_of_bits(function) ? "bytes|251|1" : "bytes|251|10");
    }
}

/* ---- exceptions ---- */

/* The text of the library for an exception that Modbus defines, the number for any other. */
static void expect_exception(unsigned code) {
    bool defined = (code >= 1 && code <= 8) || code == 10 || code == 11;
    char number[32];
    (void)snprintf(number, sizeof number, "exception %u", code);
    expect_text("304");
    expect_text(defined ? modbus_strerror(MODBUS_ENOBASE + (int)code) : number);
}

/* Each exception has a text and affects its own channels only. */
static void test_every_exception(void) {
    for (unsigned code = 0; code <= 255; code++) {
        exception_code = code;
        set_lie(exception);
        open_for(1 + code % 4, 10, false);
        tl_probe_poll(&probe);
        for (size_t i = 0; i < channel_count; i++) {
            TEST_ASSERT_EQUAL_INT(TL_NO_LINK, probe.newest[i].quality);
        }
        TEST_ASSERT_TRUE_MESSAGE(probe.link_up && probe.part_failures > 0, probe.link_text);
        TEST_ASSERT_NULL_MESSAGE(strstr(probe.link_text, "nknown"), probe.link_text);
        expect_exception(code);
        set_lie(truth);
        tl_probe_poll(&probe);
        expect_values();
        expect_text("304|again");
    }
}

static void test_the_exception_0(void) {
    exception_code = 0;
    set_lie(exception);
    for (unsigned function = 1; function <= 4; function++) {
        open_for(function, 10, false);
        tl_probe_poll(&probe);
        tl_probe_poll(&probe);
        TEST_ASSERT_EQUAL_size_t(0, good_ones);
        TEST_ASSERT_TRUE(probe.link_up);
        TEST_ASSERT_EQUAL_size_t(2, probe.links); /* connected, and one report of the exception */
        expect_text("300|304|exception 0");
    }
}

static void test_another_exception_each_time(void) {
    exception_code = 3;
    set_lie(another_exception_each_time);
    close_driver();
    add_of(1, TL_MODBUS_INPUT, 300);
    open_with(10, false);
    for (int i = 0; i < 300; i++) {
        tl_probe_poll(&probe);
    }
    TEST_ASSERT_EQUAL_size_t(0, good_ones);
    TEST_ASSERT_EQUAL_size_t(2, probe.links); /* connected, and the first one */
    expect_text("300|Slave device or server failure");
}

static void test_exceptions_that_are_wrong(void) {
    exception_code = 4;
    set_lie(long_exception);
    expect_disbelief_of_all("length|4|3");
    set_lie(exception_of_another_function);
    expect_disbelief(3, "function|144|3");
}

/* ---- slow and incomplete answers ---- */

static void test_an_answer_in_single_bytes(void) {
    manner.piece = 1;
    manner.pause_ms = 1;
    for (unsigned function = 1; function <= 4; function++) {
        open_for(function, 10, false);
        tl_probe_poll(&probe);
        expect_values();
    }
}

static void test_an_answer_that_trickles_within_the_timeout(void) {
    manner.piece = 1;
    manner.pause_ms = 20; /* 19 bytes: 0.4 s */
    open_for(TL_MODBUS_HOLDING, 10, false);
    tl_probe_poll(&probe);
    expect_values();
}

/* Each byte follows soon, but the whole answer is too late. */
static void test_an_answer_that_trickles_beyond_the_timeout(void) {
    manner.piece = 1;
    manner.pause_ms = 20;
    open_for(TL_MODBUS_HOLDING, 0.1, false);
    tl_time begun = tl_test_now();
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(tl_test_now() - begun >= TL_SECOND / 10);
    TEST_ASSERT_TRUE(tl_test_now() - begun < 10 * TL_SECOND);
    TEST_ASSERT_EQUAL_size_t(0, good_ones);
    expect_text("0.1 s");
}

static void test_half_an_answer(void) {
    set_lie(half);
    open_for(TL_MODBUS_INPUT, 0.1, false);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(0, good_ones);
    expect_text("0.1 s");
}

static void test_half_an_answer_can_be_interrupted(void) {
    set_lie(half);
    open_for(TL_MODBUS_INPUT, 60, false);
    tl_time begun = tl_test_now();
    pthread_t thread = tl_probe_interrupt_after(&probe, 100);
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(tl_test_now() - begun < 10 * TL_SECOND);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]); /* nothing is posted or reported */
    TEST_ASSERT_EQUAL_size_t(0, probe.links);
    set_lie(truth);
    tl_probe_poll(&probe);
    expect_values(); /* without the bytes of the half answer */
}

/* ---- surplus bytes ---- */

/* Several requests per poll: all values are right in each, and the surplus is reported once. */
static void expect_right_and_reported_once(lie_function *lie) {
    set_lie(lie);
    close_driver();
    for (unsigned function = 1; function <= 4; function++) {
        add_of(1, function, 20);
        add_of(1, function, 600);
        add_of(2, function, 20);
    }
    open_with(10, false);
    for (int i = 0; i < 50; i++) {
        tl_probe_poll(&probe);
        expect_values();
    }
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    TEST_ASSERT_TRUE(probe.link_up);
    TEST_ASSERT_EQUAL_size_t(1, surplus_reports);
    TEST_ASSERT_EQUAL_size_t(50 * 12, good_ones);
}

static void test_trailing_bytes(void) {
    expect_right_and_reported_once(trailing_bytes);
}

static void test_two_answers_at_once(void) {
    expect_right_and_reported_once(two_answers);
}

/* The second answer arrives while the driver splits the request. */
static void test_two_answers_to_a_request_that_is_split(void) {
    set_lie(two_answers_but_refuses_large_requests);
    open_for(TL_MODBUS_HOLDING, 10, false);
    tl_probe_poll(&probe);
    expect_values();
    TEST_ASSERT_EQUAL_size_t(1, surplus_reports);
}

/* The driver reports surplus bytes again after an outage. */
static void test_surplus_bytes_are_reported_again(void) {
    set_lie(trailing_bytes);
    open_for(TL_MODBUS_COIL, 0.2, false);
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    expect_text("gateway");
    set_lie(half);
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    set_lie(trailing_bytes);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    expect_text("connected");
    tl_probe_poll(&probe);
    expect_text("gateway");
}

static void test_answers_that_are_one_behind(void) {
    set_lie(one_behind);
    close_driver();
    add_of(1, TL_MODBUS_HOLDING, 20);
    add_of(1, TL_MODBUS_HOLDING, 600);
    open_with(0.05, false);
    for (tl_time end = tl_test_now() + TL_SECOND; tl_test_now() < end; tl_test_pause_ms(5)) {
        tl_probe_poll(&probe);
    }
    TEST_ASSERT_EQUAL_size_t(0, good_ones);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

static void test_each_request_has_another_number(void) {
    open_for(TL_MODBUS_HOLDING, 10, false);
    for (unsigned i = 1; i <= 300; i++) {
        tl_probe_poll(&probe);
        const uint8_t *request = server.record + (size_t)(i - 1) * REQUEST;
        TEST_ASSERT_EQUAL_UINT(i, (unsigned)request[0] * 256 + request[1]);
    }
    expect_values();
}

/* ---- units ---- */

/* Only channels of unit 2 are lost, with one report, although the wrong unit id differs each
 * time. */
static void test_one_unit_with_a_wrong_unit_id(void) {
    set_lie(unit_2_has_a_wrong_unit_id);
    close_driver();
    for (uint8_t unit = 1; unit <= 3; unit++) {
        add_of(unit, TL_MODBUS_HOLDING, unit);
    }
    open_with(10, false);
    for (tl_time end = tl_test_now() + TL_SECOND; tl_test_now() < end; tl_test_pause_ms(5)) {
        tl_probe_poll(&probe);
        TEST_ASSERT_EQUAL_INT(TL_NO_LINK, probe.newest[1].quality);
    }
    TEST_ASSERT_EQUAL_INT(TL_GOOD, probe.newest[0].quality);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, probe.newest[2].quality);
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    TEST_ASSERT_TRUE(probe.link_up);
    expect_text("unit 2|holding|any_unit_id");
    TEST_ASSERT_TRUE(tl_modbus_peer_connections(&server) < 20); /* pauses of 0.1, 0.2, 0.4 s */
    set_lie(truth);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    expect_values();
    expect_text("unit 2|holding|again");
}

static void test_any_unit_id(void) {
    static const unsigned UNITS[] = {0, 1, 7, 255};
    for (size_t i = 0; i < sizeof UNITS / sizeof UNITS[0]; i++) {
        for (unsigned function = 1; function <= 4; function++) {
            set_forged(6, 1, UNITS[i]);
            open_for(function, 10, true);
            tl_probe_poll(&probe);
            tl_probe_poll(&probe);
            expect_values();
            TEST_ASSERT_EQUAL_size_t(1, probe.links);
        }
    }
}

/* any_unit_id accepts no other error. */
static void test_any_unit_id_and_nothing_else(void) {
    static const size_t PLACES[] = {0, 1, 2, 3, 4, 5, 7, 8};
    for (size_t i = 0; i < sizeof PLACES / sizeof PLACES[0]; i++) {
        set_forged(PLACES[i], 1, 0x55);
        open_for(TL_MODBUS_INPUT, 10, true);
        tl_probe_poll(&probe);
        TEST_ASSERT_EQUAL_size_t(0, good_ones);
        TEST_ASSERT_FALSE(probe.link_up);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_truth_is_believed);
    RUN_TEST(test_another_transaction);
    RUN_TEST(test_another_protocol);
    RUN_TEST(test_another_length);
    RUN_TEST(test_an_answer_that_ends_early);
    RUN_TEST(test_another_unit);
    RUN_TEST(test_another_function);
    RUN_TEST(test_another_number_of_bytes);
    RUN_TEST(test_another_number_of_values);
    RUN_TEST(test_every_exception);
    RUN_TEST(test_the_exception_0);
    RUN_TEST(test_another_exception_each_time);
    RUN_TEST(test_exceptions_that_are_wrong);
    RUN_TEST(test_an_answer_in_single_bytes);
    RUN_TEST(test_an_answer_that_trickles_within_the_timeout);
    RUN_TEST(test_an_answer_that_trickles_beyond_the_timeout);
    RUN_TEST(test_half_an_answer);
    RUN_TEST(test_half_an_answer_can_be_interrupted);
    RUN_TEST(test_trailing_bytes);
    RUN_TEST(test_two_answers_at_once);
    RUN_TEST(test_two_answers_to_a_request_that_is_split);
    RUN_TEST(test_surplus_bytes_are_reported_again);
    RUN_TEST(test_answers_that_are_one_behind);
    RUN_TEST(test_each_request_has_another_number);
    RUN_TEST(test_one_unit_with_a_wrong_unit_id);
    RUN_TEST(test_any_unit_id);
    RUN_TEST(test_any_unit_id_and_nothing_else);
    return UNITY_END();
}
