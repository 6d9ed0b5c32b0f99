/* Kind, right and origin of a configuration change, with their names in text.
 *
 * Formats: stored versions and replies on a control socket contain the names. Requests on it
 *          contain the numbers of rights and origins, so those must not change.
 * Thread:  pure functions.
 */
#ifndef TL_FIRMWARE_BASE_CHANGE_H
#define TL_FIRMWARE_BASE_CHANGE_H

#include <stdbool.h>

/* How a change takes effect, from the smallest effect to the largest. */
typedef enum tl_change_kind {
    TL_CHANGE_NONE,     /* the values are the same */
    TL_CHANGE_IN_PLACE, /* the twin applies it at the start of a tick, and keeps its state and all it has learned */
    TL_CHANGE_NEW_TWIN, /* other FMUs, parameters, connections or search: builds another twin for the same samples */
    TL_CHANGE_RESTART,  /* everything else: sources, signals, cycle, database */
    TL_CHANGE_KINDS
} tl_change_kind;

/* What a user may do, and what a change needs. Each right includes those before it.
 * TL_RIGHT_COMMISSION: a change that names a host, port, device, interface or component; acts on
 * the electrical side of a line; may remove recorded runs; changes how the process is scheduled; or
 * changes what the twin is checked against (measurements, strokes, step; for a wider tolerance see
 * retune/worker.h).
 * TL_RIGHT_BOX: a change that names a new library or file, or removes the confinement of FMUs. It
 * is not allowed over the network, and no request can claim it. */
typedef enum tl_change_right {
    TL_RIGHT_READ,       /* no change */
    TL_RIGHT_RETUNE,     /* values only; names no other host, device, file or component */
    TL_RIGHT_COMMISSION, /* see above */
    TL_RIGHT_BOX,        /* see above */
    TL_RIGHTS
} tl_change_right;

/* Origin of a configuration. A request has one of the first three. */
typedef enum tl_change_origin {
    TL_ORIGIN_RELOAD,  /* `twinlock reload`; of a version: with the run's own file */
    TL_ORIGIN_NETWORK, /* twinlock-serve */
    TL_ORIGIN_LIMITED, /* `twinlock reload --right`: the caller claims less than TL_RIGHT_BOX */
    TL_ORIGIN_START,   /* the run's own file, which had changed when the run started */
    TL_ORIGIN_HAND,    /* another file, by `twinlock reload` */
    TL_ORIGINS
} tl_change_origin;

extern const char *const tl_change_kinds[TL_CHANGE_KINDS]; /* "none", "in place", "new twin", "restart" */
extern const char *const tl_change_rights[TL_RIGHTS];      /* "read", "retune", "commission", "on the box" */
extern const char *const tl_change_origins[TL_ORIGINS];    /* "reload", "network", "limited", "start", "hand" */

/* Parses a right that a user may claim, so not TL_RIGHT_BOX. Returns false, without changing
 * `right`, if `word` is no such right. */
bool tl_change_right_of(const char *word, tl_change_right *right);

#endif
