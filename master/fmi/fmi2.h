/* The functions of one loaded FMI 2.0 for Co-Simulation binary.
 *
 * Purpose: the table that component.c calls through. It is filled by whoever loads the binary (firmware), so
 *          that the master knows neither files nor dlopen.
 * Source:  FMI 2.0.4, section 2.1 and 4.2.
 */
#ifndef TL_MASTER_FMI_FMI2_H
#define TL_MASTER_FMI_FMI2_H

#include "fmi2FunctionTypes.h"

/* Functions an FMU may omit (its capability flags say so) are NULL. */
typedef struct tl_fmi2 {
    fmi2GetTypesPlatformTYPE *get_types_platform;
    fmi2GetVersionTYPE *get_version;
    fmi2SetDebugLoggingTYPE *set_debug_logging;
    fmi2InstantiateTYPE *instantiate;
    fmi2FreeInstanceTYPE *free_instance;
    fmi2SetupExperimentTYPE *setup_experiment;
    fmi2EnterInitializationModeTYPE *enter_initialization_mode;
    fmi2ExitInitializationModeTYPE *exit_initialization_mode;
    fmi2TerminateTYPE *terminate;
    fmi2ResetTYPE *reset;
    fmi2GetRealTYPE *get_real;
    fmi2GetIntegerTYPE *get_integer;
    fmi2GetBooleanTYPE *get_boolean;
    fmi2GetStringTYPE *get_string;
    fmi2SetRealTYPE *set_real;
    fmi2SetIntegerTYPE *set_integer;
    fmi2SetBooleanTYPE *set_boolean;
    fmi2SetStringTYPE *set_string;
    fmi2GetFMUstateTYPE *get_fmu_state;                        /* optional */
    fmi2SetFMUstateTYPE *set_fmu_state;                        /* optional */
    fmi2FreeFMUstateTYPE *free_fmu_state;                      /* optional */
    fmi2SerializedFMUstateSizeTYPE *serialized_fmu_state_size; /* optional */
    fmi2SerializeFMUstateTYPE *serialize_fmu_state;            /* optional */
    fmi2DeSerializeFMUstateTYPE *deserialize_fmu_state;        /* optional */
    fmi2DoStepTYPE *do_step;
    fmi2CancelStepTYPE *cancel_step;
    fmi2GetStatusTYPE *get_status;
    fmi2GetBooleanStatusTYPE *get_boolean_status;
} tl_fmi2;

#endif
