/* Included before fmus/common/life.c: renames its fmi2DoStep to own_do_step. The test FMU defines
 * fmi2DoStep, and calls own_do_step in it. */
#ifndef TL_TESTS_FMU_KEEPER_OTHER_DO_STEP_H
#define TL_TESTS_FMU_KEEPER_OTHER_DO_STEP_H

#include <fmi2Functions.h>

#undef fmi2DoStep
#define fmi2DoStep own_do_step

fmi2Status own_do_step(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior);

#endif
