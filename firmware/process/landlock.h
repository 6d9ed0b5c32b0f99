/* Landlock: which files a process may read, below which folder it may write, and to which TCP ports it may connect.
 *
 * Purpose: whatever the user who started us could open, an FMU opens only what programs are made of, what the settings add, and its own folder.
 * Version: the kernel's ("ABI"), 1 … 7, is used as far as it goes. Renaming between folders from 2 on, emptying from 3 (before, the
 *          filter refuses what Landlock does not see), TCP ports from 4 (none is taken, and only `ports` are connected to), commands to devices from 5, abstract sockets and signals from 6.
 * Itself:  of /proc/self single files are read. Their places, a dozen descriptors, stay open for the rest of the process: rules depend on them.
 * Unseen:  Landlock does not hold looking (stat, access, readlink), changing the folder, and modes, owners, times and attributes; the filter
 *          refuses all changes of these.
 * Thread:  holds for the thread that calls and those that it starts.
 */
#ifndef TL_FIRMWARE_PROCESS_LANDLOCK_H
#define TL_FIRMWARE_PROCESS_LANDLOCK_H

#include "firmware/process/confine_settings.h"
#include "master/base/status.h"

/* The version from which on a file cannot be emptied by who may not write it. */
enum { TL_LANDLOCK_TRUNCATION = 3 };

/* 0: the kernel has none, or it is switched off. */
int tl_landlock_version(void);

/* The places and ports of the settings, by `settings->landlock` > 0: the kernel's version, or an older one. Places that are missing are passed over. Needs
 * PR_SET_NO_NEW_PRIVS. TL_TRY_AGAIN: it failed. */
tl_status tl_landlock_restrict(const tl_confine_settings *settings, tl_error *error);

#endif
