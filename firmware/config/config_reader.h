/* Reads the sections of a configuration and their values, and reports its problems; private to this folder.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_READER_H
#define TL_FIRMWARE_CONFIG_CONFIG_READER_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/json_document.h"
#include "master/base/arena.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Reads typed values out of a parsed configuration and says what is wrong with them.
 *
 * Purpose: so that each key of config/SPEC.md is one call that names its type, range, default and example.
 * Problems: all have one shape, "line 12: found "0.1" (text), expected a number > 0, for example 0.1", reported at
 *          the JSON path of the value. Reading goes on after a problem.
 * Defaults: a function that returns false left its target alone: set the default before the call.
 * Unknown keys: an object remembers which keys were asked for; tl_config_done() reports the others.
 * Owner:   texts point into the JSON tree, paths into the reader's arena.
 */

/* The longest duration, in seconds. Any number > 0 is one; less than a nanosecond counts as one. */
#define TL_CONFIG_LONGEST_S 1e9
#define TL_CONFIG_DURATION "a number > 0 (at most 1e9)"

/* A duration that passed the range check. */
static inline tl_time tl_config_duration(double seconds) {
    tl_time duration = tl_time_of_seconds(seconds);
    return duration > 0 ? duration : 1;
}

enum { TL_CONFIG_KEYS = 16 }; /* the most keys that one object of the format knows */

struct tl_config; /* config.h */

typedef struct tl_config_reader {
    const cJSON *root;
    tl_arena *arena;
    tl_report *report;
    const struct tl_config *config; /* what was read before */
    bool out_of_memory;             /* reported once, by whoever owns the reader */
} tl_config_reader;

/* One object of the file. */
typedef struct tl_config_object {
    tl_config_reader *reader;
    const cJSON *json; /* NULL: not there, or of a wrong type; nothing in it is found, and nothing reported */
    char path[TL_JSON_PATH];
    const char *known[TL_CONFIG_KEYS];
    size_t known_count;
} tl_config_object;

typedef enum tl_config_need {
    TL_CONFIG_OPTIONAL,
    TL_CONFIG_REQUIRED,
    TL_CONFIG_MAY_BE_EMPTY /* optional; for a text: may be "" */
} tl_config_need;

typedef struct tl_config_number {
    tl_config_need need;
    double minimum, maximum; /* ∓HUGE_VAL: none */
    bool above, below;       /* minimum, maximum itself is excluded */
    bool whole;
    const char *expected; /* NULL: made from the above */
    const char *example;
} tl_config_number;

/* An object of named entries. */
typedef struct tl_config_map {
    tl_config_need need;
    size_t least, most; /* SIZE_MAX: any number */
    const char *example;
} tl_config_map;

/* ---- objects ---- */

void tl_config_root(tl_config_reader *reader, tl_config_object *root);
bool tl_config_member(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                      tl_config_object *member);

/* An object of which every key is a name: go through it by tl_config_each(). Returns the number of entries. */
size_t tl_config_entries(tl_config_object *object, const char *key, const tl_config_map *rule, tl_config_object *map);

/* The same, with zeroed memory for each entry, `size` bytes of the configuration; the number of entries goes to `count`.
 * NULL where memory is out: no entry is there then. */
void *tl_config_take_entries(tl_config_object *object, const char *key, const tl_config_map *rule, size_t size,
                             tl_config_object *map, size_t *count);

/* Hands out its entries, one by one; `index` counts them. */
void tl_config_each(const tl_config_object *map,
                    void (*read)(const tl_config_object *map, const cJSON *item, size_t index, void *context),
                    void *context);

/* One entry of such an object (or a member found in another way) as an object of its own. */
bool tl_config_entry(const tl_config_object *map, const cJSON *item, const char *example, tl_config_object *entry);

/* Reports the keys nobody asked for, each with the nearest known one. */
void tl_config_done(const tl_config_object *object);

/* ---- values: true where the key is there and right ---- */

bool tl_config_get_number(tl_config_object *object, const char *key, const tl_config_number *rule, double *value);
bool tl_config_get_boolean(tl_config_object *object, const char *key, bool *value);

/* A rule of whole numbers from 0 up that uint32_t has; and a duration > 0. */
bool tl_config_get_count(tl_config_object *object, const char *key, const tl_config_number *rule, uint32_t *value);
bool tl_config_get_duration(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                            tl_time *value);

/* `scale`, 1 if it is not given and never 0, and `offset`. */
void tl_config_get_scale(tl_config_object *object, double *scale, double *offset);

/* A text without control characters; not empty unless TL_CONFIG_MAY_BE_EMPTY. */
bool tl_config_get_text(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                        const char **value);

/* One of `choices`, which ends with NULL; the first is the example. */
bool tl_config_get_choice(tl_config_object *object, const char *key, tl_config_need need, const char *const *choices,
                          size_t *index);

/* Whatever stands there; NULL where nothing does (reported where it is required). */
const cJSON *tl_config_get(tl_config_object *object, const char *key, tl_config_need need, const char *expected,
                           const char *example);

/* An array, if it is there; NULL where it is not, or where something else stands (reported as not being `expected`). */
const cJSON *tl_config_get_array(tl_config_object *object, const char *key, const char *expected, const char *example);

/* ---- problems ---- */

/* The one shape. `example` NULL: none. */
void tl_config_problem(const tl_config_reader *reader, const char *path, size_t line, const char *found,
                       const char *expected, const char *example);

/* At a key of an object; `found` NULL: what stands there. */
void tl_config_wrong(const tl_config_object *object, const char *key, const char *found, const char *expected,
                     const char *example);

/* At an item. `found` NULL: the item in a few words, "0.1" (text), 5 (number), true, an array of 3. */
void tl_config_wrong_item(const tl_config_reader *reader, const cJSON *item, const char *path, const char *found,
                          const char *expected, const char *example);

/* ---- memory ---- */

/* Zeroed memory of the configuration; NULL is noted in the reader. */
void *tl_config_take(tl_config_reader *reader, size_t count, size_t size);

/* A path to keep; "" where memory is out. */
const char *tl_config_keep(tl_config_reader *reader, const char *path);

/* ---- Names in a configuration: what they may look like, and what they refer to.
 *
 * Names:      of components, signals and sources: [A-Za-z_][A-Za-z0-9_]*, at most 63 characters.
 * References: "component.variable" and "plant.signal". That the component or signal exists is checked here, so that
 *             it is reported with everything else; whether the variable exists, only the FMU can tell (twin.h).
 */

/* Reports the key of an entry where it is no name. */
void tl_config_check_name(const tl_config_object *map, const cJSON *entry, const char *example);

/* Has the entry a member that is called as one of `kinds`, which end with NULL? */
bool tl_config_is_of_kind(const cJSON *entry, const char *const *kinds);

/* "WHAT: one of a, b, c", the keys of a section; where `kinds` are given, of those entries that are of one. Just WHAT
 * where there are none; cut where it does not fit. */
void tl_config_list_names(const char *what, const cJSON *section, const char *const *kinds, char *text, size_t size);

/* What a reference may lead to. */
typedef enum tl_config_target {
    TL_CONFIG_VARIABLE = 1, /* component.variable */
    TL_CONFIG_SIGNAL = 2,   /* plant.signal */
    TL_CONFIG_EITHER = 3
} tl_config_target;

/* Reports `text`, which stands at `path`, where it does not lead to such a thing. Silent where the section it leads to
 * is missing or no object: that was reported already. */
void tl_config_check_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                               tl_config_target target);

/* The same of the text of a key, or of a part of it. */
void tl_config_check_reference_of(const tl_config_object *object, const char *key, const char *text,
                                  tl_config_target target);

/* ---- The sections of a configuration: each function reads some keys of the root into the configuration.
 *
 * Purpose: for config.c, which calls them in this order; what a section needs of another has been read before it, or is looked up in the JSON
 *          tree.
 * Errors:  reported; what could not be read keeps its default.
 */

/* components, connect */
void tl_config_read_components(tl_config_object *root, struct tl_config *config);
void tl_config_read_connections(tl_config_object *root, struct tl_config *config);

/* compare, synchronise */
void tl_config_read_compare(tl_config_object *root, struct tl_config *config);
void tl_config_read_synchronise(tl_config_object *root, struct tl_config *config);

/* sources, plant */
void tl_config_read_sources(tl_config_object *root, struct tl_config *config);
void tl_config_read_signals(tl_config_object *root, struct tl_config *config);

/* delays */
void tl_config_read_delays(tl_config_object *root, struct tl_config *config);

/* Where they make each signal to be looked up: once all of the above is read. */
void tl_config_place_lookups(tl_config_object *root, struct tl_config *config);

/* recording, record, realtime, emulate */
void tl_config_read_recording(tl_config_object *root, struct tl_config *config);
void tl_config_read_record(tl_config_object *root, struct tl_config *config);
void tl_config_read_realtime(tl_config_object *root, struct tl_config *config);
void tl_config_read_emulate(tl_config_object *root, struct tl_config *config);

#endif
