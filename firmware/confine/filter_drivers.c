/* What the drivers of a plant need besides, to connect again: see filter.h.
 *
 * Addresses and requests lie in memory, where a filter does not see them: what is allowed here is allowed towards anybody.
 */
#include "firmware/confine/filter_parts.h"

#include <linux/can.h>
#include <linux/gpio.h>
#include <linux/netlink.h>
#include <linux/serial.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

enum { KINDS = 0x0f }; /* of sockets: the rest are flags */

static const struct {
    int family;
    int kind;
} sockets[] = {
    {AF_INET, SOCK_STREAM},                          /* Modbus TCP */
    {AF_INET6, SOCK_STREAM}, {AF_INET, SOCK_DGRAM},  /* names of hosts */
    {AF_INET6, SOCK_DGRAM},  {AF_NETLINK, SOCK_RAW}, /* which addresses this machine has itself, for the same */
    {AF_CAN, SOCK_RAW},
};

/* Of CAN and netlink. Nobody can listen, so an address of their length does no harm elsewhere. */
static const uint32_t address_sizes[] = {sizeof(struct sockaddr_can), sizeof(struct sockaddr_nl)};

static const uint32_t device_commands[] = {
    SIOCGIFINDEX,
    SIOCGIFFLAGS,
    SIOCGIFMTU, /* CAN interfaces */
    TCSETS,
    TCSETSW,
    TCSETSF,
    TCFLSH,
    TCSBRK,
    TIOCEXCL,
    TIOCNXCL,
    TIOCMGET,
    TIOCGRS485,
    TIOCSRS485, /* serial lines */
    GPIO_GET_CHIPINFO_IOCTL,
    GPIO_GET_LINEINFO_IOCTL,
    GPIO_GET_LINEHANDLE_IOCTL,
    GPIO_GET_LINEEVENT_IOCTL,
    GPIOHANDLE_GET_LINE_VALUES_IOCTL,
    GPIO_V2_GET_LINEINFO_IOCTL,
    GPIO_V2_GET_LINE_IOCTL,
    GPIO_V2_LINE_GET_VALUES_IOCTL,
};

static int allow(scmp_filter_ctx context, const char *call, unsigned argument, uint32_t value) {
    const struct scmp_arg_cmp condition = {argument, SCMP_CMP_MASKED_EQ, UINT32_MAX, value};
    return tl_filter_add(context, SCMP_ACT_ALLOW, call, &condition, 1);
}

int tl_filter_add_drivers(scmp_filter_ctx context) {
    int failure =
        tl_filter_allow_all(context, "connect shutdown getsockname getpeername getsockopt setsockopt send sendto "
                                     "sendmsg sendmmsg recv recvfrom recvmsg");
    for (size_t i = 0; i < COUNT(sockets) && failure == 0; i++) {
        const struct scmp_arg_cmp conditions[] = {
            {0, SCMP_CMP_MASKED_EQ, UINT32_MAX, (uint32_t)sockets[i].family},
            {1, SCMP_CMP_MASKED_EQ, KINDS, (uint32_t)sockets[i].kind},
        };
        failure = tl_filter_add(context, SCMP_ACT_ALLOW, "socket", conditions, COUNT(conditions));
    }
    for (size_t i = 0; i < COUNT(address_sizes) && failure == 0; i++) {
        failure = allow(context, "bind", 2, address_sizes[i]);
    }
    for (size_t i = 0; i < COUNT(device_commands) && failure == 0; i++) {
        failure = allow(context, "ioctl", 1, device_commands[i]);
    }
    /* A thread of a source is an ordinary one, whoever starts it (side_thread.h). */
    failure = failure != 0 ? failure : allow(context, "sched_setscheduler", 1, SCHED_OTHER);
    return failure;
}
