/* What a process is to be confined to: for confine.h, and for its parts (filter.h, landlock.h). */
#ifndef TL_FIRMWARE_PROCESS_CONFINE_SETTINGS_H
#define TL_FIRMWARE_PROCESS_CONFINE_SETTINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/io/plant_access.h"

/* All texts live during the call only. */
typedef struct tl_confine_settings {
    const char *folder;      /* absolute: becomes the current folder and TMPDIR; writing and making is allowed below it.
                                 NULL: the current folder stays, and nothing is added */
    uint64_t file_bytes;     /* no file grows longer; 0: no such limit */
    const char *const *read; /* further files and folders that may be read; those that are missing are passed over */
    size_t read_count;
    const char *const *write; /* further ones that may be written: a database's folder, devices */
    size_t write_count;
    uint64_t
        memory; /* bytes that the process may make its own, stacks of threads included; 0: no limit. Address space that is
                                 only reserved does not count. With a sanitizer, whose own memory is larger, there is none */
    uint32_t user; /* its number, and of its group; needs root, and `folder` must be that user's. 0: stay who we are */
    int start_socket;             /* sendmsg() is allowed on this number only, to hand the listener over; -1: on none */
    bool whole_process;           /* the list of system calls for all threads; else for the one that calls */
    const tl_plant_access *plant; /* what its driver of a plant needs; NULL: it reads no plant */
    bool names;                   /* and it looks up names of hosts */
    const uint16_t *ports;        /* that TCP may connect to, with Landlock 4 and later; without: any */
    size_t port_count;
    bool keeps_files; /* see above, */
    bool may_answer;  /* and this */
    bool
        forks; /* it may make copies of itself, which are its parent's children; it signals nobody then, not even itself */
    bool lives_on;       /* who reaches for another process is refused that, as all else; else his process is ended */
    int landlock;        /* private: its version that is in use; 0: none */
    int landlock_newest; /* for tests, to play an older kernel: at most this version; -1: none; 0: what the kernel has */
} tl_confine_settings;

#endif
