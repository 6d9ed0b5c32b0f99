/* What `run` gives up while FMUs share its process.
 *
 * Purpose: as far as one process allows, FMUs are confined as they are in a process of their own (confine.h). Two lists, one for a kind of thread:
 *          - the thread of the FMUs, with all that FMUs start, computes, reads what programs are made of and what the configuration names, and writes
 *            below a private folder, which is its current folder and TMPDIR. It opens no socket and no device, has no capability, and reaches no
 *            database. What it is refused is told, with the FMU's name, and the twin goes on.
 *          - all others (drivers, recorder, main thread) connect again, open serial and GPIO lines, write below the database's folder, read the
 *            CSV files' and what names of hosts are looked up by. They start no program, and see no other file either.
 * Left:    what one process cannot give. The threads share memory and descriptors: an FMU that writes where it must not can make another thread use
 *          its rights; it can close or write a descriptor of ours, such as the recorder's or a socket, by its number; and it can signal threads of this
 *          process. Files have no limit of length, as the database must grow, and nobody counts what is in the folder.
 * Order:   begin and enter before an FMU is loaded, finish before drivers and recorder are started: rights hold per thread, and threads
 *          inherit them.
 * Cost:    a refused call waits for a thread of ordinary priority. All other calls cost some 0.1 us more.
 * Thread:  the main thread, but for enter.
 */
#ifndef TL_FIRMWARE_RUN_LIVE_CONFINEMENT_H
#define TL_FIRMWARE_RUN_LIVE_CONFINEMENT_H

#include "firmware/confine/confine.h"
#include "firmware/run/journal.h"
#include "firmware/twin/assembly.h"

enum { TL_LIVE_CONFINEMENT_TEXT = TL_CONFINE_TEXT + 128 };

/* The kind of its private folder, for who removes what killed processes left. */
#define TL_LIVE_CONFINEMENT_KIND "run"

typedef struct tl_live_confinement tl_live_confinement;

/* Makes the private folder, and takes the right to other files from this thread and those that it starts. `assembly`: its files are open
 * (tl_assembly_open()); it must stay until finish. `database`: NULL: none. On failure there is nothing to end. Errors: TL_TRY_AGAIN. */
tl_status tl_live_confinement_begin(const tl_assembly *assembly, const char *database,
                                    tl_live_confinement **confinement, tl_error *error);

/* In the thread of the FMUs: the strict list. Errors: TL_TRY_AGAIN, TL_BAD_USAGE. */
tl_status tl_live_confinement_enter(tl_live_confinement *self, tl_error *error);

/* The list of the others, and the thread that answers what FMUs are refused. Errors: TL_TRY_AGAIN. */
tl_status tl_live_confinement_finish(tl_live_confinement *self, tl_error *error);

/* A sentence of what is not held on this machine; "" where all is that one process can hold. After finish. */
void tl_live_confinement_describe(const tl_live_confinement *self, char text[TL_LIVE_CONFINEMENT_TEXT]);

/* Events of what FMUs were refused and has not been told yet. */
void tl_live_confinement_tell(tl_live_confinement *self, tl_journal *journal);

/* Once the thread of the FMUs has ended: says on the log what was not told, and removes the folder. NULL is allowed. */
void tl_live_confinement_end(tl_live_confinement *self);

#endif
