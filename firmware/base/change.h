/* The kind, the right and the origin of a configuration change, and their words.
 *
 * Formats: versions on the disk and replies on a control socket have the words. Requests on it have the numbers of rights and origins: they do not change.
 * Thread:  pure functions.
 */
#ifndef TL_FIRMWARE_BASE_CHANGE_H
#define TL_FIRMWARE_BASE_CHANGE_H

#include <stdbool.h>

/* How a change takes effect, from the least to the most. */
typedef enum tl_change_kind {
    TL_CHANGE_NONE,     /* the same values */
    TL_CHANGE_IN_PLACE, /* the twin takes it at the beginning of a tick, and keeps its state and all it has learned */
    TL_CHANGE_NEW_TWIN, /* other FMUs, parameters, connections, another search: a twin of another build, over the same samples */
    TL_CHANGE_RESTART, /* the rest: other sources or signals, another cycle, another database */
    TL_CHANGE_KINDS
} tl_change_kind;

/* What a user may do, and what a change needs; each right includes those before it. */
typedef enum tl_change_right {
    TL_RIGHT_READ,       /* no change */
    TL_RIGHT_RETUNE,     /* values: nothing that names another host, device, file or component */
    TL_RIGHT_COMMISSION, /* what names a host, port, device, interface or component, what acts on a line's electrical side, what may remove recorded
                            runs, how the process is scheduled, and by what the twin is judged (what is measured, the strokes, the step; a wider tolerance: retune/worker.h) */
    TL_RIGHT_BOX, /* what names a library or a file that nobody on the box has named, or lets FMUs out: never by the network; no request claims it */
    TL_RIGHTS
} tl_change_right;

/* How a configuration came. A request has one of the first three. */
typedef enum tl_change_origin {
    TL_ORIGIN_RELOAD,  /* `twinlock reload`; of a version: with the run's own file */
    TL_ORIGIN_NETWORK, /* twinlock-serve */
    TL_ORIGIN_LIMITED, /* `twinlock reload --right`: the caller claims less than the rights of the box */
    TL_ORIGIN_START,   /* the run's own file, found changed at the start */
    TL_ORIGIN_HAND,    /* another file, by `twinlock reload` */
    TL_ORIGINS
} tl_change_origin;

extern const char *const tl_change_kinds[TL_CHANGE_KINDS]; /* "none", "in place", "new twin", "restart" */
extern const char *const tl_change_rights[TL_RIGHTS];      /* "read", "retune", "commission", "on the box" */
extern const char *const tl_change_origins[TL_ORIGINS];    /* "reload", "network", "limited", "start", "hand" */

/* Reads a right that a user may claim: not TL_RIGHT_BOX. False: the word is none, and `right` is unchanged. */
bool tl_change_right_of(const char *word, tl_change_right *right);

#endif
