/* Included before fmus/common/state.c: renames its fmi2SetFMUstate to own_set_state. The test FMU
 * defines fmi2SetFMUstate, and calls own_set_state in it. */
#ifndef TL_TESTS_FMU_KEEPER_OTHER_SET_STATE_H
#define TL_TESTS_FMU_KEEPER_OTHER_SET_STATE_H

#include <fmi2Functions.h>

#undef fmi2SetFMUstate
#define fmi2SetFMUstate own_set_state

fmi2Status own_set_state(fmi2Component component, fmi2FMUstate state);

#endif
