/* What a hostile FMU of the tests does: one function, in a file or a folder of its own here, that is called before everything else.
 *
 * Purpose: tests/support/hostile_fmu.py compiles such a file with frame.c and the sources of fmus/lag. What is told by macros
 *          (-DAT="…") is the file's own affair.
 */
#ifndef TL_TESTS_FMU_HOSTILE_HOSTILE_H
#define TL_TESTS_FMU_HOSTILE_HOSTILE_H

#include <fmi2FunctionTypes.h>
#include <stdbool.h>

/* Called at the beginning of "fmi2Instantiate", "fmi2FreeInstance", "fmi2DoStep" and so on, and by a constructor as "load".
 * False: the function fails. */
bool hostile_before(const char *function);

/* The importer's, from fmi2Instantiate on. */
extern const fmi2CallbackFunctions *hostile_callbacks;

#endif
