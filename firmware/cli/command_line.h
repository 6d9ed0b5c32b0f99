/* Command line: finds the verb, reads its options, and runs the verb.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_CLI_COMMAND_LINE_H
#define TL_FIRMWARE_CLI_COMMAND_LINE_H

/* Runs the command line, with the arguments of main(): argv[1] is the verb. The verbs of
 * twinlock-serve replace this process by that program. Returns the exit code of the process. */
int tl_command_line_run(int argc, char **argv);

#endif
