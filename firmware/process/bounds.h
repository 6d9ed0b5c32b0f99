/* Bounds: the parent of an FMU process checks how much of the machine that process uses.
 *
 * Purpose: checks what kernel limits do not cover: the size of a folder, its number of files, and
 *          the number of threads. Memory is checked in addition to its kernel limit.
 * Cost:    about 20 µs per check, plus 2 µs for each file when the folder is counted. The folder is
 *          counted in every TL_BOUNDS_CHECKS-th check. It is counted earlier if the free bytes or
 *          files of the disk have shrunk so much that the folder may exceed a bound. A folder of
 *          more than 500 files is counted in every fifth check at most.
 * Removed: files that were removed but are still open or mapped are in no folder. They are counted
 *          if the free disk space has shrunk by more than `bytes` since the first check, whatever
 *          the cause. Only root can count the removed files of a confined process. So the bounds
 *          are also broken if the free space has shrunk by more than `bytes` and is less than 5 %
 *          of the disk.
 * Memory:  the caller owns all of it.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_PROCESS_BOUNDS_H
#define TL_FIRMWARE_PROCESS_BOUNDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

/* Bytes of a text with its end mark; maximum number of nested folders; see Cost. */
enum { TL_BOUNDS_TEXT = 256, TL_BOUNDS_DEPTH = 32, TL_BOUNDS_CHECKS = 100 };

/* Bounds of one process; 0: no bound. The caller sets the public fields and zeroes the rest. The
 * folder's text must live as long as this struct. */
typedef struct tl_bounds {
    const char *folder;   /* folder of the FMUs; NULL: none */
    uint64_t bytes;       /* maximum disk usage of all files below the folder */
    uint64_t files;       /* maximum number of files and folders below it; at most TL_BOUNDS_DEPTH levels */
    uint64_t threads;     /* maximum number of threads of the process */
    uint64_t memory;      /* maximum of resident and swapped bytes, including shared ones and page tables */
    uint64_t free_before; /* private: free bytes of the disk at the first check; 0: none yet */
    uint64_t gone_before; /* private: lost free bytes when removed files were last counted */
    uint64_t least_bytes; /* private: the folder is counted again if the disk has fewer free bytes */
    uint64_t least_files; /* private: or if it has fewer free files */
    bool is_large;        /* private: the folder has more than 500 files */
    unsigned checks_left; /* private: checks until the folder is counted again; 0 at first */
} tl_bounds;

/* Returns true if the process is within all bounds, or if process or folder do not exist any more
 * (`text` is then ""). Else returns false and sets `text` to the broken bound with its limit. A
 * subfolder that cannot be opened breaks the bounds. */
bool tl_bounds_are_kept(tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]);

#endif
