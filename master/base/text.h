/* Texts: search for the most similar name, and validation of UTF-8.
 *
 * Thread:  any; pure.
 */
#ifndef TL_MASTER_BASE_TEXT_H
#define TL_MASTER_BASE_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Nearest name, to suggest in an error message.
 *
 * Purpose: finds the existing name nearest to a name that does not exist. The distance is at most 2
 *          edits, and less than half of the existing name's length. An edit inserts, deletes or
 *          replaces a character, or swaps two neighbours; case is ignored.
 * Thread:  one at a time for each object.
 */

typedef struct tl_nearest {
    const char *text; /* the name to look for; the rest starts as zeros */
    const char *best; /* NULL: no candidate is near */
    size_t distance;  /* of `best`, in edits */
} tl_nearest;

/* Compares an existing name with `text`, and keeps it in `best` if it is the nearest so far.
 * `candidate` must stay valid as long as `nearest`. */
void tl_nearest_offer(tl_nearest *nearest, const char *candidate);

/* ---- UTF-8 characters, and which of them may be shown.
 *
 * Purpose: one rule for all names, units and messages that come from outside. It rejects bytes that
 *          are no character, and characters that control a terminal, change the direction of text,
 *          or are invisible. The caller shows a substitute.
 * Thread:  pure; safe in a signal handler.
 */

/* Reads the character at `bytes`, of which there are `size` > 0. Returns its length in bytes and
 * sets *code to its code point. Returns 0 if it is malformed, overlong, a surrogate, or incomplete;
 * then *code has no meaning. */
size_t tl_utf8_read(const char *bytes, size_t size, uint32_t *code);

/* False for control characters (ASCII or C1), separators of lines or paragraphs, marks of text
 * direction, and invisible characters. */
bool tl_utf8_can_be_shown(uint32_t code);

#endif
