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
 * Purpose:      each key of docs/reference/configuration.md is one call with its type, range and
 *               example.
 * Problems:     all have one form, line 12: found "0.1" (text), expected a number > 0, for example
 *               0.1. They are reported at the JSON path of the value. Reading continues afterwards.
 * Defaults:     a tl_config_get_…() function that returns false does not change its target: set the
 *               default before the call.
 * Unknown keys: an object records the requested keys; tl_config_done() reports all others.
 * Owner:        texts point into the JSON tree, kept paths into the reader's arena.
 */

/* The longest duration, in seconds, and the expected value in problems. Less than 1 ns counts as
 * 1 ns. */
#define TL_CONFIG_LONGEST_S 1e9
#define TL_CONFIG_DURATION "a number > 0 (at most 1e9)"

/* Converts a duration from s to ns; 0 < seconds ≤ TL_CONFIG_LONGEST_S. */
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
    const struct tl_config *config; /* has the sections that were read before */
    bool out_of_memory;             /* not reported yet; the owner of the reader reports it once */
} tl_config_reader;

/* One object of the file. */
typedef struct tl_config_object {
    tl_config_reader *reader;
    const cJSON *json; /* NULL: absent or no object; then all keys count as absent, unreported */
    char path[TL_JSON_PATH];
    const char *known[TL_CONFIG_KEYS]; /* keys that were requested */
    size_t known_count;
} tl_config_object;

typedef enum tl_config_need {
    TL_CONFIG_OPTIONAL,
    TL_CONFIG_REQUIRED,
    TL_CONFIG_MAY_BE_EMPTY /* optional; a text may be "" */
} tl_config_need;

typedef struct tl_config_number {
    tl_config_need need;
    double minimum, maximum; /* ∓HUGE_VAL: no limit */
    bool above, below;       /* `minimum`, `maximum` themselves are out of range */
    bool whole;
    const char *expected; /* NULL: generated from the range */
    const char *example;
} tl_config_number;

/* An object of named entries. */
typedef struct tl_config_map {
    tl_config_need need;
    size_t least, most; /* number of entries; `most` SIZE_MAX: no limit */
    const char *example;
} tl_config_map;

/* ---- objects ---- */

/* Opens the root of the document; reports it if it is no object. */
void tl_config_root(tl_config_reader *reader, tl_config_object *root);

/* Opens the object at a key. Returns false if it is absent (reported if required) or no object
 * (reported); then all keys of `member` count as absent. */
bool tl_config_member(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                      tl_config_object *member);

/* Opens an object in which every key is a name, for tl_config_each(). Returns the number of
 * entries, also if it is out of range (reported); 0 if there is no object. */
size_t tl_config_entries(tl_config_object *object, const char *key, const tl_config_map *rule, tl_config_object *map);

/* As tl_config_entries(), and returns zeroed memory of `size` bytes for each of *count entries.
 * Returns NULL if memory is out; *count is 0 then, and `map` has no entries. */
void *tl_config_take_entries(tl_config_object *object, const char *key, const tl_config_map *rule, size_t size,
                             tl_config_object *map, size_t *count);

/* Calls `read` for each entry; `index` counts them from 0. */
void tl_config_each(const tl_config_object *map,
                    void (*read)(const tl_config_object *map, const cJSON *item, size_t index, void *context),
                    void *context);

/* Opens `item`, an entry of `map` or a member of any object, as an object. Returns false if it is
 * no object (reported). */
bool tl_config_entry(const tl_config_object *map, const cJSON *item, const char *example, tl_config_object *entry);

/* Reports all keys that were not requested, each with the most similar known key, or with all. */
void tl_config_done(const tl_config_object *object);

/* ---- values: true if the key is present and valid ---- */

bool tl_config_get_number(tl_config_object *object, const char *key, const tl_config_number *rule, double *value);
bool tl_config_get_boolean(tl_config_object *object, const char *key, bool *value);

/* The first function reads a whole number; `rule` must have `whole` and limits within uint32_t. The
 * second one reads a duration in s, > 0, at most 1e9, and sets *value in ns. */
bool tl_config_get_count(tl_config_object *object, const char *key, const tl_config_number *rule, uint32_t *value);
bool tl_config_get_duration(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                            tl_time *value);

/* Reads `scale` (default 1; 0 is reported) and `offset`; set *offset to its default before. */
void tl_config_get_scale(tl_config_object *object, double *scale, double *offset);

/* Reads a text for which tl_text_is_plain() is true. It may be "" only with
 * TL_CONFIG_MAY_BE_EMPTY. */
bool tl_config_get_text(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                        const char **value);

/* Reads one of `choices` (NULL ends the list) and sets *index; the first one is the example. */
bool tl_config_get_choice(tl_config_object *object, const char *key, tl_config_need need, const char *const *choices,
                          size_t *index);

/* Returns the value at a key, of any type. Returns NULL if it is absent (reported if required). */
const cJSON *tl_config_get(tl_config_object *object, const char *key, tl_config_need need, const char *expected,
                           const char *example);

/* Returns the array at a key; NULL if it is absent or no array (reported). */
const cJSON *tl_config_get_array(tl_config_object *object, const char *key, const char *expected, const char *example);

/* ---- problems ---- */

/* Reports a problem in the common form. `line`: from 1. `example` NULL: no example. */
void tl_config_problem(const tl_config_reader *reader, const char *path, size_t line, const char *found,
                       const char *expected, const char *example);

/* Reports a problem at a key of an object. `found` NULL: describes the value, or "nothing". */
void tl_config_wrong(const tl_config_object *object, const char *key, const char *found, const char *expected,
                     const char *example);

/* Reports a problem at an item. `found` NULL: describes the item, for example: "0.1" (text), 5
 * (number), true, an array of 3. */
void tl_config_wrong_item(const tl_config_reader *reader, const cJSON *item, const char *path, const char *found,
                          const char *expected, const char *example);

/* ---- memory ---- */

/* Allocates `count` zeroed objects of `size` bytes in the configuration's arena. If memory is out,
 * returns NULL and sets out_of_memory. */
void *tl_config_allocate(tl_config_reader *reader, size_t count, size_t size);

/* Copies a path to the arena. If memory is out, returns "" and sets out_of_memory. */
const char *tl_config_copy_path(tl_config_reader *reader, const char *path);

/* ---- Names in a configuration: their form, and their targets.
 *
 * Names:      of components, signals, sources and participants: [A-Za-z_][A-Za-z0-9_]*, at most 63
 *             characters.
 * References: "component.variable" and "plant.signal". Their components and signals are checked
 *             here, variables later against the FMU (twin.h).
 */

/* Reports the key of an entry if it is not a valid name. */
void tl_config_check_name(const tl_config_object *map, const cJSON *entry, const char *example);

/* Returns true if the entry has a key that is in `kinds`, a list that ends with NULL. */
bool tl_config_is_of_kind(const cJSON *entry, const char *const *kinds);

/* Writes "WHAT: one of a, b, c": the names of all entries of a section, or only of those with a key
 * in `kinds` (NULL: all). Writes only WHAT if there is no name. A longer text is cut. */
void tl_config_list_names(const char *what, const cJSON *section, const char *const *kinds, char *text, size_t size);

/* Allowed targets of a reference. */
typedef enum tl_config_target {
    TL_CONFIG_VARIABLE = 1, /* component.variable */
    TL_CONFIG_SIGNAL = 2,   /* plant.signal */
    TL_CONFIG_EITHER = 3
} tl_config_target;

/* Reports the reference `text` at `path` if its form is wrong, its kind is not `target`, or its
 * component or signal does not exist. The last check is skipped if the section is missing or no
 * object, because that was reported before. */
void tl_config_check_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                               tl_config_target target);

/* As tl_config_check_reference(), at a key of `object`. `text` is its value, or a part of it. */
void tl_config_check_reference_of(const tl_config_object *object, const char *key, const char *text,
                                  tl_config_target target);

/* ---- The sections of a configuration: each function reads some keys of the root into the
 * configuration.
 *
 * Purpose: config.c calls these functions in the order of their dependencies. A function that needs
 *          a later section searches the JSON tree.
 * Errors:  reported; an invalid value keeps its default.
 */

/* components, connect */
void tl_config_read_fill_in(tl_config_object *root, struct tl_config *config);
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

/* Computes the look-ups of each signal (config.h). Call it after the functions above. */
void tl_config_build_lookups(tl_config_object *root, struct tl_config *config);

/* recording, record, detect, realtime, emulate */
void tl_config_read_recording(tl_config_object *root, struct tl_config *config);
void tl_config_read_record(tl_config_object *root, struct tl_config *config);
void tl_config_read_detect(tl_config_object *root, struct tl_config *config);
void tl_config_read_realtime(tl_config_object *root, struct tl_config *config);
void tl_config_read_emulate(tl_config_object *root, struct tl_config *config);

#endif
