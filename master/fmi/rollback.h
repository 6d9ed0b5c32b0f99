/* Rollback methods: how a component is restored to an earlier instant.
 *
 * Source: FMI 2.0.4, section 2.1.8 (fmi2GetFMUstate) for the FMU's own states. The other methods
 *         are ours, for FMUs whose states are missing or not exact.
 */
#ifndef TL_MASTER_FMI_ROLLBACK_H
#define TL_MASTER_FMI_ROLLBACK_H

typedef enum tl_rollback {
    TL_ROLLBACK_NONE,   /* no rollback: nothing is synchronised, or no method works */
    TL_ROLLBACK_AUTO,   /* a method below that is exact: the rollback proof chooses it (master/sync/proof.h) */
    TL_ROLLBACK_STATE,  /* fmi2GetFMUstate, fmi2SetFMUstate */
    TL_ROLLBACK_MEMORY, /* all memory of the FMU is copied */
    TL_ROLLBACK_REPLAY, /* the FMU is reset and given its inputs again */
    TL_ROLLBACKS
} tl_rollback;

/* Rollback by replay: default limit, in steps from the start values to the restored instant. */
enum { TL_REPLAY_STEPS = 1000 };

#endif
