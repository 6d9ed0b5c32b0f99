/* Attacks of a hostile FMU: one function per attack, one file per kind of attack.
 *
 * Purpose: tests of the confinement of FMUs. tests/support/attacks.py has the table of attacks.
 * Use:     resources/attack.txt of the FMU has one line per attack, with tabs between the fields:
 *          WHERE, LABEL, NAME and arguments. NAME is the attack's function. WHERE is the argument
 *          of hostile_before() at which the attack runs. "fmi2DoStep:50": at the fiftieth call.
 *          "fmi2DoStep@thread": in a thread that is started there.
 * Result:  a line on stderr: "attack LABEL: succeeded", or the name of the error. This is only the
 *          attacker's report; the test checks whether the attack had an effect.
 * Bounds:  arguments limit everything that grows, and processes and threads that remain end on
 *          their own. Both hold also without confinement.
 */
#ifndef TL_TESTS_FMU_HOSTILE_ATTACK_ATTACK_H
#define TL_TESTS_FMU_HOSTILE_ATTACK_ATTACK_H

#include <sys/types.h>

enum { ATTACK_WORDS = 8, ATTACK_PATH = 4200 };

/* Carries out an attack. Missing arguments are "". Returns 0 if it has succeeded, else the
 * errno. */
typedef int attack_function(char *const words[]);

typedef struct attack {
    const char *name;
    attack_function *run;
} attack;

/* Each table ends with an entry whose name is NULL. */
extern const attack attack_network[];
extern const attack attack_files[];
extern const attack attack_processes[];
extern const attack attack_programs[];
extern const attack attack_bombs[];
extern const attack attack_inside[];
extern const attack attack_kernel[];

/* Returns errno if `result`, that of a call, is negative; else 0. */
int attack_errno(long result);

/* Opens the file at `path` with `flags`, and writes `text` to it (NULL: nothing). Returns 0 or the
 * errno. */
int attack_open(const char *path, int flags, const char *text);

/* Writes the path of resources/attack.txt, found from the path of this library. */
void attack_orders_path(char path[ATTACK_PATH]);

/* Returns the process ID that `word` names: a number, or "parent". */
pid_t attack_pid(const char *word);

/* Waits, so that other processes can react. */
void attack_pause(unsigned milliseconds);

#endif
