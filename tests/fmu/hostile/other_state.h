/* Included before fmus/common/state.c and values.c: renames the functions that states.c defines
 * itself, so that states.c can call them. */
#ifndef TL_TESTS_FMU_HOSTILE_OTHER_STATE_H
#define TL_TESTS_FMU_HOSTILE_OTHER_STATE_H

#include <fmi2Functions.h>

#undef fmi2SetReal
#undef fmi2GetFMUstate
#undef fmi2SetFMUstate
#undef fmi2SerializeFMUstate
#undef fmi2DeSerializeFMUstate
#define fmi2SetReal own_set_real
#define fmi2GetFMUstate own_get_state
#define fmi2SetFMUstate own_set_state
#define fmi2SerializeFMUstate own_serialize
#define fmi2DeSerializeFMUstate own_deserialize

fmi2SetRealTYPE own_set_real;
fmi2GetFMUstateTYPE own_get_state;
fmi2SetFMUstateTYPE own_set_state;
fmi2SerializeFMUstateTYPE own_serialize;
fmi2DeSerializeFMUstateTYPE own_deserialize;

#endif
