/* Attacks by sockets of each kind at which a plant or a local server could listen. */
#include <arpa/inet.h>
#include <errno.h>
#include <linux/can.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "tests/fmu/hostile/attack/attack.h"

typedef union address {
    struct sockaddr any;
    struct sockaddr_in four;
    struct sockaddr_in6 six;
    struct sockaddr_un local;
    struct sockaddr_can can;
    struct sockaddr_ll link;
    struct sockaddr_storage room;
} address;

static socklen_t internet(address *to, const char *host, const char *port) {
    in_port_t number = htons((uint16_t)strtoul(port, NULL, 10));
    memset(to, 0, sizeof *to);
    if (inet_pton(AF_INET6, host, &to->six.sin6_addr) == 1) {
        to->six.sin6_family = AF_INET6;
        to->six.sin6_port = number;
        return sizeof to->six;
    }
    to->four.sin_family = AF_INET;
    to->four.sin_port = number;
    (void)inet_pton(AF_INET, host, &to->four.sin_addr);
    return sizeof to->four;
}

/* Fills a local address from a path, or from "@" and an abstract name. */
static socklen_t local(address *to, const char *name) {
    memset(to, 0, sizeof *to);
    to->local.sun_family = AF_UNIX;
    (void)snprintf(to->local.sun_path, sizeof to->local.sun_path, "%s", name);
    if (name[0] == '@') {
        to->local.sun_path[0] = '\0';
        return (socklen_t)(offsetof(struct sockaddr_un, sun_path) + strlen(name));
    }
    return sizeof to->local;
}

/* Connects, sends, and waits for an answer if one is wanted. */
static int send_to(const address *to, socklen_t size, int type, const void *bytes, size_t count, size_t answer) {
    char got[256];
    int made = socket(to->any.sa_family, type | SOCK_CLOEXEC, 0);
    if (made < 0) {
        return errno;
    }
    int error = attack_errno(connect(made, &to->any, size));
    if (error == 0) {
        error = attack_errno(send(made, bytes, count, MSG_NOSIGNAL));
    }
    if (error == 0 && answer != 0) {
        error = recv(made, got, answer, MSG_WAITALL) == (ssize_t)answer ? 0 : EIO;
    }
    (void)close(made);
    return error;
}

/* HOST PORT: writes 4711 to holding register 7 of unit 1. */
static int modbus(char *const words[]) {
    static const uint8_t write_register[] = {0, 1, 0, 0, 0, 6, 1, 6, 0, 7, 4711 >> 8, 4711 & 255};
    address to;
    socklen_t size = internet(&to, words[0], words[1]);
    return send_to(&to, size, SOCK_STREAM, write_register, sizeof write_register, sizeof write_register);
}

static int datagram(char *const words[]) {
    address to;
    socklen_t size = internet(&to, words[0], words[1]);
    return send_to(&to, size, SOCK_DGRAM, "attack", 6, 0);
}

static int stream_socket(char *const words[]) {
    address to;
    socklen_t size = local(&to, words[0]);
    return send_to(&to, size, SOCK_STREAM, "attack", 6, 0);
}

/* One end of a pair is an open socket: it needs neither socket() nor connect(). */
static int pair_socket(char *const words[]) {
    int ends[2];
    address to;
    socklen_t size = local(&to, words[0]);
    if (socketpair(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0, ends) != 0) {
        return errno;
    }
    int error = attack_errno(sendto(ends[0], "attack", 6, MSG_NOSIGNAL, &to.any, size));
    (void)close(ends[0]);
    (void)close(ends[1]);
    return error;
}

/* INTERFACE: sends a CAN frame with the id 0x123. */
static int can_frame(char *const words[]) {
    struct can_frame frame = {.can_id = 0x123, .can_dlc = 2, .data = {0x47, 0x11}};
    address to = {.can = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(words[0])}};
    int made = socket(AF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
    if (made < 0) {
        return errno;
    }
    int error = attack_errno(sendto(made, &frame, sizeof frame, 0, &to.any, sizeof to.can));
    (void)close(made);
    return error;
}

/* INDEX WORD: sends an Ethernet frame of the type for local experiments on the interface with this
 * index. The word tells it apart from other frames. */
static int ethernet_frame(char *const words[]) {
    uint8_t frame[64] = {[12] = 0x88, 0xB5};
    address to = {.link = {.sll_family = AF_PACKET, .sll_ifindex = (int)strtol(words[0], NULL, 10), .sll_halen = 6}};
    (void)snprintf((char *)frame + 14, sizeof frame - 14, "%s", words[1]);
    int made = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
    if (made < 0) {
        return errno;
    }
    int error = attack_errno(sendto(made, frame, sizeof frame, 0, &to.any, sizeof to.link));
    (void)close(made);
    return error;
}

/* Asks the kernel for the machine's interfaces. */
static int interfaces(char *const words[]) {
    struct {
        struct nlmsghdr head;
        struct rtgenmsg body;
    } ask = {.head = {.nlmsg_len = sizeof ask, .nlmsg_type = RTM_GETLINK, .nlmsg_flags = NLM_F_REQUEST | NLM_F_DUMP}};
    char answer[8192];
    int made = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
    (void)words;
    if (made < 0) {
        return errno;
    }
    int error = attack_errno(send(made, &ask, sizeof ask, 0));
    error = error != 0 ? error : attack_errno(recv(made, answer, sizeof answer, 0));
    (void)close(made);
    return error;
}

const attack attack_network[] = {{"modbus", modbus},
                                 {"datagram", datagram},
                                 {"stream_socket", stream_socket},
                                 {"pair_socket", pair_socket},
                                 {"can_frame", can_frame},
                                 {"ethernet_frame", ethernet_frame},
                                 {"interfaces", interfaces},
                                 {NULL, NULL}};
