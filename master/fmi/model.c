/* Looks up variables and units by name, and names causalities, variabilities and initial kinds. */
#include "master/fmi/model.h"

#include <string.h>

#include "master/base/text.h"

const tl_variable *tl_model_variable(const tl_model *model, const char *name) {
    for (size_t i = 0; i < model->variable_count; i++) {
        if (strcmp(model->variables[i].name, name) == 0) {
            return &model->variables[i];
        }
    }
    return NULL;
}

const char *tl_model_nearest(const tl_model *model, const char *name) {
    tl_nearest nearest = {.text = name};
    for (size_t i = 0; i < model->variable_count && i < TL_MODEL_COMPARED; i++) {
        tl_nearest_offer(&nearest, model->variables[i].name);
    }
    return nearest.best;
}

const tl_unit *tl_model_unit(const tl_model *model, const char *name) {
    for (size_t i = 0; i < model->unit_count; i++) {
        if (strcmp(model->units[i].name, name) == 0) {
            return &model->units[i];
        }
    }
    return NULL;
}

const char *tl_causality_name(tl_causality causality) {
    static const char *const names[] = {"parameter", "calculatedParameter", "input", "output", "local", "independent"};
    return names[causality];
}

const char *tl_variability_name(tl_variability variability) {
    static const char *const names[] = {"constant", "fixed", "tunable", "discrete", "continuous"};
    return names[variability];
}

const char *tl_initial_name(tl_initial initial) {
    static const char *const names[] = {"none", "exact", "approx", "calculated"};
    return names[initial];
}
