/* Before fmus/common/state.c: its fmi2SetFMUstate gets another name, for an FMU that does something besides. */
#ifndef TL_TESTS_FMU_KEEPER_OTHER_SET_STATE_H
#define TL_TESTS_FMU_KEEPER_OTHER_SET_STATE_H

#include <fmi2Functions.h>

#undef fmi2SetFMUstate
#define fmi2SetFMUstate own_set_state

fmi2Status own_set_state(fmi2Component component, fmi2FMUstate state);

#endif
