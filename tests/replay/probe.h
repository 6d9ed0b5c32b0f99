/* Shared function of the probes: small programs through which a Python test calls one module.
 *
 * Purpose: reports failures. The top of each NAME_probe.c describes its arguments and its output.
 */
#ifndef TL_TESTS_REPLAY_PROBE_H
#define TL_TESTS_REPLAY_PROBE_H

/* Prints the program's name and the text on stderr. Returns EXIT_FAILURE. */
int tl_probe_fail(const char *text);

#endif
