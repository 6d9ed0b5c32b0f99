/* Tests of a twin for `check`: verification after many steps, and, in separate processes, a second
 * twin beside it and other rollback methods.
 *
 * Thread:  the FMU thread.
 * Errors:  findings are results; an error means that the test could not be done.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_TRIAL_H
#define TL_FIRMWARE_TWIN_TWIN_TRIAL_H

#include <stdint.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_step.h"

/* ---- Late verification: checks if the rollback of the FMUs is exact after many steps and with
 * moving inputs.
 *
 * Purpose: the proof before the first step tests FMUs at one point only. Some missing parts of
 *          their state have no effect there. A check has time for more steps. It moves the adjusted
 *          variables up and down, or on and off, and verifies the rollback (tl_twin_verify_until())
 *          after as many steps as possible.
 * Bounds:  an FMU may fail, or lose a part of its state, only at values that a search reaches late.
 *          So after these steps, candidates (twin_candidate.h) test each Real variable: one step of
 *          the search up and down, and both bounds. On a side without a bound they test 4, 16 and
 *          64 steps of the search. Then all candidates are repeated in reverse order. The results
 *          must be the same, to the bit.
 * Limits:  of the steps: TL_FAR_STEPS, TL_FAR_LONGEST (0.5 s), the stop time of the FMUs, and
 *          duration_s. Then at most 16 candidates of T_P macro steps per variable, repetitions
 *          included; no further value is tested after another TL_FAR_LONGEST.
 * Not for: a twin that adjusts nothing, has an event horizon, or has verification off. Then the
 *          test makes no step.
 * Thread:  the FMU thread. Afterwards the twin can only be destroyed.
 */

enum { TL_FAR_STEPS = 1000 };

#define TL_FAR_LONGEST (TL_SECOND / 2)

typedef struct tl_late_verification {
    int64_t first;                 /* first tick of the test */
    int64_t steps;                 /* steps made; the test ends early if a finding is not repaired or an FMU fails */
    uint64_t times;                /* number of verifications so far: rollback and comparison */
    tl_twin_verify_report outcome; /* the last finding */
    char bounds[TL_MAX_ADJUST][TL_ERROR_TEXT]; /* of each variable: how its first failed candidate failed; "": none */
    tl_status status; /* TL_FMU_FAILED: an FMU failed with the moved inputs; this is no finding about its rollback */
    tl_error error;   /* of `status` */
} tl_late_verification;

/* Runs the test. `tick`: next tick of the twin, which has begun and has not taken a reading. */
void tl_late_verification_run(const tl_assembly *assembly, int64_t tick, tl_late_verification *look);

/* ---- Comparison of two twins of one configuration in one process: do the same inputs give the
 * same values, or does one disturb the other?
 *
 * Purpose: for `check`, in a process of its own. The first twin computes some steps. Then the
 *          second one is built beside it and computes the same steps. Its FMUs have their own
 *          copies of the libraries, as every component has (own_copies.h). Every value of every FMU
 *          must be equal, bit by bit.
 * Inputs:  the initial values of the plant's signals. The adjusted variables move as in the late
 *          verification; with an event horizon they are constant.
 * Account: in memory that another process reads, because this one may crash, hang or write false
 *          values.
 * Memory:  the values of the first twin, during the comparison.
 */

enum { TL_PAIR_STEPS = 100, TL_PAIR_LEAST = 10, TL_PAIR_NAME = TL_ASSEMBLY_NAME };

/* The first twin makes at most TL_PAIR_STEPS steps. After this time (0.25 s) it stops, but not
 * before TL_PAIR_LEAST steps. The second twin makes as many steps as the first one. */
#define TL_PAIR_LONGEST (TL_SECOND / 4)

typedef struct tl_twin_pair_account {
    uint32_t steps;                /* steps of the first twin; 0: it cannot step with the plant's initial values */
    uint64_t marks[TL_PAIR_STEPS]; /* of each step of the first twin: hash of all values after it */
    uint32_t has_second;           /* 1: the second twin was started */
    char component[TL_PAIR_NAME];  /* first component that differs or fails; "": none */
} tl_twin_pair_account;

/* Compares the twins. `first` was built; `second` has only its configuration and is built here.
 * `alone`: only the first twin runs. error->text describes their difference; "": they are equal.
 * Errors: TL_TRY_AGAIN. Any other, with a text or a logged cause: the second twin cannot be built,
 *         or cannot step. */
tl_status tl_twin_pair_compare(const tl_assembly *first, tl_assembly *second, bool alone, tl_twin_pair_account *account,
                               tl_error *error);

/* ---- Rollback methods of the components and their cost, as an FMU process reports them to its
 * parent.
 *
 * Purpose: for `check`. Stores the methods of a twin that was checked. To test other methods
 *          (check_trials.h), a separate process does the same proof and late verification as a
 *          check. Then it measures the time of a save and of a restore, but not for replay.
 * Account: in memory that another process reads, because this one may crash, hang or write false
 *          values.
 * Thread:  the FMU thread. Afterwards the twin can only be destroyed.
 */

typedef struct tl_component_method {
    uint32_t rollback; /* tl_rollback in use */
    uint32_t
        is_given_again; /* 1: after a restore its inputs are set again, because its saved state does not contain them */
    uint32_t is_measured; /* 1: the values below are measured, by a trial; 0: they are 0 */
    int64_t save;         /* ns, median */
    int64_t restore;      /* ns, median */
    uint64_t bytes;       /* size of a state; 0: unknown */
} tl_component_method;

typedef struct tl_component_methods {
    uint32_t rollback_inexact;        /* 1: the rollback of a component is not exact */
    char component[TL_ASSEMBLY_NAME]; /* that component, or the one whose failure ended a trial; "": none or unknown */
    tl_component_method of[TL_RECORDER_COMPONENTS];
} tl_component_methods;

/* Stores the methods of a twin that has begun. `of` stays unchanged if no rollback was tested. */
void tl_component_methods_note(const tl_assembly *assembly, tl_component_methods *ways);

/* Builds the assembly and tests its rollback. The caller has opened the assembly and has set the
 * methods to test in its configuration. TL_OK and empty error->text: all rollbacks are exact. TL_OK
 * with a text: the rollback of ways->component is not exact; the text describes how. Logs only the
 * output of FMUs. Errors: the twin cannot be built or begin; ways->component is set if known. */
tl_status tl_component_methods_try(tl_assembly *assembly, tl_component_methods *ways, tl_error *error);

#endif
