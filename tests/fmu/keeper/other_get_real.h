/* Included before fmus/common/values.c: renames its fmi2GetReal to own_get_real. The test FMU
 * defines fmi2GetReal, and calls own_get_real in it. */
#ifndef TL_TESTS_FMU_KEEPER_OTHER_GET_REAL_H
#define TL_TESTS_FMU_KEEPER_OTHER_GET_REAL_H

#include <fmi2Functions.h>

#undef fmi2GetReal
#define fmi2GetReal own_get_real

fmi2Status own_get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                        fmi2Real values[]);

#endif
