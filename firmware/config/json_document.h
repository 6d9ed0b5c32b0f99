/* JSON document: parses a text with line numbers, and builds and finds paths of values.
 *
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_JSON_DOCUMENT_H
#define TL_FIRMWARE_CONFIG_JSON_DOCUMENT_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stddef.h>

#include "firmware/base/json.h"
#include "master/base/arena.h"
#include "master/base/status.h"

/* ---- Iterates over all items of a JSON document without recursion.
 *
 * Order: each value comes after the value that contains it and before its next sibling.
 */

/* The objects and arrays around the current item, outermost first. Zero it before the first call.
 * tl_json_parse() limits the depth. */
typedef struct tl_json_walk {
    cJSON *around[TL_JSON_MAX_DEPTH];
    size_t depth;
} tl_json_walk;

/* Returns the item after `item`; in the first call that is the root. NULL: there are no more. */
cJSON *tl_json_walk_next(tl_json_walk *walk, cJSON *item);

/* ---- Paths of values in a JSON document, for messages.
 *
 * Paths:  "plant.omega.stale_s", "connect[2][0]"; "" is the root. A key may contain dots
 *         ("motor.d"), which are not escaped.
 * Thread: pure functions.
 */

/* Bytes, including the NUL, of a path, and of a key or text in a message. Longer ones are cut by
 * tl_text_for_people(). */
enum { TL_JSON_PATH = 256, TL_JSON_SHOWN = 64 };

/* One step of a path: to a member of an object, or to an element of an array. */
typedef struct tl_json_step {
    const char *key; /* key of a member; NULL: an element of an array */
    size_t index;    /* index of the element, from 0 */
} tl_json_step;

/* Write the path of a member of the object at `parent`, or of an element of the array at `parent`.
 * `path` has TL_JSON_PATH bytes and may be `parent` itself. */
void tl_json_member_path(char *path, const char *parent, const char *key);
void tl_json_element_path(char *path, const char *parent, size_t index);

/* Writes the path of `depth` steps from the root; `path` has TL_JSON_PATH bytes. */
void tl_json_steps_path(char *path, const tl_json_step *way, size_t depth);

/* ---- A JSON document: a text that json.h accepts, parsed by cJSON, with lines and paths.
 *
 * Lines: the `valueint` of each item is its line (from 1); numbers are only in `valuedouble`.
 * Owner: the caller frees the root with cJSON_Delete().
 */

/* Parses `size` bytes. `scratch`: memory that is needed only during the call; the caller frees it.
 * Errors: all are reported. TL_BAD_DATA if json.h rejects the text, TL_TRY_AGAIN if memory is out:
 *         *root is NULL then. TL_BAD_DATA also if an object has a key twice; all such keys are
 *         reported. *root is set in this case, so that the caller can report further problems. */
tl_status tl_json_parse(const char *text, size_t size, tl_arena *scratch, tl_report *report, cJSON **root);

/* Applies a merge patch (RFC 7396), an object, to an object; its items are copied. Returns false if
 * memory is out or `patch` has more than TL_JSON_MAX_DEPTH levels; `target` may be changed then. */
bool tl_json_merge(cJSON *target, const cJSON *patch);

/* Returns the members of an object, sorted by key, equal keys by `valueint`. The caller frees the
 * array. Returns NULL if memory is out. */
cJSON **tl_json_sorted(const cJSON *object, size_t *count);

/* Returns the line (from 1) of an item of tl_json_parse(). */
size_t tl_json_line(const cJSON *item);

/* Returns the item at a path, or the innermost existing item around it. Returns NULL if not even
 * the first step exists. Keys may contain dots: of several that match, the longest one is used. */
const cJSON *tl_json_nearest(const cJSON *root, const char *path);

#endif
