/* List of solvers. */
#include "master/solve/optimiser.h"

#include <string.h>

static const tl_optimiser_class *const solvers[] = {
    &tl_secant, &tl_nelder_mead, &tl_bobyqa, &tl_lbfgs, &tl_sbplx, &tl_boolean,
};

const tl_optimiser_class *tl_optimiser_find(const char *name) {
    for (size_t i = 0; i < sizeof solvers / sizeof solvers[0]; i++) {
        if (strcmp(solvers[i]->name, name) == 0) {
            return solvers[i];
        }
    }
    return NULL;
}

const tl_optimiser_class *tl_optimiser_numbered(int number) {
    for (size_t i = 0; i < sizeof solvers / sizeof solvers[0]; i++) {
        if (number != 0 && solvers[i]->number == number) {
            return solvers[i];
        }
    }
    return NULL;
}

const char *tl_optimiser_names(void) {
    return "\"secant\", \"nelder-mead\", \"bobyqa\", \"l-bfgs\", \"sbplx\", \"boolean\"";
}
