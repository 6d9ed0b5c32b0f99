/* Simulated disk that is full, broken, slow or loses power: a VFS between SQLite and the files.
 *
 * Model:   a write that fails writes the first half of its bytes, as a full disk does. A power cut
 *          keeps synced data. The seed decides which of the later writes it keeps.
 * Limits:  one disk for all files of the process; no memory-mapped files. Removals and renames
 *          outside of SQLite are not tracked.
 * Thread:  install and restore_power from one thread while no file is open; all others from any.
 */
#ifndef TL_TESTS_SUPPORT_FAULTY_VFS_H
#define TL_TESTS_SUPPORT_FAULTY_VFS_H

#include <stdbool.h>
#include <stdint.h>

/* Installs the VFS as SQLite's default, without faults. May be called again. */
void tl_faulty_vfs_install(void);

/* After `after` more writes, each write, truncation and sync fails with `code`, for example
 * SQLITE_FULL. SQLITE_OK: the disk works again. */
void tl_faulty_vfs_refuse(int code, uint64_t after);

/* Only the next write, truncation or sync fails. */
void tl_faulty_vfs_refuse_once(int code);

/* Number of failed operations, and of successful writes, since the installation. */
uint64_t tl_faulty_vfs_refusals(void);
uint64_t tl_faulty_vfs_writes(void);

/* Number of attempts to lock the write-ahead log that failed, since the start. */
uint64_t tl_faulty_vfs_locked(void);

/* Files are opened read-only, and none is created, as on a read-only medium. */
void tl_faulty_vfs_read_only(bool on);

/* Each write takes this time from now on. */
void tl_faulty_vfs_slow(int64_t nanoseconds);

/* A power cut: nothing is written, synced, truncated or removed any more. It must be armed
 * before the files are opened. */
void tl_faulty_vfs_arm_power_cut(void);
void tl_faulty_vfs_cut_power(void);

/* Ends the power cut: gives the real files the content after it. All files must be closed. */
void tl_faulty_vfs_restore_power(uint64_t seed);

#endif
