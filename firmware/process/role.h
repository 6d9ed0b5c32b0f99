/* Roles: the program starts itself again as a process that has one task (its role) and only the
 * resources for this task.
 *
 * Purpose: a child with a role inherits no memory, no handlers, no terminal, and only the given
 *          descriptors. The program file is opened once at the start, and all children execute this
 *          open file. So an upgrade of the file does not affect a running system. The kernel kills
 *          a child when its parent ends.
 * Title:   argv[0] is "twinlock: TITLE", as ps shows it.
 * Without exec: an emulator of another processor (qemu-user) cannot execute a descriptor. Without
 *               /proc there is no descriptor. Then the forked child does not execute the program:
 *               it calls `fallback`, and `is_forked` is true.
 * Memory:  the caller owns both structs. The settings are used only during tl_role_start().
 * Errors:  TL_TRY_AGAIN if processes, memory or descriptors are missing.
 * Thread:  the main thread starts, polls and kills children, because the kernel kills a child when
 *          the thread that started it ends.
 */
#ifndef TL_FIRMWARE_PROCESS_ROLE_H
#define TL_FIRMWARE_PROCESS_ROLE_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "master/base/status.h"

/* Maximum numbers: descriptors of a child, bytes of a title, variables that are added. */
enum { TL_ROLE_DESCRIPTORS = 24, TL_ROLE_TITLE = 96, TL_ROLE_VARIABLES = 8 };

typedef struct tl_role_settings {
    const char *title;                    /* for example "twin [motor]"; truncated to TL_ROLE_TITLE bytes */
    int descriptors[TL_ROLE_DESCRIPTORS]; /* entry i becomes descriptor i (0 … 23) of the child; −1: closed there */
    const char *const *variables;         /* "TMPDIR=…": added to the environment; replaces a variable of that name */
    size_t variable_count;                /* at most TL_ROLE_VARIABLES */
    const char *const *inherits; /* names of inherited variables, ended by NULL; "LC_*": all that begin so. NULL: all */
    int (*fallback)(const char *title, void *context); /* runs the role, returns the exit code; NULL: none */
    void *context;                                     /* of `fallback` */
} tl_role_settings;

/* A child. Zeroed: none. */
typedef struct tl_role {
    pid_t pid;      /* 0: none, or it has ended and was reaped */
    bool is_forked; /* the program could not be executed: the child has a copy of our memory */
    bool has_ended; /* `signal` and `code` are valid */
    int signal;     /* signal that killed the child; 0: the child exited */
    int code;       /* exit code; -1: unknown, because other code has reaped the child */
} tl_role;

/* ---- at the start of every process ---- */

/* Call it first in main(). Returns the title of the role, which is part of `argv`. If the process
 * has no role, opens the program file and returns NULL. */
const char *tl_role_begin(char *const *argv);

/* In a process with a role: changes its title. The new title is truncated to the length of the
 * original one, which can be padded with spaces to reserve room. */
void tl_role_entitle(const char *title);

/* Call it in a process with a role before it starts children: opens the program file that
 * tl_role_start() executes. */
void tl_role_open_program(void);

/* In a process without a role, after all its children have ended: executes the program again with
 * the same command line. Returns only if that fails. */
void tl_role_restart(void);

/* In a process with a role: requests that the kernel kills this process when its parent ends. Call
 * it again after a change of the user ID, which cancels the request. Ends this process if the
 * parent has already ended. */
void tl_role_enter(void);

/* ---- in the parent ---- */

/* Starts a child, and waits until the child executes the program or `fallback`. Sets *role; zeroed
 * on failure. */
tl_status tl_role_start(const tl_role_settings *settings, tl_role *role, tl_error *error);

/* Polls the child without blocking. Returns true if the child has ended and was reaped. */
bool tl_role_watch(tl_role *role);

/* Kills the child if it has not ended, and waits for its end. A zeroed role is allowed. */
void tl_role_kill(tl_role *role);

#endif
