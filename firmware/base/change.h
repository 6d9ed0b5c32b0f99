/* Kind, right and origin of a configuration change, with their names in text.
 *
 * Formats: stored versions, and replies on a control socket, contain the names. Requests on that
 *          socket contain the numbers of rights and origins. So do not change these numbers.
 * Thread:  pure functions.
 */
#ifndef TL_FIRMWARE_BASE_CHANGE_H
#define TL_FIRMWARE_BASE_CHANGE_H

#include <stdbool.h>

/* How a change takes effect, from the smallest effect to the largest. */
typedef enum tl_change_kind {
    TL_CHANGE_NONE,     /* all values are the same */
    TL_CHANGE_IN_PLACE, /* the running twin applies it at the start of a tick, and keeps its state and learned values */
    TL_CHANGE_NEW_TWIN, /* other FMUs, parameters, connections or search: a second twin (shadow) replaces the twin */
    TL_CHANGE_RESTART,  /* sources, signals, cycle, database and all others: the run restarts */
    TL_CHANGE_KINDS
} tl_change_kind;

/* What a user may do; and the right that a change needs. Each right includes those before it.
 * TL_RIGHT_COMMISSION is needed for a change that does one of these:
 * - names a host, port, device, interface or component;
 * - changes electrical settings of a line, for example a pull-up resistor;
 * - may remove recorded runs;
 * - changes how the process is scheduled;
 * - changes what the twin is compared with: measurements, event horizons (strokes), macro step. For
 *   a wider tolerance see retune/worker.h.
 * TL_RIGHT_BOX is needed for a change that names a library, file or FMU file that is not allowed
 * yet, or removes the confinement of FMUs. Requests over the network, and those with `--right`,
 * cannot make such a change. */
typedef enum tl_change_right {
    TL_RIGHT_READ,       /* no change */
    TL_RIGHT_RETUNE,     /* a change of values that names no other host, device, file or component */
    TL_RIGHT_COMMISSION, /* see above */
    TL_RIGHT_BOX,        /* see above */
    TL_RIGHTS
} tl_change_right;

/* Origin of a configuration version. A request has one of the first three. */
typedef enum tl_change_origin {
    TL_ORIGIN_RELOAD,  /* `twinlock reload`; in a version: with the text of the run's own configuration file */
    TL_ORIGIN_NETWORK, /* twinlock-serve */
    TL_ORIGIN_LIMITED, /* `twinlock reload --right`: the user limits the request to a lower right than TL_RIGHT_BOX */
    TL_ORIGIN_START,   /* the run's own file, read at the start of a run: the first version, or the file had changed */
    TL_ORIGIN_HAND,    /* `twinlock reload` with another text than that of the run's own file; only in versions */
    TL_ORIGINS
} tl_change_origin;

extern const char *const tl_change_kinds[TL_CHANGE_KINDS]; /* "none", "in place", "new twin", "restart" */
extern const char *const tl_change_rights[TL_RIGHTS];      /* "read", "retune", "commission", "on the box" */
extern const char *const tl_change_origins[TL_ORIGINS];    /* "reload", "network", "limited", "start", "hand" */

/* Parses the name of a right that a user may claim: every right except TL_RIGHT_BOX. For any other
 * `word`, returns false and leaves *right unchanged. */
bool tl_change_right_of(const char *word, tl_change_right *right);

#endif
