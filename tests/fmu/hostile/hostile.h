/* Hostile FMU of the tests: a file or folder beside this header defines its behaviour in one
 * function, which runs before each FMI function.
 *
 * Purpose: tests/support/hostile_fmu.py compiles such a file with frame.c and the sources of
 *          fmus/lag. Each file defines the meaning of its own macros (-DAT="…").
 */
#ifndef TL_TESTS_FMU_HOSTILE_HOSTILE_H
#define TL_TESTS_FMU_HOSTILE_HOSTILE_H

#include <fmi2FunctionTypes.h>
#include <stdbool.h>

/* Called at the beginning of the FMI function with this name ("fmi2DoStep"), and as "load" when the
 * library is loaded. If it returns false, the FMI function fails. */
bool hostile_before(const char *function);

/* The callbacks of the importer; set by fmi2Instantiate. */
extern const fmi2CallbackFunctions *hostile_callbacks;

#endif
