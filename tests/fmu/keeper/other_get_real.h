/* Before fmus/common/values.c: its fmi2GetReal gets another name, for an FMU that does something besides. */
#ifndef TL_TESTS_FMU_KEEPER_OTHER_GET_REAL_H
#define TL_TESTS_FMU_KEEPER_OTHER_GET_REAL_H

#include <fmi2Functions.h>

#undef fmi2GetReal
#define fmi2GetReal own_get_real

fmi2Status own_get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                        fmi2Real values[]);

#endif
