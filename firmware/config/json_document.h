/* A JSON document: a text that passed json_text.h, parsed by cJSON, with lines and paths.
 *
 * Purpose: everything that is needed to say where in a file a value stands.
 * Lines:   each item's `valueint` holds its line from 1 in place of the truncated number, which nobody reads: numbers
 *          are in `valuedouble`.
 * Owner:   the caller, who frees the root by cJSON_Delete().
 */
#ifndef TL_FIRMWARE_CONFIG_JSON_DOCUMENT_H
#define TL_FIRMWARE_CONFIG_JSON_DOCUMENT_H

#include <stddef.h>

#include <cjson/cJSON.h>

#include "firmware/config/json_path.h"
#include "master/base/arena.h"
#include "master/base/status.h"

/* Parses the text. `scratch` is used during the call only.
 * Errors: TL_BAD_DATA for what json_text.h refuses, and TL_TRY_AGAIN: reported, *root is NULL. Keys that appear
 * twice in an object are all reported too, as TL_BAD_DATA, but *root is there, so that more can be said. */
tl_status tl_json_parse(const char *text, size_t size, tl_arena *scratch, tl_report *report, cJSON **root);

/* The line of an item of a parsed document. */
size_t tl_json_line(const cJSON *item);

/* The item at a path, or the innermost one around it that exists; NULL where not even the first part exists. Where
 * several keys fit, the longest does. */
const cJSON *tl_json_nearest(const cJSON *root, const char *path);

#endif
