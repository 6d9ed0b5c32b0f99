/* The Modbus TCP driver: what to ask when, and what a missing answer means.
 *
 * A poll has two passes: first the requests that were answered last time, then, where their pause is over, those
 * that were silent. A response that does not come, or makes no sense, costs the connection: what arrives later
 * could be taken for the answer to the next request. If anything was answered in that poll, the device lives: the
 * one request is paused and the next poll connects again at once. If nothing was, the link is down and connecting
 * is paused. An exception is an answer.
 *
 * Of libmodbus only the reading functions are used; it neither connects nor recovers here (its own recovery sleeps).
 */
#include "board/io/modbus.h"

#include <errno.h>
#include <math.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board/io/modbus_link.h"
#include "board/io/modbus_map.h"

#define PAUSE_FIRST (TL_SECOND / 10)
#define PAUSE_LAST (2 * TL_SECOND)

enum { TEXT = 256 };

typedef enum link_state { LINK_UNKNOWN, LINK_DOWN, LINK_UP } link_state;

struct tl_plant_io {
    tl_modbus_link link;
    modbus_t *context;
    tl_modbus_map map;
    tl_time timeout;
    link_state state;
    tl_time pause;  /* between attempts to connect; 0: none is due */
    tl_time due;    /* of the next attempt */
    size_t start;   /* the request that the next poll begins with */
    uint64_t polls; /* so far */
    uint8_t bits[TL_MODBUS_MAX_BITS];
    uint16_t registers[TL_MODBUS_MAX_REGISTERS];
};

/* What one poll has come to. */
typedef struct progress {
    const tl_plant_io_sink *sink;
    bool answered;    /* something did */
    bool lost;        /* the connection is no more */
    bool interrupted; /* nobody wants to know */
    int failure;      /* errno of libmodbus, where it is lost */
} progress;

static void say(const tl_plant_io *io, const tl_plant_io_sink *sink, bool up, const char *text) {
    char whole[TEXT + 128];
    (void)snprintf(whole, sizeof whole, "Modbus server %.80s:%s: %s", io->link.host, io->link.service, text);
    sink->link(sink->context, up, whole);
}

static void set_link(tl_plant_io *io, const tl_plant_io_sink *sink, bool up, const char *text) {
    link_state state = up ? LINK_UP : LINK_DOWN;
    if (io->state != state) {
        io->state = state;
        say(io, sink, up, text);
    }
}

/* The next pause after one of that length. */
static tl_time longer(tl_time pause) {
    tl_time next = pause > 0 ? 2 * pause : PAUSE_FIRST;
    return next < PAUSE_LAST ? next : PAUSE_LAST;
}

/* libmodbus's errno in words; a time-out in our own. */
static void describe(const tl_plant_io *io, int failure, char *text, size_t size) {
    if (failure == ETIMEDOUT) {
        (void)snprintf(text, size, "no answer within %g s", tl_seconds(io->timeout));
    } else {
        (void)snprintf(text, size, "%s", modbus_strerror(failure));
    }
}

/* Says once that a request gives no values, and once that it does again. */
static void note_trouble(tl_plant_io *io, const tl_plant_io_sink *sink, tl_modbus_read *read, int trouble) {
    static const char *const TABLES[] = {"", "coil", "discrete input", "holding register", "input register"};
    if (read->trouble == trouble) {
        return;
    }
    char reason[TEXT / 2] = "answers again";
    if (trouble != 0) {
        describe(io, trouble, reason, sizeof reason);
    }
    char text[TEXT];
    (void)snprintf(text, sizeof text, "unit %u, %s %u to %u: %s", (unsigned)read->unit_id, TABLES[read->table],
                   (unsigned)read->address, (unsigned)read->address + read->count - 1U, reason);
    read->trouble = trouble;
    say(io, sink, true, text);
}

static void post_no_link(const tl_plant_io *io, const tl_plant_io_sink *sink, const tl_modbus_read *read) {
    tl_reading reading = {.value = 0, .stamp = tl_modbus_link_now(), .quality = TL_NO_LINK};
    for (size_t i = read->first; i < read->first + read->slots; i++) {
        sink->post(sink->context, io->map.slots[i].index, &reading);
    }
}

static void post_values(const tl_plant_io *io, const tl_plant_io_sink *sink, const tl_modbus_read *read,
                        tl_time stamp) {
    for (size_t i = read->first; i < read->first + read->slots; i++) {
        const tl_modbus_slot *slot = &io->map.slots[i];
        size_t at = (size_t)(slot->channel.address - read->address);
        uint16_t bit = io->bits[at];
        const uint16_t *raw = slot->channel.type == TL_MODBUS_BIT ? &bit : &io->registers[at];
        tl_reading reading = {.stamp = stamp, .quality = TL_GOOD};
        if (!tl_modbus_decode(&slot->channel, raw, &reading.value)) {
            reading.quality = TL_NOT_A_NUMBER;
        }
        sink->post(sink->context, slot->index, &reading);
    }
}

/* One request and its response: 0, or errno. */
static int ask(tl_plant_io *io, const tl_modbus_read *read) {
    int count = -1;
    if (modbus_set_slave(io->context, read->unit_id) != 0) {
        return errno;
    }
    switch (read->table) {
    case TL_MODBUS_COIL:
        count = modbus_read_bits(io->context, read->address, read->count, io->bits);
        break;
    case TL_MODBUS_DISCRETE:
        count = modbus_read_input_bits(io->context, read->address, read->count, io->bits);
        break;
    case TL_MODBUS_HOLDING:
        count = modbus_read_registers(io->context, read->address, read->count, io->registers);
        break;
    case TL_MODBUS_INPUT:
        count = modbus_read_input_registers(io->context, read->address, read->count, io->registers);
        break;
    }
    if (count == read->count) {
        return 0;
    }
    return count < 0 ? errno : EMBBADDATA;
}

/* The device answered, but with an exception. EMBBADEXC: one that the specification does not know. */
static bool is_exception(int failure) {
    return (failure >= EMBXILFUN && failure <= EMBXGTAR) || failure == EMBBADEXC;
}

/* Would the device perhaps answer a smaller request? */
static bool is_refused_shape(int failure) {
    return failure == EMBXILADD || failure == EMBXILVAL;
}

/* Asks one request and posts what came of it; splits it first where the device does not like its shape. */
static void serve(tl_plant_io *io, size_t index, progress *now) {
    tl_modbus_read *read = &io->map.reads[index];
    int failure = ask(io, read);
    tl_time stamp = tl_modbus_link_now();
    while (is_refused_shape(failure)) {
        size_t parts = tl_modbus_map_split(&io->map, index);
        if (parts == 1) {
            break;
        }
        if (index < io->start) {
            io->start += parts - 1;
        }
        failure = ask(io, read);
        stamp = tl_modbus_link_now();
    }
    if (failure != 0 && !is_exception(failure)) {
        now->lost = true;
        now->failure = failure;
        io->start = (index + 1) % io->map.read_count;
        if (now->answered) {
            note_trouble(io, now->sink, read, failure);
            read->pause = longer(read->pause);
            read->due = stamp + read->pause;
        }
        return;
    }
    now->answered = true;
    set_link(io, now->sink, true, "connected");
    read->polled = io->polls;
    read->pause = 0;
    note_trouble(io, now->sink, read, failure);
    if (failure == 0) {
        post_values(io, now->sink, read, stamp);
    } else {
        post_no_link(io, now->sink, read);
    }
}

/* One pass over the requests; the list may grow while we go. */
static void pass(tl_plant_io *io, bool silent_ones, progress *now) {
    for (size_t visited = 0; visited < io->map.read_count && !now->lost; visited++) {
        size_t index = (io->start + visited) % io->map.read_count;
        const tl_modbus_read *read = &io->map.reads[index];
        bool wanted = silent_ones ? read->pause > 0 && tl_modbus_link_now() >= read->due : read->pause == 0;
        if (wanted && read->polled != io->polls) {
            serve(io, index, now);
        }
    }
}

/* No answer from anything: the link is down, and the next attempt waits. */
static void give_up(tl_plant_io *io, const tl_plant_io_sink *sink, const char *cause) {
    io->pause = longer(io->pause);
    io->due = tl_modbus_link_now() + io->pause;
    set_link(io, sink, false, cause);
}

/* Is there a connection, now? */
static bool connected(tl_plant_io *io, progress *now) {
    if (io->link.socket >= 0 && tl_modbus_link_stray(&io->link)) {
        tl_modbus_link_close(&io->link); /* closed by the device while idle: no reason to complain */
    }
    if (io->link.socket >= 0) {
        return true;
    }
    if (io->pause > 0 && tl_modbus_link_now() < io->due) {
        return false;
    }
    char cause[TEXT];
    if (!tl_modbus_link_connect(&io->link, io->timeout, cause, sizeof cause)) {
        now->interrupted = tl_modbus_link_interrupted(&io->link);
        if (!now->interrupted) {
            give_up(io, now->sink, cause);
        }
        return false;
    }
    (void)modbus_set_socket(io->context, io->link.socket);
    if (io->state != LINK_UP) {
        tl_modbus_map_reset(&io->map); /* it may be another device by now */
        io->start = io->start < io->map.read_count ? io->start : 0;
    }
    return true;
}

/* Asks everything that is due. */
static void converse(tl_plant_io *io, progress *now) {
    pass(io, false, now);
    pass(io, true, now);
    if (now->answered) {
        io->pause = 0;
    }
    if (now->lost) {
        tl_modbus_link_close(&io->link);
        now->interrupted = tl_modbus_link_interrupted(&io->link);
    }
    if (now->lost && !now->answered && !now->interrupted) {
        char text[TEXT];
        describe(io, now->failure, text, sizeof text);
        give_up(io, now->sink, text);
    }
}

static tl_status modbus_poll(tl_plant_io *io, const tl_plant_io_sink *sink, bool *finished, tl_error *error) {
    (void)error;
    progress now = {.sink = sink, .interrupted = tl_modbus_link_interrupted(&io->link)};
    *finished = false;
    io->polls++;
    if (!now.interrupted && connected(io, &now)) {
        converse(io, &now);
    }
    for (size_t i = 0; i < io->map.read_count && !now.interrupted; i++) {
        if (io->map.reads[i].polled != io->polls) {
            post_no_link(io, sink, &io->map.reads[i]);
        }
    }
    return TL_OK;
}

static void modbus_interrupt(tl_plant_io *io) {
    tl_modbus_link_interrupt(&io->link);
}

static void modbus_close_io(tl_plant_io *io) {
    modbus_free(io->context);
    tl_modbus_map_release(&io->map);
    tl_modbus_link_release(&io->link);
    free(io);
}

const tl_plant_io_driver tl_modbus_driver = {
    .name = "modbus_tcp", .poll = modbus_poll, .interrupt = modbus_interrupt, .close = modbus_close_io};

static tl_status check_channel(const tl_modbus_channel *channel, size_t index, tl_error *error) {
    bool bit_table = channel->table == TL_MODBUS_COIL || channel->table == TL_MODBUS_DISCRETE;
    if (channel->table < TL_MODBUS_COIL || channel->table > TL_MODBUS_INPUT) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: there is no table %d", index, (int)channel->table);
    }
    if (bit_table != (channel->type == TL_MODBUS_BIT)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: %s", index,
                       bit_table ? "coils and discrete inputs hold bits, nothing else"
                                 : "registers hold numbers, not bits");
    }
    if (channel->unit_id > 247 && channel->unit_id != 255) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: unit id %u is neither 0 to 247 nor 255", index,
                       (unsigned)channel->unit_id);
    }
    if (channel->address + tl_modbus_registers(channel->type) > 65536) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: its last register is beyond address 65535", index);
    }
    if (!isfinite(channel->scale) || channel->scale == 0 || !isfinite(channel->offset)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus channel %zu: scale must be finite and not 0, offset finite", index);
    }
    return TL_OK;
}

static tl_status check(const tl_modbus_settings *settings, tl_error *error) {
    if (settings->host == NULL || settings->host[0] == '\0') {
        return tl_fail(error, TL_BAD_DATA, "a Modbus server needs a name or an address, for example 192.168.1.17");
    }
    if (!(settings->timeout_s >= 0.001 && settings->timeout_s <= 3600)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus server %s: timeout_s is %g, but must be 0.001 to 3600",
                       settings->host, settings->timeout_s);
    }
    for (size_t i = 0; i < settings->channel_count; i++) {
        if (check_channel(&settings->channels[i], i, error) != TL_OK) {
            return TL_BAD_DATA;
        }
    }
    return TL_OK;
}

/* libmodbus's context, told to take the whole response into account, and to recover nothing by itself. */
static modbus_t *new_context(tl_time timeout) {
    modbus_t *context = modbus_new_tcp("127.0.0.1", 502); /* neither is used: the socket is ours */
    if (context != NULL) {
        (void)modbus_set_error_recovery(context, MODBUS_ERROR_RECOVERY_NONE);
        (void)modbus_set_response_timeout(context, (uint32_t)(timeout / TL_SECOND),
                                          (uint32_t)(timeout % TL_SECOND / 1000));
        (void)modbus_set_byte_timeout(context, 0, 0); /* none of its own: the response's goes on */
    }
    return context;
}

tl_status tl_modbus_open(const tl_modbus_settings *settings, tl_plant_io **io, tl_error *error) {
    tl_status status = check(settings, error);
    if (status != TL_OK) {
        return status;
    }
    tl_plant_io *made = calloc(1, sizeof *made);
    if (made == NULL || !tl_modbus_link_make(&made->link, settings->host, settings->port)) {
        status = tl_fail(error, TL_TRY_AGAIN, "Modbus server %s: %s", settings->host, strerror(errno));
        free(made);
        return status;
    }
    made->timeout = tl_time_of_seconds(settings->timeout_s);
    made->context = new_context(made->timeout);
    if (made->context == NULL || !tl_modbus_map_make(&made->map, settings->channels, settings->channel_count)) {
        modbus_free(made->context);
        tl_modbus_link_release(&made->link);
        free(made);
        return tl_fail(error, TL_TRY_AGAIN, "Modbus server %s: out of memory", settings->host);
    }
    *io = made;
    return TL_OK;
}
