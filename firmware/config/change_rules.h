/* What a change of each key of a configuration needs: the table, and nothing else.
 *
 * Purpose: the one place in which it is decided what is changed in place, what takes a new twin or a new start, and who may do it. A test holds it
 *          against config/schema/twinlock-1.json, so that a new key has to be decided; until it is, a change of it is a restart and commissioning.
 * Patterns: keys from the root with dots between them; "*" is any key of an object of named entries, "[]" any element of an array, "**" at the end
 *          whatever is below.
 * Thread:  pure functions.
 */
#ifndef TL_FIRMWARE_CONFIG_CHANGE_RULES_H
#define TL_FIRMWARE_CONFIG_CHANGE_RULES_H

#include <stddef.h>

#include "firmware/config/json_difference.h"

/* From the least to the most. */
typedef enum tl_change_kind {
    TL_CHANGE_NONE,     /* the same values */
    TL_CHANGE_IN_PLACE, /* the twin takes it at the beginning of a tick, and keeps its state and all it has learned */
    TL_CHANGE_NEW_TWIN, /* other FMUs, parameters, connections, another search: a twin of another build, over the same samples */
    TL_CHANGE_RESTART /* the rest: other sources or signals, another cycle, another database */
} tl_change_kind;

enum { TL_CHANGE_KINDS = TL_CHANGE_RESTART + 1 };

/* What who changes it must be allowed to do; each may what those before it may. */
typedef enum tl_change_right {
    TL_CHANGE_BY_RETUNE,     /* values */
    TL_CHANGE_BY_COMMISSION, /* what names a host, port, device, interface or component, what acts on a line's electrical side, what may remove recorded
                                runs, how the process is scheduled, and by what the twin is judged (what is measured, the strokes, the step; a wider tolerance: errand/validator.h) */
    TL_CHANGE_ON_THE_BOX /* what names a library or a file that nobody on the box has named, or lets FMUs out: that does not come by the network, whoever sends it */
} tl_change_right;

enum { TL_CHANGE_RIGHTS = TL_CHANGE_ON_THE_BOX + 1 };

/* What a value names that does not come by the network, unless it was named on the box before (allowed_names.h). */
typedef enum tl_change_named {
    TL_NAMES_NOTHING,
    TL_NAMES_FILE, /* or a FIFO, or a folder: to be read */
    TL_NAMES_LIBRARY,
    TL_NAMES_FMU
} tl_change_named;

typedef struct tl_change_needs {
    tl_change_kind kind;
    tl_change_right right; /* of what has a name: unless that is allowed; then TL_CHANGE_BY_COMMISSION is enough */
    tl_change_named names;
} tl_change_needs;

typedef struct tl_change_rule {
    const char *pattern;
    tl_change_needs needs;
    /* Values that need more than the key does; NULL: none do. */
    void (*judge)(const tl_json_value *before, const tl_json_value *after, tl_change_needs *needs);
} tl_change_rule;

/* All of them, ended by one without a pattern. */
const tl_change_rule *tl_change_rules(void);

/* The one of a path; NULL: none, and a change there is the worst of all. */
const tl_change_rule *tl_change_rule_of(const tl_json_step *way, size_t depth);

/* What this difference by itself needs, without what is within it. Another order of keys is none, but of what is matched and adjusted, and of signals: a twin knows these by
 * their places. */
tl_change_needs tl_change_needs_of(const tl_json_difference *difference);

/* "none", "in place", "new twin", "restart". */
const char *tl_change_kind_name(tl_change_kind kind);

/* "retune", "commission", "on the box". */
const char *tl_change_right_name(tl_change_right right);

#endif
