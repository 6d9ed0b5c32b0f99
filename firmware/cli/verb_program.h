/* Verbs that are programs of their own: what the network reaches, and its client.
 *
 * Purpose: this program loads FMUs, and so it links no TLS. `twinlock serve` is `twinlock-serve`, found beside it.
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_CLI_VERB_PROGRAM_H
#define TL_FIRMWARE_CLI_VERB_PROGRAM_H

typedef struct tl_verb_program {
    const char *name;
    const char *program; /* "twinlock-serve" */
    const char *purpose; /* half a line */
} tl_verb_program;

enum { TL_VERB_PROGRAMS = 2 };
extern const tl_verb_program tl_verb_programs[TL_VERB_PROGRAMS];

/* NULL if there is none. */
const tl_verb_program *tl_verb_program_find(const char *name);

/* Becomes it; argv[0] is the verb. Returns only if that fails, which it says: the exit code of the process. */
int tl_verb_program_run(const tl_verb_program *verb, int argc, char **argv);

#endif
