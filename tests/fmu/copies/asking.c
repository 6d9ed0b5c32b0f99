/* The number of a library that has it from another one. */
#include "tests/fmu/copies/integral.h"

double *tl_outer_integral(void);

double *tl_integral(void) {
    return tl_outer_integral();
}
