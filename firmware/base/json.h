/* JSON texts: validates them, reads small objects, and writes objects.
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

/* ---- Strict validation of a JSON text (RFC 8259) before a parser reads it.
 *
 * Purpose: cJSON accepts 01, 1e999, invalid UTF-8, a byte order mark and text after the end, and
 *          has no line numbers. This check rejects all of these, reports the position of the error,
 *          and records the line of each value.
 * Stricter: rules in addition to those of the RFC. No \u0000, because texts are C strings. No
 *           number that is infinite as a double. At most TL_JSON_NUMBER_CHARS characters in a
 *           number, because cJSON would truncate a longer one. At most TL_JSON_MAX_DEPTH levels of
 *           brackets.
 * Not found: duplicate keys; json_document.h finds them after decoding.
 * Bound:   time O(size), no recursion.
 * Memory:  only `lines`, in the caller's arena: 4 bytes for each '[', ',' and ':' in the text, plus
 *          4 bytes.
 * Thread:  no shared state.
 */

enum { TL_JSON_MAX_DEPTH = 32, TL_JSON_NUMBER_CHARS = 63 };

/* Line number (from 1) of each value, in the order in which the values begin. A key is not a value.
 */
typedef struct tl_json_lines {
    uint32_t *line;
    size_t count;
} tl_json_lines;

/* Validates `text` (`size` < 4 GiB, no NUL needed). Sets *lines, allocated in the arena.
 * Errors:  TL_BAD_DATA for the first error, "line 3, column 7: found …, expected …" (columns count
 *          characters, from 1); TL_TRY_AGAIN if memory is out. */
tl_status tl_json_text_check(const char *text, size_t size, tl_arena *arena, tl_json_lines *lines, tl_error *error);

/* Returns true if all of `text` can be displayed unchanged: valid UTF-8 without control characters
 * (including tabs), direction marks and invisible characters (text.h). */
bool tl_text_is_plain(const char *text);

/* Copies `text` for display. Characters that cannot be displayed become escapes: \t, or for example
 * \x1B or \u{202E} (text.h). A text that does not fit is truncated between two characters and ends
 * in "…". `size`: bytes of `copy`, at least 8. */
void tl_text_for_people(const char *text, char *copy, size_t size);

/* ---- Reader of a small JSON object that this program has written earlier. The text is untrusted.
 *
 * Purpose: reads a few members by their keys. It does not report the position of an error;
 *          json_document.h does.
 * Use:     read all members, then check `right`.
 * Errors:  if a member is missing or has another type, `right` becomes false and the function
 *          returns 0, false or "".
 * Owner:   the caller frees the reader; texts from it are valid until then.
 * Thread:  one thread.
 */

struct cJSON;

typedef struct tl_json_reader {
    struct cJSON *root; /* private; NULL: there is no JSON text */
    bool right;         /* no error so far */
} tl_json_reader;

/* Checks `text` as tl_json_text_check() does, then parses it (no NUL needed). If the check rejects
 * the text or memory is out, `right` is false. */
tl_json_reader tl_json_reader_of(const char *text, size_t size);

/* Parses a file of at most 16 KiB. If it cannot be read, `right` is false. */
tl_json_reader tl_json_file_read(const char *path);

/* Each of these reads the first member with this key. A count is a number ≥ 0 and < 9e15, rounded
 * down. tl_json_has() only returns true if the key exists; it ignores the case of letters. */
uint64_t tl_json_count(tl_json_reader *reader, const char *key);
bool tl_json_has(const tl_json_reader *reader, const char *key); /* for members that older versions do not write */
double tl_json_number(tl_json_reader *reader, const char *key);
bool tl_json_truth(tl_json_reader *reader, const char *key);
const char *tl_json_text(tl_json_reader *reader, const char *key);

void tl_json_reader_free(tl_json_reader *reader);

/* ---- Writer: builds one JSON object in memory and writes it completely or not at all.
 *
 * Purpose: each call adds a value at the end of the innermost open object or array. In an array,
 *          `key` is NULL. Before the object is written, open levels need not be closed.
 * Numbers: 15 digits; 17 if the relative error of 15 digits exceeds 2^-52. A number that is not
 *          finite becomes null, because JSON has neither NaN nor infinity. Counts are exact up to
 *          10^15.
 * Errors:  only the functions that write the object report that memory was out.
 * Owner:   the caller frees the writer; keys and texts are copied.
 * Thread:  one thread.
 */

enum { TL_JSON_WRITER_DEPTH = 8 }; /* maximum number of nested levels */

struct cJSON;

/* Fields are private. */
typedef struct tl_json_writer {
    struct cJSON *open[TL_JSON_WRITER_DEPTH]; /* open objects and arrays, outermost first; NULL: memory was out */
    size_t depth;                             /* number of open objects and arrays */
    bool failed;                              /* memory was out */
} tl_json_writer;

/* Initialises the writer and opens the outermost object. */
void tl_json_writer_begin(tl_json_writer *writer);

void tl_json_add_truth(tl_json_writer *writer, const char *key, bool truth);
void tl_json_add_number(tl_json_writer *writer, const char *key, double number);
void tl_json_add_count(tl_json_writer *writer, const char *key, uint64_t count);

/* `text` must be UTF-8; NULL becomes null. */
void tl_json_add_text(tl_json_writer *writer, const char *key, const char *text);

/* Adds the members of the object `text` to the innermost object. If the text is no JSON object, the
 * writer fails as if memory were out. */
void tl_json_add_members(tl_json_writer *writer, const char *text);

/* Opens an object or array inside the innermost one; at most TL_JSON_WRITER_DEPTH levels, including
 * the outermost (asserted). */
void tl_json_open_object(tl_json_writer *writer, const char *key);
void tl_json_open_array(tl_json_writer *writer, const char *key);

/* Closes the innermost object or array, but never the outermost (asserted). */
void tl_json_close(tl_json_writer *writer);

/* Prints the object, indented, and a newline. Errors: TL_TRY_AGAIN if memory was out; then nothing
 * is printed. The caller checks `file` for write errors. */
tl_status tl_json_writer_print(const tl_json_writer *writer, FILE *file, tl_error *error);

/* Writes the object to a file, completely or not at all (tl_new_file). Errors: TL_TRY_AGAIN if
 * memory is out or the file cannot be written. */
tl_status tl_json_file_write(const tl_json_writer *writer, const char *path, tl_error *error);

/* Writes the object as one line without a newline, and a NUL. Returns the length of the line; 0 if
 * memory was out or the line does not fit into `room` bytes. `room` must be a few bytes longer than
 * the line, because cJSON needs them. */
size_t tl_json_writer_line(const tl_json_writer *writer, char *line, size_t room);

void tl_json_writer_free(tl_json_writer *writer);

#endif
