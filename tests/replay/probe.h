/* What the probes share: programs with which a test of another language reaches one part of ours.
 *
 * Purpose: each NAME_probe.c says at its top how it is called and what it prints; only what goes wrong is said here.
 */
#ifndef TL_TESTS_REPLAY_PROBE_H
#define TL_TESTS_REPLAY_PROBE_H

/* Says it on stderr after the program's name. Returns the exit code of a failure. */
int tl_probe_fail(const char *text);

#endif
