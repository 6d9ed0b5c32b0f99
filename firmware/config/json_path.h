/* Where in a JSON document something stands, for people.
 *
 * Paths:   "plant.omega.stale_s", "connect[2][0]"; "" is the root. A key may hold dots ("motor.d").
 * Thread:  pure functions.
 */
#ifndef TL_FIRMWARE_CONFIG_JSON_PATH_H
#define TL_FIRMWARE_CONFIG_JSON_PATH_H

#include <stddef.h>

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

#endif
