/* Change of a configuration: finds the differences, the right that each one requires, and how it
 * takes effect. "The box" is the computer on which twinlock runs.
 *
 * Errors: each function states its own; nothing is logged.
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_CHANGE_H
#define TL_FIRMWARE_CONFIG_CONFIG_CHANGE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/base/change.h"
#include "firmware/config/json_difference.h"
#include "firmware/config/json_document.h"
#include "master/base/status.h"

/* ---- The table of rules: what a change of each key requires.
 *
 * Purpose:  decides whether a change is made in place, by a new twin or by a restart, and which
 *           right it requires. A test compares the table with config/schema/twinlock-1.json, so
 *           that every new key gets a rule. A key without a rule requires a restart and
 *           TL_RIGHT_COMMISSION.
 * Patterns: keys from the root, separated by dots: "components.*.read[]". "*" is any key, "[]" any
 *           element of an array. "**" at the end is the value itself and all values in it.
 * Thread:   pure functions.
 */

/* What a value names. A configuration from the network may use only allowed names (see below). */
typedef enum tl_change_named {
    TL_NAMES_NOTHING,
    TL_NAMES_FILE, /* a file, FIFO or folder to be read */
    TL_NAMES_LIBRARY,
    TL_NAMES_FMU
} tl_change_named;

typedef struct tl_change_needs {
    tl_change_kind kind;   /* how the change takes effect */
    tl_change_right right; /* required. In a rule with `names` it is ignored: see tl_change_needs_of() */
    tl_change_named names; /* what the value of this key names */
} tl_change_needs;

typedef struct tl_change_rule {
    const char *pattern;
    tl_change_needs needs;
    /* Raises the requirements for particular values; an absent one is NULL. Function NULL: `needs`
     * applies to all values. */
    void (*check)(const cJSON *before, const cJSON *after, tl_change_needs *needs);
} tl_change_rule;

/* Requirements for keys of a driver: a restart, and TL_RIGHT_RETUNE or TL_RIGHT_COMMISSION. FILE:
 * the value names a file. */
#define TL_RULE_RETUNE                                                                                                 \
    { TL_CHANGE_RESTART, TL_RIGHT_RETUNE, TL_NAMES_NOTHING }
#define TL_RULE_COMMISSION                                                                                             \
    { TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, TL_NAMES_NOTHING }
#define TL_RULE_FILE                                                                                                   \
    { TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, TL_NAMES_FILE }

/* Rules of all keys except those of drivers, which have their own (drivers.h). A rule with pattern
 * NULL ends each list. The first rule that matches a path applies. */
extern const tl_change_rule tl_change_rules[];

/* Returns the rule of a path of `depth` steps, also one of a driver; NULL if there is none. */
const tl_change_rule *tl_change_rule_of(const tl_json_step *way, size_t depth);

/* Returns the requirements of this difference alone, without those within it. A value with
 * `names` needs TL_RIGHT_BOX, its removal TL_RIGHT_COMMISSION. Another order of keys is
 * TL_CHANGE_NONE, except in `match`, `adjust` and `plant`: a twin identifies their entries by
 * index. */
tl_change_needs tl_change_needs_of(const tl_json_difference *difference);

/* ---- Names of files and libraries that a configuration from the network may use.
 *
 * Purpose: a library is native code, and our processes may read more files than the sender. So a
 *          configuration from the network may use only names from the administrator's list, the
 *          active configuration, or the configuration file on the box. An allowed name needs only
 *          TL_RIGHT_COMMISSION.
 * Compare: names are compared byte for byte, as written. No path is resolved and no link followed;
 *          ".." has no special meaning.
 * Kinds:   permission to read a file does not include permission to load it as a library. Otherwise
 *          a person who can write the file could inject code.
 * Owner:   the caller; a zeroed struct is empty. It owns copies of the names.
 * Thread:  one thread.
 */

struct tl_allowed_name;

/* Fields are private. */
typedef struct tl_allowed_names {
    struct tl_allowed_name *names;
    size_t count;
} tl_allowed_names;

/* Adds the names of an administrator's list: lines "file NAME" or "library NAME". Blank lines and
 * lines that begin with # are ignored. Errors: TL_BAD_DATA for any other line, with its number;
 * TL_TRY_AGAIN if memory is out. Names before the error were added. */
tl_status tl_allowed_names_add_list(tl_allowed_names *allowed, const char *text, tl_error *error);

/* Adds the names that a configuration uses. Errors: TL_BAD_DATA if the text is not JSON or has a
 * key twice; TL_TRY_AGAIN if memory is out. */
tl_status tl_allowed_names_add_configuration(tl_allowed_names *allowed, const char *text, tl_error *error);

/* Returns true if this name is allowed for this kind. */
bool tl_allowed_names_have(const tl_allowed_names *allowed, tl_change_named kind, const char *name);

/* Frees the names and empties the struct. */
void tl_allowed_names_free(tl_allowed_names *allowed);

/* ---- The change from one configuration to another, and its requirements.
 *
 * Purpose: the strictest kind and the highest right of all differences apply to the change.
 * Order:   of keys: see tl_change_needs_of().
 * Default: a key with its default value and a key left out are different.
 * Thread:  one thread; plain data.
 */

/* Largest number of listed edits and of listed privileged values; bytes of a shown value. */
enum { TL_CONFIG_EDITS = 64, TL_CONFIG_PRIVILEGED = 8, TL_CONFIG_EDIT_SHOWN = 64 };

/* One difference. An object or array that was added or removed as a whole is one difference; its
 * requirements include those of all parts. Another order of keys: `before` is "entries", `after` is
 * "entries in another order". */
typedef struct tl_config_edit {
    char path[TL_JSON_PATH];
    char before[TL_CONFIG_EDIT_SHOWN]; /* as JSON, cut; "": the key was absent */
    char after[TL_CONFIG_EDIT_SHOWN];  /* as JSON, cut; "": the key was removed */
    tl_change_needs needs;             /* `right`: with allowed names taken into account */
} tl_config_edit;

/* A value that needs TL_RIGHT_BOX: an edit, or a part of one. */
typedef struct tl_config_privileged {
    char path[TL_JSON_PATH];
    char found[TL_CONFIG_EDIT_SHOWN]; /* as JSON, cut */
    tl_change_named names;
    bool lacks_hash; /* an FMU that is named without folder and sha256; with its sha256 it would be allowed */
} tl_config_privileged;

typedef struct tl_config_change {
    tl_change_needs needs; /* of all edits: the strictest kind, the highest right; `names`: TL_NAMES_NOTHING */
    size_t count;          /* number of all edits */
    size_t listed;         /* number of elements of `edits`; if not all fit, the strictest edits */
    tl_config_edit edits[TL_CONFIG_EDITS];
    size_t privileged_count; /* number of all of them; `privileged` has the first ones */
    tl_config_privileged privileged[TL_CONFIG_PRIVILEGED];
} tl_config_change;

/* Finds all differences. `active_text` (the active configuration) and `candidate` are texts that
 * were read without a problem (config.h). `allowed`: names that need only TL_RIGHT_COMMISSION.
 * Errors: TL_BAD_DATA if a text is not JSON or has a key twice; TL_TRY_AGAIN if memory is out.
 * `change` is empty then. */
tl_status tl_config_change_find(const char *active_text, size_t active_size, const char *candidate,
                                size_t candidate_size, const tl_allowed_names *allowed, tl_config_change *change,
                                tl_error *error);

#endif
