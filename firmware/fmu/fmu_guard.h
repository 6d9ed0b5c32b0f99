/* FMU guard: a table of FMI functions that wraps an FMU's own functions.
 *
 * Purpose: all calls of an FMU go through the guard. Around each call the guard:
 *            - notes the call, so that a crash, a timeout or an exit can be reported with its name
 *              (fmu_call.h);
 *            - restores the floating-point control bits (host_state.h) and the locale of the
 *              thread, without a system call;
 *            - after loading, instantiating, initialising, resetting and freeing, and in turn at
 *              each tick: restores all other process state that an FMU may have changed
 *              (host_state.h), and logs this once;
 *            - leaves out a far stop time (TL_EXPERIMENT_FAR) for FMUs of OpenModelica;
 *            - if the FMU refuses a start time other than 0: starts it at 0, shifts its time, and
 *              logs this;
 *            - reports an error if the FMU returns fmi2OK without a state;
 *            - catches crashes in its own state functions until the rollback is proved: they count
 *              as fmi2Error, so that the next rollback method is used;
 *            - if the FMU is rolled back by memory (rollback/fmu_memory.h): serves its allocations
 *              from its own heap, and saves and restores copies instead of calling the FMU's state
 *              functions;
 *            - if the FMU is rolled back by replay (rollback/fmu_replay.h): notes its inputs.
 *          A caller uses the table as it would use the FMU's own functions.
 * Owner:   the caller provides the memory of a guard and must not move it before
 *          tl_fmu_guard_close(). The master decides when a state is saved, restored and freed
 *          (master/fmi/component.h); the guard executes this. The memory of a state belongs to the
 *          FMU (its own states) or to the guard (copies of memory, replay).
 * Thread:  the thread that calls the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_FMU_GUARD_H
#define TL_FIRMWARE_FMU_FMU_GUARD_H

#include <stdbool.h>

#include "firmware/fmu/guarded_fmu.h"
#include "firmware/process/fmu_call.h"
#include "master/fmi/fmi2.h"

/* Initialises a guard before the FMU is loaded; from then on calls may go through it. `name` and
 * `generator` come from the model description. Afterwards the caller opens `memory` and sets the
 * allowed rollback methods. */
void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator);

/* Call them before and after a call of the FMU that does not go through the table: opening its
 * binary, and reading its version. */
void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function);
void tl_fmu_guard_leave(tl_fmu_guard *guard);

/* Fills the table for callers. `own`: the functions of the FMU, which its binary exports. */
void tl_fmu_guard_front(tl_fmu_guard *guard, const tl_fmi2 *own);

/* Frees what the guard owns: wrappers of instances, and its copies. States of the FMU's own must
 * have been freed before (tl_component_forget()). Use no instance afterwards. Memory of instances
 * that still exist is freed without a call of the FMU. A zeroed guard is allowed. */
void tl_fmu_guard_close(tl_fmu_guard *guard);

/* Restores process state that any FMU may have changed, and logs each kind of change once per
 * process. `whole`: all of it; else one system call: one kind in turn, all within
 * TL_HOST_STATE_TURNS calls. */
void tl_fmu_guard_tick(bool whole);

#endif
