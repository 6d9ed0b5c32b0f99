/* Somebody who looks at a process: it is silent because he holds it, and not because it hangs.
 *
 * Purpose: who debugs an FMU stops its process for as long as he likes, and so does Ctrl-Z or `kill -STOP`. That is told from a hang by what the kernel says of
 *          each thread: that it is stopped, or that another process traces it (gdb, strace).
 * Cost:    some files of /proc for each thread: for who has found the process silent, not for each look.
 * Limits:  who has stopped it is not known: an FMU may have stopped its own process. If the kernel hides /proc, nobody looks.
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_LIVE_ONLOOKER_H
#define TL_FIRMWARE_LIVE_ONLOOKER_H

#include <stdbool.h>
#include <sys/types.h>

/* A thread of this process is traced or stopped. */
bool tl_onlooker_holds(pid_t process);

#endif
