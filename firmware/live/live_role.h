/* The processes of a run, from within: twin, io, recorder, activator.
 *
 * Purpose: what main() becomes in a process that the tree (process_tree.h) has started with such a role.
 * Order:   the same in each: log, parent, shared memory, places, confinement, signals, then the work. Told to end by SIGTERM.
 * Ends:    with an exit code, after it was announced in the process's pulse.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_ROLE_H
#define TL_FIRMWARE_LIVE_LIVE_ROLE_H

#include "firmware/live/live_blocks.h"
#include "firmware/process/confine.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/twin_role.h"

/* Titles begin with these. */
#define TL_LIVE_IO "io"
#define TL_LIVE_RECORDER "recorder"
#define TL_LIVE_CONFIG_MANAGER "activator"
#define TL_LIVE_TWIN "twin"
#define TL_LIVE_TWIN_SHADOW "twin, shadow" /* changes with TL_LIVE_TWIN at a flip, and so that has room for it: */
#define TL_LIVE_TWIN_ROOM "        "

/* Reads the plant: the configured sources, into the mailboxes. */
int tl_io_role_run(void);

/* Writes what the others hand over into the database. */
int tl_recorder_role_run(void);

/* Answers at the control socket, and changes the configuration (config_manager.h), until nothing is to be done. */
int tl_config_manager_role_run(void);

/* Holds the FMUs and the real-time cycle: for tl_twin_role_tasks, what its process does once it is confined. An exit code, which was announced. */
int tl_live_twin(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts);

/* What each of them but the twin has from its supervisor. */
typedef struct tl_live_given {
    tl_block job_block;
    tl_live_job job;
    tl_config config;
    tl_block blocks[TL_LIVE_BLOCKS]; /* by their numbers; those that it does not have are zeroed */
    tl_record_queue queue;           /* of events; not of the recorder, as the next one */
    tl_journal journal;
} tl_live_given;

/* First in each of them: the log is for who reads the pipe, the process ends with its parent, and takes what it was given. What goes wrong is logged. */
tl_status tl_live_role_begin(tl_live_kind kind, tl_live_given *given);

/* Events go to the log and into the outbox, which outlives the journal. */
void tl_live_role_open_journal(tl_journal *journal, tl_record_queue *queue);

/* Last: what it says of its end, and its exit code. */
int tl_live_role_end(tl_heartbeats *beats, bool was_ready, int code);

#endif
