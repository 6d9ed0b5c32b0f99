/* The nearest name: see nearest.h. */
#include "master/base/nearest.h"

#include <stdbool.h>
#include <string.h>

/* What is longer is no name. */
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

/* Edits from a to b, two neighbours that changed places being one ("optimal string alignment"). Exact up to MOST_EDITS,
 * so only the cells near the diagonal are looked at; else more than that, also where one of them is too long to be a
 * name. */
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
