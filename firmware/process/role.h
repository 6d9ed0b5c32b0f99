/* Roles: the program starts itself again, as a process that does one thing and holds nothing else.
 *
 * Purpose: a child with a role inherits no memory, no descriptor but those it is given, no handler and no terminal. It is executed by a
 *          descriptor that was opened at the start, so that an upgrade of the file changes nothing under way. It dies with its parent.
 * Title:   argv[0] is "twinlock: TITLE", as ps shows it.
 * Without exec: an emulator of a foreign machine (qemu-user) cannot execute a descriptor, and without /proc there is none. Then the child
 *          goes on in the forked image, by `fallback`; `is_forked` tells so.
 * Errors:  TL_TRY_AGAIN: processes, memory or descriptors are missing.
 * Thread:  the main thread starts, watches and kills: if the thread that has started a child ends, the child is killed.
 */
#ifndef TL_FIRMWARE_PROCESS_ROLE_H
#define TL_FIRMWARE_PROCESS_ROLE_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "master/base/status.h"

enum { TL_ROLE_DESCRIPTORS = 24, TL_ROLE_TITLE = 96, TL_ROLE_VARIABLES = 8 };

typedef struct tl_role_settings {
    const char *title;                    /* "twin [motor]"; cut to TL_ROLE_TITLE bytes */
    int descriptors[TL_ROLE_DESCRIPTORS]; /* ours, which become 0 … 23 in the child; −1: closed there */
    const char *const *variables; /* "TMPDIR=…", which are added to the environment or replace one of that name */
    size_t variable_count;        /* at most TL_ROLE_VARIABLES */
    const char *const *inherits;  /* names of our variables that it gets; "LC_*": all that begin so. NULL: all */
    int (*fallback)(const char *title, void *context); /* what main() does for such a title: the child's exit code */
    void *context;                                     /* of `fallback` */
} tl_role_settings;

/* A child. A zeroed one is none. */
typedef struct tl_role {
    pid_t pid;      /* 0: none, or it has ended and was reaped */
    bool is_forked; /* it has a copy of our memory: it could not be executed */
    bool has_ended; /* and how: */
    int signal;     /* that killed it; 0: */
    int code;       /* its exit code; -1: unknown, somebody else has reaped it */
} tl_role;

/* ---- at the start of every process ---- */

/* First of all in main(). The title of the role it was started as, which lives as long as argv; NULL: an ordinary start. */
const char *tl_role_begin(char *const *argv);

/* In a process with a role: another title from now on, cut to as many bytes as it was started with: spaces at its end are room. */
void tl_role_entitle(const char *title);

/* In a process with a role that starts others itself. */
void tl_role_open_program(void);

/* In a process without a role, once all its children have ended: it becomes the program that it was started as, with the same command line, anew. Returns
 * if that cannot be. */
void tl_role_restart(void);

/* In a process with a role: it is killed when its parent ends, now and from now on. Again after the user has changed, which undoes it. Ends the
 * process if the parent is gone. */
void tl_role_enter(void);

/* ---- in the parent ---- */

tl_status tl_role_start(const tl_role_settings *settings, tl_role *role, tl_error *error);

/* Looks without waiting. True: it has ended, and is reaped. */
bool tl_role_watch(tl_role *role);

/* Kills it if it has not ended, and waits until it is gone. None is allowed. */
void tl_role_kill(tl_role *role);

#endif
