/* The process with the FMUs: what the program does if it was started as "twinlock: twin [NAME]".
 *
 * Purpose: it reads its job, opens the FMU files, gives up every right that FMUs have no business with (confine.h), and only then loads them.
 *          It builds the twin, and answers each tick with a result, prints the page of a check, or lives beside a plant. It has no file of the
 *          user's, no terminal and no socket; what it says goes through pipes and blocks of shared memory.
 * Order:   log, parent, title; signals; job; files; confinement; then it says that it is ready, or lives.
 * Live:    the room that does it is above this one, so it is handed in. It has no channel; its blocks have the numbers that twin_wire.h says. An FMU
 *          that reaches for another process is refused that, and the twin goes on, as the plant's data do. The process may lock its memory, and
 *          who has started it may give it the configured priority, though it has no capability.
 * Thread:  main waits; the FMUs have theirs (fmu_thread.h).
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_ROLE_H
#define TL_FIRMWARE_TWIN_TWIN_ROLE_H

#include <stdio.h>

#include "firmware/process/confine.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/read_back.h"
#include "firmware/twin/twin_job.h"

/* Prints what a check tells of an assembly, which was built if `status` is TL_OK, and says on the log what is wrong with it. Returns the status
 * of the whole. `host` as in tl_read_back_take(). */
typedef tl_status tl_twin_page(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                               const tl_read_back_host *host, FILE *page, tl_twin_check *found);

/* In the process of that role, for TL_TASK_LIVE, in the main thread, which is the only one so far: to its end; the exit code. The assembly's
 * configuration was read, and its files are open, but not if the job holds; it is freed in the thread that builds it. */
typedef int tl_twin_live(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts);

/* What other rooms do in this one. */
typedef struct tl_twin_role_tasks {
    tl_twin_page *print_page;
    tl_twin_live *live;
} tl_twin_role_tasks;

/* In the process of that role: to its end; the exit code. */
int tl_twin_role_run(const tl_twin_role_tasks *tasks);

#endif
