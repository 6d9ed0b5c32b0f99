/* A library that gets the number from another one. */
#include "tests/fmu/copies/integral.h"

double *tl_outer_integral(void);

double *tl_integral(void) {
    return tl_outer_integral();
}
