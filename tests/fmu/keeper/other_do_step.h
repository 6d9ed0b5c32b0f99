/* Before fmus/common/life.c: its fmi2DoStep gets another name, for an FMU that does something besides. */
#ifndef TL_TESTS_FMU_KEEPER_OTHER_DO_STEP_H
#define TL_TESTS_FMU_KEEPER_OTHER_DO_STEP_H

#include <fmi2Functions.h>

#undef fmi2DoStep
#define fmi2DoStep own_do_step

fmi2Status own_do_step(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior);

#endif
