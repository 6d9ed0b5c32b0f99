/* CAN interface: see can_interface.h. */
#include "board/can/can_interface.h"

#include <errno.h>
#include <linux/can.h>
#include <net/if.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

int tl_can_interface_open(void) {
    return socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
}

static bool ask(int socket, const char *name, unsigned long question, struct ifreq *answer) {
    memset(answer, 0, sizeof *answer);
    (void)snprintf(answer->ifr_name, sizeof answer->ifr_name, "%s", name);
    return ioctl(socket, question, answer) == 0;
}

int tl_can_interface_index(int socket, const char *name) {
    struct ifreq answer;
    return ask(socket, name, SIOCGIFINDEX, &answer) ? answer.ifr_ifindex : 0;
}

bool tl_can_interface_bind(int socket, int index) {
    const struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = index};
    return bind(socket, (const struct sockaddr *)&address, sizeof address) == 0;
}

bool tl_can_interface_probe(int socket, const char *name, tl_can_state *state) {
    struct ifreq flags;
    struct ifreq size;
    if (!ask(socket, name, SIOCGIFFLAGS, &flags) || !ask(socket, name, SIOCGIFMTU, &size)) {
        return false;
    }
    state->up = (flags.ifr_flags & IFF_UP) != 0;
    state->running = (flags.ifr_flags & IFF_RUNNING) != 0;
    state->fd = size.ifr_mtu >= (int)CANFD_MTU;
    return true;
}

const char *tl_can_interface_failure(int reason) {
    bool none = reason == EAFNOSUPPORT || reason == EPROTONOSUPPORT;
    return none ? "this kernel has no CAN: load its modules (`modprobe can-raw`)" : strerror(reason);
}
