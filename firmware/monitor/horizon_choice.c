/* Choice of the horizon: see horizon_choice.h. */
#include "firmware/monitor/horizon_choice.h"

#include <math.h>

/* An age with fewer steps of released twins is not compared. */
enum { LEAST_STEPS = 20 };

/* In tolerances squared. Mean square errors below it are equally good: only rounding differs. */
static const double NEGLIGIBLE = 1e-12;

static bool is_usable(const tl_horizon_trial *trial, tl_time budget) {
    return trial->fault[0] == '\0' && trial->time <= budget;
}

/* NaN: not compared. An age below T_P is not, because the corrections have used its measurements.
 */
static double mean_square(const tl_horizon_trial *trial, size_t age) {
    const tl_released_counts *released = &trial->released;
    bool is_compared = released->steps[age] >= LEAST_STEPS && ((uint64_t)1 << age) >= trial->prediction;
    return is_compared ? fmax(released->squares[age] / (double)released->steps[age], NEGLIGIBLE) : (double)NAN;
}

/* Mean square error of the locked twin, plus the noise σ² if the tolerance is 3 σ. NaN: unknown. */
static double locked_square(const tl_horizon_trial *trial) {
    static const double noise = 1.0 / 9.0;
    return trial->compared != 0 ? trial->squares / (double)trial->compared + noise : (double)NAN;
}

static void find_errors(tl_horizon_trial *trial) {
    double squares = 0.0;
    double steps = 0.0;
    for (size_t i = 0; i < TL_RELEASED_AGES; i++) {
        squares += trial->released.squares[i];
        steps += (double)trial->released.steps[i];
    }
    trial->error = steps > 0.0 ? sqrt(squares / steps) : (double)NAN;
    trial->locked = trial->compared != 0 ? sqrt(trial->squares / (double)trial->compared) : (double)NAN;
    trial->regret = (double)NAN;
    trial->age = 0;
}

/* The smallest error of the usable trials at this age; NaN: no trial has one. */
static double find_best(const tl_horizon_choice *choice, size_t age, tl_time budget) {
    double best = (double)NAN;
    for (size_t i = 0; i < choice->count; i++) {
        if (is_usable(&choice->trial[i], budget)) {
            best = fmin(best, mean_square(&choice->trial[i], age)); /* fmin() ignores a NaN */
        }
    }
    return best;
}

static void raise_regret(tl_horizon_trial *trial, double ratio, tl_time age) {
    if (!isnan(ratio) && !(ratio <= trial->regret)) {
        trial->regret = ratio;
        trial->age = age;
    }
}

static void find_regrets(tl_horizon_choice *choice, tl_time step, tl_time budget) {
    double least = (double)NAN;
    for (size_t i = 0; i < choice->count; i++) {
        bool counts = is_usable(&choice->trial[i], budget);
        least = counts ? fmin(least, locked_square(&choice->trial[i])) : least;
    }
    for (size_t i = 0; i < choice->count; i++) {
        tl_horizon_trial *trial = &choice->trial[i];
        for (size_t age = 0; age < TL_RELEASED_AGES && is_usable(trial, budget); age++) {
            raise_regret(trial, mean_square(trial, age) / find_best(choice, age, budget), step << age);
        }
        if (is_usable(trial, budget) && !isnan(trial->regret)) {
            raise_regret(trial, locked_square(trial) / least, 0);
        }
    }
}

static bool has_corrected(const tl_horizon_trial *trial) {
    return (double)trial->corrected >= TL_HORIZON_CORRECTS * (double)trial->steps;
}

/* Of two trials that are equally good. Trials are in the order of T_P. */
static bool is_preferred(const tl_horizon_trial *trial, const tl_horizon_trial *to) {
    return trial->prediction == to->prediction && !trial->rests;
}

void tl_horizon_choose(tl_horizon_choice *choice, tl_time step, tl_time budget) {
    double least = HUGE_VAL;
    double least_corrected = HUGE_VAL;
    choice->chosen = SIZE_MAX;
    for (size_t i = 0; i < choice->count; i++) {
        find_errors(&choice->trial[i]);
    }
    find_regrets(choice, step, budget);
    for (size_t i = 0; i < choice->count; i++) {
        const tl_horizon_trial *trial = &choice->trial[i];
        least = fmin(least, trial->regret);
        least_corrected = has_corrected(trial) ? fmin(least_corrected, trial->regret) : least_corrected;
    }
    bool corrects = least_corrected <= TL_HORIZON_QUIET * least;
    for (size_t i = 0; i < choice->count; i++) {
        const tl_horizon_trial *trial = &choice->trial[i];
        bool is_good = corrects ? has_corrected(trial) && trial->regret <= TL_HORIZON_EQUAL * least_corrected
                                : trial->regret <= TL_HORIZON_EQUAL * least;
        bool is_better = choice->chosen == SIZE_MAX || is_preferred(trial, &choice->trial[choice->chosen]);
        choice->chosen = is_good && is_better ? i : choice->chosen;
    }
}
