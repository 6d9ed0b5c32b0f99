/* A JSON document: parsing with lines, paths to its values.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_CONFIG_JSON_DOCUMENT_H
#define TL_FIRMWARE_CONFIG_JSON_DOCUMENT_H

#include <cjson/cJSON.h>
#include <stddef.h>

#include "firmware/base/json.h"
#include "master/base/arena.h"
#include "master/base/status.h"

/* ---- All items of a JSON document, one after the other, without recursion.
 *
 * Purpose: each value is met after those around it, in the order of the children.
 * Thread:  one thread.
 */

/* The items around the current one, outermost first; zeroed at the root. The depth was checked with the text. */
typedef struct tl_json_walk {
    cJSON *around[TL_JSON_MAX_DEPTH];
    size_t depth;
} tl_json_walk;

/* The item after this one, NULL after the last below where the walk began. */
cJSON *tl_json_walk_next(tl_json_walk *walk, cJSON *item);

/* ---- Where in a JSON document something stands, for people.
 *
 * Paths:   "plant.omega.stale_s", "connect[2][0]"; "" is the root. A key may hold dots ("motor.d").
 * Thread:  pure functions.
 */

/* Room for a path and for a key or text in a message; what is longer is cut, see tl_text_for_people(). */
enum { TL_JSON_PATH = 256, TL_JSON_SHOWN = 64 };

/* One step down. */
typedef struct tl_json_step {
    const char *key; /* of a member; NULL: an element of an array */
    size_t index;    /* of the element */
} tl_json_step;

/* The path of a member of the object at `parent`, and of an element of the array at `parent`. `path` has TL_JSON_PATH
 * bytes and may be `parent` itself. */
void tl_json_member_path(char *path, const char *parent, const char *key);
void tl_json_element_path(char *path, const char *parent, size_t index);

/* The path of so many steps from the root. */
void tl_json_way_path(char *path, const tl_json_step *way, size_t depth);

/* ---- A JSON document: a text that passed json.h, parsed by cJSON, with lines and paths.
 *
 * Purpose: everything that is needed to say where in a file a value stands.
 * Lines:   each item's `valueint` holds its line from 1 in place of the truncated number, which nobody reads: numbers
 *          are in `valuedouble`.
 * Owner:   the caller, who frees the root by cJSON_Delete().
 */

/* Parses the text. `scratch` is used during the call only.
 * Errors: TL_BAD_DATA for what json.h refuses, and TL_TRY_AGAIN: reported, *root is NULL. Keys that appear
 * twice in an object are all reported too, as TL_BAD_DATA, but *root is there, so that more can be said. */
tl_status tl_json_parse(const char *text, size_t size, tl_arena *scratch, tl_report *report, cJSON **root);

/* The members of an object by their keys, the same keys by `valueint`. The caller frees the array. NULL: not enough memory. */
cJSON **tl_json_sorted(const cJSON *object, size_t *count);

/* The line of an item of a parsed document. */
size_t tl_json_line(const cJSON *item);

/* The item at a path, or the innermost one around it that exists; NULL where not even the first part exists. Where
 * several keys fit, the longest does. */
const cJSON *tl_json_nearest(const cJSON *root, const char *path);

#endif
