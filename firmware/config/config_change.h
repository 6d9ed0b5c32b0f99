/* A change of the configuration: what differs, which right each key needs, and how it takes effect.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_CHANGE_H
#define TL_FIRMWARE_CONFIG_CONFIG_CHANGE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/base/change.h"
#include "firmware/config/json_difference.h"
#include "firmware/config/json_document.h"
#include "master/base/status.h"

/* ---- What a change of each key of a configuration needs: the table, and nothing else.
 *
 * Purpose: the one place in which it is decided what is changed in place, what takes a new twin or a new start, and who may do it. A test holds it
 *          against config/schema/twinlock-1.json, so that a new key has to be decided; until it is, a change of it is a restart and commissioning.
 * Patterns: keys from the root with dots between them; "*" is any key of an object of named entries, "[]" any element of an array, "**" at the end
 *          the part itself and whatever is below.
 * Thread:  pure functions.
 */

/* What a value names that does not come by the network, unless it was named on the box before (config_change.h). */
typedef enum tl_change_named {
    TL_NAMES_NOTHING,
    TL_NAMES_FILE, /* or a FIFO, or a folder: to be read */
    TL_NAMES_LIBRARY,
    TL_NAMES_FMU
} tl_change_named;

typedef struct tl_change_needs {
    tl_change_kind kind;
    tl_change_right right; /* of what has a name: unless that is allowed; then TL_RIGHT_COMMISSION is enough */
    tl_change_named names; /* of a rule: what the value, if it is there, names; so it comes from the box only */
} tl_change_needs;

typedef struct tl_change_rule {
    const char *pattern;
    tl_change_needs needs;
    /* Values that need more than the key does; NULL: none do. */
    void (*judge)(const cJSON *before, const cJSON *after, tl_change_needs *needs);
} tl_change_rule;

/* What keys of a driver need: a restart, and the right to retune or to commission; or the value names a file. */
#define TL_RULE_RETUNE                                                                                                 \
    { TL_CHANGE_RESTART, TL_RIGHT_RETUNE, TL_NAMES_NOTHING }
#define TL_RULE_COMMISSION                                                                                             \
    { TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, TL_NAMES_NOTHING }
#define TL_RULE_FILE                                                                                                   \
    { TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, TL_NAMES_FILE }

/* Of all keys but those of drivers, which have rules of their own (drivers.h). Each list is ended by a rule without a pattern; the first that
 * matches a path counts. */
extern const tl_change_rule tl_change_rules[];

/* The one of a path; NULL: none, and a change there is the worst of all. */
const tl_change_rule *tl_change_rule_of(const tl_json_step *way, size_t depth);

/* What this difference by itself needs, without what is within it. Another order of keys is none, but of what is matched and adjusted, and of signals: a twin knows these by
 * their places. */
tl_change_needs tl_change_needs_of(const tl_json_difference *difference);

/* ---- Names of files and libraries that a configuration from the network may have.
 *
 * Purpose: a library is native code, and a file is read by whoever may read it. So of those a configuration that does not come from the box names only what somebody on
 *          the box has named before: the administrator in a list, the active configuration, the file on the box.
 * Compare: names are compared as they are written, byte for byte. So nothing is looked up, no link is followed, and no ".." leads anywhere else.
 * Kinds:   a file that may be read is no library that may be loaded: who may write the one would bring code by the other.
 * Owner:   the caller places it; zeroed it is empty. tl_allowed_names_free() frees what it holds.
 * Thread:  one thread.
 */

struct tl_allowed_name;

/* Fields are private. */
typedef struct tl_allowed_names {
    struct tl_allowed_name *names;
    size_t count;
} tl_allowed_names;

/* Those of an administrator's list: lines "file NAME" or "library NAME"; empty ones, and those that begin with #, say nothing. Other than these it is wrong as a whole.
 * Errors: TL_BAD_DATA, with the line; TL_TRY_AGAIN. */
tl_status tl_allowed_names_add_list(tl_allowed_names *allowed, const char *text, tl_error *error);

/* Those that a configuration has. Errors: TL_BAD_DATA for a text that is no JSON; TL_TRY_AGAIN. */
tl_status tl_allowed_names_add_configuration(tl_allowed_names *allowed, const char *text, tl_error *error);

bool tl_allowed_names_have(const tl_allowed_names *allowed, tl_change_named kind, const char *name);

void tl_allowed_names_free(tl_allowed_names *allowed);

/* ---- What the change from one configuration to another is, and what it needs.
 *
 * Purpose: a configuration is changed in the way that the worst of its differences needs, by who may make all of them.
 * Order:   of keys counts as nothing, but in `match` and `adjust` (config_change.h).
 * Default: a key with its default value and a key left out are two different configurations; nothing is guessed.
 * Thread:  one thread; plain data.
 */

enum { TL_CONFIG_EDITS = 64, TL_CONFIG_BARRED = 8, TL_CONFIG_EDIT_SHOWN = 64 };

/* One difference. An object or array that came or went as a whole is one, with what everything in it needs. */
typedef struct tl_config_edit {
    char path[TL_JSON_PATH];
    char before[TL_CONFIG_EDIT_SHOWN]; /* as JSON, cut; "": it was not there */
    char after[TL_CONFIG_EDIT_SHOWN];  /* "": it is no more */
    tl_change_needs needs;
} tl_config_edit;

/* A value that only somebody on the box may give, within an edit or an edit itself. */
typedef struct tl_config_barred {
    char path[TL_JSON_PATH];
    char found[TL_CONFIG_EDIT_SHOWN]; /* as JSON, cut */
    tl_change_named names;
    bool is_installed; /* of an FMU: without its sha256, and else it would do */
} tl_config_barred;

typedef struct tl_config_change {
    tl_change_needs needs; /* of all of them: the worst kind, the higher right */
    size_t count;          /* of edits, */
    size_t listed;         /* of them listed: if there is no room for all, those that need most */
    tl_config_edit edits[TL_CONFIG_EDITS];
    size_t barred; /* values; the first ones are listed */
    tl_config_barred bar[TL_CONFIG_BARRED];
} tl_config_change;

/* `in_force` and `candidate` are texts of configurations that were read without a problem (config.h). `allowed`: names that take no right beyond commissioning.
 * Errors: TL_BAD_DATA for one that is no JSON after all; TL_TRY_AGAIN where memory is out. `change` is empty then. */
tl_status tl_config_change_find(const char *in_force, size_t in_force_size, const char *candidate,
                                size_t candidate_size, const tl_allowed_names *allowed, tl_config_change *change,
                                tl_error *error);

#endif
