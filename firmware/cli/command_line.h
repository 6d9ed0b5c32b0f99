/* The command line: finds the verb, reads its options, and runs it.
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_CLI_COMMAND_LINE_H
#define TL_FIRMWARE_CLI_COMMAND_LINE_H

/* As main() gets them: argv[1] is the verb. The exit code of the process. */
int tl_command_line_run(int argc, char **argv);

/* In a process that this program has started with a role (role.h): what its title says. The exit code. */
int tl_command_line_be(const char *title);

#endif
