/* The command line: finds the verb, reads its options, and runs it.
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_CLI_COMMAND_LINE_H
#define TL_FIRMWARE_CLI_COMMAND_LINE_H

/* As main() gets them: argv[1] is the verb. The exit code of the process. */
int tl_command_line_run(int argc, char **argv);

#endif
