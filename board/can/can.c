/* SocketCAN driver: link state, decoding of frames, and reports.
 *
 * The socket stays usable if its interface is set down and up again, so it is kept; it is opened
 * again only if the interface was removed. The kernel does not report that an interface has come
 * up, so its state is polled with back-off. The kernel reports that it goes down (ENETDOWN), is
 * removed (ENODEV), or has left the bus (an error frame).
 */
#include "board/can/can.h"

#include <inttypes.h>
#include <linux/can.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "board/can/can_codec.h"
#include "board/can/can_link.h"
#include "board/io/link.h"
#include "board/io/monotonic.h"

enum { WAIT_MS = 50, FRAMES = 512, TEXT = 384 };

/* Problems that may persist; reported at most once per second. */
typedef struct tally {
    uint64_t dropped;    /* by the kernel */
    uint64_t overflows;  /* of the controller */
    uint64_t bus_errors; /* error frames */
    const char *bus_error;
    tl_time due;
} tally;

struct tl_plant_io {
    char name[16 + TL_CAN_INTERFACE]; /* for messages */
    tl_can_link link;
    tl_can_map map;
    tl_link state;
    tl_can_health health;
    bool wants_fd;      /* a signal needs a CAN FD frame */
    bool bus_off;       /* an error frame reported bus-off, and none has ended it yet */
    tl_backoff backoff; /* of searches for the interface */
    tally tally;
};

/* ---- reports ---- */

/* Sets the link down; the next search waits. */
static void set_link_down(tl_plant_io *io, const tl_plant_io_sink *sink, const char *cause) {
    tl_backoff_fail(&io->backoff, tl_monotonic_now());
    (void)tl_link_set(&io->state, sink, false, io->name, cause);
}

static void report_tally(tl_plant_io *io, const tl_plant_io_sink *sink) {
    tally *now = &io->tally;
    char text[TEXT] = "";
    size_t used = 0;
    if (now->dropped + now->overflows + now->bus_errors == 0) {
        return;
    }
    if (now->dropped > 0) {
        used += (size_t)snprintf(text + used, sizeof text - used,
                                 "%" PRIu64 " frames lost: they came faster than the box read them. ", now->dropped);
    }
    if (now->overflows > 0) {
        used += (size_t)snprintf(text + used, sizeof text - used, "the controller lost frames %" PRIu64 " times. ",
                                 now->overflows);
    }
    if (now->bus_errors > 0) {
        used += (size_t)snprintf(text + used, sizeof text - used,
                                 "%" PRIu64 " errors on the bus (%s): check bit rate, termination and wiring. ",
                                 now->bus_errors, now->bus_error);
    }
    text[used - 2] = '\0'; /* without the last separator */
    tl_link_report(&io->state, sink, false, io->name, text);
    *now = (tally){.due = tl_monotonic_now() + TL_SECOND};
}

/* ---- the interface ---- */

/* Reads the state of the interface, sets the link up or down, and reports a change. */
static void check_interface(tl_plant_io *io, const tl_plant_io_sink *sink) {
    char text[TEXT];
    tl_can_state state;
    if (!tl_can_link_state(&io->link, &state)) {
        tl_can_link_close(&io->link);
        set_link_down(io, sink, "the interface is gone: plug it in, or load its driver");
    } else if (!state.up) {
        (void)snprintf(
            text, sizeof text,
            "the interface is down: run `ip link set %s up type can bitrate 500000`, with the bit rate of the bus",
            io->link.interface);
        set_link_down(io, sink, text);
    } else if (!state.running) {
        io->bus_off = false; /* from now on the carrier shows it */
        set_link_down(
            io, sink,
            "the interface is not on the bus (bus-off, or no carrier): check bit rate, termination and wiring");
    } else if (io->bus_off) {
        set_link_down(io, sink, tl_can_health_text(TL_CAN_BUS_OFF));
    } else {
        tl_backoff_reset(&io->backoff);
        bool fits = state.fd || !io->wants_fd;
        if (tl_link_change(&io->state, true)) {
            tl_link_report(&io->state, sink, fits, io->name,
                           fits ? "is up"
                                : "is up, but not for CAN FD, which its signals need: set it up with `fd on`");
        }
    }
}

/* Opens the socket if there is none, and reads the state. */
static void open_and_check(tl_plant_io *io, const tl_plant_io_sink *sink) {
    char cause[TEXT];
    if (!tl_backoff_is_due(&io->backoff, tl_monotonic_now())) {
        return;
    }
    if (io->link.socket < 0) {
        io->bus_off = false;
        io->health = TL_CAN_ACTIVE;
        if (!tl_can_link_open(&io->link, &io->map, cause, sizeof cause)) {
            set_link_down(io, sink, cause);
            return;
        }
    }
    check_interface(io, sink);
}

/* ---- frames ---- */

static void post(const tl_plant_io_sink *sink, const tl_can_entry *entry, const tl_can_frame *frame) {
    tl_reading reading = {.stamp = frame->stamp, .quality = TL_GOOD};
    if (frame->length < entry->bytes || !tl_can_decode(&entry->channel, frame->data, &reading.value)) {
        reading.quality = TL_NOT_A_NUMBER;
    }
    sink->post(sink->context, entry->index, &reading);
}

/* Reports once that frames of an id are too short, and once that they are long enough again. */
static void note_length(tl_plant_io *io, const tl_plant_io_sink *sink, tl_can_id *id, const tl_can_frame *frame,
                        size_t needed) {
    char text[TEXT];
    char name[32];
    bool too_short = frame->length < needed;
    if (id->too_short != too_short) {
        id->too_short = too_short;
        if (id->is_pgn) {
            (void)snprintf(name, sizeof name, "PGN %" PRIu32, id->id >> 8 & 0x3FFFF);
        } else {
            (void)snprintf(name, sizeof name, "id 0x%" PRIX32, id->id);
        }
        (void)snprintf(text, sizeof text, "frames of %s have %u bytes, %s", name, (unsigned)frame->length,
                       too_short ? "too few for their signals: correct bytes or start"
                                 : "enough for their signals again");
        tl_link_report(&io->state, sink, !too_short, io->name, text);
    }
}

static void post_signals(tl_plant_io *io, const tl_plant_io_sink *sink, tl_can_id *id, const tl_can_frame *frame) {
    size_t needed = 0;
    for (size_t i = id->first; i < id->first + id->entries; i++) {
        const tl_can_entry *entry = &io->map.entries[i];
        if (tl_can_is_present(&entry->channel, frame->data)) {
            needed = entry->bytes > needed ? entry->bytes : needed;
            post(sink, entry, frame);
        }
    }
    note_length(io, sink, id, frame, needed);
}

static void handle_data(tl_plant_io *io, const tl_plant_io_sink *sink, const tl_can_frame *frame) {
    tl_can_id *id = tl_can_map_find(&io->map, NULL, frame->id, frame->extended);
    if (id == NULL) {
        return;
    }
    io->bus_off = false;
    if (!tl_link_is_up(&io->state)) {
        tl_backoff_reset(&io->backoff); /* the interface works if frames come */
        open_and_check(io, sink);
    }
    for (; id != NULL; id = tl_can_map_find(&io->map, id, frame->id, frame->extended)) {
        post_signals(io, sink, id, frame);
    }
}

static void handle_health(tl_plant_io *io, const tl_plant_io_sink *sink, tl_can_health health) {
    if (health == TL_CAN_SAME || health == io->health) {
        return;
    }
    io->health = health;
    io->bus_off = health == TL_CAN_BUS_OFF;
    if (io->bus_off) {
        set_link_down(io, sink, tl_can_health_text(health));
    } else if (tl_link_is_up(&io->state)) {
        tl_link_report(&io->state, sink, health == TL_CAN_ACTIVE, io->name, tl_can_health_text(health));
    } else {
        tl_backoff_reset(&io->backoff); /* it may have recovered */
        open_and_check(io, sink);
    }
}

static void handle_error(tl_plant_io *io, const tl_plant_io_sink *sink, const tl_can_fault *fault) {
    io->tally.overflows += fault->overflow ? 1 : 0;
    if (fault->bus_error != NULL) {
        io->tally.bus_errors++;
        io->tally.bus_error = fault->bus_error;
    }
    handle_health(io, sink, fault->health);
}

/* Handles one arrival. Returns false if it was the last one for now. */
static bool handle_arrival(tl_plant_io *io, const tl_plant_io_sink *sink, tl_can_arrival arrival,
                           const tl_can_frame *frame) {
    io->tally.dropped += frame->lost;
    switch (arrival) {
    case TL_CAN_DATA:
        handle_data(io, sink, frame);
        return io->link.socket >= 0;
    case TL_CAN_ERROR:
        handle_error(io, sink, &frame->fault);
        return io->link.socket >= 0;
    case TL_CAN_OTHER:
        return true;
    case TL_CAN_DOWN: /* its state follows */
        io->bus_off = false;
        io->health = TL_CAN_ACTIVE;
        tl_backoff_reset(&io->backoff);
        open_and_check(io, sink);
        return io->link.socket >= 0;
    case TL_CAN_LOST:
        tl_can_link_close(&io->link);
        set_link_down(io, sink, "the interface is gone: plug it in, or load its driver");
        return false;
    case TL_CAN_NOTHING:
        break;
    }
    return false;
}

static void post_no_link(const tl_plant_io *io, const tl_plant_io_sink *sink) {
    const tl_reading reading = {.value = 0, .stamp = tl_monotonic_now(), .quality = TL_NO_LINK};
    for (size_t i = 0; i < io->map.entry_count; i++) {
        sink->post(sink->context, io->map.entries[i].index, &reading);
    }
}

/* ---- the driver ---- */

static void can_poll(tl_plant_io *io, const tl_plant_io_sink *sink) {
    if (!tl_link_is_up(&io->state)) {
        open_and_check(io, sink);
    }
    bool not_interrupted = tl_can_link_await(&io->link, WAIT_MS);
    for (int i = 0; not_interrupted && i < FRAMES && io->link.socket >= 0; i++) {
        tl_can_frame frame;
        tl_can_arrival arrival = tl_can_link_receive(&io->link, &frame);
        if (!handle_arrival(io, sink, arrival, &frame)) {
            break;
        }
    }
    if (tl_monotonic_now() >= io->tally.due) {
        report_tally(io, sink);
    }
    if (!tl_link_is_up(&io->state)) {
        post_no_link(io, sink);
    }
}

static void can_interrupt(tl_plant_io *io) {
    tl_can_link_interrupt(&io->link);
}

static void can_finish(tl_plant_io *io, const tl_plant_io_sink *sink) {
    report_tally(io, sink);
}

static void can_close(tl_plant_io *io) {
    tl_can_link_release(&io->link);
    tl_can_map_release(&io->map);
    free(io);
}

const tl_plant_io_driver tl_can_driver = {
    .name = "can", .poll = can_poll, .interrupt = can_interrupt, .finish = can_finish, .close = can_close};

/* ---- access ---- */

static const tl_plant_socket sockets[] = {{AF_CAN, SOCK_RAW, CAN_RAW}};
static const uint32_t commands[] = {SIOCGIFINDEX, SIOCGIFFLAGS, SIOCGIFMTU};

const tl_plant_access tl_can_access = {
    .calls = "getsockopt setsockopt recvmsg",
    .sockets = sockets,
    .socket_count = sizeof sockets / sizeof sockets[0],
    .bind_address_bytes = sizeof(struct sockaddr_can),
    .commands = commands,
    .command_count = sizeof commands / sizeof commands[0],
};

/* ---- open ---- */

static bool fits_field(const tl_can_field *field, unsigned most, unsigned bytes) {
    return field->length >= 1 && field->length <= most && tl_can_field_bytes(field) <= bytes;
}

static bool fits_type(const tl_can_channel *channel) {
    return (channel->type != TL_CAN_FLOAT32 || channel->field.length == 32) &&
           (channel->type != TL_CAN_FLOAT64 || channel->field.length == 64);
}

static bool fits_conditions(const tl_can_channel *channel) {
    bool fits = channel->condition_count <= TL_CAN_CONDITIONS;
    for (size_t i = 0; fits && i < channel->condition_count; i++) {
        const tl_can_condition *condition = &channel->conditions[i];
        fits = condition->value_count >= 1 && condition->value_count <= TL_CAN_CONDITION_VALUES &&
               fits_field(&condition->field, TL_CAN_MULTIPLEXOR_BITS, channel->bytes);
    }
    return fits;
}

static tl_status check_channel(const tl_can_channel *channel, size_t index, tl_error *error) {
    if (channel->id > (channel->extended ? 0x1FFFFFFFU : 0x7FFU)) {
        return tl_fail(error, TL_BAD_DATA, "CAN channel %zu: id 0x%" PRIX32 " has more than %d bits", index,
                       channel->id, channel->extended ? 29 : 11);
    }
    if (!tl_can_is_length(channel->bytes)) {
        return tl_fail(error, TL_BAD_DATA, "CAN channel %zu: bytes is %u, but no CAN frame has that length", index,
                       (unsigned)channel->bytes);
    }
    if (!fits_field(&channel->field, 64, channel->bytes) || !fits_type(channel)) {
        return tl_fail(error, TL_BAD_DATA, "CAN channel %zu: %u bits from %u on do not fit its frame or its type",
                       index, (unsigned)channel->field.length, (unsigned)channel->field.start);
    }
    if (!fits_conditions(channel)) {
        return tl_fail(error, TL_BAD_DATA, "CAN channel %zu: a multiplexor does not fit its frame", index);
    }
    if (!isfinite(channel->scale) || channel->scale == 0 || !isfinite(channel->offset)) {
        return tl_fail(error, TL_BAD_DATA,
                       "CAN channel %zu: scale is %g, offset is %g (expected finite values, scale not 0)", index,
                       channel->scale, channel->offset);
    }
    return TL_OK;
}

static tl_status check(const tl_can_settings *settings, tl_error *error) {
    size_t length = strlen(settings->interface);
    if (length == 0 || length > TL_CAN_INTERFACE) {
        return tl_fail(error, TL_BAD_DATA, "CAN interface \"%s\": the name must have 1 to %d characters",
                       settings->interface, (int)TL_CAN_INTERFACE);
    }
    for (size_t i = 0; i < settings->channel_count; i++) {
        tl_status status = check_channel(&settings->channels[i], i, error);
        if (status != TL_OK) {
            return status;
        }
    }
    return TL_OK;
}

tl_status tl_can_open(const tl_can_settings *settings, tl_plant_io **io, tl_error *error) {
    tl_status status = check(settings, error);
    if (status != TL_OK) {
        return status;
    }
    tl_plant_io *made = calloc(1, sizeof *made);
    if (made == NULL || !tl_can_map_make(&made->map, settings->channels, settings->channel_count)) {
        free(made);
        return tl_fail(error, TL_TRY_AGAIN, "CAN interface %s: not enough memory", settings->interface);
    }
    if (!tl_can_link_make(&made->link, settings->interface)) {
        tl_can_map_release(&made->map);
        free(made);
        return tl_fail(error, TL_TRY_AGAIN, "CAN interface %s: cannot create an event descriptor", settings->interface);
    }
    for (size_t i = 0; i < made->map.entry_count; i++) {
        made->wants_fd = made->wants_fd || made->map.entries[i].bytes > 8;
    }
    (void)snprintf(made->name, sizeof made->name, "CAN interface %s", settings->interface);
    *io = made;
    return TL_OK;
}
