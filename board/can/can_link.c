/* Socket of a CAN interface: see can_link.h. */
#include "board/can/can_link.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "board/io/monotonic.h"

/* ---- can clock ---- */

void tl_can_clock_empty(tl_can_clock *clock, tl_time monotonic, tl_time wall) {
    clock->floor = monotonic;
    clock->ahead = wall - monotonic;
    clock->known = true;
}

static bool fits(const tl_can_clock *clock, tl_time stamp, tl_time now) {
    return stamp >= clock->floor && stamp <= now;
}

static tl_time limit_stamp(const tl_can_clock *clock, tl_time stamp, tl_time now) {
    if (stamp > now) {
        return now;
    }
    return stamp < clock->floor ? clock->floor : stamp;
}

tl_time tl_can_clock_stamp(tl_can_clock *clock, tl_time received, tl_time monotonic, tl_time wall) {
    tl_time stamp = received > 0 ? received - (wall - monotonic) : monotonic;
    if (received > 0 && clock->known && !fits(clock, stamp, monotonic) &&
        fits(clock, received - clock->ahead, monotonic)) {
        stamp = received - clock->ahead;
    }
    clock->floor = limit_stamp(clock, stamp, monotonic);
    return clock->floor;
}

/* ---- can fault ---- */

/* Without those that only a sender has: lost arbitration, missing acknowledgement, time-out. */
const uint32_t tl_can_fault_classes =
    CAN_ERR_CRTL | CAN_ERR_PROT | CAN_ERR_TRX | CAN_ERR_BUSOFF | CAN_ERR_BUSERROR | CAN_ERR_RESTARTED;

enum { CONTROLLER = 1, VIOLATION = 2, LOCATION = 3, TRANSCEIVER = 4 }; /* indices of data bytes */

static tl_can_health health_of(uint32_t classes, uint8_t controller) {
    if ((classes & CAN_ERR_BUSOFF) != 0) {
        return TL_CAN_BUS_OFF;
    }
    if ((classes & CAN_ERR_RESTARTED) != 0) {
        return TL_CAN_ACTIVE;
    }
    if ((classes & CAN_ERR_CRTL) == 0) {
        return TL_CAN_SAME;
    }
    if ((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
        return TL_CAN_PASSIVE;
    }
    if ((controller & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0) {
        return TL_CAN_WARNING;
    }
    return (controller & CAN_ERR_CRTL_ACTIVE) != 0 ? TL_CAN_ACTIVE : TL_CAN_SAME;
}

static const char *violation_of(uint8_t kind, uint8_t location) {
    if (location == CAN_ERR_PROT_LOC_CRC_SEQ || location == CAN_ERR_PROT_LOC_CRC_DEL) {
        return "wrong checksums";
    }
    if ((kind & CAN_ERR_PROT_STUFF) != 0) {
        return "bit stuffing errors";
    }
    if ((kind & CAN_ERR_PROT_FORM) != 0) {
        return "frames of a wrong form";
    }
    return (kind & CAN_ERR_PROT_OVERLOAD) != 0 ? "overload frames" : "bit errors";
}

static const char *transceiver_of(uint8_t status) {
    switch (status) {
    case CAN_ERR_TRX_CANH_NO_WIRE:
        return "no wire at CAN high";
    case CAN_ERR_TRX_CANL_NO_WIRE:
        return "no wire at CAN low";
    case CAN_ERR_TRX_CANL_SHORT_TO_CANH:
        return "CAN low and CAN high are short-circuited";
    default:
        return "a fault of the transceiver or of a wire";
    }
}

tl_can_fault tl_can_fault_of(uint32_t classes, const uint8_t data[8]) {
    tl_can_fault fault = {.health = health_of(classes, data[CONTROLLER])};
    fault.overflow = (classes & CAN_ERR_CRTL) != 0 && (data[CONTROLLER] & CAN_ERR_CRTL_RX_OVERFLOW) != 0;
    if ((classes & CAN_ERR_TRX) != 0 && data[TRANSCEIVER] != CAN_ERR_TRX_UNSPEC) {
        fault.bus_error = transceiver_of(data[TRANSCEIVER]);
    } else if ((classes & (CAN_ERR_PROT | CAN_ERR_BUSERROR)) != 0) {
        fault.bus_error = violation_of(data[VIOLATION], data[LOCATION]);
    }
    return fault;
}

const char *tl_can_health_text(tl_can_health health) {
    switch (health) {
    case TL_CAN_ACTIVE:
        return "error active again: the controller counts few errors";
    case TL_CAN_WARNING:
        return "error warning: the controller counts many errors: check bit rate, termination and wiring";
    case TL_CAN_PASSIVE:
        return "error passive: the controller counts very many errors: check bit rate, termination and wiring";
    case TL_CAN_BUS_OFF:
        return "bus-off: the controller has left the bus: check bit rate, termination and wiring; set `restart-ms`, so that "
               "it restarts";
    case TL_CAN_SAME:
        break;
    }
    return "";
}

/* ---- Raw CAN socket that only listens.
 *
 * Options set before bind() apply from the first frame on. Loopback and own messages are off,
 * although nothing is sent.
 */

enum { QUEUE = 1024 * 1024 }; /* bytes; the kernel allows at most net.core.rmem_max */

/* Control data of a frame. */
typedef union ancillary {
    struct cmsghdr align;
    char bytes[CMSG_SPACE(sizeof(struct timespec)) + CMSG_SPACE(sizeof(uint32_t))];
} ancillary;

static tl_time wall_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

static void read_clocks(tl_can_link *link) {
    link->monotonic = tl_monotonic_now();
    link->wall = wall_now();
}

bool tl_can_link_make(tl_can_link *link, const char *interface) {
    memset(link, 0, sizeof *link);
    (void)snprintf(link->interface, sizeof link->interface, "%s", interface);
    link->socket = -1;
    return tl_wake_make(&link->wake);
}

/* ---- open ---- */

static bool set(int socket, int level, int option, int value) {
    return setsockopt(socket, level, option, &value, sizeof value) == 0;
}

/* No remote requests, and no extended id for a standard one. */
static bool set_filters(int socket, const tl_can_map *map) {
    struct can_filter filters[CAN_RAW_FILTER_MAX];
    if (map->id_count > CAN_RAW_FILTER_MAX) {
        errno = EINVAL;
        return false;
    }
    for (size_t i = 0; i < map->id_count; i++) {
        bool extended = map->ids[i].extended;
        filters[i].can_id = map->ids[i].id | (extended ? CAN_EFF_FLAG : 0U);
        filters[i].can_mask =
            CAN_EFF_FLAG | CAN_RTR_FLAG | (map->ids[i].mask & (extended ? CAN_EFF_MASK : CAN_SFF_MASK));
    }
    return setsockopt(socket, SOL_CAN_RAW, CAN_RAW_FILTER, filters, (socklen_t)(map->id_count * sizeof filters[0])) ==
           0;
}

static bool set_options(int socket, const tl_can_map *map) {
    can_err_mask_t errors = tl_can_fault_classes;
    (void)set(socket, SOL_SOCKET, SO_RCVBUF, QUEUE);
    (void)set(socket, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 1); /* without effect in a kernel without CAN FD */
    return set_filters(socket, map) &&
           setsockopt(socket, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) == 0 &&
           set(socket, SOL_CAN_RAW, CAN_RAW_LOOPBACK, 0) && set(socket, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, 0) &&
           set(socket, SOL_SOCKET, SO_TIMESTAMPNS, 1) && set(socket, SOL_SOCKET, SO_RXQ_OVFL, 1);
}

static void copy_text(const char *reason, char *cause, size_t cause_size) {
    (void)snprintf(cause, cause_size, "%s", reason);
}

static bool bind_to(const tl_can_link *link, int socket, char *cause, size_t cause_size) {
    int index = tl_can_interface_index(socket, link->interface);
    if (index == 0) {
        copy_text(errno == ENODEV ? "no interface has this name: see `ip link`; plug it in, or load its driver"
                                  : strerror(errno),
                  cause, cause_size);
        return false;
    }
    if (!tl_can_interface_bind(socket, index)) {
        copy_text(errno == ENODEV ? "this is not a CAN interface: see `ip -details link`" : strerror(errno), cause,
                  cause_size);
        return false;
    }
    return true;
}

bool tl_can_link_open(tl_can_link *link, const tl_can_map *map, char *cause, size_t cause_size) {
    int made = tl_can_interface_open();
    if (made < 0) {
        copy_text(tl_can_interface_failure(errno), cause, cause_size);
        return false;
    }
    bool done = set_options(made, map);
    if (!done) {
        (void)snprintf(cause, cause_size, "the kernel refuses an option of the socket: %s", strerror(errno));
    }
    if (!done || !bind_to(link, made, cause, cause_size)) {
        (void)close(made);
        return false;
    }
    link->socket = made;
    link->overflow = 0;
    read_clocks(link);
    tl_can_clock_empty(&link->clock, link->monotonic, link->wall);
    return true;
}

bool tl_can_link_state(const tl_can_link *link, tl_can_state *state) {
    return tl_can_interface_probe(link->socket, link->interface, state);
}

void tl_can_link_close(tl_can_link *link) {
    if (link->socket >= 0) {
        (void)close(link->socket);
        link->socket = -1;
    }
}

void tl_can_link_release(tl_can_link *link) {
    tl_can_link_close(link);
    tl_wake_release(&link->wake);
}

/* ---- receive ---- */

bool tl_can_link_await(tl_can_link *link, int timeout_ms) {
    struct pollfd both[2] = {{.fd = link->wake.descriptor, .events = POLLIN}, {.fd = link->socket, .events = POLLIN}};
    return poll(both, 2, timeout_ms) <= 0 || both[0].revents == 0 || !tl_wake_clear(&link->wake);
}

void tl_can_link_interrupt(tl_can_link *link) {
    tl_wake_call(&link->wake);
}

/* Wall clock stamp of a message, 0 if it has none; also reads the kernel's count of dropped frames.
 */
static tl_time read_ancillary(tl_can_link *link, struct msghdr *message, tl_can_frame *frame) {
    struct timespec stamp = {.tv_sec = 0};
    uint32_t overflow = link->overflow;
    for (struct cmsghdr *one = CMSG_FIRSTHDR(message); one != NULL; one = CMSG_NXTHDR(message, one)) {
        if (one->cmsg_level == SOL_SOCKET && one->cmsg_type == SCM_TIMESTAMPNS) {
            memcpy(&stamp, CMSG_DATA(one), sizeof stamp);
        } else if (one->cmsg_level == SOL_SOCKET && one->cmsg_type == SO_RXQ_OVFL) {
            memcpy(&overflow, CMSG_DATA(one), sizeof overflow);
        }
    }
    frame->lost = overflow - link->overflow; /* modulo 2³², as the kernel counts */
    link->overflow = overflow;
    return (tl_time)stamp.tv_sec * TL_SECOND + stamp.tv_nsec;
}

static tl_can_arrival take_frame(const struct canfd_frame *from, size_t size, tl_can_frame *frame) {
    if (size != CAN_MTU && size != CANFD_MTU) {
        return TL_CAN_OTHER;
    }
    if ((from->can_id & CAN_ERR_FLAG) != 0) {
        frame->fault = tl_can_fault_of(from->can_id, from->data);
        return TL_CAN_ERROR;
    }
    size_t room = size == CAN_MTU ? CAN_MAX_DLEN : CANFD_MAX_DLEN;
    frame->extended = (from->can_id & CAN_EFF_FLAG) != 0;
    frame->id = from->can_id & (frame->extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame->length = (uint8_t)(from->len < room ? from->len : room);
    memcpy(frame->data, from->data, frame->length);
    return (from->can_id & CAN_RTR_FLAG) != 0 ? TL_CAN_OTHER : TL_CAN_DATA;
}

static tl_can_arrival failure_of(int reason) {
    if (reason == EAGAIN || reason == EINTR) {
        return TL_CAN_NOTHING;
    }
    return reason == ENETDOWN ? TL_CAN_DOWN : TL_CAN_LOST;
}

tl_can_arrival tl_can_link_receive(tl_can_link *link, tl_can_frame *frame) {
    struct canfd_frame from;
    ancillary control;
    struct iovec buffer = {.iov_base = &from, .iov_len = sizeof from};
    struct msghdr message = {
        .msg_iov = &buffer, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    memset(&from, 0, sizeof from);
    memset(frame, 0, sizeof *frame);
    ssize_t size = recvmsg(link->socket, &message, MSG_DONTWAIT);
    int reason = errno;
    if (size < 0) {
        if (reason == EAGAIN) { /* the queue was empty at the last reading of the clocks, or has become empty since */
            tl_can_clock_empty(&link->clock, link->monotonic, link->wall);
            read_clocks(link);
        }
        errno = reason;
        return failure_of(reason);
    }
    read_clocks(link);
    tl_time received = read_ancillary(link, &message, frame);
    frame->stamp = tl_can_clock_stamp(&link->clock, received, link->monotonic, link->wall);
    return take_frame(&from, (size_t)size, frame);
}
