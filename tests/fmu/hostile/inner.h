/* Included before the sources of fmus/common: renames their FMI functions (fmi2DoStep to
 * inner_do_step).
 *
 * Purpose: frame.c defines the FMI functions of a hostile FMU. Each misbehaves first, and then
 *          calls the renamed function of the good FMU fmus/lag.
 */
#ifndef TL_TESTS_FMU_HOSTILE_INNER_H
#define TL_TESTS_FMU_HOSTILE_INNER_H

#include <fmi2Functions.h>

#undef fmi2Instantiate
#undef fmi2FreeInstance
#undef fmi2SetupExperiment
#undef fmi2EnterInitializationMode
#undef fmi2ExitInitializationMode
#undef fmi2Terminate
#undef fmi2Reset
#undef fmi2GetReal
#undef fmi2SetReal
#undef fmi2GetFMUstate
#undef fmi2SetFMUstate
#undef fmi2FreeFMUstate
#undef fmi2SerializedFMUstateSize
#undef fmi2SerializeFMUstate
#undef fmi2DeSerializeFMUstate
#undef fmi2DoStep

#define fmi2Instantiate inner_instantiate
#define fmi2FreeInstance inner_free_instance
#define fmi2SetupExperiment inner_setup_experiment
#define fmi2EnterInitializationMode inner_enter_initialization_mode
#define fmi2ExitInitializationMode inner_exit_initialization_mode
#define fmi2Terminate inner_terminate
#define fmi2Reset inner_reset
#define fmi2GetReal inner_get_real
#define fmi2SetReal inner_set_real
#define fmi2GetFMUstate inner_get_state
#define fmi2SetFMUstate inner_set_state
#define fmi2FreeFMUstate inner_free_state
#define fmi2SerializedFMUstateSize inner_serialized_size
#define fmi2SerializeFMUstate inner_serialize
#define fmi2DeSerializeFMUstate inner_deserialize
#define fmi2DoStep inner_do_step

fmi2InstantiateTYPE inner_instantiate;
fmi2FreeInstanceTYPE inner_free_instance;
fmi2SetupExperimentTYPE inner_setup_experiment;
fmi2EnterInitializationModeTYPE inner_enter_initialization_mode;
fmi2ExitInitializationModeTYPE inner_exit_initialization_mode;
fmi2TerminateTYPE inner_terminate;
fmi2ResetTYPE inner_reset;
fmi2GetRealTYPE inner_get_real;
fmi2SetRealTYPE inner_set_real;
fmi2GetFMUstateTYPE inner_get_state;
fmi2SetFMUstateTYPE inner_set_state;
fmi2FreeFMUstateTYPE inner_free_state;
fmi2SerializedFMUstateSizeTYPE inner_serialized_size;
fmi2SerializeFMUstateTYPE inner_serialize;
fmi2DeSerializeFMUstateTYPE inner_deserialize;
fmi2DoStepTYPE inner_do_step;

#endif
