/* What the change from one configuration to another is, and what it needs.
 *
 * Purpose: a configuration is changed in the way that the worst of its differences needs, by who may make all of them.
 * Order:   of keys counts as nothing, but in `match` and `adjust` (change_rules.h).
 * Default: a key with its default value and a key left out are two different configurations; nothing is guessed.
 * Thread:  one thread; plain data.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_CHANGE_H
#define TL_FIRMWARE_CONFIG_CONFIG_CHANGE_H

#include <stddef.h>

#include "firmware/config/allowed_names.h"
#include "firmware/config/change_rules.h"
#include "firmware/config/json_path.h"
#include "master/base/status.h"

enum { TL_CONFIG_EDITS = 64, TL_CONFIG_BARRED = 8, TL_CONFIG_EDIT_SHOWN = 64, TL_CONFIG_EDIT_TEXT = 512 };

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

/* "plant.omega.stale_s: 0.5 → 2 (restart)", "…: 0.5 is removed (…)", "…: 2 is added (…)". */
void tl_config_edit_write(const tl_config_edit *edit, char text[TL_CONFIG_EDIT_TEXT]);

#endif
