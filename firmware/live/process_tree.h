/* Process tree of a live run: starts, runs and ends all processes.
 *
 * Memory:  the caller owns the settings; they must outlive the call.
 * Errors:  logged; the exit code reports them.
 * Thread:  the supervisor's.
 */
#ifndef TL_FIRMWARE_LIVE_PROCESS_TREE_H
#define TL_FIRMWARE_LIVE_PROCESS_TREE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/twin/twin_role.h"

typedef struct tl_process_tree_settings {
    const tl_config *config; /* as read; not changed */
    const char *running;     /* text for the log: version, file and hash of the configuration */
    const char *database;    /* path; NULL: as configured */
    tl_time duration;        /* ns; 0: as configured */
    bool verbose;            /* also prints step outcomes, FMU executions and mean squared errors */
    bool json;               /* prints the summary of the run as JSON */
    bool status;             /* shows a status line also if standard error is no terminal */
    bool follow;             /* prints JSON lines (follow.h); the summary goes to standard error */
    bool unconfined;         /* FMUs have all rights of the user */
    uint64_t memory_limit;   /* of an FMU process, bytes; 0: half of the machine's (confine.h) */
    double require_lock;     /* least % of steps in lock, else exit code 3; 0: one step is enough */
    bool supervised;         /* restarts a failed twin; else its failure ends the run */
    tl_time call_limit;      /* ns; if not supervised: FMU calls that hang for ten times this end the run */
    const char *state;       /* folder of the versions and, if supervised, of the restart record; NULL: none */
    const char *control;     /* path of the control socket, for configuration changes; NULL: none. Needs `state` */
    const char *allowed;     /* path of the list of files and libraries that a remote configuration may name */
    const char *watchdog;    /* device; NULL: none */
    int watchdog_s;          /* timeout of the watchdog, s */
    const tl_twin_role_tasks *tasks;                  /* functions of higher layers that a twin process calls */
    int (*run_role)(const char *role, void *context); /* runs a role in a fork if exec is not possible (role.h) */
} tl_process_tree_settings;

/* How the run ended. Both are false if its duration was over, or if a signal requested the end. */
typedef struct tl_process_tree_end {
    bool again;      /* start another run, with the active version of the configuration (versions.h) */
    bool is_failure; /* the run could not start or continue */
} tl_process_tree_end;

/* Runs the process tree. Returns an exit code; errors were logged. */
int tl_process_tree_run(const tl_process_tree_settings *settings, tl_process_tree_end *end);

#endif
