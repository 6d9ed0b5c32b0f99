/* Connection to a Modbus server: see modbus_link.h. */
#include "board/modbus/modbus_link.h"

#include <errno.h>
#include <modbus.h>
#include <poll.h>
#include <stdio.h>

#include "board/io/monotonic.h"

/* ---- modbus line ---- */

const uint32_t tl_modbus_bauds[] = {1200,   2400,   4800,   9600,   19200,  38400,   57600,
                                    115200, 230400, 460800, 500000, 921600, 1000000, 0};

static bool is_baud(uint32_t baud) {
    const uint32_t *known = tl_modbus_bauds;
    while (*known != 0 && *known != baud) {
        known++;
    }
    return *known != 0;
}

tl_status tl_modbus_line_check(const tl_modbus_line *line, tl_error *error) {
    if (line->device[0] == '\0') {
        return tl_fail(error, TL_BAD_DATA,
                       "Modbus line: device is empty: write for example /dev/serial/by-id/usb-0-port0");
    }
    if (!is_baud(line->baud)) {
        return tl_fail(error, TL_BAD_DATA,
                       "Modbus line %s: baud is %u (expected a usual speed, for example 9600 or 19200)", line->device,
                       (unsigned)line->baud);
    }
    if (line->parity != 'N' && line->parity != 'E' && line->parity != 'O') {
        return tl_fail(error, TL_BAD_DATA, "Modbus line %s: parity is wrong (expected N, E or O)", line->device);
    }
    if (line->stop_bits != 1 && line->stop_bits != 2) {
        return tl_fail(error, TL_BAD_DATA, "Modbus line %s: stop_bits is %u (expected 1 or 2)", line->device,
                       (unsigned)line->stop_bits);
    }
    return TL_OK;
}

/* ---- modbus frame ---- */

enum { UNIT, FUNCTION, BYTES, BODY }; /* indices in a body; BODY: their number */

enum { LONGEST_BODY = 254, EXCEPTION_FLAG = 0x80 };

static uint16_t word_at(const uint8_t *bytes) {
    return (uint16_t)((unsigned)bytes[0] << 8 | bytes[1]);
}

static void put_word(uint8_t *bytes, unsigned word) {
    bytes[0] = (uint8_t)(word >> 8);
    bytes[1] = (uint8_t)(word & 0xFF);
}

size_t tl_modbus_value_bytes(const tl_modbus_read *read) {
    return tl_modbus_is_bit_table(read->table) ? (read->count + 7U) / 8 : 2U * read->count;
}

void tl_modbus_put_body(const tl_modbus_read *read, uint8_t request[TL_MODBUS_BODY_REQUEST]) {
    request[UNIT] = read->unit_id;
    request[FUNCTION] = (uint8_t)read->table;
    put_word(request + 2, read->address);
    put_word(request + 4, read->count);
}

void tl_modbus_put_request(const tl_modbus_question *asked, uint8_t request[TL_MODBUS_TCP_REQUEST]) {
    put_word(request, asked->transaction);
    put_word(request + 2, 0);
    put_word(request + 4, TL_MODBUS_BODY_REQUEST);
    tl_modbus_put_body(asked->read, request + TL_MODBUS_TCP_PREFIX);
}

static tl_modbus_outcome compare(tl_modbus_kind kind, size_t found, size_t wanted) {
    tl_modbus_outcome outcome = {
        .kind = found == wanted ? TL_MODBUS_VALUES : kind, .found = (int)found, .wanted = (int)wanted};
    return outcome;
}

/* Checks function, exception or number of bytes of a body of this size. */
static tl_modbus_outcome check_function(const tl_modbus_read *read, const uint8_t *body, size_t size) {
    if (body[FUNCTION] == ((unsigned)read->table | EXCEPTION_FLAG)) {
        tl_modbus_outcome refusal = {.kind = TL_MODBUS_EXCEPTION, .found = body[BYTES]};
        return size == BODY ? refusal : compare(TL_MODBUS_WRONG_LENGTH, size, BODY);
    }
    tl_modbus_outcome outcome = compare(TL_MODBUS_WRONG_FUNCTION, body[FUNCTION], (size_t)read->table);
    if (outcome.kind == TL_MODBUS_VALUES) {
        outcome = compare(TL_MODBUS_WRONG_BYTES, body[BYTES], tl_modbus_value_bytes(read));
    }
    return outcome.kind == TL_MODBUS_VALUES ? compare(TL_MODBUS_WRONG_LENGTH, size, BODY + tl_modbus_value_bytes(read))
                                            : outcome;
}

/* Checks what comes before the function. */
static tl_modbus_outcome check_header(const tl_modbus_question *asked, const uint8_t *answer) {
    const size_t length = word_at(answer + 4);
    tl_modbus_outcome outcome = {.kind = TL_MODBUS_VALUES};
    if (!asked->any_transaction_id) {
        outcome = compare(TL_MODBUS_WRONG_TRANSACTION, word_at(answer), asked->transaction);
    }
    if (outcome.kind == TL_MODBUS_VALUES) {
        outcome = compare(TL_MODBUS_WRONG_PROTOCOL, word_at(answer + 2), 0);
    }
    if (outcome.kind == TL_MODBUS_VALUES && (length < BODY || length > LONGEST_BODY)) {
        outcome = compare(TL_MODBUS_WRONG_LENGTH, length, BODY + tl_modbus_value_bytes(asked->read));
    }
    if (outcome.kind == TL_MODBUS_VALUES && !asked->any_unit_id) {
        outcome = compare(TL_MODBUS_WRONG_UNIT, answer[TL_MODBUS_TCP_PREFIX + UNIT], asked->read->unit_id);
    }
    return outcome;
}

tl_modbus_outcome tl_modbus_check_tcp(const tl_modbus_question *asked, const uint8_t *answer, size_t size,
                                      size_t *missing) {
    const size_t header = TL_MODBUS_TCP_PREFIX + 1;
    tl_modbus_outcome outcome = {.kind = TL_MODBUS_VALUES};
    *missing = 0;
    if (size < header) {
        *missing = TL_MODBUS_TCP_FIRST - size;
        return outcome;
    }
    outcome = check_header(asked, answer);
    if (outcome.kind != TL_MODBUS_VALUES) {
        return outcome;
    }
    if (size < TL_MODBUS_TCP_FIRST) {
        *missing = TL_MODBUS_TCP_FIRST - size;
        return outcome;
    }
    const size_t length = word_at(answer + 4);
    outcome = check_function(asked->read, answer + TL_MODBUS_TCP_PREFIX, length);
    if (outcome.kind == TL_MODBUS_VALUES && size < TL_MODBUS_TCP_PREFIX + length) {
        *missing = TL_MODBUS_TCP_PREFIX + length - size;
    }
    return outcome;
}

/* Reflected polynomial 0xA001; sent with the lower byte first. */
static unsigned check_sum(const uint8_t *bytes, size_t size) {
    unsigned sum = 0xFFFF;
    for (size_t i = 0; i < 8 * size; i++) {
        sum ^= i % 8 == 0 ? bytes[i / 8] : 0U;
        sum = (sum & 1) != 0 ? sum >> 1 ^ 0xA001U : sum >> 1;
    }
    return (sum & 0xFF) << 8 | sum >> 8;
}

void tl_modbus_put_framed(const tl_modbus_question *asked, uint8_t request[TL_MODBUS_TCP_REQUEST]) {
    tl_modbus_put_body(asked->read, request);
    put_word(request + TL_MODBUS_BODY_REQUEST, check_sum(request, TL_MODBUS_BODY_REQUEST));
}

tl_modbus_outcome tl_modbus_check_framed(const tl_modbus_question *asked, const uint8_t *answer, size_t size,
                                         size_t *missing) {
    tl_modbus_outcome outcome = {.kind = TL_MODBUS_VALUES};
    *missing = size < BODY + TL_MODBUS_SUM ? BODY + TL_MODBUS_SUM - size : 0;
    if (*missing > 0) {
        return outcome;
    }
    const bool is_exception = (answer[FUNCTION] & EXCEPTION_FLAG) != 0;
    const size_t length = BODY + (is_exception ? 0 : tl_modbus_value_bytes(asked->read));
    if (!asked->any_unit_id) {
        outcome = compare(TL_MODBUS_WRONG_UNIT, answer[UNIT], asked->read->unit_id);
    }
    if (outcome.kind == TL_MODBUS_VALUES) {
        outcome = check_function(asked->read, answer, length);
    }
    if (outcome.kind > TL_MODBUS_EXCEPTION) {
        return outcome;
    }
    *missing = size < length + TL_MODBUS_SUM ? length + TL_MODBUS_SUM - size : 0;
    if (*missing == 0 && word_at(answer + length) != check_sum(answer, length)) {
        outcome = (tl_modbus_outcome){.kind = TL_MODBUS_FAILED, .found = EMBBADCRC};
    }
    return outcome;
}

tl_modbus_outcome tl_modbus_check_rtu(const tl_modbus_read *asked, const uint8_t *answer, size_t size) {
    tl_modbus_outcome outcome = compare(TL_MODBUS_WRONG_UNIT, answer[UNIT], asked->unit_id);
    return outcome.kind == TL_MODBUS_VALUES ? check_function(asked, answer, size) : outcome;
}

void tl_modbus_take_values(const tl_modbus_read *read, const uint8_t *bytes, tl_modbus_values *values) {
    for (size_t i = 0; i < read->count; i++) {
        if (tl_modbus_is_bit_table(read->table)) {
            values->bits[i] = (uint8_t)((unsigned)bytes[i / 8] >> i % 8 & 1U);
        } else {
            values->registers[i] = word_at(bytes + 2 * i);
        }
    }
}

/* ---- Common part of all links: interruption. A waiting thread also polls the wake-up call. */

bool tl_modbus_link_init(tl_modbus_link *link, const tl_modbus_link_settings *settings) {
    *link = (tl_modbus_link){.kind = settings->kind, .timeout = settings->timeout, .descriptor = -1};
    (void)snprintf(link->name, sizeof link->name, "%s", settings->name);
    return tl_wake_make(&link->wake);
}

void tl_modbus_link_done(tl_modbus_link *link) {
    tl_wake_release(&link->wake);
}

void tl_modbus_link_begin_pause(tl_modbus_link *link) {
    link->pause_end = tl_monotonic_now() + link->pause;
}

bool tl_modbus_link_await_pause(const tl_modbus_link *link) {
    return tl_modbus_link_await(link, link->descriptor, 0, link->pause_end) != EINTR;
}

int tl_modbus_link_await(const tl_modbus_link *link, int descriptor, short events, tl_time deadline) {
    for (;;) {
        struct pollfd both[2] = {{.fd = descriptor, .events = events}, {.fd = link->wake.descriptor, .events = POLLIN}};
        tl_time left = deadline - tl_monotonic_now();
        int ready = left > 0 ? poll(both, 2, (int)(left / 1000000) + 1) : 0;
        if (ready == 0) {
            return ETIMEDOUT;
        }
        if (ready < 0 && errno != EINTR) {
            return errno;
        }
        if (ready > 0 && both[1].revents != 0) {
            return EINTR;
        }
        if (ready > 0 && both[0].revents != 0) {
            return 0;
        }
    }
}
