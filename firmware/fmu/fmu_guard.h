/* The guard: a table of FMI functions of ours in front of an FMU's own.
 *
 * Purpose: everything that calls an FMU comes through here, so this is the place for what must be done around each call:
 *            - note the call, so that a crash, a hang or an exit in it is told by name (fmu_call.h);
 *            - put back the floating-point control bits (fp_control.h) and the locale of the thread, without a system call;
 *            - after loading, instantiating, initialising, resetting, freeing, and once a tick: put back the rest of what an FMU may have
 *              changed of the process (host_state.h), and say so once;
 *            - take for a failure what claims success and is none: no state with fmi2OK;
 *            - if the FMU is rolled back by its memory (rollback/fmu_memory.h): serve it from a heap of its own, and save and restore that in
 *              place of the FMU's own functions.
 *            - or if it is rolled back by replay (rollback/fmu_replay.h): note what it is given.
 *            - if it is rolled back by forking: nothing of that; the FMU is in a process of its own (forked/forked_host.h), where a guard is in front of it, too.
 *          A caller of the table cannot tell the difference.
 * Owner:   the caller places a guard and keeps it where it is until tl_fmu_guard_close(); instances made through it, and their
 *          states, are the guard's.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_FMU_GUARD_H
#define TL_FIRMWARE_FMU_FMU_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/fmu/fmu_guarded.h"
#include "firmware/forked/forked_line.h"
#include "firmware/process/fmu_call.h"

/* Before the FMU is loaded: from now on it may be called. `name` and `generator` are those of its
 * description. */
void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator);

/* After that: it is rolled back by its memory, or can be. `folder` is what it is unpacked to, absolute and without links; it must stay. Errors: TL_TRY_AGAIN. */
tl_status tl_fmu_guard_use_memory(tl_fmu_guard *guard, const char *folder, bool at_once, tl_error *error);

/* After that: it is led back by replay, or can be, from `most` steps after its beginning at most. */
void tl_fmu_guard_use_replay(tl_fmu_guard *guard, uint32_t most, bool at_once);

/* In place of that: it is in a process of its own, whose functions (forked_calls.h) are the ones that tl_fmu_guard_front() is given. */
void tl_fmu_guard_use_fork(tl_fmu_guard *guard, tl_forked_line *line);

/* Around what calls the FMU without the table: opening its library, asking for its version. */
void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function);
void tl_fmu_guard_leave(tl_fmu_guard *guard);

/* The FMU's functions are known: fills the table. */
void tl_fmu_guard_front(tl_fmu_guard *guard, const tl_fmi2 *own);

/* No instance is called any more; those that were never freed are given up. A zeroed guard is allowed. */
void tl_fmu_guard_close(tl_fmu_guard *guard);

/* Once a tick: puts back what any FMU may have changed of the process since; said once a process for each kind. */
void tl_fmu_guard_tick(void);

#endif
