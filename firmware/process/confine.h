/* Confinement: a process with FMUs drops all rights that FMUs do not need.
 *
 * Purpose: after tl_confine() the process can compute, start threads, read programs and libraries,
 *          and write below one folder. Whatever an FMU does, the process cannot start programs,
 *          open sockets or change other files. It cannot signal, trace or read other processes.
 *          This cannot be undone.
 * Means:   a list of allowed system calls (filter.c); Landlock for file access (landlock.c);
 *          resource limits; protection against other processes of the same user; for root, a
 *          separate user.
 * Missing: features that the kernel lacks are reported by tl_confine_describe() and are no error.
 *          So the program also runs in an emulator, in a container and on an old kernel.
 * Not prevented, because no kernel feature covers it: an FMU can see names, sizes and dates of all
 * files (Landlock controls reading, not stat()). It can use all processor time, and read the listed
 * folders. It can fill the disk with removed but still open files, up to the limits of file size
 * and of bounds.h.
 * Others:  a process without FMUs also drops what it does not need. With `plant`, an io process can
 *          still open what its plant driver needs, but no other kind of socket or device. From
 *          Linux 6.7 on, it can connect by TCP to `ports` only. With `keeps_files`, a recorder can
 *          remove and rename files below its writable folders, and change mode and owner of open
 *          files. Neither of these can listen, start programs or reach a local socket. With
 *          `is_server`, a server that already listens can accept connections, and connect to local
 *          sockets only.
 * Thread:  call from the thread that will load FMUs, preferably before other threads exist.
 *          Landlock and capabilities apply to the calling thread and the threads that it starts.
 *          With whole_process the system call list, the limits and the user apply to all threads.
 * Before:  before the call, do what needs more rights, such as PR_SET_PDEATHSIG, setsid() or
 *          opening a device. PR_SET_PDEATHSIG is set again after a change of the user, because the
 *          kernel resets it.
 */
#ifndef TL_FIRMWARE_PROCESS_CONFINE_H
#define TL_FIRMWARE_PROCESS_CONFINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/resource.h>

#include "board/io/plant_access.h"
#include "master/base/status.h"

/* Bytes of a text with its end mark; upper bound of the default memory limit, MiB. */
enum { TL_CONFINE_TEXT = 768, TL_CONFINE_MEMORY_MIB = 4096 };

/* Texts and lists must stay valid during the call only. */
typedef struct tl_confine_settings {
    const char *folder;      /* absolute; becomes the current folder, TMPDIR, and writable; NULL: none */
    uint64_t file_bytes;     /* largest size of a file; 0: no limit */
    const char *const *read; /* additional readable files and folders; missing ones are skipped */
    size_t read_count;
    const char *const *write; /* additional writable ones: a database's folder, devices */
    size_t write_count;
    /* Largest private memory in bytes, thread stacks included; 0: no limit. Reserved but unused
     * address space does not count. A program with a sanitizer has no limit, because the
     * sanitizer's own memory is larger. */
    uint64_t memory;
    uint32_t user;      /* user and group ID to change to, needs root; the group needs access to `folder`; 0: none */
    int start_socket;   /* the only socket that allows sendmsg(), to pass on `listener` (tl_confine()); -1: none */
    bool whole_process; /* applies the system call list to all threads, else to the caller's */
    const tl_plant_access *plant; /* what the plant driver of the process needs; NULL: no driver */
    bool names;                   /* the driver resolves host names */
    const uint16_t *ports;        /* TCP ports to which the driver may connect; before Landlock 4: any port */
    size_t port_count;
    bool keeps_files;    /* see Others above */
    bool is_server;      /* see Others above */
    bool only_denies;    /* true: signalling or tracing another process only fails; false: it kills this process */
    int landlock;        /* private: Landlock version in use; 0: none */
    int landlock_newest; /* highest Landlock version to use, for tests; -1: no Landlock; 0: that of the kernel */
} tl_confine_settings;

/* What tl_confine() enforces, or what the kernel supports (tl_confine_probe()). */
typedef struct tl_confine_facts {
    bool filter;   /* filter of system calls */
    bool notifies; /* refused calls can be reported (refusal.h) */
    int landlock;  /* version of Landlock ("ABI"); 0: none */
    bool memory;   /* memory limit */
    bool user;     /* separate user: protects files of other users also without Landlock */
} tl_confine_facts;

/* Detects what the kernel supports, without confining. Sets `user` if this process could change its
 * user. */
void tl_confine_probe(tl_confine_facts *facts);

/* Returns the default memory limit of an FMU process, bytes: half of the machine's memory, at most
 * TL_CONFINE_MEMORY_MIB. 0: unknown. */
uint64_t tl_confine_fair_memory(void);

/* Confines the process and sets *facts to what is enforced. If `listener` is NULL, refused calls
 * return EPERM and are not reported. Else *listener becomes a descriptor for tl_refusal_take() in
 * another process, or -1 if calls are not reported. A refused call waits for an answer, so pass the
 * descriptor to that process and close it here at once.
 * Errors:  TL_BAD_USAGE if the folder cannot be entered. TL_TRY_AGAIN if a feature of the kernel
 *          failed; the process is partly confined and must end. TL_INTERRUPTED if the parent that
 *          PR_SET_PDEATHSIG refers to has ended. */
tl_status tl_confine(const tl_confine_settings *settings, tl_confine_facts *facts, int *listener, tl_error *error);

/* Describes what is not enforced, for users; "" if all is. */
void tl_confine_describe(const tl_confine_facts *facts, char text[TL_CONFINE_TEXT]);

/* ---- System call filter: the list of calls that a confined process may make, and its loading into
 * the kernel.
 *
 * Purpose: a call that is not on the list returns EPERM, and is reported to a listener if there is
 *          one (refusal.h). In filter.c, the list has one line for each group of calls, with its
 *          purpose. Then follow the calls that are allowed only with certain arguments. Calls that
 *          are newer than this program fail with ENOSYS.
 * Machine: only calls of this program's own machine type are allowed. A call of another type
 *          (32-bit or x32 on x86-64, AArch32) kills the process.
 * Thread:  any.
 */

/* Return true if the kernel supports filters (first), or can report refused calls (second). */
bool tl_filter_is_offered(void);
bool tl_filter_can_notify(void);

/* Loads the filter. If `listener` is NULL, refused calls are not reported. Else *listener becomes
 * the descriptor for tl_refusal_take(), or -1 if the kernel cannot report calls, or if another
 * process already receives them.
 * Errors:  TL_TRY_AGAIN if the filter could not be loaded. */
tl_status tl_filter_load(const tl_confine_settings *settings, int *listener, tl_error *error);

/* ---- Landlock: which files a process may read, below which folders it may write, and to which TCP
 * ports it may connect.
 *
 * Purpose: an FMU can open only the files of programs and libraries, those that the settings add,
 *          and its own folder. This holds whatever rights the user has.
 * Version: uses the kernel's version ("ABI"), from 1 on. From 2: renaming between folders. From 3:
 *          truncating files (before, the filter refuses what Landlock does not check). From 4: TCP
 *          ports (no binding; connecting to `ports` only). From 5: device commands. From 6:
 *          abstract sockets and signals.
 * Itself:  single files of /proc/self are readable. About a dozen descriptors of them stay open
 *          until the process ends, because the rules depend on them.
 * Unseen:  Landlock does not check stat(), access(), readlink(), changes of the current folder, and
 *          changes of mode, owner, times and attributes. The filter permits changing the current
 *          folder and refuses the other changes. keeps_files also permits fchmod() and fchown().
 * Thread:  applies to the calling thread and the threads that it starts.
 */

/* From this Landlock version on, a file that may not be written cannot be truncated either. */
enum { TL_LANDLOCK_TRUNCATION = 3 };

/* Returns the kernel's version; 0: not supported, or disabled. */
int tl_landlock_version(void);

/* Applies the folders and ports of the settings. `settings->landlock` > 0 is the version to use, at
 * most that of the kernel. Missing folders are skipped. Needs PR_SET_NO_NEW_PRIVS.
 * Errors:  TL_TRY_AGAIN if the kernel rejects the rules. */
tl_status tl_landlock_restrict(const tl_confine_settings *settings, tl_error *error);

/* ---- Limits: memory and file size as in the settings, no message queue, no core dump, a bounded
 * stack, and the limits below.
 *
 * Thread:  they apply to the whole process.
 */

/* Maximum number of descriptors above the highest one that is open at confinement; maximum number
 * of pending timers and signals. */
enum { TL_PROCESS_LIMITS_DESCRIPTORS = 256, TL_PROCESS_LIMITS_SIGNALS = 256 };

/* Raises the soft limit of `resource` (RLIMIT_…) to at least `least`, or to the hard limit if that
 * is lower and cannot be raised. The limit stays when capabilities are dropped. */
void tl_process_limits_permit(int resource, rlim_t least);

#endif
