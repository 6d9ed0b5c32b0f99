/* Twin slots: memory of the two twin processes of a run, and the confinement of io and recorder.
 *
 * Thread:  each part states its own.
 */
#ifndef TL_FIRMWARE_LIVE_TWIN_SLOTS_H
#define TL_FIRMWARE_LIVE_TWIN_SLOTS_H

#include "firmware/config/config.h"
#include "firmware/live/live_blocks.h"
#include "firmware/process/block.h"
#include "firmware/twin/twin_process.h"
#include "master/base/status.h"

/* ---- Twin slot: status block, record queue and configuration of one twin process.
 *
 * Purpose: there are two slots (handover.h). The first twin of a run has slot 0. Another
 *          configuration is *loaded* into the slot that has no twin process. The memory outlives
 *          each process of the slot: the next process in the slot continues with the memory.
 * Memory:  the record queue is allocated when a configuration is loaded; its size depends on the
 *          configuration. Pages take memory only when they are used.
 * Trust:   a candidate is untrusted. Its text is copied and the hash of the text is verified, but
 *          the text is not parsed. Its sizes (`needs`) come from a worker and are bounded here. If
 *          they are wrong, the twin detects that its memory has the wrong size.
 * Thread:  the supervisor's.
 */

/* The caller sets `live_status` and `queue`, and zeroes the rest. While the run lasts, it also sets
 * `start`, `started`, `twin` and `pid`. */
typedef struct tl_twin_slot {
    tl_live_twin_status *live_status;
    tl_block *queue; /* record queue; empty before a configuration is loaded */
    tl_record_queue_settings queue_settings;
    const char *text; /* text of the loaded configuration; NULL: none */
    char hash[TL_SHA256_TEXT];
    tl_twin_fmus fmus;
    bool unconfined;
    tl_time start;         /* shadow: t_start of the live twin, monotonic clock, ns; else 0 */
    int64_t started;       /* the instant `start` in UTC, ms since 1970; 0 if `start` is 0 */
    tl_twin_process *twin; /* the running process; NULL: none */
    pid_t pid;             /* of `twin`; 0: none */
    char *copy;            /* private: the text, if the slot owns it */
} tl_twin_slot;

/* Loads the configuration that the run starts with. `config` must outlive the slot. Errors:
 * TL_TRY_AGAIN. */
tl_status tl_twin_slot_load(tl_twin_slot *slot, const tl_config *config, bool unconfined, tl_error *error);

/* Replaces the content of the slot by a candidate. `candidate`: the block with it
 * (tl_live_candidate). `needs`: sizes of the candidate, as a worker has computed them. `step`: T_S
 * of the run, ns. The slot must have no running twin, and the recorder must have read the whole
 * queue. Clears the status block, but keeps `number`, the count of twin processes. Errors:
 * TL_BAD_DATA, TL_TRY_AGAIN; then the slot is empty. */
tl_status tl_twin_slot_load_candidate(tl_twin_slot *slot, const tl_block *candidate, const tl_live_needs *needs,
                                      tl_time step, tl_error *error);

/* Returns how many samples, steps and events in the record queue the recorder has not read.
 * `taken`: what it has read (record_queue.h). The slot's twin must have ended. */
uint64_t tl_twin_slot_count_remaining(const tl_twin_slot *slot, const tl_record_queue_taken *taken);

/* Frees the text and the record queue. An empty slot is allowed. */
void tl_twin_slot_unload(tl_twin_slot *slot);

/* ---- Confinement of io and recorder: drops access to all files and system calls that their work
 * does not need.
 *
 * Purpose: neither process has an FMU. But io parses data from the plant's network, and the
 *          recorder parses a database file; both inputs are untrusted. An attacker who controls one
 *          of the processes must not get access to the other, or to anything else. io: may open
 *          only what its kind of sources needs, as the driver declares (drivers.h): TCP connections
 *          to their ports (and name look-ups, if needed), sockets, devices, or files. It writes no
 *          file.
 * Recorder: writes in the folder of the database, and reads the FMU files, whose hashes it records.
 *           It has no socket.
 * Both:    may not start a program, accept connections, trace, or signal another process.
 * Missing: features that the kernel lacks are skipped. The twin's process lacks the same ones and
 *          reports them.
 * Thread:  the main thread of io or recorder, before it starts another one. Errors: TL_TRY_AGAIN.
 */

/* `kind`: tl_driver_bit() of the sources that this process reads; 0: no sources. */
tl_status tl_twin_slots_confine_io(const tl_config *config, unsigned kind, tl_error *error);

/* `database`: path of the database file. */
tl_status tl_twin_slots_confine_recorder(const tl_config *config, const char *database, tl_error *error);

#endif
