/* JSON document: parses a text with line numbers, and builds and finds paths of values.
 *
 * Thread:        one thread.
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
 * Purpose: visits each value after the values that contain it, in the order of the children.
 * Thread:  one thread.
 */

/* The objects and arrays around the current item, outermost first. Zero it before the walk starts.
 * The parser has limited the depth. */
typedef struct tl_json_walk {
    cJSON *around[TL_JSON_MAX_DEPTH];
    size_t depth;
} tl_json_walk;

/* Returns the next item, or NULL after the last item below the start. */
cJSON *tl_json_walk_next(tl_json_walk *walk, cJSON *item);

/* ---- Paths of values in a JSON document, for messages.
 *
 * Paths:  "plant.omega.stale_s", "connect[2][0]"; "" is the root. A key may contain dots
 *         ("motor.d").
 * Thread: pure functions.
 */

/* Bytes of a path, and of a key or text in a message. Longer ones are cut: see
 * tl_text_for_people(). */
enum { TL_JSON_PATH = 256, TL_JSON_SHOWN = 64 };

/* One step of a path: to a member of an object, or to an element of an array. */
typedef struct tl_json_step {
    const char *key; /* key of a member; NULL: an element of an array */
    size_t index;    /* index of the element */
} tl_json_step;

/* Write the path of a member of the object at `parent`, and of an element of the array at `parent`.
 * `path` has TL_JSON_PATH bytes and may be `parent` itself. */
void tl_json_member_path(char *path, const char *parent, const char *key);
void tl_json_element_path(char *path, const char *parent, size_t index);

/* Writes the path of `depth` steps from the root; `path` has TL_JSON_PATH bytes. */
void tl_json_steps_path(char *path, const tl_json_step *way, size_t depth);

/* ---- A JSON document: a text that json.h accepts, parsed by cJSON, with lines and paths.
 *
 * Purpose: finds the position of a value in the file.
 * Lines:   the `valueint` of each item holds its line (from 1) instead of the truncated number.
 *          Numbers are read from `valuedouble`.
 * Owner:   the caller frees the root with cJSON_Delete().
 */

/* Parses the text. `scratch` is used only during the call.
 * Errors: all are reported. TL_BAD_DATA if json.h rejects the text, TL_TRY_AGAIN if memory is out:
 *         *root is NULL then. TL_BAD_DATA also if an object has a key twice; all such keys are
 *         reported. *root is set in this case, so that the caller can report further problems. */
tl_status tl_json_parse(const char *text, size_t size, tl_arena *scratch, tl_report *report, cJSON **root);

/* Applies a merge patch (RFC 7396) to an object; the items of `patch` are copied. Returns false if
 * memory is out, or the patch is deeper than TL_JSON_MAX_DEPTH. */
bool tl_json_merge(cJSON *target, const cJSON *patch);

/* Returns the members of an object, sorted by key, equal keys by `valueint`. The caller frees the
 * array. Returns NULL if memory is out. */
cJSON **tl_json_sorted(const cJSON *object, size_t *count);

/* Returns the line of an item of a parsed document. */
size_t tl_json_line(const cJSON *item);

/* Returns the item at a path, or the innermost existing item around it. Returns NULL if not even
 * the first step exists. If several keys match, because keys contain dots, the longest one is used.
 */
const cJSON *tl_json_nearest(const cJSON *root, const char *path);

#endif
