/* Fuzzes the answers of a Modbus device: through the checks of an answer, the driver, its map of
 * requests, and its codec.
 *
 * The harness replaces modbus_link.c, modbus_tcp.c, modbus_rtu.c, the clock and the wake-up call:
 * answers are bytes of the input, and the input moves the clock. So nothing waits, and the same
 * bytes have the same effect. An input is channels, then the events of each poll: see
 * read_channels(), answer_tcp(), happen().
 */
#include <errno.h>
#include <math.h>
#include <string.h>

#include "board/io/monotonic.h"
#include "board/modbus/modbus.h"
#include "board/modbus/modbus_link.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { CHANNELS = 12, POLLS = 64, HEADER = 9 };
enum { BAD_CHECK_SUM = 112345690 }; /* EMBBADCRC of libmodbus, whose header belongs to board/ */

/* ---- the input ---- */

static tl_modbus_channel channels[CHANNELS];
static size_t channel_count;
static bool any_unit_id;
static bool on_a_line;
static bool split_failed;
static bool framed; /* frames of a line by TCP */

/* Reads channels of 4 bytes each: unit, table and order; type and scale; address. */
static void read_channels(void) {
    static const double SCALES[] = {1, 0.1, -3, 1e300};
    unsigned head = tl_fuzz_take();
    on_a_line = (head & 0x80) != 0;
    any_unit_id = (head & 0x40) != 0;
    split_failed = (head & 0x20) != 0;
    framed = !on_a_line && (head & 0x10) != 0;
    channel_count = 1 + head % CHANNELS;
    for (size_t i = 0; i < channel_count; i++) {
        unsigned where = tl_fuzz_take();
        unsigned what = tl_fuzz_take();
        unsigned address = tl_fuzz_take() << 8;
        channels[i] = (tl_modbus_channel){.unit_id = (uint8_t)(where % 4),
                                          .table = (tl_modbus_table)(where / 4 % 8),
                                          .words_little = (where & 0x40) != 0,
                                          .bytes_little = (where & 0x80) != 0,
                                          .type = (tl_modbus_type)(what % 16 % 14),
                                          .bit = what % 16 % 14 == TL_MODBUS_REGISTER_BIT ? 11 : 0,
                                          .scale = SCALES[what / 16 % 4],
                                          .offset = what >> 6,
                                          .address = (uint16_t)(address | tl_fuzz_take())};
    }
}

/* ---- the link ---- */

static tl_modbus_link bytes_link;
static tl_time clock_now;
static uint16_t transaction;
static bool woken;     /* the driver has not noticed it yet */
static bool disturbed; /* in this poll */
static tl_modbus_outcome last;

static void be_called(bool really) {
    woken = woken || really;
    disturbed = disturbed || woken;
}

/* Makes a valid answer with any values. Returns its size. */
static size_t right_answer(const uint8_t request[TL_MODBUS_TCP_REQUEST], uint8_t *answer) {
    unsigned count = (unsigned)request[10] << 8 | request[11];
    unsigned bytes = request[7] <= 2 ? (count + 7) / 8 : 2 * count;
    memcpy(answer, request, 8);
    answer[4] = 0;
    answer[5] = (uint8_t)(bytes + 3);
    answer[8] = (uint8_t)bytes;
    for (unsigned i = 0; i < bytes; i++) {
        answer[HEADER + i] = (uint8_t)tl_fuzz_take();
    }
    return HEADER + bytes;
}

/* Makes an answer: any bytes, or a valid answer or exception with some changes. Returns its
 * size. */
static size_t some_answer(const uint8_t request[TL_MODBUS_TCP_REQUEST], uint8_t *answer) {
    unsigned how = tl_fuzz_take();
    if ((how & 1) != 0) {
        size_t size = tl_fuzz_take();
        for (size_t i = 0; i < size; i++) {
            answer[i] = (uint8_t)tl_fuzz_take();
        }
        return size;
    }
    size_t size = right_answer(request, answer);
    if ((how & 2) != 0) { /* an exception */
        answer[5] = 3;
        answer[7] = (uint8_t)(request[7] | 0x80U);
        answer[8] = (uint8_t)tl_fuzz_take();
        size = HEADER;
    }
    for (unsigned i = 0; i < how / 4 % 4; i++) {
        answer[tl_fuzz_take() % size] ^= (uint8_t)tl_fuzz_take();
    }
    return (how & 0x80) != 0 && size > 1 ? size - 1 - tl_fuzz_take() % (size - 1) : size;
}

/* Expects a read request within the limits of Modbus. */
static void check_request(const uint8_t request[TL_MODBUS_TCP_REQUEST]) {
    static const uint8_t HEAD[] = {0, 0, 0, 6};
    unsigned count = (unsigned)request[10] << 8 | request[11];
    tl_fuzz_hold(memcmp(request + 2, HEAD, sizeof HEAD) == 0);
    tl_fuzz_hold(request[7] >= 1 && request[7] <= 4);
    tl_fuzz_hold(count >= 1 && count <= (request[7] <= 2 ? 2000 : 125));
    tl_fuzz_hold(((unsigned)request[8] << 8 | request[9]) + count <= 65536);
}

/* Expects that an accepted answer fits the request. */
static void check_belief(const uint8_t request[TL_MODBUS_TCP_REQUEST], const uint8_t *answer, size_t size) {
    unsigned count = (unsigned)request[10] << 8 | request[11];
    unsigned bytes = request[7] <= 2 ? (count + 7) / 8 : 2 * count;
    tl_fuzz_hold(memcmp(answer, request, 4) == 0);
    tl_fuzz_hold(((unsigned)answer[4] << 8 | answer[5]) == 3 + bytes);
    tl_fuzz_hold(any_unit_id || answer[6] == request[6]);
    tl_fuzz_hold(answer[7] == request[7] && answer[8] == bytes && size >= HEADER + bytes);
}

/* Receives an answer as modbus_tcp.c does. The bytes arrive in pieces; if some are missing, the
 * answer fails. */
static tl_modbus_outcome receive(const tl_modbus_question *asked, const uint8_t *answer, size_t there, size_t *size) {
    size_t missing = 0;
    *size = 0;
    for (;;) {
        tl_modbus_outcome outcome = framed ? tl_modbus_check_framed(asked, answer, *size, &missing)
                                           : tl_modbus_check_tcp(asked, answer, *size, &missing);
        if (missing == 0) {
            return outcome;
        }
        tl_fuzz_hold(*size + missing <= TL_MODBUS_TCP_ANSWER);
        if (*size == there) {
            return (tl_modbus_outcome){.kind = TL_MODBUS_FAILED, .found = there > 0 ? EPROTO : ETIMEDOUT};
        }
        size_t some = 1 + tl_fuzz_take() % missing;
        *size += some < there - *size ? some : there - *size;
    }
}

/* Replaces the prefix of an answer by a check sum, which is mostly right. Returns the new size. */
static size_t frame_answer(uint8_t *answer, size_t size) {
    unsigned sum = tl_fuzz_take() % 8 == 7 ? 1 : 0xFFFF;
    size = size > TL_MODBUS_TCP_PREFIX ? size - TL_MODBUS_TCP_PREFIX : 0;
    memmove(answer, answer + TL_MODBUS_TCP_PREFIX, size);
    for (size_t i = 0; i < 8 * size; i++) {
        sum ^= i % 8 == 0 ? answer[i / 8] : 0U;
        sum = (sum & 1) != 0 ? sum >> 1 ^ 0xA001U : sum >> 1;
    }
    answer[size] = (uint8_t)sum;
    answer[size + 1] = (uint8_t)(sum >> 8);
    return size + 2;
}

static tl_modbus_outcome answer_tcp(const tl_modbus_read *read, tl_modbus_values *values) {
    uint8_t request[TL_MODBUS_TCP_REQUEST];
    uint8_t answer[512] = {0};
    transaction++;
    const tl_modbus_question asked = {.read = read, .transaction = transaction, .any_unit_id = any_unit_id};
    tl_modbus_put_request(&asked, request);
    check_request(request);
    size_t there = some_answer(request, answer);
    size_t size = 0;
    there = framed ? frame_answer(answer, there) : there;
    tl_modbus_outcome outcome = receive(&asked, answer, there, &size);
    if (outcome.kind == TL_MODBUS_VALUES && framed) { /* has no header */
        memmove(answer + TL_MODBUS_TCP_PREFIX, answer, size);
        memcpy(answer, request, 4);
        memcpy(answer + 4, (uint8_t[]){0, (uint8_t)(size - TL_MODBUS_SUM)}, 2);
        size += TL_MODBUS_TCP_PREFIX - TL_MODBUS_SUM;
    }
    if (outcome.kind == TL_MODBUS_VALUES) {
        check_belief(request, answer, size);
        tl_modbus_take_values(read, answer + HEADER, values);
    }
    return outcome;
}

/* Answers as modbus_rtu.c does: libmodbus has removed the checksum. */
static tl_modbus_outcome answer_rtu(const tl_modbus_read *read, tl_modbus_values *values) {
    uint8_t request[TL_MODBUS_TCP_REQUEST] = {0, 0, 0, 0, 0, 6};
    uint8_t answer[512] = {0};
    tl_modbus_put_body(read, request + TL_MODBUS_TCP_PREFIX);
    check_request(request);
    size_t size = some_answer(request, answer);
    if (size < HEADER) {
        return (tl_modbus_outcome){.kind = TL_MODBUS_FAILED, .found = BAD_CHECK_SUM};
    }
    tl_modbus_outcome outcome = tl_modbus_check_rtu(read, answer + TL_MODBUS_TCP_PREFIX, size - TL_MODBUS_TCP_PREFIX);
    if (outcome.kind == TL_MODBUS_VALUES) {
        memcpy(answer + 4, (uint8_t[]){0, (uint8_t)(size - TL_MODBUS_TCP_PREFIX)}, 2); /* has no header */
        memcpy(answer, request, 4);
        check_belief(request, answer, size);
        tl_modbus_take_values(read, answer + HEADER, values);
    }
    return outcome;
}

/* Answers a request, or fails in another way. */
static tl_modbus_outcome ask(tl_modbus_link *link, const tl_modbus_read *read, tl_modbus_values *values) {
    static const int FAILURES[] = {ETIMEDOUT, EPROTO, EBUSY, ECONNRESET, BAD_CHECK_SUM, EINTR, EIO, ETIMEDOUT};
    unsigned what = tl_fuzz_take();
    tl_fuzz_hold(link->descriptor >= 0);
    clock_now += (what & 0x80) != 0 ? link->timeout : TL_SECOND / 1000;
    be_called(what % 128 == 127);
    if (what % 4 == 3) {
        last = (tl_modbus_outcome){.kind = TL_MODBUS_FAILED, .found = woken ? EINTR : FAILURES[what / 4 % 8]};
    } else {
        last = on_a_line ? answer_rtu(read, values) : answer_tcp(read, values);
    }
    return last;
}

static bool connect_link(tl_modbus_link *link, char *cause, size_t cause_size) {
    unsigned what = tl_fuzz_take();
    be_called(what == 255);
    link->descriptor = what % 8 == 7 ? -1 : 100;
    (void)strncpy(cause, "no connection", cause_size);
    return link->descriptor >= 0;
}

static tl_modbus_health check(const tl_modbus_link *link) {
    unsigned what = tl_fuzz_take();
    tl_fuzz_hold(link->descriptor >= 0);
    if (what < 240) {
        return TL_MODBUS_SOUND;
    }
    return what % 2 == 0 && !on_a_line ? TL_MODBUS_TALKATIVE : TL_MODBUS_CLOSED;
}

static void close_link(tl_modbus_link *link) {
    link->descriptor = -1;
}

static void failed(tl_modbus_link *link, const tl_modbus_outcome *outcome) {
    tl_fuzz_hold(outcome->kind != TL_MODBUS_VALUES && outcome->kind != TL_MODBUS_EXCEPTION);
    if (!on_a_line || outcome->found == EIO) {
        close_link(link);
    }
}

static tl_modbus_link *make(tl_time timeout) {
    static const tl_modbus_link_kind TCP = {.connect = connect_link,
                                            .check = check,
                                            .ask = ask,
                                            .failed = failed,
                                            .close = close_link,
                                            .release = close_link};
    static const tl_modbus_link_kind LINE = {.is_line = true,
                                             .connect = connect_link,
                                             .check = check,
                                             .ask = ask,
                                             .failed = failed,
                                             .close = close_link,
                                             .release = close_link};
    bytes_link = (tl_modbus_link){
        .kind = on_a_line ? &LINE : &TCP, .name = "Modbus server fuzz", .timeout = timeout, .descriptor = -1};
    return &bytes_link;
}

tl_modbus_link *tl_modbus_tcp_make(const tl_modbus_server *server, tl_time timeout) {
    tl_fuzz_hold(!on_a_line && server->any_unit_id == any_unit_id && server->rtu_framing == framed &&
                 server->host[0] != '\0');
    return make(timeout);
}

tl_modbus_link *tl_modbus_rtu_make(const tl_modbus_line *line, tl_time timeout) {
    tl_fuzz_hold(on_a_line && line->device[0] != '\0');
    return make(timeout);
}

tl_time tl_monotonic_now(void) {
    return clock_now;
}

bool tl_wake_is_called(const tl_wake *wake) {
    (void)wake;
    return woken;
}

bool tl_wake_clear(tl_wake *wake) {
    bool was = woken;
    (void)wake;
    woken = false;
    return was;
}

void tl_wake_call(tl_wake *wake) {
    (void)wake;
    be_called(true);
}

/* ---- what the driver says ---- */

static size_t posted[CHANNELS];

/* Expects that a value is equal after encoding and decoding, for a channel without rounding. */
static void check_codec(const tl_modbus_channel *channel, double value) {
    uint16_t registers[4] = {0};
    double again = 0;
    if (channel->scale == 1 && channel->offset == 0) {
        tl_modbus_encode(channel, value, registers);
        tl_fuzz_hold(tl_modbus_decode(channel, registers, &again) && again == value);
    }
}

static void post(void *context, size_t channel, const tl_reading *reading) {
    (void)context;
    tl_fuzz_hold(channel < channel_count && isfinite(reading->value) && reading->stamp <= clock_now);
    tl_fuzz_hold(reading->quality == TL_NO_LINK || last.kind == TL_MODBUS_VALUES);
    posted[channel]++;
    if (reading->quality == TL_GOOD) {
        check_codec(&channels[channel], reading->value);
    } else {
        tl_fuzz_hold(reading->value == 0);
    }
}

static void say(void *context, bool up, const char *text) {
    (void)context;
    (void)up;
    tl_fuzz_hold(strncmp(text, "Modbus server fuzz: ", 20) == 0 && strlen(text) > 24 && strstr(text, "11234") == NULL);
}

/* Expects one reading of each channel in a poll; none is allowed too if the poll was
 * interrupted. */
static void check_posts(void) {
    for (size_t i = 0; i < channel_count; i++) {
        tl_fuzz_hold(posted[i] == 1 || (disturbed && posted[i] == 0));
    }
    memset(posted, 0, sizeof posted);
}

static void happen(tl_plant_io *io) {
    const tl_plant_io_sink sink = {.post = post, .link = say};
    unsigned what = tl_fuzz_take();
    clock_now += (tl_time)(what % 64) * (TL_SECOND / 20);
    disturbed = woken;
    if (what >= 0xF0) {
        tl_modbus_driver.interrupt(io);
    }
    tl_modbus_driver.poll(io, &sink);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_plant_io *io = NULL;
    tl_error error;
    tl_fuzz_begin(data, size);
    clock_now = TL_SECOND;
    transaction = 0;
    woken = false;
    memset(posted, 0, sizeof posted);
    read_channels();
    const tl_modbus_settings settings = {
        .host = "fuzz",
        .any_unit_id = any_unit_id,
        .line = {.device = on_a_line ? "fuzz" : NULL, .baud = 19200, .parity = 'N', .stop_bits = 2},
        .rtu_framing = framed,
        .most_registers = split_failed ? 3 : 0,
        .split_failed = split_failed,
        .timeout_s = 0.5,
        .channels = channels,
        .channel_count = channel_count};
    if (tl_modbus_open(&settings, &io, &error) != TL_OK) {
        tl_fuzz_hold(error.text[0] != '\0');
        return 0;
    }
    for (int i = 0; i < POLLS && !tl_fuzz_is_over(); i++) {
        happen(io);
        check_posts();
    }
    tl_modbus_driver.close(io);
    return 0;
}
