/* The verbs of the command line; each parses its own arguments and returns the process exit code.
 *
 * Exit codes: 0 done, 2 wrong usage, 65 bad configuration or data, 69 plant I/O, 70 FMU, 75 try again.
 * Arguments:  argv[0] is the verb itself.
 */
#ifndef TL_FIRMWARE_VERBS_VERBS_H
#define TL_FIRMWARE_VERBS_VERBS_H

int tl_verb_check(int argc, char **argv);
int tl_verb_plant(int argc, char **argv);
int tl_verb_replay(int argc, char **argv);
int tl_verb_run(int argc, char **argv);
int tl_verb_show(int argc, char **argv);

#endif
