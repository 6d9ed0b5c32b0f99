/* Horizon trials: replays a recording with several prediction horizons T_P, for `check`.
 *
 * Purpose: measures what horizon_choice.h compares. Each trial is a replay in a process of its own.
 *          Its configuration has the proposed settings, one T_P, and released twins of the same
 *          duration R, an eighth of the recording.
 * Order:   T_P = T_D first, then 2, 5, 10, 20, 50 … steps and the configured T_P. The next one is
 *          not tried if the last trial took TL_HORIZON_LONGEST, if its steps exceeded the time
 *          budget, or if the recording has fewer than TL_HORIZON_PARTS horizons. The chosen T_P is
 *          tried again with the other value of "free_twin".
 * Not for: an event horizon, and twins without released twins (tl_released_state).
 * Thread:  one, as for twin_child.h.
 */
#ifndef TL_FIRMWARE_CLI_HORIZON_TRIALS_H
#define TL_FIRMWARE_CLI_HORIZON_TRIALS_H

#include "firmware/monitor/horizon_choice.h"
#include "firmware/twin/twin_child.h"

/* A trial replays at most this number of steps from the beginning of the recording. */
enum { TL_HORIZON_STEPS = 20000, TL_HORIZON_PARTS = 16 };
#define TL_HORIZON_LONGEST (20 * TL_SECOND)

typedef struct tl_horizon_trials_settings {
    const tl_twin_child_settings *child; /* of the configuration; its job names path, text and confinement */
    const char *recording;               /* path */
    int64_t run;                         /* of a database; 0: the last one */
    const char *patch;                   /* proposed settings, a JSON merge patch */
} tl_horizon_trials_settings;

/* Runs the trials and chooses. Failures of a trial are part of the result. Errors: TL_INTERRUPTED;
 * TL_TRY_AGAIN if memory is out. */
tl_status tl_horizon_trials_run(const tl_horizon_trials_settings *settings, tl_horizon_choice *choice, tl_error *error);

#endif
