/* Fuzzes modelDescription.xml of an FMU. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/fmu/model_description.h"
#include "tests/fuzz/harness.h"

/* Expects the properties on which the twin relies. */
static void check_model(const tl_model *model) {
    for (size_t i = 0; i < model->variable_count; i++) {
        const tl_variable *variable = &model->variables[i];
        if (variable->name == NULL || variable->description == NULL ||
            (variable->type == TL_REAL && (isnan(variable->minimum) || isnan(variable->maximum)))) {
            abort();
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_arena arena;
    tl_model model;
    tl_error error = {TL_OK, ""};
    tl_arena_init(&arena);
    tl_status status = tl_model_description_parse((const char *)data, size, "input.fmu", &arena, &model, &error);
    if (status == TL_OK) {
        check_model(&model);
    } else if (error.text[0] == '\0') {
        abort();
    }
    tl_arena_release(&arena);
    return 0;
}
