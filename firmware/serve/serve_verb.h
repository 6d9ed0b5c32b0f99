/* The verbs of the program twinlock-serve: `twinlock serve` and `twinlock token` (makes, lists and revokes tokens).
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_SERVE_SERVE_VERB_H
#define TL_FIRMWARE_SERVE_SERVE_VERB_H

/* From its options to its end; argv[0] is the verb, or the program. The exit code of the process. */
int tl_serve_verb_run(int argc, char **argv);
int tl_token_verb_run(int argc, char **argv);

#endif
