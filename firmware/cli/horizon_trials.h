/* Horizon trials: replays a recording with several prediction horizons T_P, for `check`.
 *
 * Purpose: measures what horizon_choice.h compares. Each trial is a replay in a separate process.
 *          The configuration of a trial has the proposed settings, one T_P, and released twins. A
 *          released twin runs for a duration R, the same in all trials: an eighth of the replayed
 *          time.
 * Order:   T_P = T_D first, then 2, 5, 10, 20, 50 … steps and the configured T_P, ascending. The
 *          trials end if the last one failed, took more than TL_HORIZON_LONGEST, or exceeded the
 *          time budget of a step. They also end if the replayed time is below TL_HORIZON_PARTS
 *          times the next T_P. The last trial has the chosen T_P and the opposite of the configured
 *          `free_twin` (true: u rests at nominal while the free-running twin predicts well).
 * Not for: an event horizon, or a configuration that adjusts nothing. A trial fails if its twin has
 *          no released twins, for example because an FMU is rolled back by replay
 *          (tl_released_state).
 * Thread:  one, as for twin_child.h.
 */
#ifndef TL_FIRMWARE_CLI_HORIZON_TRIALS_H
#define TL_FIRMWARE_CLI_HORIZON_TRIALS_H

#include "firmware/monitor/horizon_choice.h"
#include "firmware/twin/twin_child.h"

/* A trial replays at most TL_HORIZON_STEPS steps from the beginning of the recording. */
enum { TL_HORIZON_STEPS = 20000, TL_HORIZON_PARTS = 16 };
#define TL_HORIZON_LONGEST (20 * TL_SECOND)

typedef struct tl_horizon_trials_settings {
    const tl_twin_child_settings *child; /* each trial copies it and replaces the text of the configuration */
    const char *recording;               /* path of the recording */
    int64_t run;                         /* run of a recording that is a database; 0: the last */
    const char *patch;                   /* proposed settings, a JSON merge patch */
} tl_horizon_trials_settings;

/* Runs the trials and chooses a T_P (horizon_choice.h). If trials are impossible, choice->note is
 * the reason. Failures of a trial are part of the result. Errors: TL_INTERRUPTED; TL_TRY_AGAIN if
 * memory is out; those of tl_recording_open(). */
tl_status tl_horizon_trials_run(const tl_horizon_trials_settings *settings, tl_horizon_choice *choice, tl_error *error);

#endif
