/* The bytes of a JSON text: checked strictly (RFC 8259) before a parser sees them.
 *
 * Purpose: cJSON takes 01, 1e999, bad UTF-8, a byte order mark and text after the end, and does not know lines. This
 *          check refuses all of that, says where, and notes on which line each value stands.
 * Beyond the RFC: no \u0000 (texts are C strings), no number that is infinite as a double, none with more than
 *          TL_JSON_NUMBER_CHARS characters (cJSON would cut it), at most TL_JSON_MAX_DEPTH levels. Keys that appear
 *          twice are found by json_document.h, once they are decoded.
 * Bound:   time O(size), no recursion; the lines take 4 bytes for each of the characters [ , : and 4 more.
 * Thread:  no shared state.
 */
#ifndef TL_FIRMWARE_BASE_JSON_TEXT_H
#define TL_FIRMWARE_BASE_JSON_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"

enum { TL_JSON_MAX_DEPTH = 32, TL_JSON_NUMBER_CHARS = 63 };

/* The line (from 1) of each value in the order in which the values begin; keys are not values. */
typedef struct tl_json_lines {
    uint32_t *line;
    size_t count;
} tl_json_lines;

/* Checks all of `text` (`size` < 4 GiB, no terminator needed). `lines` is taken from the arena.
 * Errors: TL_BAD_DATA for the first thing that is wrong, "line 3, column 7: found …, expected …" (columns count
 * characters, from 1); TL_TRY_AGAIN where memory is out. */
tl_status tl_json_text_check(const char *text, size_t size, tl_arena *arena, tl_json_lines *lines, tl_error *error);

/* Whether all of it can be shown as it is: valid UTF-8 without control characters, marks that turn text and unseen ones (utf8.h). */
bool tl_text_is_plain(const char *text);

/* Copies `text` for people: what cannot be shown becomes \x1B or \u{202E} (clean_text.h), and what does not fit is cut at a character and ends in
 * "…". `size` ≥ 8. */
void tl_text_for_people(const char *text, char *copy, size_t size);

#endif
