/* Configuration reader: reads sections and values of a configuration and reports problems; private
 * to this folder.
 *
 * Memory: the configuration's arena. Thread: one thread.
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

/* ---- Reads typed values from a parsed configuration and reports invalid ones.
 *
 * Purpose:      each key of config/SPEC.md is one call that names its type, range, default and
 *               example.
 * Problems:     all have one form, "line 12: found "0.1" (text), expected a number > 0, for example
 *               0.1", reported at the JSON path of the value. Reading continues after a problem.
 * Defaults:     a function that returns false does not change its target: set the default before
 *               the call.
 * Unknown keys: an object remembers the keys that were requested; tl_config_done() reports the
 *               others.
 * Owner:        texts point into the JSON tree, paths into the reader's arena.
 */

/* The longest duration, in seconds. Any number > 0 is allowed; less than 1 ns counts as 1 ns. */
#define TL_CONFIG_LONGEST_S 1e9
#define TL_CONFIG_DURATION "a number > 0 (at most 1e9)"

/* Converts a duration that passed the range check; s to ns. */
static inline tl_time tl_config_duration(double seconds) {
    tl_time duration = tl_time_of_seconds(seconds);
    return duration > 0 ? duration : 1;
}

enum { TL_CONFIG_KEYS = 24 }; /* maximum number of keys of one object of the format */

struct tl_config; /* config.h */

typedef struct tl_config_reader {
    const cJSON *root;
    tl_arena *arena;
    tl_report *report;
    const struct tl_config *config; /* what was read so far */
    bool out_of_memory;             /* the owner of the reader reports it once */
} tl_config_reader;

/* One object of the file. */
typedef struct tl_config_object {
    tl_config_reader *reader;
    const cJSON *json; /* NULL: absent or of a wrong type; all its keys then count as absent, without a report */
    char path[TL_JSON_PATH];
    const char *known[TL_CONFIG_KEYS]; /* keys that were requested */
    size_t known_count;
} tl_config_object;

typedef enum tl_config_need {
    TL_CONFIG_OPTIONAL,
    TL_CONFIG_REQUIRED,
    TL_CONFIG_MAY_BE_EMPTY /* optional; for a text: may be "" */
} tl_config_need;

typedef struct tl_config_number {
    tl_config_need need;
    double minimum, maximum; /* ∓HUGE_VAL: no limit */
    bool above, below;       /* the value must be > minimum (not only ≥), < maximum (not only ≤) */
    bool whole;
    const char *expected; /* NULL: generated from the range */
    const char *example;
} tl_config_number;

/* An object of named entries. */
typedef struct tl_config_map {
    tl_config_need need;
    size_t least, most; /* SIZE_MAX: any number */
    const char *example;
} tl_config_map;

/* ---- objects ---- */

/* Opens the root of the document. Reports a root that is no object. */
void tl_config_root(tl_config_reader *reader, tl_config_object *root);

/* Opens the object at a key. Returns false if it is absent (reported if required) or no object
 * (reported). */
bool tl_config_member(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                      tl_config_object *member);

/* Opens an object in which every key is a name, to be read with tl_config_each(). Returns the
 * number of entries. */
size_t tl_config_entries(tl_config_object *object, const char *key, const tl_config_map *rule, tl_config_object *map);

/* As tl_config_entries(), and allocates zeroed memory of `size` bytes for each entry. Sets *count.
 * Returns NULL if memory is out; *count is 0 then. */
void *tl_config_take_entries(tl_config_object *object, const char *key, const tl_config_map *rule, size_t size,
                             tl_config_object *map, size_t *count);

/* Calls `read` for each entry; `index` counts them from 0. */
void tl_config_each(const tl_config_object *map,
                    void (*read)(const tl_config_object *map, const cJSON *item, size_t index, void *context),
                    void *context);

/* Opens `item`, an entry of `map` or a member of any object, as an object. Returns false if it is
 * no object (reported). */
bool tl_config_entry(const tl_config_object *map, const cJSON *item, const char *example, tl_config_object *entry);

/* Reports all keys that were not requested, each with the nearest known key. */
void tl_config_done(const tl_config_object *object);

/* ---- values: true if the key is present and valid ---- */

bool tl_config_get_number(tl_config_object *object, const char *key, const tl_config_number *rule, double *value);
bool tl_config_get_boolean(tl_config_object *object, const char *key, bool *value);

/* The first function reads a whole number; `rule` must limit it to the range of uint32_t. The
 * second one reads a duration > 0, in s, and sets *value in ns. */
bool tl_config_get_count(tl_config_object *object, const char *key, const tl_config_number *rule, uint32_t *value);
bool tl_config_get_duration(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                            tl_time *value);

/* Reads `scale` (default 1, never 0) and `offset` (default 0). */
void tl_config_get_scale(tl_config_object *object, double *scale, double *offset);

/* Reads a text without control characters. It is not empty, unless `need` is
 * TL_CONFIG_MAY_BE_EMPTY. */
bool tl_config_get_text(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                        const char **value);

/* Reads one of `choices`, a list that ends with NULL; the first one is the example. */
bool tl_config_get_choice(tl_config_object *object, const char *key, tl_config_need need, const char *const *choices,
                          size_t *index);

/* Returns the value at a key, of any type. Returns NULL if it is absent (reported if required). */
const cJSON *tl_config_get(tl_config_object *object, const char *key, tl_config_need need, const char *expected,
                           const char *example);

/* Returns the array at a key. Returns NULL if it is absent, or no array (reported; the problem says
 * what is `expected`). */
const cJSON *tl_config_get_array(tl_config_object *object, const char *key, const char *expected, const char *example);

/* ---- problems ---- */

/* Reports a problem in the common form. `line`: from 1. `example` NULL: no example. */
void tl_config_problem(const tl_config_reader *reader, const char *path, size_t line, const char *found,
                       const char *expected, const char *example);

/* Reports a problem at a key of an object. `found` NULL: describes the value of the key. */
void tl_config_wrong(const tl_config_object *object, const char *key, const char *found, const char *expected,
                     const char *example);

/* Reports a problem at an item. `found` NULL: a short description of the item, as "0.1" (text), 5
 * (number), true, an array of 3. */
void tl_config_wrong_item(const tl_config_reader *reader, const cJSON *item, const char *path, const char *found,
                          const char *expected, const char *example);

/* ---- memory ---- */

/* Allocates zeroed memory of the configuration. If memory is out, returns NULL and sets
 * out_of_memory. */
void *tl_config_take(tl_config_reader *reader, size_t count, size_t size);

/* Copies a path; "" if memory is out. */
const char *tl_config_keep(tl_config_reader *reader, const char *path);

/* ---- Names in a configuration: their form, and their targets.
 *
 * Names:      of components, signals and sources: [A-Za-z_][A-Za-z0-9_]*, at most 63 characters.
 * References: "component.variable" and "plant.signal". Whether the component or signal exists is
 *             checked here, so that it is reported with all other problems. Only the FMU shows
 *             later whether the variable exists (twin.h).
 */

/* Reports the key of an entry if it is not a valid name. */
void tl_config_check_name(const tl_config_object *map, const cJSON *entry, const char *example);

/* Returns true if the entry has a key that is in `kinds`. NULL ends the list `kinds`. */
bool tl_config_is_of_kind(const cJSON *entry, const char *const *kinds);

/* Writes "WHAT: one of a, b, c", where a, b, c are the names of the entries of a section. `kinds`
 * not NULL: only entries of these kinds. Writes only WHAT if there is no name. Cut if it does not
 * fit. */
void tl_config_list_names(const char *what, const cJSON *section, const char *const *kinds, char *text, size_t size);

/* Allowed targets of a reference. */
typedef enum tl_config_target {
    TL_CONFIG_VARIABLE = 1, /* component.variable */
    TL_CONFIG_SIGNAL = 2,   /* plant.signal */
    TL_CONFIG_EITHER = 3
} tl_config_target;

/* Reports the reference `text` at `path` if its target does not exist. Reports nothing if the
 * section of the target is missing or not an object, because that was reported before. */
void tl_config_check_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                               tl_config_target target);

/* As tl_config_check_reference(), at the path and line of a key of `object`. `text` is the value of
 * the key, or a part of it. */
void tl_config_check_reference_of(const tl_config_object *object, const char *key, const char *text,
                                  tl_config_target target);

/* ---- The sections of a configuration: each function reads some keys of the root into the
 * configuration.
 *
 * Purpose: config.c calls these functions. If a section needs another section, config.c has read
 *          that one before, or the function searches the JSON tree.
 * Errors:  reported; a value that cannot be read keeps its default.
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

/* Computes the look-ups of each signal (config.h). Call it after all functions above. */
void tl_config_build_lookups(tl_config_object *root, struct tl_config *config);

/* recording, record, realtime, emulate */
void tl_config_read_recording(tl_config_object *root, struct tl_config *config);
void tl_config_read_record(tl_config_object *root, struct tl_config *config);
void tl_config_read_detect(tl_config_object *root, struct tl_config *config);
void tl_config_read_realtime(tl_config_object *root, struct tl_config *config);
void tl_config_read_emulate(tl_config_object *root, struct tl_config *config);

#endif
