/* A small JSON object that this program has written earlier, read back as if a stranger had.
 *
 * Purpose: a few members by their keys. What says where in a file something is wrong is firmware/config/json_document.h.
 * Use:     `right` is looked at once all members are read.
 * Errors:  a member that is missing or of another type makes `right` false, and reads as something harmless.
 * Owner:   the caller, who frees it; texts live until then.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_BASE_JSON_READER_H
#define TL_FIRMWARE_BASE_JSON_READER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct cJSON;

typedef struct tl_json_reader {
    struct cJSON *root; /* NULL: the text is no JSON object */
    bool right;
} tl_json_reader;

/* `text` needs no terminator and passes json_text.h first. If it is refused, or memory is out, nothing is right. */
tl_json_reader tl_json_reader_of(const char *text, size_t size);

/* Whether there is a member with this key: for one that an older program did not write. */
bool tl_json_has(const tl_json_reader *reader, const char *key);

/* Of the first member with this key. A count is a number of at least 0, below 9e15, rounded down. */
uint64_t tl_json_count(tl_json_reader *reader, const char *key);
double tl_json_number(tl_json_reader *reader, const char *key);
bool tl_json_truth(tl_json_reader *reader, const char *key);
const char *tl_json_text(tl_json_reader *reader, const char *key);

void tl_json_reader_free(tl_json_reader *reader);

#endif
