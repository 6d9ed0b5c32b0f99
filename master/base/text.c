/* Texts: the nearest of given words, and valid UTF-8: see text.h. */
#include "master/base/text.h"

#include <string.h>

/* ---- nearest ---- */

/* Longer texts are not names. */
enum { NAME_CHARS = 63, MOST_EDITS = 2 };

static char lower(char character) {
    return (char)(character >= 'A' && character <= 'Z' ? character - 'A' + 'a' : character);
}

static size_t least_of(size_t a, size_t b) {
    return a < b ? a : b;
}

static bool same(const char *a, size_t i, const char *b, size_t j) {
    return lower(a[i]) == lower(b[j]);
}

/* Edits from a to b; a swap of two neighbours is one edit ("optimal string alignment"). Exact up to
 * MOST_EDITS, so only cells near the diagonal are computed; larger otherwise, also if a text is too
 * long to be a name. */
static size_t edits(const char *a, const char *b) {
    unsigned char cost[NAME_CHARS + 1]
                      [NAME_CHARS + 1]; /* [i][j]: from the first i characters of a to the first j of b */
    size_t a_size = strlen(a);
    size_t b_size = strlen(b);
    if (a_size > NAME_CHARS || b_size > NAME_CHARS || a_size > b_size + MOST_EDITS || b_size > a_size + MOST_EDITS) {
        return MOST_EDITS + 1;
    }
    memset(cost, MOST_EDITS + 1, sizeof cost);
    for (size_t i = 0; i <= MOST_EDITS; i++) {
        cost[i][0] = (unsigned char)i;
        cost[0][i] = (unsigned char)i;
    }
    for (size_t i = 1; i <= a_size; i++) {
        size_t last = least_of(b_size, i + MOST_EDITS);
        for (size_t j = i > MOST_EDITS ? i - MOST_EDITS : 1; j <= last; j++) {
            size_t least = cost[i - 1][j - 1] + (same(a, i - 1, b, j - 1) ? 0u : 1u);
            least = least_of(least, least_of(cost[i - 1][j], cost[i][j - 1]) + 1u);
            if (i > 1 && j > 1 && same(a, i - 1, b, j - 2) && same(a, i - 2, b, j - 1)) {
                least = least_of(least, cost[i - 2][j - 2] + 1u);
            }
            cost[i][j] = (unsigned char)least;
        }
    }
    return cost[a_size][b_size];
}

void tl_nearest_offer(tl_nearest *nearest, const char *candidate) {
    size_t distance = edits(nearest->text, candidate);
    if (distance <= MOST_EDITS && 2 * distance < strlen(candidate) &&
        (nearest->best == NULL || distance < nearest->distance)) {
        nearest->best = candidate;
        nearest->distance = distance;
    }
}

/* ---- utf8 ---- */

/* Length of the character that starts with this byte; 0: no character does. */
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
