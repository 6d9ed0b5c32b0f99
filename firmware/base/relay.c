/* From a pipe to lines that can be shown: see relay.h. */
#include "firmware/base/relay.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/text.h"

void tl_relay_clean(const char *bytes, size_t size, char clean[TL_RELAY_CLEAN]) {
    (void)tl_clean_text(bytes, size, clean, TL_RELAY_CLEAN);
}

/* ---- Lines ---- */

static void pass_on(const tl_relay *relay, size_t size) {
    char clean[TL_RELAY_CLEAN];
    tl_relay_clean(relay->line, size, clean);
    relay->pass(relay->context, clean);
}

/* Bytes at the end of a full line that begin a character which goes on in the next piece: which the right bytes behind them would make one. */
static size_t begun_at_end(const tl_relay *relay) {
    for (size_t back = 1; back <= 3; back++) {
        unsigned char byte = (unsigned char)relay->line[relay->used - back];
        if ((byte & 0xC0U) != 0x80) {
            size_t length = byte < 0xC2 ? 1 : byte < 0xE0 ? 2 : byte < 0xF0 ? 3 : byte < 0xF5 ? 4 : 1;
            return length > back ? back : 0;
        }
    }
    return 0;
}

/* A line without an end that takes all there is. */
static void pass_on_piece(tl_relay *relay) {
    size_t rest = begun_at_end(relay);
    pass_on(relay, relay->used - rest);
    memmove(relay->line, relay->line + relay->used - rest, rest);
    relay->used = rest;
}

static void add(tl_relay *relay, const char *bytes, size_t size) {
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
        if (end != NULL) {
            pass_on(relay, relay->used);
            relay->used = 0;
            length++;
        } else if (length < size) {
            pass_on_piece(relay);
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

static bool drain(tl_relay *relay) {
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
        add(relay, bytes, (size_t)size);
        total += (size_t)size;
    }
    return true;
}

bool tl_relay_drain(tl_relay *relay) {
    (void)pthread_mutex_lock(&relay->lock);
    bool is_open = drain(relay);
    (void)pthread_mutex_unlock(&relay->lock);
    return is_open;
}

void tl_relay_close(tl_relay *relay) {
    if (relay->used > 0) {
        pass_on(relay, relay->used);
    }
    (void)close(relay->descriptor);
    (void)pthread_mutex_destroy(&relay->lock);
    relay->used = 0;
}
