/* Runs a function in a forked, confined child, and returns how the child ended and which system
 * calls were refused.
 *
 * Purpose: tests of the confinement by real system calls. Meanwhile the parent answers refused
 *          calls, as the program does.
 * Thread:  the only one of the test program, because fork() copies no other thread.
 */
#ifndef TL_TESTS_SUPPORT_CONFINED_H
#define TL_TESTS_SUPPORT_CONFINED_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "firmware/process/confine.h"
#include "firmware/process/refusal.h"

enum { TL_CONFINED_REFUSALS = 256 };

/* Runs in the child, and writes messages to descriptor 2. Returns true if all was as expected. */
typedef bool tl_confined_body(void *context);

typedef struct tl_confined {
    bool succeeded; /* the body returned true */
    int signal;     /* that ended the child; 0: none */
    tl_confine_facts facts;
    tl_refusal refusals[TL_CONFINED_REFUSALS];
    size_t refusal_count;
} tl_confined;

/* Runs `body` in a confined child; this process stays unconfined. Sets settings.start_socket. Kills
 * the child after 60 s. */
void tl_confined_run(tl_confine_settings settings, tl_confined_body *body, void *context, tl_confined *confined);

/* Returns true if a system call of that name was refused. */
bool tl_confined_was_refused(const tl_confined *confined, const char *call);

/* In the child: returns true if such a socket is refused with EPERM, as expected. */
bool tl_confined_has_no_socket(int family, int kind, int protocol);

/* In the child: returns `holds`. If it is false, writes a line to descriptor 2. */
bool tl_confined_expect(bool holds, const char *what, int line);
#define TL_EXPECT(condition) tl_confined_expect((condition), #condition, __LINE__)

#endif
