/* What is different between two JSON documents, path by path.
 *
 * Purpose: two texts that passed json.h are the same if they have the same values at the same paths. White space counts as nothing, and 5, 5.0
 *          and 5e0 are one number; a key that is left out is not the same as one with any value. If keys that an object has on both sides are in another
 *          order, that is told too, for who it means something to (`is_order`).
 * Arrays:  elements that are the same at the beginning and at the end are paired; those between by their order. So one that was put in or taken out
 *          is one difference. An element's index is the one it has afterwards, or had before if it is gone.
 * Order:   keys of an object by their bytes, elements by their index.
 * Whole parts: an object or array of which there is nothing on the other side (or something else than an object or an array) is one
 *          difference; what is in it comes after it, as `within`.
 * Bound:   time O(n·log n) for each level of brackets, no recursion.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_JSON_DIFFERENCE_H
#define TL_FIRMWARE_CONFIG_JSON_DIFFERENCE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/json_document.h"
#include "master/base/status.h"

typedef struct tl_json_difference {
    const tl_json_step *way;     /* from the root; */
    size_t depth;                /* 0: the root itself */
    const cJSON *before, *after; /* NULL: there is nothing */
    bool within;                 /* a part of the last one that is not */
    bool
        is_order; /* two objects, of which the keys that both have are in another order; all else that is different in them is told besides */
} tl_json_difference;

/* A text; it needs no terminator. */
typedef struct tl_json_source {
    const char *text;
    size_t size;
    const char *called; /* in an error: "the configuration in force" */
} tl_json_source;

/* Calls `see` for each difference; everything it is given lives during the call only.
 * Errors: TL_BAD_DATA for a text that is no JSON or has a key twice; TL_TRY_AGAIN where memory is out. In both cases there may have
 * been calls, and they mean nothing. */
tl_status tl_json_compare(const tl_json_source *before, const tl_json_source *after,
                          void (*see)(const tl_json_difference *difference, void *context), void *context,
                          tl_error *error);

/* The object that it is a member of has such a key, too. False of NULL. */
bool tl_json_has_sibling(const cJSON *item, const char *key);

/* The value as JSON for people, cut to `size` ≥ 8 bytes; "" of NULL. */
void tl_json_show(const cJSON *item, char *text, size_t size);

#endif
