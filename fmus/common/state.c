/* Saves, restores and serialises an instance by copying one block of memory without pointers.
 *
 * An existing handle is overwritten and not allocated again. So an importer that creates its
 * handles before the first cycle needs no further memory. Serialised bytes are valid for the same
 * FMU binary only.
 */
#include "fmus/common/instance.h"

#include <stdlib.h>
#include <string.h>

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *handle) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2GetFMUstate", TL_FMU_ANY_MODE);
    if (!instance) {
        return fmi2Error;
    }
    if (!handle) {
        return tl_fmu_refuse(instance, "fmi2GetFMUstate: no place for the handle");
    }
    if (!*handle) {
        *handle = malloc(tl_fmu_state_size());
        if (!*handle) {
            return tl_fmu_refuse(instance, "fmi2GetFMUstate: out of memory");
        }
    }
    memcpy(*handle, instance->state, tl_fmu_state_size());
    return fmi2OK;
}

/* Returns true if `state` can belong to this FMU: right GUID, valid mode. */
static bool is_ours(const tl_fmu_state *state) {
    const int64_t mode = state->mode;
    const bool one_mode = mode > 0 && (mode & (mode - 1)) == 0 && (mode & TL_FMU_ANY_MODE) != 0;
    return memcmp(state->guid, tl_fmu_model_of_this_fmu.guid, sizeof state->guid) == 0 && one_mode;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate handle) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2SetFMUstate", TL_FMU_ANY_MODE);
    if (!instance) {
        return fmi2Error;
    }
    if (!handle || !is_ours(handle)) {
        return tl_fmu_refuse(instance, "fmi2SetFMUstate: this is no state of this FMU");
    }
    memcpy(instance->state, handle, tl_fmu_state_size());
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *handle) {
    if (!tl_fmu_enter(component, "fmi2FreeFMUstate", TL_FMU_ANY_MODE)) {
        return fmi2Error;
    }
    if (handle) {
        free(*handle);
        *handle = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate handle, size_t *size) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2SerializedFMUstateSize", TL_FMU_ANY_MODE);
    if (!instance) {
        return fmi2Error;
    }
    if (!handle || !size) {
        return tl_fmu_refuse(instance, "fmi2SerializedFMUstateSize: no state, or no place for its size");
    }
    *size = tl_fmu_state_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate handle, fmi2Byte bytes[], size_t size) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2SerializeFMUstate", TL_FMU_ANY_MODE);
    if (!instance) {
        return fmi2Error;
    }
    if (!handle || !bytes || size < tl_fmu_state_size()) {
        return tl_fmu_refuse(instance, "fmi2SerializeFMUstate: no state, or fewer than %zu bytes for it",
                             tl_fmu_state_size());
    }
    memcpy(bytes, handle, tl_fmu_state_size());
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *handle) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2DeSerializeFMUstate", TL_FMU_ANY_MODE);
    if (!instance) {
        return fmi2Error;
    }
    if (!bytes || !handle || size != tl_fmu_state_size()) {
        return tl_fmu_refuse(instance, "fmi2DeSerializeFMUstate: a state of this FMU has %zu bytes, not %zu",
                             tl_fmu_state_size(), size);
    }
    tl_fmu_state head;
    memcpy(&head, bytes, sizeof head);
    if (!is_ours(&head)) {
        return tl_fmu_refuse(instance, "fmi2DeSerializeFMUstate: these bytes are no state of this FMU");
    }
    if (!*handle) {
        *handle = malloc(size);
        if (!*handle) {
            return tl_fmu_refuse(instance, "fmi2DeSerializeFMUstate: out of memory");
        }
    }
    memcpy(*handle, bytes, size);
    return fmi2OK;
}
