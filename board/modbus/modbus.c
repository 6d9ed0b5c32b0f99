/* Modbus driver: schedules requests and derives the link state from missing answers. The link sends
 *                and receives.
 *
 * A poll has two passes: first the requests that were answered last time, then those that were
 * silent, if their pause is over. After a missing or wrong response a TCP connection is closed,
 * because late bytes could be taken for the answer to the next request; a line is used again as
 * soon as it is quiet. Extra bytes beside a response also close the connection, but then the next
 * request just uses another one.
 * If any request of a poll was answered, the device works: only the silent request is paused; on a
 * serial line, also its unit for a short time. If no request was answered, the link is down and the
 * next try waits. An exception is an answer.
 */
#include "board/modbus/modbus.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>

#include "board/io/link.h"
#include "board/io/monotonic.h"
#include "board/modbus/modbus_link.h"
#include "board/modbus/modbus_map.h"

/* Pause after waiting for silent requests, as a multiple of that time. */
#define REST 4

enum { TEXT = 320, SILENCES_ON_A_LINE = 2, SILENCES_BEFORE_SPLIT = 2 };

/* Exceptions. */
enum { ILLEGAL_ADDRESS = 2, ILLEGAL_VALUE = 3, DEVICE_FAILURE = 4, DEVICE_BUSY = 6 };

struct tl_plant_io {
    tl_modbus_link *link;
    tl_modbus_map map;
    tl_link state;
    bool surplus_reported; /* it was reported that more bytes came than were requested */
    tl_backoff backoff;    /* of tries to connect */
    tl_time silent_due;    /* no silent request is repeated before this time */
    size_t start;          /* first request of the next poll */
    tl_time period;        /* of polls */
    bool split_failed;
    size_t mute_polls; /* polls in a row with a connection and without an answer */
    uint64_t polls;    /* so far */
    tl_modbus_values values;
};

/* Result of one poll. */
typedef struct progress {
    const tl_plant_io_sink *sink;
    tl_time end;               /* no request is repeated after it */
    bool checked;              /* the connection was checked, and nothing was sent since */
    bool answered;             /* there was an answer */
    size_t silent;             /* requests without an answer */
    tl_time waited;            /* for these */
    bool over;                 /* no more requests in this poll */
    bool interrupted;          /* by interrupt() */
    tl_modbus_outcome failure; /* the last missing answer */
} progress;

static void set_link(tl_plant_io *io, const tl_plant_io_sink *sink, bool up, const char *text) {
    if (tl_link_set(&io->state, sink, up, io->link->name, text)) {
        io->surplus_reported = io->surplus_reported && up;
    }
}

static void describe_outcome(const tl_plant_io *io, const tl_modbus_outcome *outcome, char *text, size_t size) {
    tl_modbus_outcome_text(outcome, io->link->kind->is_line, io->link->timeout, text, size);
}

/* Reports once that a request gives no values, and once that it does again. */
static void note_trouble(tl_plant_io *io, const tl_plant_io_sink *sink, tl_modbus_read *read,
                         tl_modbus_outcome trouble) {
    if (tl_modbus_outcome_is_same(&read->trouble, &trouble)) {
        return;
    }
    char reason[TEXT - 64] = "answers again";
    if (trouble.kind != TL_MODBUS_VALUES) {
        describe_outcome(io, &trouble, reason, sizeof reason);
    }
    char text[TEXT];
    (void)snprintf(text, sizeof text, "unit %u, %s %u to %u: %s", (unsigned)read->unit_id,
                   tl_modbus_table_name(read->table), (unsigned)read->address,
                   (unsigned)read->address + read->count - 1U, reason);
    read->trouble = trouble;
    tl_link_report(&io->state, sink, trouble.kind == TL_MODBUS_VALUES, io->link->name, text);
}

static void post_no_link(const tl_plant_io *io, const tl_plant_io_sink *sink, const tl_modbus_read *read) {
    tl_reading reading = {.value = 0, .stamp = tl_monotonic_now(), .quality = TL_NO_LINK};
    for (size_t i = read->first; i < read->first + read->entries; i++) {
        sink->post(sink->context, io->map.entries[i].index, &reading);
    }
}

static void post_values(const tl_plant_io *io, const tl_plant_io_sink *sink, const tl_modbus_read *read,
                        tl_time stamp) {
    for (size_t i = read->first; i < read->first + read->entries; i++) {
        const tl_modbus_entry *entry = &io->map.entries[i];
        size_t offset = (size_t)(entry->channel.address - read->address);
        uint16_t bit = io->values.bits[offset];
        const uint16_t *raw = entry->channel.type == TL_MODBUS_BIT ? &bit : &io->values.registers[offset];
        tl_reading reading = {.stamp = stamp, .quality = TL_GOOD};
        if (!tl_modbus_decode(&entry->channel, raw, &reading.value)) {
            reading.quality = TL_NOT_A_NUMBER;
        }
        sink->post(sink->context, entry->index, &reading);
    }
}

/* True if the device may answer a smaller request. */
static bool is_split_useful(const tl_plant_io *io, const tl_modbus_outcome *outcome) {
    return outcome->kind == TL_MODBUS_EXCEPTION &&
           (outcome->found == ILLEGAL_ADDRESS || outcome->found == ILLEGAL_VALUE ||
            (outcome->found == DEVICE_FAILURE && io->split_failed));
}

/* Records a missing or wrong answer; its meaning is known at the end of the poll. */
static void note_silence(tl_plant_io *io, size_t index, tl_modbus_outcome failure, progress *now) {
    tl_modbus_read *read = &io->map.reads[index];
    io->link->kind->failed(io->link, &failure);
    io->start = (index + 1) % io->map.read_count;
    read->silent = io->polls;
    read->failure = failure;
    now->failure = failure;
    now->silent++;
    now->over = io->link->descriptor < 0 || now->silent >= SILENCES_ON_A_LINE || tl_wake_is_called(&io->link->wake);
}

/* Closes a connection on which anything has happened meanwhile. */
static void check_connection(tl_plant_io *io, const tl_plant_io_sink *sink) {
    tl_modbus_health health = io->link->descriptor < 0 ? TL_MODBUS_SOUND : io->link->kind->check(io->link);
    if (health == TL_MODBUS_SOUND) {
        return;
    }
    io->link->kind->close(io->link); /* closed by the device while idle: not an error */
    if (health == TL_MODBUS_TALKATIVE && !io->surplus_reported) {
        io->surplus_reported = true;
        tl_link_report(&io->state, sink, false, io->link->name,
                       "the device sends more bytes than asked for: they are dropped, each time with a new connection: "
                       "check the device and the gateway before it");
    }
}

static bool connect_link(tl_plant_io *io, char *cause, size_t cause_size) {
    bool is_connected = io->link->kind->connect(io->link, cause, cause_size);
    tl_modbus_link_begin_pause(io->link);
    return is_connected;
}

/* Connects if necessary, and waits for the end of the pause. True if the link is open and holds no
 * bytes of earlier answers. After a failure the next poll reports the reason. */
static bool is_ready(tl_plant_io *io, progress *now) {
    char cause[TEXT];
    bool is_usable = tl_modbus_link_await_pause(io->link);
    if (!now->checked || io->link->pause > 0) {
        check_connection(io, now->sink);
    }
    now->checked = false;
    if (is_usable && io->link->descriptor < 0) {
        is_usable = connect_link(io, cause, sizeof cause) && tl_modbus_link_await_pause(io->link);
    }
    now->over = !is_usable;
    return is_usable;
}

static tl_modbus_outcome ask(tl_plant_io *io, const tl_modbus_read *read, tl_time *stamp) {
    tl_modbus_outcome outcome = io->link->kind->ask(io->link, read, &io->values);
    *stamp = tl_monotonic_now();
    tl_modbus_link_begin_pause(io->link);
    return outcome;
}

/* True if the device is busy and there is time to ask it again after a pause. */
static bool is_retry_useful(const tl_plant_io *io, const tl_modbus_outcome *outcome, const progress *now) {
    return outcome->kind == TL_MODBUS_EXCEPTION && outcome->found == DEVICE_BUSY && io->link->pause > 0 &&
           io->link->pause_end < now->end;
}

/* Sends a request; splits it if the device rejects a large one; repeats it if the device is
 * busy. */
static tl_modbus_outcome request_values(tl_plant_io *io, size_t index, tl_time *stamp, progress *now) {
    tl_modbus_read *read = &io->map.reads[index];
    tl_modbus_outcome outcome = ask(io, read, stamp);
    while (is_split_useful(io, &outcome)) {
        size_t parts = tl_modbus_map_split(&io->map, index);
        if (parts == 1) {
            break;
        }
        if (index < io->start) {
            io->start += parts - 1;
        }
        if (!is_ready(io, now)) {
            break;
        }
        outcome = ask(io, read, stamp);
    }
    while (is_retry_useful(io, &outcome, now) && is_ready(io, now)) {
        outcome = ask(io, read, stamp);
    }
    return outcome;
}

/* Sends one request and posts its result. */
static void handle_request(tl_plant_io *io, size_t index, progress *now) {
    tl_time begin = tl_monotonic_now();
    tl_time stamp = begin;
    tl_modbus_outcome outcome = request_values(io, index, &stamp, now);
    if (outcome.kind != TL_MODBUS_VALUES && outcome.kind != TL_MODBUS_EXCEPTION) {
        note_silence(io, index, outcome, now);
        now->waited += tl_monotonic_now() - begin;
        return;
    }
    tl_modbus_read *read = &io->map.reads[index];
    now->answered = true;
    set_link(io, now->sink, true, "connected");
    read->polled = io->polls;
    tl_backoff_reset(&read->backoff);
    note_trouble(io, now->sink, read, outcome);
    if (outcome.kind == TL_MODBUS_VALUES) {
        post_values(io, now->sink, read, stamp);
    } else {
        post_no_link(io, now->sink, read);
    }
}

/* True if that unit was silent in this poll. */
static bool is_unit_silent(const tl_plant_io *io, uint8_t unit_id) {
    for (size_t i = 0; i < io->map.read_count; i++) {
        if (io->map.reads[i].unit_id == unit_id && io->map.reads[i].silent == io->polls) {
            return true;
        }
    }
    return false;
}

/* True if the request is due. */
static bool is_due(const tl_plant_io *io, const tl_modbus_read *read, bool silent_ones) {
    tl_time now = tl_monotonic_now();
    bool was_silent = tl_backoff_is_on(&read->backoff);
    bool is_wanted =
        was_silent == silent_ones && (!was_silent || (tl_backoff_is_due(&read->backoff, now) && now >= io->silent_due));
    return is_wanted && now >= read->hold && read->polled != io->polls &&
           !(io->link->kind->is_line && is_unit_silent(io, read->unit_id));
}

/* One pass over the requests; the list may grow meanwhile. */
static void send_due(tl_plant_io *io, bool silent_ones, progress *now) {
    size_t start = io->start;
    size_t count = io->map.read_count;
    for (size_t done = 0; done < io->map.read_count && !now->over; done++) {
        size_t index = (start + done) % io->map.read_count;
        if (is_due(io, &io->map.reads[index], silent_ones) && is_ready(io, now)) {
            handle_request(io, index, now);
        }
        if (index < start) { /* the list has grown before the start */
            start += io->map.read_count - count;
        }
        count = io->map.read_count;
    }
}

/* The requests after an outage: joined ones, because it may be another device by now. If it does
 * not answer these, one address may be the cause: then each value is tried once by itself. */
static void reset_requests(tl_plant_io *io) {
    const bool is_mute = io->split_failed && io->mute_polls >= SILENCES_BEFORE_SPLIT;
    if (is_mute && io->mute_polls == SILENCES_BEFORE_SPLIT) {
        tl_modbus_map_reset(&io->map, TL_MODBUS_SINGLE);
    } else if (!is_mute || io->mute_polls >= SILENCES_BEFORE_SPLIT + io->map.read_count) {
        io->mute_polls = is_mute ? 0 : io->mute_polls;
        tl_modbus_map_reset(&io->map, TL_MODBUS_GAPS);
    }
    io->start = io->start < io->map.read_count ? io->start : 0;
}

/* No answer at all: the link is down and the next try waits. Silence of single requests is dropped.
 */
static void set_link_down(tl_plant_io *io, const tl_plant_io_sink *sink, const char *cause) {
    tl_backoff_fail(&io->backoff, tl_monotonic_now());
    io->silent_due = 0;
    set_link(io, sink, false, cause);
}

/* True if there is a connection. */
static bool is_connected(tl_plant_io *io, progress *now) {
    check_connection(io, now->sink);
    now->checked = true;
    if (!tl_backoff_is_due(&io->backoff, tl_monotonic_now())) {
        return false;
    }
    char cause[TEXT];
    if (io->link->descriptor < 0 && !connect_link(io, cause, sizeof cause)) {
        now->interrupted = tl_wake_clear(&io->link->wake);
        if (!now->interrupted) {
            set_link_down(io, now->sink, cause);
        }
        return false;
    }
    if (!tl_link_is_up(&io->state)) {
        reset_requests(io);
    }
    return true;
}

/* Splits a request that was silent before. Returns the number of parts; 1: it is not split. */
static size_t split_silent(tl_plant_io *io, size_t index, tl_time end) {
    const bool is_again = io->split_failed && tl_backoff_is_on(&io->map.reads[index].backoff);
    const size_t parts = is_again ? tl_modbus_map_split(&io->map, index) : 1;
    for (size_t i = index; parts > 1 && i < index + parts; i++) {
        io->map.reads[i].silent = io->polls;
        io->map.reads[i].hold = io->link->kind->is_line ? end + io->link->timeout : 0;
    }
    io->start += index < io->start ? parts - 1 : 0;
    return parts;
}

/* Other requests were answered: these are asked later and less often. */
static void pause_silent(tl_plant_io *io, const progress *now) {
    tl_time end = tl_monotonic_now();
    io->silent_due = end + REST * now->waited;
    for (size_t i = 0; i < io->map.read_count; i++) {
        tl_modbus_read *read = &io->map.reads[i];
        const size_t parts = read->silent == io->polls ? split_silent(io, i, end) : 1;
        if (parts > 1) {
            i += parts - 1;
        } else if (read->silent == io->polls) {
            note_trouble(io, now->sink, read, read->failure);
            tl_backoff_fail(&read->backoff, end);
        } else if (io->link->kind->is_line && is_unit_silent(io, read->unit_id)) {
            read->hold = end + io->link->timeout;
        }
    }
}

/* Sends all requests that are due. */
static void send_all_due(tl_plant_io *io, progress *now) {
    send_due(io, false, now);
    send_due(io, true, now);
    if (now->answered) {
        tl_backoff_reset(&io->backoff);
        io->mute_polls = 0;
    }
    now->interrupted = (now->silent > 0 || now->over) && tl_wake_clear(&io->link->wake);
    if (now->silent == 0 || now->interrupted) {
        return;
    }
    if (now->answered) {
        pause_silent(io, now);
    } else {
        char text[TEXT];
        describe_outcome(io, &now->failure, text, sizeof text);
        io->mute_polls++;
        set_link_down(io, now->sink, text);
    }
}

static void modbus_poll(tl_plant_io *io, const tl_plant_io_sink *sink) {
    progress now = {.sink = sink, .interrupted = tl_wake_clear(&io->link->wake)};
    now.end = tl_monotonic_now() + io->period;
    io->polls++;
    if (!now.interrupted && is_connected(io, &now)) {
        send_all_due(io, &now);
    }
    for (size_t i = 0; i < io->map.read_count && !now.interrupted; i++) {
        if (io->map.reads[i].polled != io->polls) {
            post_no_link(io, sink, &io->map.reads[i]);
        }
    }
}

static void modbus_interrupt(tl_plant_io *io) {
    tl_wake_call(&io->link->wake);
}

static void modbus_close_io(tl_plant_io *io) {
    tl_modbus_map_release(&io->map);
    io->link->kind->release(io->link);
    free(io);
}

const tl_plant_io_driver tl_modbus_driver = {
    .name = "modbus", .poll = modbus_poll, .interrupt = modbus_interrupt, .close = modbus_close_io};

/* ---- access ---- */

static const uint32_t line_commands[] = {TCSETS,   TCSETSW,  TCSETSF,  TCFLSH,     TCSBRK,
                                         TIOCEXCL, TIOCNXCL, TIOCMGET, TIOCGRS485, TIOCSRS485};

const tl_plant_access tl_modbus_tcp_access = {.tcp = true};

/* A device that is plugged in again has a new entry in /dev, to which links of other folders lead.
 */
const tl_plant_access tl_modbus_rtu_access = {
    .commands = line_commands, .command_count = sizeof line_commands / sizeof line_commands[0], .write = "/dev"};

/* ---- settings ---- */

static tl_status check_unit(const tl_modbus_channel *channel, size_t index, bool on_a_line, tl_error *error) {
    if (on_a_line && (channel->unit_id < 1 || channel->unit_id > 247)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: unit_id is %u (expected 1 to 247 on a serial line)",
                       index, (unsigned)channel->unit_id);
    }
    if (channel->unit_id > 247 && channel->unit_id != 255) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: unit_id is %u (expected 0 to 247 or 255)", index,
                       (unsigned)channel->unit_id);
    }
    return TL_OK;
}

static tl_status check_channel(const tl_modbus_channel *channel, size_t index, tl_error *error) {
    bool bit_table = tl_modbus_is_bit_table(channel->table);
    if (channel->table < TL_MODBUS_COIL || channel->table > TL_MODBUS_INPUT) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: table is %d (expected 1 to 4)", index,
                       (int)channel->table);
    }
    if (bit_table != (channel->type == TL_MODBUS_BIT)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: %s", index,
                       bit_table ? "coils and discrete inputs hold bits: remove type"
                                 : "registers hold numbers, not bits: set type");
    }
    if (channel->address + tl_modbus_registers(channel->type) > 65536) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: the value at address %u ends beyond address 65535",
                       index, (unsigned)channel->address);
    }
    unsigned part = tl_modbus_part_bits(channel->type);
    if (channel->bit > (part > 0 ? 16 - part : 0)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: bit is %u (expected at most %u for its type)", index,
                       (unsigned)channel->bit, part > 0 ? 16 - part : 0);
    }
    if (!isfinite(channel->scale) || channel->scale == 0 || !isfinite(channel->offset)) {
        return tl_fail(error, TL_BAD_DATA,
                       "Modbus channel %zu: scale is %g, offset is %g (expected finite values, scale not 0)", index,
                       channel->scale, channel->offset);
    }
    return TL_OK;
}

static tl_status check(const tl_modbus_settings *settings, tl_error *error) {
    const char *device = settings->line.device;
    if (device == NULL && (settings->host == NULL || settings->host[0] == '\0')) {
        return tl_fail(error, TL_BAD_DATA,
                       "Modbus server: host is empty: write a name or an address, for example 192.168.1.17");
    }
    if (!(settings->timeout_s >= 0.001 && settings->timeout_s <= 3600)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus %s: timeout_s is %g (expected 0.001 to 3600)",
                       device != NULL ? device : settings->host, settings->timeout_s);
    }
    if (device != NULL && tl_modbus_line_check(&settings->line, error) != TL_OK) {
        return TL_BAD_DATA;
    }
    if (!(settings->pause_s >= 0 && settings->pause_s <= 60)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus %s: pause_s is %g (expected 0 to 60)",
                       device != NULL ? device : settings->host, settings->pause_s);
    }
    if (settings->most_registers > TL_MODBUS_MAX_REGISTERS) {
        return tl_fail(error, TL_BAD_DATA, "Modbus %s: most_registers is %u (expected 1 to 125)",
                       device != NULL ? device : settings->host, (unsigned)settings->most_registers);
    }
    for (size_t i = 0; i < settings->channel_count; i++) {
        if (check_channel(&settings->channels[i], i, error) != TL_OK ||
            check_unit(&settings->channels[i], i, device != NULL, error) != TL_OK) {
            return TL_BAD_DATA;
        }
    }
    return TL_OK;
}

static tl_modbus_link *make_link(const tl_modbus_settings *settings) {
    tl_time timeout = tl_time_of_seconds(settings->timeout_s);
    const tl_modbus_server server = {.host = settings->host,
                                     .port = settings->port,
                                     .any_unit_id = settings->any_unit_id,
                                     .any_transaction_id = settings->any_transaction_id,
                                     .rtu_framing = settings->rtu_framing};
    return settings->line.device != NULL ? tl_modbus_rtu_make(&settings->line, timeout)
                                         : tl_modbus_tcp_make(&server, timeout);
}

tl_status tl_modbus_open(const tl_modbus_settings *settings, tl_plant_io **io, tl_error *error) {
    tl_status status = check(settings, error);
    if (status != TL_OK) {
        return status;
    }
    const char *name = settings->line.device != NULL ? settings->line.device : settings->host;
    tl_plant_io *made = calloc(1, sizeof *made);
    if (made == NULL || (made->link = make_link(settings)) == NULL) {
        status = tl_fail(error, TL_TRY_AGAIN, "Modbus %s: %s", name, strerror(errno));
        free(made);
        return status;
    }
    made->split_failed = settings->split_failed;
    made->period = tl_time_of_seconds(settings->period_s);
    made->link->pause = tl_time_of_seconds(settings->pause_s);
    if (!tl_modbus_map_make(&made->map, settings->channels, settings->channel_count,
                            settings->most_registers > 0 ? settings->most_registers : TL_MODBUS_MAX_REGISTERS)) {
        made->link->kind->release(made->link);
        free(made);
        return tl_fail(error, TL_TRY_AGAIN, "Modbus %s: not enough memory", name);
    }
    *io = made;
    return TL_OK;
}
