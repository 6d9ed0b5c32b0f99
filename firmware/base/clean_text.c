/* Clean text: see clean_text.h. */
#include "firmware/base/clean_text.h"

#include <string.h>

#include "master/base/utf8.h"

enum { LONGEST = 16 };

/* Digits of `value`, at least `least` of them, behind `begin`. Without stdio, which no signal handler may use. */
static size_t put_hex(char *to, const char *begin, uint32_t value, int least) {
    size_t size = 0;
    int digits = least;
    while (begin[size] != '\0') {
        to[size] = begin[size];
        size++;
    }
    while (digits < 8 && value >> (4 * digits) != 0) {
        digits++;
    }
    for (int i = digits - 1; i >= 0; i--) {
        to[size++] = "0123456789ABCDEF"[value >> (4 * i) & 0xFU];
    }
    return size;
}

/* What stands for a character of `length` bytes; 0: for a byte that is none. Bytes added to `shown`. */
static size_t show(const char *bytes, size_t length, uint32_t code, char shown[LONGEST]) {
    if (length == 0 || (length == 1 && code != '\t' && !tl_utf8_can_be_shown(code))) {
        return put_hex(shown, "\\x", (unsigned char)bytes[0], 2);
    }
    if (length > 1 && !tl_utf8_can_be_shown(code)) {
        size_t size = put_hex(shown, "\\u{", code, 1);
        shown[size++] = '}';
        return size;
    }
    memcpy(shown, bytes, length);
    return length;
}

size_t tl_clean_text(const char *bytes, size_t size, char *clean, size_t room) {
    size_t end = 0;
    for (size_t i = 0; i < size;) {
        char shown[LONGEST];
        uint32_t code = 0;
        size_t length = tl_utf8_read(bytes + i, size - i, &code);
        size_t added = show(bytes + i, length, code, shown);
        if (end + added >= room) {
            break;
        }
        memcpy(clean + end, shown, added);
        end += added;
        i += length == 0 ? 1 : length;
    }
    clean[end] = '\0';
    return end;
}
