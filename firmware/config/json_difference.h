/* Difference of two JSON documents, path by path.
 *
 * Purpose:     two texts that json.h accepts are equal if they have equal values at equal paths.
 *              White space is ignored; 5, 5.0 and 5e0 are equal, but 0 and -0 are not. An absent
 *              key differs from a key with any value. Another order of the keys of an object is
 *              reported separately (`is_order`).
 * Arrays:      equal elements at the start and at the end are paired; the remaining ones are paired
 *              by position. So one inserted or removed element is one difference, plus its parts.
 *              A path contains the new index of an element, or the old index if it was removed.
 * Order:       by the bytes of keys, and by index in arrays; an object or array before its parts.
 * Whole parts: an object or array without a counterpart of the same type is one difference with
 *              `within` false. Then all values in it are reported, with `within` true.
 * Bound:       time O(n·log n) for each nesting level; no recursion.
 * Memory:      allocated and freed during the call.
 * Thread:      one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_JSON_DIFFERENCE_H
#define TL_FIRMWARE_CONFIG_JSON_DIFFERENCE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/json_document.h"
#include "master/base/status.h"

typedef struct tl_json_difference {
    const tl_json_step *way;     /* the path: keys and indices from the root to the value */
    size_t depth;                /* number of steps in `way`; 0: the root itself */
    const cJSON *before, *after; /* NULL: absent */
    bool within;                 /* part of the last difference with `within` false */
    bool is_order;               /* a difference in the order of an object's common keys */
} tl_json_difference;

/* A JSON text of `size` bytes; it need not be NUL-terminated. */
typedef struct tl_json_source {
    const char *text;
    size_t size;
    const char *called; /* name in error texts: "the new configuration" */
} tl_json_source;

/* Calls `see` for each difference, with `context`. Its pointers are valid only during that call.
 * Errors: TL_BAD_DATA if a text is not JSON or has a key twice; TL_TRY_AGAIN if memory is out.
 *         `see` may have been called before an error; ignore these calls. */
tl_status tl_json_compare(const tl_json_source *before, const tl_json_source *after,
                          void (*see)(const tl_json_difference *difference, void *context), void *context,
                          tl_error *error);

/* Returns true if the object that contains `item` has the key `key`; false if `item` is NULL. */
bool tl_json_has_sibling(const cJSON *item, const char *key);

/* Writes the value as JSON for a message, cut to `size` ≥ 8 bytes; "" if `item` is NULL or
 * memory is out. */
void tl_json_show(const cJSON *item, char *text, size_t size);

#endif
