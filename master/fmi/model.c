/* Looks up variables and units by name, and names causalities, variabilities and initial kinds. */
#include "master/fmi/model.h"

#include <string.h>

#include "master/base/nearest.h"

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
    for (size_t i = 0; i < model->variable_count && i < TL_MODEL_OFFERED; i++) {
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
    switch (causality) {
    case TL_PARAMETER:
        return "parameter";
    case TL_CALCULATED_PARAMETER:
        return "calculatedParameter";
    case TL_INPUT:
        return "input";
    case TL_OUTPUT:
        return "output";
    case TL_LOCAL:
        return "local";
    case TL_INDEPENDENT:
        return "independent";
    }
    return "unknown";
}

const char *tl_variability_name(tl_variability variability) {
    switch (variability) {
    case TL_CONSTANT:
        return "constant";
    case TL_FIXED:
        return "fixed";
    case TL_TUNABLE:
        return "tunable";
    case TL_DISCRETE:
        return "discrete";
    case TL_CONTINUOUS:
        return "continuous";
    }
    return "unknown";
}

const char *tl_initial_name(tl_initial initial) {
    switch (initial) {
    case TL_INITIAL_NONE:
        return "none";
    case TL_INITIAL_EXACT:
        return "exact";
    case TL_INITIAL_APPROX:
        return "approx";
    case TL_INITIAL_CALCULATED:
        return "calculated";
    }
    return "unknown";
}
