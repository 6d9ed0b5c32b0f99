/* Places of twins beside each other in a run.
 *
 * Thread:  the supervisor's.
 */
#ifndef TL_FIRMWARE_LIVE_TWIN_SLOTS_H
#define TL_FIRMWARE_LIVE_TWIN_SLOTS_H

#include "firmware/config/config.h"
#include "firmware/live/live_blocks.h"
#include "firmware/process/block.h"
#include "firmware/twin/twin_process.h"
#include "master/base/status.h"

/* ---- A place for a twin: its pulse, its outbox, and of which configuration it is.
 *
 * Purpose: there are two (handover.h). The twin that the run begins with lives in the first; another configuration *moves in*
 *          where no twin is now. What is in the memory outlives each twin's process: its successor goes on with it.
 * Memory:  the outbox has the size of the configuration, and is made when that moves in. It takes memory only as far as it is used.
 * Trust:   a candidate is copied, and its text is that of its digest; it is not read. Its numbers are another process's, and bounded here: what is wrong in
 *          them its own twin finds, since its memory does not fit.
 * Thread:  the supervisor's.
 */

/* Begins with `pulse` and `queue`, and zeros. `start`, `started`, `twin` and `pid` are its user's. */
typedef struct tl_twin_slot {
    tl_live_twin_pulse *pulse;
    tl_block *queue; /* none before a configuration has moved in */
    tl_record_queue_settings queue_settings;
    const char *text; /* of the configuration; NULL: none */
    char hash[TL_SHA256_TEXT];
    tl_twin_fmus fmus;
    bool unconfined;
    tl_time start;         /* t_start of the run beside which its twin was begun as a shadow; 0: it was not */
    int64_t started;       /* UTC, ms */
    tl_twin_process *twin; /* that lives; NULL: none, */
    pid_t pid;             /* and 0 */
    char *copy;            /* private: the text, if it is ours */
} tl_twin_slot;

/* The run's own configuration, which was read here and stays. Errors: TL_TRY_AGAIN. */
tl_status tl_twin_slot_move_in(tl_twin_slot *place, const tl_config *config, bool unconfined, tl_error *error);

/* A candidate (tl_live_candidate) moves in beside the run of this step, in place of what was there: no twin lives, and all of the outbox was taken. Nothing of the
 * one before is left in the pulse but its number. Errors: TL_BAD_DATA, TL_TRY_AGAIN; then the place is empty. */
tl_status tl_twin_slot_move_in_candidate(tl_twin_slot *place, const tl_block *candidate, const tl_live_needs *needs,
                                         tl_time step, tl_error *error);

/* Samples, steps and events in the outbox that nobody has taken. Its twin is dead. */
uint64_t tl_twin_slot_count_rest(const tl_twin_slot *place, const tl_record_queue_taken *taken);

/* Frees the text and the outbox; also of a place that is empty. */
void tl_twin_slot_move_out(tl_twin_slot *place);

/* ---- What io and the recorder give up: all files and system calls that their work does not need.
 *
 * Purpose: neither has an FMU. But io understands what whoever sits on the plant's network says, and the recorder a file that anybody may have written: a hole
 *          in one of them must not be a way into the other, or anywhere else.
 * io:      opens what its kind of sources needs, as the row of the driver says (drivers.h): TCP to their ports (and names of hosts, if they are looked
 *          up), sockets, devices, or files. It writes no file.
 * Recorder: writes in the folder of the database, reads the FMUs' files (whose digests it records). It has no socket.
 * Neither:  starts a program, listens, traces, or signals another process.
 * Missing: what the kernel does not offer is passed over, as for the twin, which tells it.
 * Thread:  the main thread, before any other is started. Errors: TL_TRY_AGAIN.
 */

/* `kind`: of the sources that this process reads, tl_driver_bit(); 0: of none. */
tl_status tl_twin_slots_confine_io(const tl_config *config, unsigned kind, tl_error *error);

/* `database`: the path of its file. */
tl_status tl_twin_slots_confine_recorder(const tl_config *config, const char *database, tl_error *error);

#endif
