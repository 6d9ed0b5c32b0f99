/* A process that holds FMUs gives up what FMUs have no business with.
 *
 * Purpose: after tl_confine() the process computes, starts threads, reads what programs are made of, and writes below one folder. It
 *          starts no program, opens no socket, signals, traces and reads no other process, and changes no file elsewhere, whatever an
 *          FMU in it does. There is no way back.
 * Means:   a list of the system calls that are allowed (filter.c), Landlock for the places of files (landlock.c), limits, a
 *          process that others of the same user cannot look into, and, for root, a user of its own.
 * Missing: what the kernel does not offer is a fact, told by tl_confine_describe(), never a failure. So the program goes on in an
 *          emulator, in a container and on an old kernel.
 * Left open, since no kernel holds it: names, sizes and dates of files can be seen anywhere (Landlock knows reading, not looking); time on
 *          the processor; what the listed folders hold; a file that was removed but is still open counts nowhere but at its limit, and where
 *          the disk gets full (bounds.h).
 * Others:  a process without FMUs gives up all it does not need, too. With `plant` it can open again what that driver of a plant needs, and
 *          no socket or device of another kind. TCP connects to `ports` only, from Linux 6.7 on. With keeps_files a recorder can remove and rename below the folders
 *          that it writes, and give files the mode of others. Neither can listen, start programs or reach a local socket. With may_answer a server that listens
 *          already can accept, and reach local sockets, and nobody else.
 * Thread:  from the thread that will load FMUs, best while there is no other: Landlock and capabilities hold for the thread that calls and
 *          those that it starts. With whole_process the list of system calls, the limits and the user hold for all threads.
 * Before:  what needs more than the above, as PR_SET_PDEATHSIG, setsid(), opening a device, has been done. PR_SET_PDEATHSIG is kept, which the
 *          kernel forgets when the user changes.
 */
#ifndef TL_FIRMWARE_PROCESS_CONFINE_H
#define TL_FIRMWARE_PROCESS_CONFINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/resource.h>

#include "board/io/plant_access.h"
#include "master/base/status.h"

enum { TL_CONFINE_TEXT = 768, TL_CONFINE_MEMORY_MIB = 4096 };

/* All texts live during the call only. */
typedef struct tl_confine_settings {
    const char *folder;      /* absolute: becomes the current folder and TMPDIR; writing and making is allowed below it.
                                 NULL: the current folder stays, and nothing is added */
    uint64_t file_bytes;     /* no file grows longer; 0: no such limit */
    const char *const *read; /* further files and folders that may be read; those that are missing are passed over */
    size_t read_count;
    const char *const *write; /* further ones that may be written: a database's folder, devices */
    size_t write_count;
    /* Bytes that the process may make its own, stacks of threads included; 0: no limit. Address space that is only reserved does not count. With a sanitizer,
     * whose own memory is larger, there is none. */
    uint64_t memory;
    uint32_t user; /* its number, and of its group; needs root, and `folder` must be that user's. 0: stay who we are */
    int start_socket;             /* sendmsg() is allowed on this number only, to hand the listener over; -1: on none */
    bool whole_process;           /* the list of system calls for all threads; else for the one that calls */
    const tl_plant_access *plant; /* what its driver of a plant needs; NULL: it reads no plant */
    bool names;                   /* and it looks up names of hosts */
    const uint16_t *ports;        /* that TCP may connect to, with Landlock 4 and later; without: any */
    size_t port_count;
    bool keeps_files;    /* see above, */
    bool may_answer;     /* and this */
    bool lives_on;       /* who reaches for another process is refused that, as all else; else his process is ended */
    int landlock;        /* private: its version that is in use; 0: none */
    int landlock_newest; /* for tests, to play an older kernel: at most this version; -1: none; 0: what the kernel has */
} tl_confine_settings;

/* What holds, or what the kernel offers. */
typedef struct tl_confine_facts {
    bool filter;   /* of system calls */
    bool notifies; /* refused calls can be named (refusal.h) */
    int landlock;  /* its version ("ABI"); 0: none */
    bool memory;   /* there is a limit to it */
    bool user;     /* a user of its own: files of other users are out of reach without Landlock too */
} tl_confine_facts;

/* What this kernel offers, without confining. `user`: whether this process could change its user. */
void tl_confine_probe(tl_confine_facts *facts);

/* Bytes that a process with FMUs may take by default: half of the machine's memory, at most TL_CONFINE_MEMORY_MIB. 0: unknown. */
uint64_t tl_confine_fair_memory(void);

/* Confines. `listener` may be NULL: then refused calls answer EPERM and nobody is told. Else it is a descriptor for tl_refusal_take() of
 * another process, or -1; a refused call waits until somebody answers, so it must be handed over and closed here at once.
 * TL_BAD_USAGE: the folder cannot be entered. TL_TRY_AGAIN: something that the kernel offers failed; the process is half confined, and must
 * end. TL_INTERRUPTED: whoever was to be told of our end by PR_SET_PDEATHSIG has ended. */
tl_status tl_confine(const tl_confine_settings *settings, tl_confine_facts *facts, int *listener, tl_error *error);

/* A sentence of what is not held, for people; "" where all is. */
void tl_confine_describe(const tl_confine_facts *facts, char text[TL_CONFINE_TEXT]);

/* ---- The list of system calls that a confined process may make, and its loading into the kernel.
 *
 * Purpose: what is not on the list is refused: EPERM, and told to a listener if there is one (refusal.h). The list has one line
 *          for a group and its reason; behind it are the calls of which the arguments decide.
 * Machine: that of this program; a call of another one (32-bit or x32 calls on x86-64, AArch32) ends the process.
 * Thread:  any.
 */

/* Whether the kernel has filters; whether it can tell of refused calls. */
bool tl_filter_is_offered(void);
bool tl_filter_can_notify(void);

/* Loads. `listener` may be NULL: nobody is to be told; else a descriptor, or -1 where the kernel cannot, or where somebody else is told
 * already. TL_TRY_AGAIN: it could not be loaded. */
tl_status tl_filter_load(const tl_confine_settings *settings, int *listener, tl_error *error);

/* ---- Landlock: which files a process may read, below which folder it may write, and to which TCP ports it may connect.
 *
 * Purpose: whatever the user who started us could open, an FMU opens only what programs are made of, what the settings add, and its own folder.
 * Version: the kernel's ("ABI"), 1 … 7, is used as far as it goes. Renaming between folders from 2 on, emptying from 3 (before, the
 *          filter refuses what Landlock does not see), TCP ports from 4 (none is taken, and only `ports` are connected to), commands to devices from 5, abstract sockets and signals from 6.
 * Itself:  of /proc/self single files are read. Their places, a dozen descriptors, stay open for the rest of the process: rules depend on them.
 * Unseen:  Landlock does not hold looking (stat, access, readlink), changing the folder, and modes, owners, times and attributes; the filter
 *          refuses all changes of these.
 * Thread:  holds for the thread that calls and those that it starts.
 */

/* The version from which on a file cannot be emptied by who may not write it. */
enum { TL_LANDLOCK_TRUNCATION = 3 };

/* 0: the kernel has none, or it is switched off. */
int tl_landlock_version(void);

/* The places and ports of the settings, by `settings->landlock` > 0: the kernel's version, or an older one. Places that are missing are passed over. Needs
 * PR_SET_NO_NEW_PRIVS. TL_TRY_AGAIN: it failed. */
tl_status tl_landlock_restrict(const tl_confine_settings *settings, tl_error *error);

/* ---- Limits: memory and the length of a file as the settings say, no message queue, no core, no stack that grows without end, and as below.
 *
 * Thread:  they hold for the whole process.
 */

/* More descriptors than are open when it confines itself, and timers and signals under way, at most. */
enum { TL_PROCESS_LIMITS_DESCRIPTORS = 256, TL_PROCESS_LIMITS_SIGNALS = 256 };

/* At least so much of a resource (RLIMIT_…) from now on, also when capabilities are given up; as much of it as may be had, if that is less. */
void tl_process_limits_permit(int resource, rlim_t least);

#endif
