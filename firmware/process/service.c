/* Service manager: see service.h. The protocol is that of systemd. */
#include <errno.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "firmware/process/service.h"

/* NOTIFY_SOCKET is a path, or an abstract name after an @. Returns false if it is neither. */
static bool find_address(struct sockaddr_un *address, socklen_t *size) {
    const char *name = getenv("NOTIFY_SOCKET");
    size_t length = name == NULL ? 0 : strlen(name);
    *address = (struct sockaddr_un){.sun_family = AF_UNIX};
    if (length < 2 || length >= sizeof address->sun_path || (name[0] != '/' && name[0] != '@')) {
        return false;
    }
    memcpy(address->sun_path, name, length);
    if (name[0] == '@') {
        address->sun_path[0] = '\0';
    }
    *size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length);
    return true;
}

/* Replaces sd_notify(), which blocks if the socket is full. */
bool tl_service_notify(const char *state) {
    struct sockaddr_un address;
    socklen_t size = 0;
    if (!find_address(&address, &size)) {
        return true;
    }
    int line = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (line < 0) {
        return false;
    }
    ssize_t sent = sendto(line, state, strlen(state), MSG_DONTWAIT | MSG_NOSIGNAL, (struct sockaddr *)&address, size);
    bool full = sent < 0 && errno == EAGAIN;
    (void)close(line);
    return !full;
}

/* Replaces sd_watchdog_enabled(). */
tl_time tl_service_watchdog_period(void) {
    const char *process = getenv("WATCHDOG_PID"); /* the process that is meant; children inherit the variable */
    const char *microseconds = getenv("WATCHDOG_USEC");
    bool is_meant = process == NULL || strtol(process, NULL, 10) == getpid();
    return is_meant && microseconds != NULL ? (tl_time)strtoul(microseconds, NULL, 10) * 1000 : 0;
}
