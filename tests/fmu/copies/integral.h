/* State of the FMU of this folder: one number outside of its instance.
 *
 * Purpose: an FMU whose state is a global variable, as in simulator code that is older than FMI. If
 *          two components share that variable, the values of both are wrong.
 * Owner:   the library that defines the variable. Thread: one.
 */
#ifndef TL_TESTS_FMU_COPIES_INTEGRAL_H
#define TL_TESTS_FMU_COPIES_INTEGRAL_H

/* Returns the address of the number. NULL: the library that defines it cannot be opened. */
double *tl_integral(void);

#endif
