/* JSON texts: validation, reading of flat objects, writing.
 *
 * Thread:  one per reader or writer.
 */
#ifndef TL_FIRMWARE_BASE_JSON_H
#define TL_FIRMWARE_BASE_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/arena.h"
#include "master/base/status.h"

/* ---- Validation of a JSON text: strict (RFC 8259), before a parser reads it.
 *
 * Purpose: cJSON accepts 01, 1e999, invalid UTF-8, a byte order mark and text after the end, and
 *          has no line numbers. This check rejects all of these, reports the position, and records
 *          the line of each value.
 * Stricter: additional rules to those of the RFC. No \u0000, because texts are C strings. No number
 *           that is infinite as a double. At most TL_JSON_NUMBER_CHARS characters in a number,
 *           because cJSON would truncate it, and TL_JSON_MAX_DEPTH levels. Duplicate keys are
 *           detected by json_document.h, after decoding.
 * Bound:   time O(size), no recursion. The lines need 4 bytes for each of the characters [ , : and
 *          4 more.
 * Memory:  the arena.
 * Thread:  no shared state.
 */

enum { TL_JSON_MAX_DEPTH = 32, TL_JSON_NUMBER_CHARS = 63 };

/* Line (from 1) of each value, in the order in which the values begin. Keys are no values. */
typedef struct tl_json_lines {
    uint32_t *line;
    size_t count;
} tl_json_lines;

/* Validates `text` (`size` < 4 GiB, no NUL needed). Allocates `lines` in the arena.
 * Errors: TL_BAD_DATA for the first error, "line 3, column 7: found …, expected …" (columns count
 *         characters, from 1); TL_TRY_AGAIN if memory is out. */
tl_status tl_json_text_check(const char *text, size_t size, tl_arena *arena, tl_json_lines *lines, tl_error *error);

/* Returns whether all of `text` can be displayed unchanged: valid UTF-8 without control characters,
 * direction marks and invisible characters (text.h). */
bool tl_text_is_plain(const char *text);

/* Copies `text` for display. Characters that cannot be displayed become \x1B or \u{202E} (text.h).
 * A text that does not fit is truncated between two characters and ends in "…". `size` ≥ 8. */
void tl_text_for_people(const char *text, char *copy, size_t size);

/* ---- Reader of a small JSON object that this program has written earlier; treats it as untrusted.
 *
 * Purpose: reads a few members by their keys. To report the position of an error in a file, use
 *          firmware/config/json_document.h.
 * Use:     check `right` after all members are read.
 * Errors:  if a member is missing or has another type, `right` becomes false and the member reads
 *          as a harmless value.
 * Owner:   the caller, which frees it; texts live until then.
 * Thread:  one thread.
 */

struct cJSON;

typedef struct tl_json_reader {
    struct cJSON *root; /* NULL: the text is no JSON object */
    bool right;
} tl_json_reader;

/* Parses `text` (no NUL needed) after tl_json_text_check(). If it is rejected or memory is out,
 * `right` is false. */
tl_json_reader tl_json_reader_of(const char *text, size_t size);

/* Parses a file of at most 16 KiB. If it cannot be read, `right` is false. */
tl_json_reader tl_json_file_read(const char *path);

/* Read the first member with this key. A count is a number from 0 to below 9e15, rounded down. */
uint64_t tl_json_count(tl_json_reader *reader, const char *key);
bool tl_json_has(const tl_json_reader *reader, const char *key); /* an older version may not have written it */
double tl_json_number(tl_json_reader *reader, const char *key);
bool tl_json_truth(tl_json_reader *reader, const char *key);
const char *tl_json_text(tl_json_reader *reader, const char *key);

void tl_json_reader_free(tl_json_reader *reader);

/* ---- Writer: builds one JSON object in memory and writes it completely or not at all.
 *
 * Purpose: all JSON is written by this writer. Values are added to the innermost open object or
 *          array, in the order of the calls. `key` is NULL in an array.
 * Numbers: 15 digits, or 17 if 15 are less exact than one part in 2^52. A number that is not finite
 *          becomes null, because JSON has neither NaN nor infinity.
 * Errors:  a lack of memory is reported once, when the object is written.
 * Owner:   the caller, which frees it.
 * Thread:  one thread.
 */

enum { TL_JSON_WRITER_DEPTH = 8 };

struct cJSON;

typedef struct tl_json_writer {
    struct cJSON *open[TL_JSON_WRITER_DEPTH]; /* open objects and arrays, outermost first; NULL: memory was out */
    size_t depth;
    bool failed;
} tl_json_writer;

/* Starts with the outermost object open. */
void tl_json_writer_begin(tl_json_writer *writer);

void tl_json_add_truth(tl_json_writer *writer, const char *key, bool truth);
void tl_json_add_number(tl_json_writer *writer, const char *key, double number);
void tl_json_add_count(tl_json_writer *writer, const char *key, uint64_t count);

/* UTF-8; NULL becomes null. */
void tl_json_add_text(tl_json_writer *writer, const char *key, const char *text);

/* Opens an object or array inside the innermost one; at most TL_JSON_WRITER_DEPTH levels, including
 * the outermost. */
void tl_json_open_object(tl_json_writer *writer, const char *key);
void tl_json_open_array(tl_json_writer *writer, const char *key);

/* Closes the innermost object or array; never the outermost. */
void tl_json_close(tl_json_writer *writer);

/* Prints the object, indented, and a newline. Errors: TL_TRY_AGAIN if memory was out; then nothing
 * is printed. */
tl_status tl_json_writer_print(const tl_json_writer *writer, FILE *file, tl_error *error);

/* Writes the object to a file, completely or not at all (tl_new_file). Errors: TL_TRY_AGAIN. */
tl_status tl_json_file_write(const tl_json_writer *writer, const char *path, tl_error *error);

/* Writes the object as one line without newline, with a NUL. Returns its length, or 0 if it does
 * not fit into `room` bytes or memory was out. */
size_t tl_json_writer_line(const tl_json_writer *writer, char *line, size_t room);

void tl_json_writer_free(tl_json_writer *writer);

#endif
