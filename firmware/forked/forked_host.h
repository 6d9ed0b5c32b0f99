/* The FMU's end: a process that loads one FMU, does what it is asked, and forks itself when it is asked that.
 *
 * Purpose: the child of a fork *is* the FMU as it was: it waits in the same place, until it is asked to fork in its turn or to end. It is made by clone() with
 *          the keeper as its parent, so whoever forked it may end. Nothing of the C library's own fork() runs: what this thread
 *          believes of itself, as the number by which a lock knows its owner, stays as it was, in each of them.
 * Refused: a fork copies memory, and one thread. A thread, a process, an open file or socket, whose position and connection the copies would
 *          share, and memory that is shared: whoever has one cannot be saved, and is told which. Threads are looked for in each save, all else (forked_traces.h) in the first ones and now and then.
 * Thread:  the only one of its process.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_HOST_H
#define TL_FIRMWARE_FORKED_FORKED_HOST_H

#include "firmware/forked/forked_answer.h"
#include "master/base/status.h"

/* What the process of an FMU does besides: it gives up what FMUs have no business with, before anything is loaded; and loads the FMU that is unpacked in
 * `folder`. */
typedef struct tl_forked_service {
    tl_status (*confine)(const void *context, tl_error *error); /* NULL: it does not */
    tl_status (*settle)(
        const void *context,
        tl_error *error); /* the keeper becomes the user that this process will be: the kernel lets nobody of
                                                                    another one signal it. NULL: it does not */
    const void *context;
    tl_status (*load)(const char *folder, const char *label, tl_forked_fmu *fmu, tl_error *error);
} tl_forked_service;

/* In the process in slot 0: until it is told to end. `keeper` is its parent. */
void tl_forked_host_run(tl_forked_block *block, uint32_t slots, pid_t keeper, const tl_forked_service *service)
    __attribute__((noreturn));

#endif
