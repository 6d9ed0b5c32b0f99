/* FMI functions that ask the process of an FMU: what stands in the place of the FMU's own behind a guard.
 *
 * Purpose: who calls the table cannot tell where the FMU is. Saving and restoring are forks (forked_line.h); a state cannot be turned into bytes.
 * Answers: a process that has ended is fmi2Fatal, and was said on the log. What is no status is fmi2Fatal as well.
 * Bound:   the values of one call and their references in TL_FORKED_BYTES; else fmi2Error, which is said.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_CALLS_H
#define TL_FIRMWARE_FORKED_FORKED_CALLS_H

#include "firmware/forked/forked_line.h"
#include "master/fmi/fmi2.h"

/* The process loads what is unpacked in `folder`; `name` is the FMU's. Errors: what loading there has; TL_FMU_FATAL: it has ended. */
tl_status tl_forked_load(tl_forked_line *line, const char *folder, const char *label, const char *name,
                         tl_error *error);

/* Its functions. The environment of the callbacks that `instantiate` gets must be the line. */
extern const tl_fmi2 tl_forked_functions;

#endif
