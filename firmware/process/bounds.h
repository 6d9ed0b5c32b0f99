/* What a process with FMUs may take of the machine, looked at from the process that started it.
 *
 * Purpose: what limits of the kernel do not hold: the size of a folder, its number of files, threads; and memory a second time.
 * Cost:    some 20 us a look, and 2 us for each file in the folder: a large one is walked only at each fifth look.
 * Removed: files that were removed and are still open, or mapped, are in no folder. They are counted if more than `bytes` of the disk went since the
 *          first look, whoever took them. Only root can count those of a confined process. For all others the bounds are broken if less than a
 *          twentieth of the disk is left by then.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_PROCESS_BOUNDS_H
#define TL_FIRMWARE_PROCESS_BOUNDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

enum { TL_BOUNDS_TEXT = 256, TL_BOUNDS_DEPTH = 32 };

/* 0: no bound. The text lives as long as this. */
typedef struct tl_bounds {
    const char *folder; /* NULL: none */
    uint64_t bytes;     /* that all below it take on the disk */
    uint64_t files;     /* and folders below it, TL_BOUNDS_DEPTH deep at most */
    uint64_t threads;
    uint64_t memory;      /* bytes in use, shared ones and the kernel's tables of them included */
    uint64_t free_before; /* private: bytes that the disk had free at the first look; 0: not looked yet */
    uint64_t gone_before; /* private: bytes that had gone when removed files were counted last */
    unsigned looks_left;  /* private; 0 at first: the folder is walked when there is none left */
} tl_bounds;

/* False: not, and `text` says which, what was found and what was allowed. A process or a folder that is gone keeps everything. A folder
 * below `folder` that cannot be looked into breaks them. */
bool tl_bounds_are_kept(tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]);

#endif
