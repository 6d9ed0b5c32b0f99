/* provisional */
#include "firmware/process/relay.h"
#include <errno.h>
#include <fcntl.h>
#include <unistd.h>
void tl_relay_open(tl_relay *relay, int descriptor, tl_relay_line *pass, void *context) {
    relay->descriptor = descriptor; relay->pass = pass; relay->context = context; relay->length = 0;
    (void)fcntl(descriptor, F_SETFL, O_NONBLOCK);
}
bool tl_relay_drain(tl_relay *relay) {
    char bytes[4096];
    for (;;) {
        ssize_t n = read(relay->descriptor, bytes, sizeof bytes);
        if (n == 0) return false;
        if (n < 0) return errno == EAGAIN || errno == EINTR;
        for (ssize_t i = 0; i < n; i++) {
            if (bytes[i] == '\n' || relay->length + 1 == sizeof relay->line) {
                relay->line[relay->length] = '\0'; relay->pass(relay->context, relay->line); relay->length = 0;
            }
            if (bytes[i] != '\n') relay->line[relay->length++] = bytes[i];
        }
    }
}
void tl_relay_close(tl_relay *relay) {
    if (relay->length > 0) { relay->line[relay->length] = '\0'; relay->pass(relay->context, relay->line); }
    (void)close(relay->descriptor);
}
