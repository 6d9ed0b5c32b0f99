/* What the attacker does: one function for each attack, in a file of its own for each kind.
 *
 * Purpose: the set of hostile FMUs that the confinement of FMUs is held against (tests/support/attacks.py, which has the table).
 * Use:     resources/attack.txt of the FMU says what to do, a line for each attack: WHERE, LABEL, NAME and arguments, with tabs between. WHERE is
 *          what hostile_before() is called with; "fmi2DoStep:50" is the fiftieth call, "fmi2DoStep@thread" a thread that is begun there.
 * Result:  a line "attack LABEL: succeeded", or the name of the error, on stderr. That is what the attacker believes; whether it reached
 *          anything, the test sees at the other end.
 * Bounds:  whatever grows has a bound in its arguments, and what is left behind ends by itself: nothing depends on the confinement.
 */
#ifndef TL_TESTS_FMU_HOSTILE_ATTACK_ATTACK_H
#define TL_TESTS_FMU_HOSTILE_ATTACK_ATTACK_H

#include <sys/types.h>

enum { ATTACK_WORDS = 8, ATTACK_PATH = 4200 };

/* Takes its arguments, which are "" if they are not given. Returns 0 if it has succeeded, else the error's number. */
typedef int attack_function(char *const words[]);

typedef struct attack {
    const char *name;
    attack_function *run;
} attack;

/* Each ends with a name that is NULL. */
extern const attack attack_network[];
extern const attack attack_files[];
extern const attack attack_processes[];
extern const attack attack_programs[];
extern const attack attack_bombs[];
extern const attack attack_inside[];
extern const attack attack_kernel[];

/* 0, or errno if the result of a call is negative. */
int attack_errno(long result);

/* What a file at `path` gives for `flags` (of open()) after `text` is written to it, if that is not NULL. */
int attack_open(const char *path, int flags, const char *text);

/* Where resources/attack.txt is: two folders above the library. */
void attack_orders_path(char path[ATTACK_PATH]);

/* A process: its number, or "parent". */
pid_t attack_pid(const char *word);

/* Waits for a short time, so that others may take notice. */
void attack_pause(unsigned milliseconds);

#endif
