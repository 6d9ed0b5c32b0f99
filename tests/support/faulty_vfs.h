/* A disk that can be full, broken, locked up or lose its power: a VFS for SQLite, between it and the real files.
 *
 * Purpose: to show what the recorder does when its disk does not do what it should.
 * Model:   a refused write writes the first half of its bytes, as a full disk does. A power cut keeps what was synced
 *          and, of what was written since, each write or not, as the seed decides.
 * Limits:  one disk for all files of the process; no memory-mapped files; names that are removed or renamed outside of
 *          SQLite are not followed.
 * Thread:  install and restore_power from one thread while no file is open; all others from any thread.
 */
#ifndef TL_TESTS_SUPPORT_FAULTY_VFS_H
#define TL_TESTS_SUPPORT_FAULTY_VFS_H

#include <stdbool.h>
#include <stdint.h>

/* Becomes SQLite's default VFS; a disk without faults. May be repeated. */
void tl_faulty_vfs_install(void);

/* From the write behind the next `after` ones on, every write, truncation and sync fails with `code` (SQLITE_FULL,
 * SQLITE_IOERR_WRITE, …); SQLITE_OK: the disk works again. */
void tl_faulty_vfs_refuse(int code, uint64_t after);

/* The next write, truncation or sync fails, and no other. */
void tl_faulty_vfs_refuse_once(int code);

/* Operations refused, and writes done, since the installation. */
uint64_t tl_faulty_vfs_refusals(void);
uint64_t tl_faulty_vfs_writes(void);

/* How often a lock in the write-ahead log was not to be had, since the start. */
uint64_t tl_faulty_vfs_locked(void);

/* From now on files are opened for reading only, and none is made, as on a medium that is mounted so. */
void tl_faulty_vfs_read_only(bool on);

/* Every write takes this long from now on. */
void tl_faulty_vfs_slow(int64_t nanoseconds);

/* From now on nothing is written, synced, truncated or removed any more. Must be armed before the files are opened. */
void tl_faulty_vfs_arm_power_cut(void);
void tl_faulty_vfs_cut_power(void);

/* All files closed: makes the files on the real disk what they are after the cut, and ends it. */
void tl_faulty_vfs_restore_power(uint64_t seed);

#endif
