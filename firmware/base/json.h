/* JSON texts: validation, reading of flat objects, writing.
 *
 * Thread:  one for each reader or writer.
 */
#ifndef TL_FIRMWARE_BASE_JSON_H
#define TL_FIRMWARE_BASE_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/arena.h"
#include "master/base/status.h"

/* ---- The bytes of a JSON text: checked strictly (RFC 8259) before a parser sees them.
 *
 * Purpose: cJSON takes 01, 1e999, bad UTF-8, a byte order mark and text after the end, and does not know lines. This
 *          check refuses all of that, says where, and notes on which line each value stands.
 * Beyond the RFC: no \u0000 (texts are C strings), no number that is infinite as a double, none with more than
 *          TL_JSON_NUMBER_CHARS characters (cJSON would cut it), at most TL_JSON_MAX_DEPTH levels. Keys that appear
 *          twice are found by json_document.h, once they are decoded.
 * Bound:   time O(size), no recursion; the lines take 4 bytes for each of the characters [ , : and 4 more.
 * Thread:  no shared state.
 */

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

/* Whether all of it can be shown as it is: valid UTF-8 without control characters, marks that turn text and unseen ones (text.h). */
bool tl_text_is_plain(const char *text);

/* Copies `text` for people: what cannot be shown becomes \x1B or \u{202E} (text.h), and what does not fit is cut at a character and ends in
 * "…". `size` ≥ 8. */
void tl_text_for_people(const char *text, char *copy, size_t size);

/* ---- A small JSON object that this program has written earlier, read back as if a stranger had.
 *
 * Purpose: a few members by their keys. What says where in a file something is wrong is firmware/config/json_document.h.
 * Use:     `right` is looked at once all members are read.
 * Errors:  a member that is missing or of another type makes `right` false, and reads as something harmless.
 * Owner:   the caller, who frees it; texts live until then.
 * Thread:  one thread.
 */

struct cJSON;

typedef struct tl_json_reader {
    struct cJSON *root; /* NULL: the text is no JSON object */
    bool right;
} tl_json_reader;

/* `text` needs no terminator and passes json.h first. If it is refused, or memory is out, nothing is right. */
tl_json_reader tl_json_reader_of(const char *text, size_t size);

/* That of a file of at most 16 KiB; nothing is right if it cannot be read. */
tl_json_reader tl_json_file_read(const char *path);

/* Of the first member with this key. A count is a number of at least 0, below 9e15, rounded down. */
uint64_t tl_json_count(tl_json_reader *reader, const char *key);
bool tl_json_has(const tl_json_reader *reader, const char *key); /* an older version may not have written it */
double tl_json_number(tl_json_reader *reader, const char *key);
bool tl_json_truth(tl_json_reader *reader, const char *key);
const char *tl_json_text(tl_json_reader *reader, const char *key);

void tl_json_reader_free(tl_json_reader *reader);

/* ---- JSON for programs: one object, put together in memory and written whole, or not at all.
 *
 * Purpose: the one place where JSON is written. Values go into the innermost object or array that is open, with a key in an
 *          object and NULL in an array, and come out in that order.
 * Numbers: with 15 digits, 17 if those are not enough for one part in 2^52. Null if they are not finite: JSON knows neither
 *          NaN nor infinity.
 * Errors:  memory that is out is told once, by tl_json_writer_print().
 * Owner:   the caller, who frees it.
 * Thread:  one thread.
 */

enum { TL_JSON_WRITER_DEPTH = 8 };

struct cJSON;

typedef struct tl_json_writer {
    struct cJSON *open[TL_JSON_WRITER_DEPTH]; /* objects and arrays, the outermost first; NULL: memory was out */
    size_t depth;
    bool failed;
} tl_json_writer;

/* The outermost object is open. */
void tl_json_writer_begin(tl_json_writer *writer);

void tl_json_add_truth(tl_json_writer *writer, const char *key, bool truth);
void tl_json_add_number(tl_json_writer *writer, const char *key, double number);
void tl_json_add_count(tl_json_writer *writer, const char *key, uint64_t count);

/* UTF-8; null if it is NULL. */
void tl_json_add_text(tl_json_writer *writer, const char *key, const char *text);

/* An object or an array within, which is open from now on; at most TL_JSON_WRITER_DEPTH with the outermost. */
void tl_json_open_object(tl_json_writer *writer, const char *key);
void tl_json_open_array(tl_json_writer *writer, const char *key);

/* Closes the innermost; never the outermost. */
void tl_json_close(tl_json_writer *writer);

/* Prints the object, indented, and a newline. Errors: TL_TRY_AGAIN if memory was out; nothing is printed then. */
tl_status tl_json_writer_print(const tl_json_writer *writer, FILE *file, tl_error *error);

/* Makes the object a file, whole or not at all (tl_new_file). Errors: TL_TRY_AGAIN. */
tl_status tl_json_file_write(const tl_json_writer *writer, const char *path, tl_error *error);

/* The object in one line without its end, with a NUL behind it. Returns its length; 0: it does not fit into `room` bytes, or memory was out. */
size_t tl_json_writer_line(const tl_json_writer *writer, char *line, size_t room);

void tl_json_writer_free(tl_json_writer *writer);

#endif
