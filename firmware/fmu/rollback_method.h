/* Chooses the rollback method of an FMU, and writes its functions to the guard's table.
 *
 * Purpose: the order of methods is: the FMU's own states; copies of its memory; own states with the
 *          last inputs set again; replay; replay with a new instance instead of fmi2Reset. If the
 *          proof finds a method wrong, tl_fmi2_fallback switches to the next one and restores the
 *          start of the proof. After the proof only one change is possible: from copies that were
 *          chosen for speed back to own states.
 * Thread:  the thread that calls the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_ROLLBACK_METHOD_H
#define TL_FIRMWARE_FMU_ROLLBACK_METHOD_H

#include "firmware/fmu/guarded_fmu.h"

/* Chooses the first rollback method from `memory`, `by_memory`, `by_replay` and `may_replay`, and
 * writes its functions to guard->functions. Call it before the FMU is instantiated, and again after
 * a change of these fields. */
void tl_rollback_method_choose(tl_fmu_guard *guard);

/* Stops noting the calls and inputs of this instance, and frees what was noted. */
void tl_rollback_method_end_recording(tl_fmu_guarded *self);

/* Frees the copy from after fmi2Instantiate (guard->instantiated), if there is one. */
void tl_rollback_method_forget_instantiated(tl_fmu_guard *guard);

#endif
