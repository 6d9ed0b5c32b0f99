/* A library between the FMU and the library that defines the number. */
#include "tests/fmu/copies/integral.h"

double *tl_outer_integral(void);

__attribute__((visibility("default"))) double *tl_outer_integral(void) {
    return tl_integral();
}
