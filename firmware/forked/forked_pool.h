/* Processes for FMUs that are rolled back by forking: a keeper and a first process for each, started before anything of an FMU is here.
 *
 * Purpose: a process that is confined starts no other, so those of its FMUs are begun before. Each FMU has a *keeper*, which has no code of an FMU and does
 *          nothing but reap, and below it the process that loads the FMU (forked_host.h) and all that are forked from it: they are
 *          children of the keeper, all of them, so that the end of one ends no other.
 * Ends:    all of them end when this process does, in whatever way: then a pipe of the keeper's has no other end any more, and it kills its group, which what is
 *          confined cannot leave. Each process of ours is killed if its keeper is. A signal to the keeper at the end of the twin would not reach it: what is
 *          confined by Landlock signals nobody outside, not even so.
 * Bound:   processes of the user, by RLIMIT_NPROC: as many as the machine has when they are begun, and some hundred more.
 * Thread:  the main thread begins, while it is the only one; the thread of the FMUs takes.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_POOL_H
#define TL_FIRMWARE_FORKED_FORKED_POOL_H

#include "firmware/forked/forked_host.h"
#include "firmware/forked/forked_line.h"

/* FMUs of a process. */
enum { TL_FORKED_FMUS = 64 };

/* Processes for one more FMU, with so many snapshots at a time. `service` is what its process does. Errors: TL_TRY_AGAIN. */
tl_status tl_forked_begin(uint32_t snapshots, const tl_forked_service *service, tl_error *error);

/* The next one that was begun and not taken yet; NULL: there is none. It is there until tl_forked_line_close(). */
tl_forked_line *tl_forked_take(void);

#endif
