/* The process with the FMUs: what the program does if it was started as "twinlock: twin [NAME]".
 *
 * Purpose: it reads its job, opens the FMU files, gives up every right that FMUs have no business with (confine.h), and only then loads them.
 *          It builds the twin, and answers each tick with a result, or prints the page of a check. It has no file of the user's, no terminal
 *          and no socket; what it says goes through pipes and a block of shared memory.
 * Order:   log, parent, title; job; files; confinement; signals; then it says that it is ready.
 * Thread:  main waits; the FMUs have theirs (fmu_thread.h).
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_ROLE_H
#define TL_FIRMWARE_TWIN_TWIN_ROLE_H

#include <stdio.h>

#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_job.h"

/* Prints what a check tells of an assembly, which was built if `status` is TL_OK, and says on the log what is wrong with it. Returns the status
 * of the whole. */
typedef tl_status tl_twin_page(const tl_assembly *assembly, const tl_twin_job *job, tl_status status, FILE *page);

/* In the process of that role: to its end; the exit code. */
int tl_twin_role_run(tl_twin_page *print_page);

#endif
