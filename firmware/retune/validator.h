/* The validator: reads a candidate, and says what is wrong with it, or what the change to it is.
 *
 * Purpose: the process in which a configuration of a stranger is parsed. It has no file, no socket, no FMU: two texts in, a verdict out.
 * Thread:  the main thread of its process.
 */
#ifndef TL_FIRMWARE_RETUNE_VALIDATOR_H
#define TL_FIRMWARE_RETUNE_VALIDATOR_H

/* By how much the right to retune may widen what is called in lock, against the version that was commissioned last. */
enum { TL_VALIDATOR_WIDEST = 3 };

/* Titles begin with it. */
#define TL_VALIDATOR "validator"

/* What main() becomes in it (errand.h); its answer is a tl_verdict. */
int tl_validator_role_run(void);

#endif
