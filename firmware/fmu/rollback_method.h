/* Rollback methods of an FMU in their order, and the functions of each in FMI's table.
 *
 * Purpose: the order is: its own states; copies of its memory; its own states, followed by setting
 *          its last inputs again; replay. If the proof finds a method wrong, tl_fmi2_fallback
 *          switches to the next one and restores the start of the proof. After the proof only one
 *          change is possible: from copies back to exact own states.
 * Thread:  the thread that calls the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_ROLLBACK_METHOD_H
#define TL_FIRMWARE_FMU_ROLLBACK_METHOD_H

#include "firmware/fmu/guarded_fmu.h"

/* Chooses the first rollback method again, by `memory`, `by_memory`, `by_replay` and `may_replay`.
 * Call it before the FMU is instantiated. */
void tl_rollback_method_choose(tl_fmu_guard *guard);

/* Frees what the instance has noted for a replay, and its last inputs. Ends the noting. */
void tl_rollback_method_end_recording(tl_fmu_guarded *self);

/* Frees the copy from after fmi2Instantiate. Allowed if there is none. */
void tl_rollback_method_forget_instantiated(tl_fmu_guard *guard);

#endif
