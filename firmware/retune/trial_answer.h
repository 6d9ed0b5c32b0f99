/* The answer of a trial: what has to be known of a candidate to make room for its twin, and what that will take.
 *
 * Trust:   made beside FMUs of a stranger: it lies in memory of a fixed size and is believed nothing, as a verdict is (verdict.h). The worst that a lie can
 *          do is to have a shadow begun that has no room or no time, which ends by itself.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_RETUNE_TRIAL_ANSWER_H
#define TL_FIRMWARE_RETUNE_TRIAL_ANSWER_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/simtime.h"

typedef struct tl_trial_answer {
    uint32_t is_there;                  /* 1: all of this is; the last to be written */
    uint32_t match, adjust, components; /* components: without the plant */
    uint32_t unconfined;                /* 1: FMUs may do what the user can */
    uint64_t fmu_bytes;                 /* of the FMU files */
    uint32_t signals;                   /* of the plant, second look-ups among them */
    uint64_t memory;                    /* bytes that its twin will take, FMUs and all */
    tl_time step;                       /* ns: T_S, */
    tl_time budget;                     /* of a step's time by the configuration, */
    tl_time least;                      /* of a free step as measured, 0: not known; */
    tl_time worst;                      /* of one with all its evaluations, 0: not known, or nothing is searched */
} tl_trial_answer;

enum { TL_TRIAL_WHY = 400 };

/* Of a trial of states. */
typedef struct tl_trial_states {
    uint32_t is_there;      /* as above */
    char why[TL_TRIAL_WHY]; /* why another process cannot use them; "": nothing was found against them */
} tl_trial_states;

/* False: there is none. */
bool tl_trial_states_take(const tl_trial_states *from, char why[TL_TRIAL_WHY]);

/* False: there is none, or it cannot be one. */
bool tl_trial_answer_take(const tl_trial_answer *from, tl_trial_answer *answer);

#endif
