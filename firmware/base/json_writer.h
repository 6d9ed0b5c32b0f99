/* JSON for programs: one object, put together in memory and written whole, or not at all.
 *
 * Purpose: the one place where JSON is written. Values go into the innermost object or array that is open, with a key in an
 *          object and NULL in an array, and come out in that order.
 * Numbers: with 15 digits, 17 if those are not enough for one part in 2^52. Null if they are not finite: JSON knows neither
 *          NaN nor infinity.
 * Errors:  memory that is out is told once, by tl_json_writer_print().
 * Owner:   the caller, who frees it.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_BASE_JSON_WRITER_H
#define TL_FIRMWARE_BASE_JSON_WRITER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/status.h"

enum { TL_JSON_WRITER_DEPTH = 8 };

struct cJSON;

typedef struct tl_json_writer {
    struct cJSON *open[TL_JSON_WRITER_DEPTH]; /* objects and arrays, the outermost first; NULL: memory was out */
    size_t depth;
    bool failed;
} tl_json_writer;

/* The outermost object is open. */
void tl_json_writer_begin(tl_json_writer *writer);

void tl_json_add_null(tl_json_writer *writer, const char *key);
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

/* The object in one line without its end, with a NUL behind it. Returns its length; 0: it does not fit into `room` bytes, or memory was out. */
size_t tl_json_writer_line(const tl_json_writer *writer, char *line, size_t room);

void tl_json_writer_free(tl_json_writer *writer);

#endif
