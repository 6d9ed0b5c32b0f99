/* Characters of UTF-8: see utf8.h. */
#include "master/base/utf8.h"

/* Bytes that a character which begins so should have; 0: none begins so. */
static size_t length_by(unsigned char first) {
    if (first < 0x80) {
        return 1;
    }
    return first < 0xC2 ? 0 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : first < 0xF5 ? 4 : 0;
}

size_t tl_utf8_read(const char *bytes, size_t size, uint32_t *code) {
    static const uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
    unsigned char first = (unsigned char)bytes[0];
    size_t length = length_by(first);
    *code = first;
    if (length <= 1) {
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
    return *code >= least[length] && *code <= 0x10FFFF && !is_surrogate ? length : 0;
}

bool tl_utf8_can_be_shown(uint32_t code) {
    static const struct {
        uint32_t first;
        uint32_t last;
    } hidden[] = {{0, 0x1F},        {0x7F, 0x9F},     {0x61C, 0x61C},   {0x200E, 0x200F},  {0x2028, 0x202E},
                  {0x2066, 0x2069}, {0xFEFF, 0xFEFF}, {0xFFF9, 0xFFFB}, {0xE0000, 0xE007F}};
    for (size_t i = 0; i < sizeof hidden / sizeof hidden[0]; i++) {
        if (code >= hidden[i].first && code <= hidden[i].last) {
            return false;
        }
    }
    return true;
}
