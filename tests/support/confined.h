/* A forked child that confines itself and then does something: what became of it, and what it was refused.
 *
 * Purpose: tests of confinement by real system calls. The parent takes refused calls meanwhile, as the program does.
 * Thread:  one; the test program has no other, or the child has not either.
 */
#ifndef TL_TESTS_SUPPORT_CONFINED_H
#define TL_TESTS_SUPPORT_CONFINED_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "firmware/process/confine.h"
#include "firmware/process/refusal.h"

enum { TL_CONFINED_REFUSALS = 256 };

/* Done in the child; true: all went as expected. What it says, it writes to descriptor 2. */
typedef bool tl_confined_body(void *context);

typedef struct tl_confined {
    bool succeeded;
    int signal; /* that ended it; 0: none */
    tl_confine_facts facts;
    tl_refusal refusals[TL_CONFINED_REFUSALS];
    size_t refusal_count;
} tl_confined;

/* `settings->start_socket` is set here. Stays confined to the child. Kills it after 60 s. */
void tl_confined_run(tl_confine_settings settings, tl_confined_body *body, void *context, tl_confined *confined);

/* Whether a call of that name was refused. */
bool tl_confined_was_refused(const tl_confined *confined, const char *call);

/* In the child: whether a socket of that family and kind is refused, as it is to be. */
bool tl_confined_has_no_socket(int family, int kind, int protocol);

/* In the child: false, with a line on descriptor 2, unless `holds`. */
bool tl_confined_expect(bool holds, const char *what, int line);
#define TL_EXPECT(condition) tl_confined_expect((condition), #condition, __LINE__)

#endif
