/* Roles of a run: main functions of the processes twin, io, recorder, config manager and explainer.
 *
 * Purpose: main() calls one of them in a process that the process tree (process_tree.h) has started
 *          with that role.
 * Order:   each process first sets up its log, makes sure that it ends when its parent ends, and
 *          sets up its signal handlers and shared memory. Then it confines itself and starts its
 *          work. SIGTERM ends it.
 * Ends:    each function announces its exit code in the status block of its process, if it has one,
 *          and returns the exit code.
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_ROLE_H
#define TL_FIRMWARE_LIVE_LIVE_ROLE_H

#include "firmware/live/live_blocks.h"
#include "firmware/process/confine.h"
#include "firmware/process/role.h"
#include "firmware/report/journal.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_role.h"

/* The title of a process begins with the name of its role. */
#define TL_LIVE_IO "io"
#define TL_LIVE_RECORDER "recorder"
#define TL_LIVE_CONFIG_MANAGER "config manager"
#define TL_LIVE_EXPLAINER "explainer"
#define TL_LIVE_TWIN "twin"
#define TL_LIVE_TWIN_SHADOW "twin, shadow"
/* A handover changes one of the two titles above to the other. These blanks after the
 * shorter title reserve room for the longer one (tl_role_entitle()). */
#define TL_LIVE_TWIN_ROOM "        "

/* Reads the configured sources of the plant into the sample buffers. */
int tl_io_role_run(void);

/* Writes the data of the other processes to the database. */
int tl_recorder_role_run(void);

/* Serves the control socket and changes the configuration (config_manager.h). Ends when there is
 * nothing more to do. */
int tl_config_manager_role_run(void);

/* Explains the finding that its job names from the recorded ticks, at the lowest priority, and
 * stores the explanation with the finding (verb_explain.c). */
int tl_explainer_role_run(void);

/* Runs the FMUs and the real-time cycle. It is `live` of tl_twin_role_tasks: called in the twin's
 * process after its confinement. Announces the exit code and returns it. */
int tl_live_twin(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts);

/* What a process without FMUs gets from the supervisor. */
typedef struct tl_live_setup {
    tl_block job_block;
    tl_live_job job;
    tl_config config;
    tl_block blocks[TL_LIVE_BLOCKS]; /* by block number; missing blocks are zeroed */
    tl_record_queue queue;           /* for events; only io and config manager use this and `journal` */
    tl_journal journal;
} tl_live_setup;

/* Called first in a process without FMUs. Sets up the log and the signal handlers, makes the
 * process end if its parent ends, and maps job and blocks. Logs errors and returns their status. */
tl_status tl_live_role_begin(tl_live_kind kind, tl_live_setup *setup);

/* Opens a journal that passes events to the log and to the record queue. `queue` must outlive the
 * journal. */
void tl_live_role_open_journal(tl_journal *journal, tl_record_queue *queue);

/* Called last. Announces the end cause and the exit code `code` in the heartbeats, and returns
 * `code`. If `code` is not 0, the cause is TL_END_CAUSE_FAILED if the process had started its work
 * (`was_ready`), else TL_END_CAUSE_REFUSED. */
int tl_live_role_end(tl_heartbeats *beats, bool was_ready, int code);

/* ---- in the parent ---- */

typedef struct tl_live_role_settings {
    tl_live_kind kind; /* not TL_LIVE_IS_TWIN */
    const tl_live_job *job;
    const char *name;                                 /* of the configuration, for the title */
    const char *path;                                 /* of the configuration file */
    const char *text;                                 /* of the configuration */
    const tl_block *blocks;                           /* TL_LIVE_BLOCKS of them */
    int output;                                       /* descriptor to which it prints */
    int client;                                       /* descriptor TL_LIVE_CLIENT; -1: none */
    int (*run_role)(const char *role, void *context); /* runs a role in a fork if exec is not possible (role.h) */
} tl_live_role_settings;

/* Starts a process without FMUs. Keeps all descriptors. Sets *role as tl_role_start() does, which
 * also states the errors. */
tl_status tl_live_role_start(const tl_live_role_settings *settings, tl_role *role, tl_error *error);

#endif
