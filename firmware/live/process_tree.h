/* The tree of processes of a live run: starting it, running it, and its end.
 *
 * Thread:  the supervisor's.
 */
#ifndef TL_FIRMWARE_LIVE_PROCESS_TREE_H
#define TL_FIRMWARE_LIVE_PROCESS_TREE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/twin/twin_role.h"

typedef struct tl_process_tree_settings {
    const tl_config *config; /* as it was read; it stays as it is */
    const char *database;    /* NULL: as configured */
    tl_time duration;        /* 0: as configured */
    bool json;               /* the summary at the end */
    bool status;             /* a status line also if standard error is no terminal */
    bool unconfined;         /* FMUs may do what the user can */
    uint64_t memory_limit;   /* bytes that the process of the FMUs may take; 0: tl_confine_fair_memory() */
    double require_lock;     /* percent of the steps that must have been in lock; 0: any, if nobody supervises */
    bool supervised;
    tl_time call_limit;  /* as in supervisor.h: if nobody supervises */
    const char *state;   /* as in supervisor.h: supervised only */
    const char *control; /* the socket by which the configuration is changed; NULL: it is not. Needs `state` */
    const char *allowed; /* the administrator's list of names that a configuration from the network may have */
    const char *watchdog;
    int watchdog_s;
    const tl_twin_role_tasks *tasks;             /* of a twin's process, */
    int (*be)(const char *title, void *context); /* and what main() does for a title: where there is no exec */
} tl_process_tree_settings;

/* Nobody asked for the end by a signal, and: */
typedef struct tl_process_tree_end {
    bool again; /* the run has ended so that another one begins, with the version that is active by now (versions.h) */
    bool is_failure; /* it could not begin, or not go on */
} tl_process_tree_end;

/* Returns an exit code; what went wrong was said on the log. */
int tl_process_tree_run(const tl_process_tree_settings *settings, tl_process_tree_end *end);

#endif
