/* The trial: a candidate's FMUs are loaded, started, run a few steps and set back, as `check` does.
 *
 * Purpose: what cannot run is found before the plant's twin is ended for it. The FMUs are in a process of their own below this one
 *          (twin_child.h), confined as the live twin's are.
 * Says:    what is wrong and what it costs, as lines; its exit code is that of a check; its answer is a tl_trial_answer (trial_answer.h).
 * Thread:  the main thread of its process.
 */
#ifndef TL_FIRMWARE_RETUNE_TRIAL_H
#define TL_FIRMWARE_RETUNE_TRIAL_H

#include "firmware/twin/twin_role.h"

/* Titles begin with these. */
#define TL_TRIAL "trial"
#define TL_TRIAL_OF_STATES "trial of states"

/* What main() becomes in it (errand.h). `tasks`: as in main(). */
int tl_trial_role_run(const tl_twin_role_tasks *tasks);

/* Finds out instead whether another process can use the states that the FMUs save (read_back.h). Says nothing; its answer is a tl_trial_states. */
int tl_trial_of_states_role_run(const tl_twin_role_tasks *tasks);

#endif
