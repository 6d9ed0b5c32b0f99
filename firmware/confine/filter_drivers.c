/* What the drivers of a plant need besides, to connect again: see filter.h.
 *
 * A filter sees numbers, not what lies in memory: addresses and the flags of a GPIO request are unseen. So each kind of source allows only its own
 * sockets and device commands. Landlock binds TCP to ports. It looks at connect() only, and at plain TCP only, so two ways around it are refused here:
 * other protocols of the same socket type (MPTCP, SCTP), and connecting by sending (MSG_FASTOPEN).
 */
#include "firmware/confine/filter_parts.h"

#include <linux/can.h>
#include <linux/gpio.h>
#include <linux/netlink.h>
#include <linux/serial.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>

#include "firmware/confine/confine.h"

#define COUNT(array) (sizeof(array) / sizeof(array)[0])
#define MASKED(n, mask, value) ((struct scmp_arg_cmp){(n), SCMP_CMP_MASKED_EQ, (mask), (value)})
#define IS(n, value) MASKED(n, UINT32_MAX, (uint32_t)(value))

enum { KINDS = 0x0f }; /* of sockets: the rest are flags */

/* The calls that a kind of source needs whatever their arguments. */
static const struct {
    unsigned drivers;
    const char *calls;
} calls[] = {
    {TL_CONFINE_TCP | TL_CONFINE_NAMES, "connect shutdown getsockname getpeername getsockopt setsockopt recv recvfrom"},
    {TL_CONFINE_NAMES, "recvmsg"},
    {TL_CONFINE_CAN, "getsockopt setsockopt recvmsg"},
};

static const struct {
    unsigned drivers;
    int family;
    int kind;
    int protocol;
} sockets[] = {
    {TL_CONFINE_TCP | TL_CONFINE_NAMES, AF_INET, SOCK_STREAM, 0},
    {TL_CONFINE_TCP | TL_CONFINE_NAMES, AF_INET, SOCK_STREAM, IPPROTO_TCP},
    {TL_CONFINE_TCP | TL_CONFINE_NAMES, AF_INET6, SOCK_STREAM, 0},
    {TL_CONFINE_TCP | TL_CONFINE_NAMES, AF_INET6, SOCK_STREAM, IPPROTO_TCP},
    {TL_CONFINE_NAMES, AF_INET, SOCK_DGRAM, 0},
    {TL_CONFINE_NAMES, AF_INET, SOCK_DGRAM, IPPROTO_UDP},
    {TL_CONFINE_NAMES, AF_INET6, SOCK_DGRAM, 0},
    {TL_CONFINE_NAMES, AF_INET6, SOCK_DGRAM, IPPROTO_UDP},
    {TL_CONFINE_NAMES, AF_NETLINK, SOCK_RAW, NETLINK_ROUTE}, /* which addresses this machine has itself */
    {TL_CONFINE_CAN, AF_CAN, SOCK_RAW, CAN_RAW},
};

/* Nobody can listen, so an address of that length does no harm elsewhere. */
static const struct {
    unsigned drivers;
    uint32_t size;
} addresses[] = {{TL_CONFINE_CAN, sizeof(struct sockaddr_can)}, {TL_CONFINE_NAMES, sizeof(struct sockaddr_nl)}};

static const struct {
    unsigned drivers;
    uint32_t command;
} device_commands[] = {
    {TL_CONFINE_CAN | TL_CONFINE_NAMES, SIOCGIFINDEX},
    {TL_CONFINE_CAN, SIOCGIFFLAGS},
    {TL_CONFINE_CAN, SIOCGIFMTU},
    {TL_CONFINE_SERIAL, TCSETS},
    {TL_CONFINE_SERIAL, TCSETSW},
    {TL_CONFINE_SERIAL, TCSETSF},
    {TL_CONFINE_SERIAL, TCFLSH},
    {TL_CONFINE_SERIAL, TCSBRK},
    {TL_CONFINE_SERIAL, TIOCEXCL},
    {TL_CONFINE_SERIAL, TIOCNXCL},
    {TL_CONFINE_SERIAL, TIOCMGET},
    {TL_CONFINE_SERIAL, TIOCGRS485},
    {TL_CONFINE_SERIAL, TIOCSRS485},
    {TL_CONFINE_GPIO, GPIO_GET_CHIPINFO_IOCTL},
    {TL_CONFINE_GPIO, GPIO_GET_LINEINFO_IOCTL},
    {TL_CONFINE_GPIO, GPIO_GET_LINEHANDLE_IOCTL},
    {TL_CONFINE_GPIO, GPIO_GET_LINEEVENT_IOCTL},
    {TL_CONFINE_GPIO, GPIOHANDLE_GET_LINE_VALUES_IOCTL},
    {TL_CONFINE_GPIO, GPIO_V2_GET_LINEINFO_IOCTL},
    {TL_CONFINE_GPIO, GPIO_V2_GET_LINE_IOCTL},
    {TL_CONFINE_GPIO, GPIO_V2_LINE_GET_VALUES_IOCTL},
};

static int allow_if(scmp_filter_ctx context, const char *call, const struct scmp_arg_cmp *conditions, unsigned count) {
    return tl_filter_add(context, SCMP_ACT_ALLOW, call, conditions, count);
}

/* Sending on a connection has no address; looking names up gives one, but for TCP. */
static int add_sending(scmp_filter_ctx context, unsigned drivers) {
    const struct scmp_arg_cmp connected[] = {MASKED(3, MSG_FASTOPEN, 0), {4, SCMP_CMP_EQ, 0, 0}};
    const struct scmp_arg_cmp flags_2 = MASKED(2, MSG_FASTOPEN, 0);
    const struct scmp_arg_cmp flags_3 = MASKED(3, MSG_FASTOPEN, 0);
    int failure = 0;
    if ((drivers & TL_CONFINE_NAMES) != 0) {
        failure = allow_if(context, "sendto", &flags_3, 1);
        failure = failure != 0 ? failure : allow_if(context, "sendmsg", &flags_2, 1);
        failure = failure != 0 ? failure : allow_if(context, "sendmmsg", &flags_3, 1);
    } else if ((drivers & TL_CONFINE_TCP) != 0) {
        failure = allow_if(context, "sendto", connected, COUNT(connected));
    }
    if ((drivers & (TL_CONFINE_NAMES | TL_CONFINE_TCP)) != 0) {
        failure = failure != 0 ? failure : allow_if(context, "send", &flags_3, 1);
    }
    return failure;
}

static int add_sockets(scmp_filter_ctx context, unsigned drivers) {
    int failure = 0;
    for (size_t i = 0; i < COUNT(sockets) && failure == 0; i++) {
        const struct scmp_arg_cmp conditions[] = {IS(0, sockets[i].family), MASKED(1, KINDS, (uint32_t)sockets[i].kind),
                                                  IS(2, sockets[i].protocol)};
        if ((sockets[i].drivers & drivers) != 0) {
            failure = allow_if(context, "socket", conditions, COUNT(conditions));
        }
    }
    for (size_t i = 0; i < COUNT(addresses) && failure == 0; i++) {
        const struct scmp_arg_cmp size = IS(2, addresses[i].size);
        failure = (addresses[i].drivers & drivers) != 0 ? allow_if(context, "bind", &size, 1) : 0;
    }
    return failure != 0 ? failure : add_sending(context, drivers);
}

int tl_filter_add_drivers(scmp_filter_ctx context, unsigned drivers) {
    /* A thread of a source is an ordinary one, whoever starts it (side_thread.h). */
    const struct scmp_arg_cmp ordinary = IS(1, SCHED_OTHER);
    int failure = allow_if(context, "sched_setscheduler", &ordinary, 1);
    for (size_t i = 0; i < COUNT(calls) && failure == 0; i++) {
        failure = (calls[i].drivers & drivers) != 0 ? tl_filter_allow_all(context, calls[i].calls) : 0;
    }
    for (size_t i = 0; i < COUNT(device_commands) && failure == 0; i++) {
        const struct scmp_arg_cmp command = IS(1, device_commands[i].command);
        failure = (device_commands[i].drivers & drivers) != 0 ? allow_if(context, "ioctl", &command, 1) : 0;
    }
    return failure != 0 ? failure : add_sockets(context, drivers);
}
