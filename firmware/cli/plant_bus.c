/* Emulated plant on a CAN bus: see plant_bus.h. */
#include "firmware/cli/plant_bus.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "board/can/can_interface.h"

struct tl_plant_bus {
    char interface[IFNAMSIZ];
    int socket; /* −1: the interface is gone */
    tl_can_channel channels[TL_MAX_SIGNALS];
    bool known[TL_MAX_SIGNALS]; /* has had a value */
    size_t channel_count;
    tl_plant_bus_frame frames[TL_MAX_SIGNALS];
    size_t frame_count;
    tl_plant_bus_counts counts;
};

/* ---- the frames ---- */

/* Sets the multiplexors to the state that a channel requires. */
static void put_multiplexors(const tl_can_channel *channel, uint8_t *data) {
    memset(data, 0, TL_CAN_BYTES);
    for (size_t i = 0; i < channel->condition_count; i++) {
        tl_can_write_bits(&channel->conditions[i].field, channel->conditions[i].values[0], data);
    }
}

/* Returns true if the channel is in the frame of another channel with more conditions, so that it
 * needs no frame of its own. */
static bool is_carried(const tl_can_channel *channels, size_t count, size_t index) {
    uint8_t data[TL_CAN_BYTES];
    for (size_t i = 0; i < count; i++) {
        if (channels[i].condition_count > channels[index].condition_count && channels[i].id == channels[index].id &&
            channels[i].extended == channels[index].extended) {
            put_multiplexors(&channels[i], data);
            if (tl_can_is_present(&channels[index], data)) {
                return true;
            }
        }
    }
    return false;
}

static bool is_planned(const tl_plant_bus_frame *frames, size_t count, const tl_can_channel *channel,
                       const uint8_t *data) {
    for (size_t i = 0; i < count; i++) {
        if (frames[i].id == channel->id && frames[i].extended == channel->extended &&
            memcmp(frames[i].data, data, TL_CAN_BYTES) == 0) {
            return true;
        }
    }
    return false;
}

static void fill(tl_plant_bus_frame *frame, const tl_can_channel *channels, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const tl_can_channel *channel = &channels[i];
        frame->members[i] =
            channel->id == frame->id && channel->extended == frame->extended && tl_can_is_present(channel, frame->data);
        if (frame->members[i]) {
            frame->bytes = channel->bytes > frame->bytes ? channel->bytes : frame->bytes;
            frame->fd = frame->fd || channel->fd;
        }
    }
}

size_t tl_plant_bus_plan(const tl_can_channel *channels, size_t count, tl_plant_bus_frame *frames) {
    size_t planned = 0;
    for (size_t i = 0; i < count; i++) {
        uint8_t data[TL_CAN_BYTES];
        put_multiplexors(&channels[i], data);
        if (is_carried(channels, count, i) || is_planned(frames, planned, &channels[i], data)) {
            continue;
        }
        frames[planned] = (tl_plant_bus_frame){.id = channels[i].id, .extended = channels[i].extended};
        memcpy(frames[planned].data, data, TL_CAN_BYTES);
        fill(&frames[planned], channels, count);
        planned++;
    }
    return planned;
}

/* ---- sending ---- */

/* Opens a socket that receives nothing. Returns −1 and sets errno on failure. */
static int open_socket(const tl_plant_bus *bus) {
    int one = 1;
    int made = tl_can_interface_open();
    if (made < 0) {
        return -1;
    }
    (void)setsockopt(made, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &one, sizeof one);
    int index =
        setsockopt(made, SOL_CAN_RAW, CAN_RAW_FILTER, &one, 0) == 0 ? tl_can_interface_index(made, bus->interface) : 0;
    if (index != 0 && tl_can_interface_bind(made, index)) {
        return made;
    }
    int failure = errno;
    (void)close(made);
    errno = failure;
    return -1;
}

static void send_frame(tl_plant_bus *bus, const tl_plant_bus_frame *frame) {
    struct canfd_frame out = {.can_id = frame->id | (frame->extended ? CAN_EFF_FLAG : 0U), .len = frame->bytes};
    size_t size = frame->fd ? CANFD_MTU : CAN_MTU;
    memcpy(out.data, frame->data, frame->bytes);
    if (bus->socket < 0) {
        bus->socket = open_socket(bus);
    }
    bool sent = bus->socket >= 0 && write(bus->socket, &out, size) == (ssize_t)size;
    bus->counts.sent += sent ? 1 : 0;
    bus->counts.dropped += sent ? 0 : 1;
    if (!sent && bus->socket >= 0 && errno != ENETDOWN && errno != ENOBUFS && errno != EAGAIN) {
        (void)close(bus->socket); /* the interface that it was bound to is gone */
        bus->socket = -1;
    }
}

/* Encodes a row into one frame. Returns true if the frame has a new value and all its channels have
 * had one. */
static bool update(tl_plant_bus *bus, tl_plant_bus_frame *frame, const double *values, const bool *present) {
    bool changed = false;
    bool whole = true;
    for (size_t i = 0; i < bus->channel_count; i++) {
        if (frame->members[i] && present[i]) {
            tl_can_encode(&bus->channels[i], values[i], frame->data);
            changed = true;
        }
        whole = whole && (!frame->members[i] || bus->known[i]);
    }
    return changed && whole;
}

void tl_plant_bus_row(tl_plant_bus *bus, const double *values, const bool *present) {
    for (size_t i = 0; i < bus->channel_count; i++) {
        bus->known[i] = bus->known[i] || present[i];
    }
    for (size_t i = 0; i < bus->frame_count; i++) {
        if (update(bus, &bus->frames[i], values, present)) {
            send_frame(bus, &bus->frames[i]);
        }
    }
}

tl_plant_bus_counts tl_plant_bus_count(const tl_plant_bus *bus) {
    return bus->counts;
}

/* ---- open and close ---- */

static tl_status check_interface(tl_plant_bus *bus, bool real, tl_error *error) {
    tl_can_state state;
    bool needs_fd = false;
    char path[64 + IFNAMSIZ]; /* of an interface without hardware: it exists only there */
    for (size_t i = 0; i < bus->frame_count; i++) {
        needs_fd = needs_fd || bus->frames[i].fd;
    }
    (void)snprintf(path, sizeof path, "/sys/devices/virtual/net/%s", bus->interface);
    bus->socket = open_socket(bus);
    if (bus->socket < 0) {
        return tl_fail(
            error, TL_TRY_AGAIN,
            "CAN interface %s: %s; for a virtual one, run `ip link add %s type vcan` and `ip link set %s up`",
            bus->interface, tl_can_interface_failure(errno), bus->interface, bus->interface);
    }
    if (!real && access(path, F_OK) != 0) {
        return tl_fail(
            error, TL_BAD_USAGE,
            "CAN interface %s is hardware: the frames would reach all devices on its bus. Use a virtual interface "
            "(vcan), or permit it with --real-bus",
            bus->interface);
    }
    if (needs_fd && !(tl_can_interface_probe(bus->socket, bus->interface, &state) && state.fd)) {
        return tl_fail(
            error, TL_TRY_AGAIN,
            "CAN interface %s does not support CAN FD: for a virtual one, run `ip link set %s mtu 72` while it is "
            "down",
            bus->interface, bus->interface);
    }
    return TL_OK;
}

tl_status tl_plant_bus_open(const tl_plant_bus_settings *settings, tl_plant_bus **bus, tl_error *error) {
    tl_plant_bus *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "CAN interface %s: out of memory", settings->interface);
    }
    (void)snprintf(made->interface, sizeof made->interface, "%s", settings->interface);
    made->channel_count = settings->channel_count;
    memcpy(made->channels, settings->channels, settings->channel_count * sizeof made->channels[0]);
    made->frame_count = tl_plant_bus_plan(made->channels, made->channel_count, made->frames);
    tl_status status = check_interface(made, settings->real, error);
    if (status != TL_OK) {
        tl_plant_bus_close(made);
        return status;
    }
    *bus = made;
    return TL_OK;
}

void tl_plant_bus_close(tl_plant_bus *bus) {
    if (bus->socket >= 0) {
        (void)close(bus->socket);
    }
    free(bus);
}
