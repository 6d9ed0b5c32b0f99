/* Texts: the nearest of given words, and valid UTF-8.
 *
 * Thread:  any; pure.
 */
#ifndef TL_MASTER_BASE_TEXT_H
#define TL_MASTER_BASE_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- The name that was probably meant.
 *
 * Purpose: of the names there are, the nearest to one that is not there: at most 2 edits away, fewer than half of its
 *          characters. An edit inserts, deletes or replaces a character or swaps two neighbours; case does not count.
 * Thread:  plain data.
 */

typedef struct tl_nearest {
    const char *text; /* what was found; the rest begins as zeros */
    const char *best; /* NULL: none is near; else one of those offered */
    size_t distance;
} tl_nearest;

void tl_nearest_offer(tl_nearest *nearest, const char *candidate);

/* ---- Characters of UTF-8, and which of them may be shown.
 *
 * Purpose: the one rule for names, units and messages that come from strangers: what is no character, or commands a terminal, turns the
 *          direction of text or hides, is not shown as it is. Whoever finds such puts something else in its place.
 * Thread:  pure; safe in a signal handler.
 */

/* Bytes of the character at `bytes`, of which there are `size` > 0, and what it is; 0: malformed, overlong, a surrogate, or not whole. */
size_t tl_utf8_read(const char *bytes, size_t size, uint32_t *code);

/* Not a control character (of ASCII or C1), a separator of lines or paragraphs, a mark that turns the direction of text, or an unseen one. */
bool tl_utf8_can_be_shown(uint32_t code);

#endif
