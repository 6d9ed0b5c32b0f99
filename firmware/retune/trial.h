/* The trial of a changed configuration: its FMUs run in a process of their own, which answers with a verdict.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_RETUNE_TRIAL_H
#define TL_FIRMWARE_RETUNE_TRIAL_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/monitor/lock_tally.h"
#include "firmware/retune/control.h"
#include "firmware/twin/twin_role.h"
#include "master/base/simtime.h"
#include "master/plan/tuning.h"

/* ---- What a twin costs, as a check finds it out: told by the process of the FMUs behind its page, to who has started the check.
 *
 * Trust:   it comes from a process with FMUs; numbers are bounded by who reads them.
 * Thread:  pure functions.
 */

typedef struct tl_twin_cost {
    tl_time least;   /* ns of a free step; 0: not known */
    tl_time worst;   /* ns of a step that uses all its evaluations; 0: not known, or nothing is searched */
    uint64_t memory; /* bytes that it will have beside what the process has before it steps */
} tl_twin_cost;

/* The last line of a page. */
void tl_twin_cost_print(const tl_twin_cost *cost, FILE *page);

/* Takes it from the page's end, which is cut there. False: there is none, or no number could be one. */
bool tl_twin_cost_take(char *page, tl_twin_cost *cost);

/* ---- A verdict: what a validator found out about a candidate.
 *
 * Purpose: all that its asker learns of a text that it does not parse itself.
 * Trust:   made by a process that has read what a stranger sent. It lies in memory of a fixed size, has no pointers, and is believed nothing:
 *          tl_verdict_take() copies it, bounds its numbers and ends its texts. The worst that a lie can do is to call a candidate good that is not, or
 *          a change small that is not: the twin refuses a tuning that does not fit it, and all else is tried before it is activated.
 * Thread:  plain data.
 */

enum { TL_VERDICT_PROBLEMS = 32, TL_VERDICT_CHANGES = 32, TL_VERDICT_WIDENED = 128 };

/* Of a window: more than any configuration can have. */
#define TL_VERDICT_LONGEST (1000000000 * TL_SECOND)

typedef struct tl_verdict {
    uint32_t is_there; /* 1: all of this is; the last to be written */
    uint32_t is_valid; /* 1: the candidate can be read without a problem, and `kind` … `tuning` mean something */
    uint32_t kind;     /* tl_change_kind */
    uint32_t right;    /* tl_change_right */
    uint32_t
        problems; /* that were found; of one that is valid: values that its sender may lack the right to; the first ones are listed */
    uint32_t changes;           /* the same */
    uint32_t strokes;           /* that must have ended before its lock is judged (lock_judge.h); 0: steps, */
    tl_time window;             /* ns that those take */
    char name[TL_CONTROL_NAME]; /* of the plant, as the candidate has it */
    tl_control_problem problem[TL_VERDICT_PROBLEMS];
    tl_control_change change[TL_VERDICT_CHANGES];
    tl_tuning tuning; /* the candidate's */
    tl_lock_yardstick
        yardstick; /* of the version that a probation would return to, in the order of the candidate's outputs; zeroed: there is none */
    char widened[TL_VERDICT_WIDENED]; /* the first output that the candidate judges less strictly, and how; "": none */
} tl_verdict;

/* False: there is none, or it cannot be one. */
bool tl_verdict_take(const tl_verdict *from, tl_verdict *verdict);

/* ---- The answer of a trial: what has to be known of a candidate to make room for its twin, and what that will take.
 *
 * Trust:   made beside FMUs of a stranger: it lies in memory of a fixed size and is believed nothing, as a verdict is (trial.h). The worst that a lie can
 *          do is to have a shadow begun that has no room or no time, which ends by itself.
 * Thread:  plain data.
 */

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

/* ---- The trial: a candidate's FMUs are loaded, started, run a few steps and set back, as `check` does.
 *
 * Purpose: what cannot run is found before the plant's twin is ended for it. The FMUs are in a process of their own below this one
 *          (twin_child.h), confined as the live twin's are.
 * Says:    what is wrong and what it costs, as lines; its exit code is that of a check; its answer is a tl_trial_answer (trial.h).
 * Thread:  the main thread of its process.
 */

/* Titles begin with these. */
#define TL_TRIAL "trial"
#define TL_TRIAL_OF_STATES "trial of states"

/* What main() becomes in it (errand.h). `tasks`: as in main(). */
int tl_trial_role_run(const tl_twin_role_tasks *tasks);

/* Finds out instead whether another process can use the states that the FMUs save (read_back.h). Says nothing; its answer is a tl_trial_states. */
int tl_trial_of_states_role_run(const tl_twin_role_tasks *tasks);

#endif
