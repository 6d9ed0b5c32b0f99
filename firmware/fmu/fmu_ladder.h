/* Ways in which an FMU is led back, one below the other: what stands in the place of its functions for states.
 *
 * Purpose: its own states; a copy of its memory; its own states, after which it is given again what it had been given; replay. Each has the same functions in the table, and
 *          what is wrong in a proof is given up for the next (tl_fmi2_aside), from where the proof began. After it nothing is given up but own states, for a copy.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_FMU_LADDER_H
#define TL_FIRMWARE_FMU_FMU_LADDER_H

#include "firmware/fmu/fmu_guarded.h"

/* The guard's table is filled: the way that it has been told to begin with. */
void tl_fmu_ladder_begin(tl_fmu_guard *guard);

/* What steps set is known, and has been set: it may have to be set again. */
void tl_fmu_ladder_know_ports(tl_fmu_guarded *self, const tl_ports *inputs);

/* What it is given is noted no more. */
void tl_fmu_ladder_end_notes(tl_fmu_guarded *self);

#endif
