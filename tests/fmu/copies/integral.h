/* The one number that the FMU of this folder remembers, outside of its instance.
 *
 * Purpose: an FMU that keeps its state in a global, as code of simulators from before FMI does. Two components that share that global
 *          disturb each other, and every value tells.
 * Owner:   whoever has the library that defines it. Thread: one.
 */
#ifndef TL_TESTS_FMU_COPIES_INTEGRAL_H
#define TL_TESTS_FMU_COPIES_INTEGRAL_H

/* Never NULL, but for one that cannot be opened. */
double *tl_integral(void);

#endif
