/* How a component is led back to an earlier instant: by which of the ways that there are.
 *
 * Source: FMI 2.0.4, section 2.1.8 (fmi2GetFMUstate) for the FMU's own; the others are ours, for FMUs that have none, or one that is not exact.
 */
#ifndef TL_MASTER_FMI_ROLLBACK_H
#define TL_MASTER_FMI_ROLLBACK_H

typedef enum tl_rollback {
    TL_ROLLBACK_NONE,   /* it is not: nothing is synchronised, or there is no way */
    TL_ROLLBACK_AUTO,   /* the first of those below that can be and is proved */
    TL_ROLLBACK_STATE,  /* fmi2GetFMUstate, fmi2SetFMUstate */
    TL_ROLLBACK_MEMORY, /* all memory of the FMU is copied */
    TL_ROLLBACK_REPLAY, /* it is reset, and given again what it was given */
    TL_ROLLBACKS
} tl_rollback;

/* By replay, unless it is said otherwise: steps from the beginning to where a component can be led back. */
enum { TL_REPLAY_STEPS = 1000 };

#endif
