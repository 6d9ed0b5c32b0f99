/* FMU guard: a table of FMI functions that wraps an FMU's own functions.
 *
 * Purpose: all calls of an FMU go through the guard. Around each call the guard:
 *            - notes the call, so that a crash, a timeout or an exit can be reported with its name
 *              (fmu_call.h);
 *            - restores the floating-point control bits (host_state.h) and the locale of the
 *              thread, without a system call;
 *            - after loading, instantiating, initialising, resetting and freeing: restores all
 *              other process state that an FMU may have changed (host_state.h), and logs this once;
 *              at each tick, tl_fmu_guard_tick() does this for a part of the state;
 *            - does not pass a far stop time (TL_EXPERIMENT_FAR) to FMUs of OpenModelica;
 *            - if the FMU refuses a start time other than 0: starts the FMU at 0, shifts its time,
 *              and logs this;
 *            - reports an error if the FMU returns fmi2OK without a state;
 *            - until the rollback is proved, catches crashes in the FMU's own state functions: a
 *              crash counts as fmi2Error, so that the next rollback method is used. A crash in
 *              serialising is always caught and counts as fmi2Discard;
 *            - if the FMU is rolled back by memory (rollback/fmu_memory.h): serves its allocations
 *              from its own heap, and saves and restores copies instead of calling the FMU's state
 *              functions;
 *            - if replay is possible (rollback/fmu_replay.h): notes the calls of the FMU.
 *          A caller uses the table like the FMU's own functions.
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

/* Initialises a guard before the FMU is loaded. `name`: modelName, `generator`: generationTool of
 * the model description. Afterwards the caller opens `memory` and sets the allowed rollback methods
 * (guarded_fmu.h). */
void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator);

/* Call these before and after a call of the FMU that does not go through the table: opening its
 * binary, or reading its version. */
void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function);
void tl_fmu_guard_leave(tl_fmu_guard *guard);

/* Fills the table for callers and chooses the first rollback method. `own`: the functions that the
 * FMU's binary exports; they are copied. */
void tl_fmu_guard_front(tl_fmu_guard *guard, const tl_fmi2 *own);

/* Frees what the guard owns: wrappers of instances, and its copies. The FMU's own states must have
 * been freed before (tl_component_forget()). Use no instance afterwards. Wrappers of instances that
 * still exist are freed without a call of the FMU. A zeroed guard is allowed. */
void tl_fmu_guard_close(tl_fmu_guard *guard);

/* Restores process state that any FMU may have changed, and logs each kind of change once per
 * process. `whole` true: restores all of this state; false: the next part, with at most three
 * system calls if nothing has changed. TL_HOST_STATE_TURNS calls restore all parts. */
void tl_fmu_guard_tick(bool whole);

#endif
