/* Current FMU call: see fmu_call.h. */
#include "firmware/process/fmu_call.h"

#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/text.h"

static const char *const FUNCTIONS[TL_FMU_FUNCTIONS] = {
    [TL_FMU_NO_CALL] = "nothing",
    [TL_FMU_LOADING] = "the loading of the library",
    [TL_FMU_GET_TYPES_PLATFORM] = "fmi2GetTypesPlatform",
    [TL_FMU_GET_VERSION] = "fmi2GetVersion",
    [TL_FMU_INSTANTIATE] = "fmi2Instantiate",
    [TL_FMU_FREE_INSTANCE] = "fmi2FreeInstance",
    [TL_FMU_SETUP_EXPERIMENT] = "fmi2SetupExperiment",
    [TL_FMU_ENTER_INITIALIZATION_MODE] = "fmi2EnterInitializationMode",
    [TL_FMU_EXIT_INITIALIZATION_MODE] = "fmi2ExitInitializationMode",
    [TL_FMU_TERMINATE] = "fmi2Terminate",
    [TL_FMU_RESET] = "fmi2Reset",
    [TL_FMU_GET_REAL] = "fmi2GetReal",
    [TL_FMU_GET_INTEGER] = "fmi2GetInteger",
    [TL_FMU_GET_BOOLEAN] = "fmi2GetBoolean",
    [TL_FMU_GET_STRING] = "fmi2GetString",
    [TL_FMU_SET_REAL] = "fmi2SetReal",
    [TL_FMU_SET_INTEGER] = "fmi2SetInteger",
    [TL_FMU_SET_BOOLEAN] = "fmi2SetBoolean",
    [TL_FMU_SET_STRING] = "fmi2SetString",
    [TL_FMU_GET_STATE] = "fmi2GetFMUstate",
    [TL_FMU_SET_STATE] = "fmi2SetFMUstate",
    [TL_FMU_FREE_STATE] = "fmi2FreeFMUstate",
    [TL_FMU_SERIALIZED_SIZE] = "fmi2SerializedFMUstateSize",
    [TL_FMU_SERIALIZE] = "fmi2SerializeFMUstate",
    [TL_FMU_DESERIALIZE] = "fmi2DeSerializeFMUstate",
    [TL_FMU_GET_BOOLEAN_STATUS] = "fmi2GetBooleanStatus",
    [TL_FMU_DO_STEP] = "fmi2DoStep",
};

/* Static, because this is the state of the process. */
static tl_fmu_calls own;
tl_fmu_calls *tl_fmu_calls_block = &own;
static __thread bool is_own_thread;

void tl_fmu_calls_use(tl_fmu_calls *block) {
    tl_fmu_calls_block = block == NULL ? &own : block;
}

void tl_fmu_calls_enter_thread(void) {
    is_own_thread = true;
}

bool tl_fmu_calls_is_own_thread(void) {
    return is_own_thread;
}

const tl_fmu_calls *tl_fmu_calls_in_use(void) {
    return tl_fmu_calls_block;
}

void tl_fmu_calls_note_end_request(void) {
    __atomic_store_n(&tl_fmu_calls_block->asked, 1, __ATOMIC_RELAXED);
}

bool tl_fmu_calls_end_is_requested(const tl_fmu_calls *block) {
    return __atomic_load_n(&block->asked, __ATOMIC_RELAXED) != 0;
}

uint32_t tl_fmu_calls_name(const char *name) {
    char kept[TL_FMU_CALL_NAME];
    uint32_t used = tl_fmu_calls_block->fmus;
    (void)snprintf(kept, sizeof kept, "%s", name);
    for (uint32_t i = 0; i < used && i < TL_FMU_CALL_FMUS; i++) {
        if (strcmp(tl_fmu_calls_block->names[i], kept) == 0) {
            return i << TL_FMU_CALL_FUNCTION_BITS;
        }
    }
    if (used >= TL_FMU_CALL_FMUS) {
        return (TL_FMU_CALL_FMUS - 1U) << TL_FMU_CALL_FUNCTION_BITS;
    }
    memcpy(tl_fmu_calls_block->names[used], kept, sizeof kept);
    __atomic_store_n(&tl_fmu_calls_block->fmus, used + 1, __ATOMIC_RELEASE);
    return used << TL_FMU_CALL_FUNCTION_BITS;
}

bool tl_fmu_calls_poll(const tl_fmu_calls *block, tl_fmu_call *call) {
    uint32_t now = __atomic_load_n(&block->now, __ATOMIC_RELAXED);
    uint32_t function = now & ((1U << TL_FMU_CALL_FUNCTION_BITS) - 1);
    uint32_t fmu = now >> TL_FMU_CALL_FUNCTION_BITS;
    call->begun = __atomic_load_n(&block->begun, __ATOMIC_RELAXED);
    if (function == TL_FMU_NO_CALL || function >= TL_FMU_FUNCTIONS) {
        return false;
    }
    call->function = FUNCTIONS[function];
    char name[TL_FMU_CALL_NAME]; /* a copy, which the FMU process cannot change */
    memcpy(name, block->names[fmu % TL_FMU_CALL_FMUS], sizeof name);
    (void)tl_clean_text(name, strnlen(name, sizeof name - 1), call->fmu, sizeof call->fmu);
    return true;
}

uint32_t tl_fmu_calls_failed(const tl_fmu_calls *block) {
    tl_fmu_call call;
    return tl_fmu_calls_poll(block, &call) ? call.begun : __atomic_load_n(&block->failed, __ATOMIC_RELAXED);
}
