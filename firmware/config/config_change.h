/* Change of a configuration: finds the differences, the right that each key requires, and how it
 * takes effect.
 *
 * Errors: each function states its own. Nothing is logged here.
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
 * Purpose:  decides in one table whether a change is made in place, by a new twin or by a restart,
 *           and who may make it. A test compares the table with config/schema/twinlock-1.json, so
 *           that every new key gets a rule. A key without a rule requires a restart and the right
 *           to commission.
 * Patterns: keys from the root, separated by dots. "*" is any key of an object of named entries,
 *           "[]" is any element of an array. "**" at the end is the value itself and all values in
 *           it.
 * Thread:   pure functions.
 */

/* What a value names. A configuration from the network may use such a name only if it was named on
 * the box before (see the allowed names below). */
typedef enum tl_change_named {
    TL_NAMES_NOTHING,
    TL_NAMES_FILE, /* a file, FIFO or folder to be read */
    TL_NAMES_LIBRARY,
    TL_NAMES_FMU
} tl_change_named;

typedef struct tl_change_needs {
    tl_change_kind kind;
    tl_change_right right; /* required right; for a value that names a file: the right if the name is not allowed */
    tl_change_named names; /* what the value of this key names */
} tl_change_needs;

typedef struct tl_change_rule {
    const char *pattern;
    tl_change_needs needs;
    /* Raises the requirements for particular values. NULL: `needs` applies to all values. */
    void (*check)(const cJSON *before, const cJSON *after, tl_change_needs *needs);
} tl_change_rule;

/* Requirements for keys of a driver: a restart, and the right to retune or to commission; or the
 * value names a file. */
#define TL_RULE_RETUNE                                                                                                 \
    { TL_CHANGE_RESTART, TL_RIGHT_RETUNE, TL_NAMES_NOTHING }
#define TL_RULE_COMMISSION                                                                                             \
    { TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, TL_NAMES_NOTHING }
#define TL_RULE_FILE                                                                                                   \
    { TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, TL_NAMES_FILE }

/* Rules of all keys except those of drivers, which have their own (drivers.h). A rule without a
 * pattern ends each list. The first rule that matches a path applies. */
extern const tl_change_rule tl_change_rules[];

/* Returns the rule of a path. NULL: there is none; then a change needs a restart and the right to
 * commission. */
const tl_change_rule *tl_change_rule_of(const tl_json_step *way, size_t depth);

/* Returns the requirements of this difference alone, without those within it. The order of keys is
 * ignored, except for matched and adjusted variables and for signals, because a twin identifies
 * these by their index. */
tl_change_needs tl_change_needs_of(const tl_json_difference *difference);

/* ---- Names of files and libraries that a configuration from the network may use.
 *
 * Purpose: a library is native code, and our processes may read more files than the sender. So a
 *          configuration from the network may use only names that were named on the box before: in
 *          the administrator's list, in the active configuration, or in the configuration file on
 *          the box. An allowed name needs only TL_RIGHT_COMMISSION.
 * Compare: names are compared byte for byte, as written. No path is resolved and no link followed;
 *          ".." has no special meaning.
 * Kinds:   permission to read a file does not include permission to load it as a library. Otherwise
 *          a person who can write the file could inject code.
 * Owner:   the caller owns the struct; zeroed it is empty. tl_allowed_names_free() frees its
 *          contents.
 * Thread:  one thread.
 */

struct tl_allowed_name;

/* Fields are private. */
typedef struct tl_allowed_names {
    struct tl_allowed_name *names;
    size_t count;
} tl_allowed_names;

/* Adds the names of an administrator's list: lines "file NAME" or "library NAME". Empty lines and
 * lines that begin with # are ignored. Any other line makes the whole list invalid. Errors:
 * TL_BAD_DATA, with the line; TL_TRY_AGAIN. */
tl_status tl_allowed_names_add_list(tl_allowed_names *allowed, const char *text, tl_error *error);

/* Adds the names that a configuration uses. Errors: TL_BAD_DATA if the text is not JSON;
 * TL_TRY_AGAIN. */
tl_status tl_allowed_names_add_configuration(tl_allowed_names *allowed, const char *text, tl_error *error);

/* Returns true if this name is allowed for this kind. */
bool tl_allowed_names_have(const tl_allowed_names *allowed, tl_change_named kind, const char *name);

/* Frees the names and empties the struct. */
void tl_allowed_names_free(tl_allowed_names *allowed);

/* ---- The change from one configuration to another, and its requirements.
 *
 * Purpose: the strictest of all differences decides how the configuration is changed, and which
 *          right is needed.
 * Order:   the order of keys is ignored, except in `match`, `adjust` and among signals (see
 *          tl_change_needs_of()).
 * Default: a key with its default value and a key left out are different.
 * Thread:  one thread; plain data.
 */

enum { TL_CONFIG_EDITS = 64, TL_CONFIG_BARRED = 8, TL_CONFIG_EDIT_SHOWN = 64 };

/* One difference. An object or array that was added or removed as a whole is one difference; its
 * requirements include those of all parts. */
typedef struct tl_config_edit {
    char path[TL_JSON_PATH];
    char before[TL_CONFIG_EDIT_SHOWN]; /* as JSON, cut; "": the key was absent */
    char after[TL_CONFIG_EDIT_SHOWN];  /* as JSON, cut; "": the key was removed */
    tl_change_needs needs;
} tl_config_edit;

/* A value that may only be given on the box: an edit, or a part of one. */
typedef struct tl_config_barred {
    char path[TL_JSON_PATH];
    char found[TL_CONFIG_EDIT_SHOWN]; /* as JSON, cut */
    tl_change_named names;
    bool is_installed; /* an installed FMU that would be allowed if its sha256 were given */
} tl_config_barred;

typedef struct tl_config_change {
    tl_change_needs needs; /* of all edits: the strictest kind, the highest right */
    size_t count;          /* number of all edits */
    size_t listed;         /* number of edits in the array; if not all fit, those with the strictest requirements */
    tl_config_edit edits[TL_CONFIG_EDITS];
    size_t barred; /* number of all barred values; `bar` contains the first ones */
    tl_config_barred bar[TL_CONFIG_BARRED];
} tl_config_change;

/* Finds all differences. `active_text` (the active configuration) and `candidate` are texts that
 * were read without a problem (config.h). `allowed`: names that need only TL_RIGHT_COMMISSION.
 * Errors: TL_BAD_DATA if a text is not JSON; TL_TRY_AGAIN if memory is out. `change` is empty then.
 */
tl_status tl_config_change_find(const char *active_text, size_t active_size, const char *candidate,
                                size_t candidate_size, const tl_allowed_names *allowed, tl_config_change *change,
                                tl_error *error);

#endif
