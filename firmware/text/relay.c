/* From a pipe to lines that can be shown: see relay.h. */
#include "firmware/text/relay.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* ---- Characters ---- */

/* Bytes that a character which begins so should have; 0: none begins so. */
static size_t length_by(unsigned char first) {
    if (first < 0x80) {
        return 1;
    }
    return first < 0xC2 ? 0 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : first < 0xF5 ? 4 : 0;
}

/* Bytes of the UTF-8 character at `bytes`, of `size` > 0, and what it is; 0: it is none. */
static size_t decode(const char *bytes, size_t size, uint32_t *code) {
    static const uint32_t LEAST[] = {0, 0, 0x80, 0x800, 0x10000};
    unsigned char first = (unsigned char)bytes[0];
    size_t length = length_by(first);
    if (length <= 1) {
        *code = first;
        return length;
    }
    if (length > size) {
        return 0;
    }
    *code = first & (0x7FU >> length);
    for (size_t i = 1; i < length; i++) {
        unsigned char next = (unsigned char)bytes[i];
        if ((next & 0xC0U) != 0x80) {
            return 0;
        }
        *code = *code << 6 | (next & 0x3FU);
    }
    bool is_surrogate = *code >= 0xD800 && *code <= 0xDFFF;
    return *code >= LEAST[length] && *code <= 0x10FFFF && !is_surrogate ? length : 0;
}

static bool is_within(uint32_t code, uint32_t first, uint32_t last) {
    return code >= first && code <= last;
}

/* Of a character behind ASCII: it commands, turns or hides. */
static bool is_unseen(uint32_t code) {
    return is_within(code, 0x80, 0x9F) || code == 0x61C || code == 0xFEFF || is_within(code, 0x200E, 0x200F) ||
           is_within(code, 0x2028, 0x202E) || is_within(code, 0x2066, 0x2069) || is_within(code, 0xFFF9, 0xFFFB) ||
           is_within(code, 0xE0000, 0xE007F);
}

/* What stands for `length` bytes. Bytes added to `clean`. */
static size_t show_character(const char *bytes, size_t length, uint32_t code, char *clean) {
    if (length == 0 || (length == 1 && (code == 0x7F || (code < ' ' && code != '\t')))) {
        return (size_t)snprintf(clean, 5, "\\x%02X", (unsigned)(unsigned char)bytes[0]);
    }
    if (length > 1 && is_unseen(code)) {
        char text[16];
        size_t size = (size_t)snprintf(text, sizeof text, "\\u{%X}", (unsigned)code);
        memcpy(clean, text, size);
        return size;
    }
    memcpy(clean, bytes, length);
    return length;
}

void tl_relay_clean(const char *bytes, size_t size, char clean[TL_RELAY_CLEAN]) {
    size_t end = 0;
    for (size_t i = 0; i < size;) {
        uint32_t code = 0;
        size_t length = decode(bytes + i, size - i, &code);
        end += show_character(bytes + i, length, code, clean + end);
        i += length == 0 ? 1 : length;
    }
    clean[end] = '\0';
}

/* ---- Lines ---- */

static void pass_on(const tl_relay *relay, size_t size) {
    char clean[TL_RELAY_CLEAN];
    tl_relay_clean(relay->line, size, clean);
    relay->pass(relay->context, clean);
}

/* Bytes at the end of a full line that begin a character which goes on in the next piece. */
static size_t begun_at_end(const tl_relay *relay) {
    for (size_t back = 1; back <= 3; back++) {
        unsigned char byte = (unsigned char)relay->line[relay->used - back];
        if ((byte & 0xC0U) != 0x80) {
            return length_by(byte) > back ? back : 0;
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
