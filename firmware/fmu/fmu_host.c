/* An FMU in a process of its own: see fmu_host.h. */
#include "firmware/fmu/fmu_host.h"

#include <limits.h>
#include <stdio.h>

#include "firmware/base/c_locale.h"
#include "firmware/fmu/fmu_binary.h"
#include "firmware/fmu/fmu_guard.h"
#include "firmware/fmu/model_description.h"
#include "master/base/arena.h"

tl_status tl_fmu_host_load(const char *folder, const char *label, tl_forked_fmu *fmu, tl_error *error) {
    static tl_arena arena; /* of the process, as the FMU is */
    static tl_model model;
    static tl_fmu_guard guard;
    char description[PATH_MAX + sizeof "/modelDescription.xml"];
    tl_locale_use();
    tl_arena_init(&arena);
    (void)snprintf(description, sizeof description, "%s/modelDescription.xml", folder);
    tl_status status = tl_model_description_read(description, label, &arena, &model, error);
    if (status != TL_OK) {
        return status;
    }
    tl_fmu_guard_open(&guard, model.name, model.generation_tool);
    status = tl_fmu_binary_open(folder, &model, label, &guard, error);
    if (status == TL_OK) {
        *fmu = (tl_forked_fmu){.functions = &guard.functions, .callbacks = &guard.callbacks};
    }
    return status;
}
