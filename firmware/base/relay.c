/* Relay: see relay.h. */
#include "firmware/base/relay.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/text.h"
#include "master/base/text.h"

/* ---- Lines ---- */

static void relay_line(const tl_relay *relay, size_t size) {
    char clean[TL_RELAY_CLEAN];
    (void)tl_clean_text(relay->line, size, clean, sizeof clean);
    if (relay->pass != NULL) {
        relay->pass(relay->context, clean);
    }
}

/* Returns the number of bytes at the end of a full line that start a UTF-8 character without
 * completing it. */
static size_t count_incomplete(const tl_relay *relay) {
    uint32_t code = 0;
    size_t back = 1;
    while (back < 4 && ((unsigned char)relay->line[relay->used - back] & 0xC0U) == 0x80U) {
        back++;
    }
    const char *first = relay->line + relay->used - back;
    return (unsigned char)*first >= 0xC0U && tl_utf8_read(first, back, &code) == 0 ? back : 0;
}

static void add_bytes(tl_relay *relay, const char *bytes, size_t size) {
    while (size > 0) {
        const char *end = memchr(bytes, '\n', size);
        size_t length = end == NULL ? size : (size_t)(end - bytes);
        size_t room = sizeof relay->line - relay->used;
        if (length > room) {
            end = NULL;
            length = room;
        }
        memcpy(relay->line + relay->used, bytes, length);
        relay->used += length;
        if (end != NULL || length < size) {
            size_t rest = end != NULL ? 0 : count_incomplete(relay);
            relay->used -= rest;
            relay_line(relay, relay->used);
            memmove(relay->line, relay->line + relay->used, rest);
            relay->used = rest;
            length += end != NULL ? 1 : 0;
        }
        bytes += length;
        size -= length;
    }
}

/* ---- The pipe ---- */

void tl_relay_open(tl_relay *relay, int descriptor, tl_relay_line *pass, void *context) {
    *relay = (tl_relay){.lock = PTHREAD_MUTEX_INITIALIZER, .descriptor = descriptor, .pass = pass, .context = context};
    (void)fcntl(descriptor, F_SETFL, fcntl(descriptor, F_GETFL) | O_NONBLOCK);
}

static bool drain_pipe(tl_relay *relay) {
    char bytes[TL_RELAY_LINE];
    size_t total = 0;
    while (total < TL_RELAY_DRAIN) {
        ssize_t size = read(relay->descriptor, bytes, sizeof bytes);
        if (size < 0 && errno == EINTR) {
            continue;
        }
        if (size <= 0) {
            return size < 0 && errno == EAGAIN;
        }
        add_bytes(relay, bytes, (size_t)size);
        total += (size_t)size;
    }
    return true;
}

bool tl_relay_drain(tl_relay *relay) {
    (void)pthread_mutex_lock(&relay->lock);
    bool is_open = drain_pipe(relay);
    (void)pthread_mutex_unlock(&relay->lock);
    return is_open;
}

void tl_relay_close(tl_relay *relay) {
    if (relay->used > 0) {
        relay_line(relay, relay->used);
    }
    (void)close(relay->descriptor);
    (void)pthread_mutex_destroy(&relay->lock);
    relay->used = 0;
}
