/* Lock monitor: see lock_monitor.h. */
#include "firmware/monitor/lock_monitor.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* ---- variable at a bound ---- */

static const double MOST = 0.5;
static const double LITTLE = 0.25;

static void judge(tl_bound_stay *stay) {
    uint64_t steps = 0;
    uint64_t there = 0;
    for (int i = 0; i < TL_BOUND_BLOCKS; i++) {
        steps += stay->steps[i];
        there += stay->there[i];
    }
    stay->share = steps == 0 ? 0.0 : (double)there / (double)steps;
    if (!stay->is_told && stay->passed == TL_BOUND_BLOCKS && stay->share > MOST) {
        stay->is_told = true;
        stay->turn = TL_BOUND_REACHED;
    } else if (stay->is_told && stay->share < LITTLE) {
        stay->is_told = false;
        stay->turn = TL_BOUND_LEFT;
    }
}

/* Clears the counts of all blocks up to `block`. */
static void go_on(tl_bound_stay *stay, int64_t block) {
    int64_t count = block - stay->block;
    for (int64_t i = 1; i <= count && i <= TL_BOUND_BLOCKS; i++) {
        stay->steps[(stay->block + i) % TL_BOUND_BLOCKS] = 0;
        stay->there[(stay->block + i) % TL_BOUND_BLOCKS] = 0;
    }
    stay->passed = count < TL_BOUND_BLOCKS - (int64_t)stay->passed ? stay->passed + (uint32_t)count : TL_BOUND_BLOCKS;
    stay->block = block;
}

void tl_bound_stay_step(tl_bound_stay *stay, tl_time time, bool is_there) {
    int64_t block = time / TL_BOUND_BLOCK;
    stay->turn = TL_BOUND_AS_BEFORE;
    stay->block = stay->has_begun ? stay->block : block; /* a resumed run may start with any block */
    stay->has_begun = true;
    if (block > stay->block) {
        judge(stay);
        go_on(stay, block);
    }
    stay->steps[stay->block % TL_BOUND_BLOCKS]++;
    stay->there[stay->block % TL_BOUND_BLOCKS] += is_there ? 1 : 0;
}

/* ---- recovery of a lost twin ---- */

void tl_recovery_init(tl_recovery *recovery, const tl_config *config, const tl_account *account) {
    *recovery = (tl_recovery){.pause = 0};
    tl_lock_monitor_init(&recovery->judge, config, account);
}

/* A twin that was in lock for TL_LOCK_LEARNS parts has recovered, so the pause starts again from
 * its shortest. */
static void forgive(tl_recovery *recovery, const tl_lock_tally *tally) {
    bool is_well = tally->state == TL_LOCK_LOCKED || tally->state == TL_LOCK_TRACKING;
    recovery->well = is_well ? recovery->well + 1 : 0;
    if (recovery->well >= TL_LOCK_LEARNS) {
        recovery->pause = 0;
    }
}

bool tl_recovery_step(tl_recovery *recovery, const tl_record *record, const tl_lock_change **change) {
    const tl_lock_tally *tally = &recovery->judge.tally;
    *change = tl_lock_monitor_step(&recovery->judge, record);
    if (tally->windows == recovery->windows) {
        return false;
    }
    recovery->windows = tally->windows;
    recovery->passed++;
    forgive(recovery, tally);
    bool is_due = recovery->judge.astray && recovery->passed >= recovery->pause &&
                  recovery->judge.config->event.start.signal == NULL;
    if (is_due) {
        uint32_t longer = 2 * recovery->pause;
        recovery->pause = longer == 0 ? TL_LOCK_PAUSE_FIRST : longer < TL_LOCK_PAUSE_LAST ? longer : TL_LOCK_PAUSE_LAST;
        recovery->passed = 0;
    }
    return is_due;
}

/* ---- lock monitor ---- */

/* Limit to enter a state, and limit to leave it. */
typedef struct limit {
    double enter, leave;
} limit;

/* Shares of the steps of the window. */
static const limit FREE = {0.5, 0.25};
static const limit OUTSIDE = {0.5, 0.25};
static const limit FAR_OUTSIDE = {0.1, 0.05};
static const limit OUTSIDE_IN_CYCLE = {0.1, 0.05};
static const limit BAD = {0.5, 0.1};
static const limit AT_BOUND = {0.5, 0.25};

/* Multiples of the usual |Δu|; and the part of a first search step that never counts as a change.
 */
static const limit BEYOND_USUAL = {3.0, 2.0};
static const double NEGLIGIBLE = 0.1;

/* In tolerances. */
static const double FAR_AWAY = 10.0;

/* In tolerances; no plant has such an error. A 24-bit converter resolves 2e7 levels, and a start
 * from 0 may be off by the plant's whole range. */
static const double RUNAWAY = 1e9;

/* u repeats its value if the difference is within this share of its range in between. */
static const double SAME_PLACE = 0.1;
static const double IN_CYCLE = 0.5;

/* A share of steps, and how much further than the plant the twin must jump. */
static const double ASTRAY = 0.25;
static const double MUCH_MORE = 3.0;
static const double FADING = 0.99; /* decay per step */

/* Shortest duration, and fewest steps, of a part. */
static const tl_time PART = TL_SECOND / 10;
enum { PART_STEPS = 2, STROKES = 3, HUNDRED = 100 };

/* The whole window. */
typedef tl_lock_part window;

static bool has_strokes(const tl_config *config) {
    return config->event.start.signal != NULL;
}

static uint32_t steps_of_part(const tl_config *config) {
    int64_t steps = (PART + config->step - 1) / config->step;
    return (uint32_t)(steps > PART_STEPS ? steps : PART_STEPS);
}

tl_lock_window tl_lock_monitor_window(const tl_config *config) {
    return has_strokes(config)
               ? (tl_lock_window){.strokes = STROKES, .time = STROKES * config->event.longest}
               : (tl_lock_window){.time = TL_LOCK_PARTS * (tl_time)steps_of_part(config) * config->step};
}

static bool is_real(const tl_lock_monitor *judge, size_t adjust) {
    return judge->adjust[adjust].type == TL_REAL;
}

void tl_lock_monitor_init(tl_lock_monitor *judge, const tl_config *config, const tl_account *account) {
    *judge = (tl_lock_monitor){.config = config};
    judge->part_steps = has_strokes(config) ? 1 : steps_of_part(config);
    memcpy(judge->adjust, account->adjust, sizeof judge->adjust);
}

static struct tl_lock_measure measure_of(const tl_config *config, size_t i) {
    return (struct tl_lock_measure){config->match[i].tolerance, config->match[i].weight};
}

static struct tl_lock_measure measure(const tl_lock_monitor *judge, size_t i) {
    return judge->tolerances != NULL ? judge->tolerances->match[i] : measure_of(judge->config, i);
}

void tl_lock_monitor_retune(tl_lock_monitor *judge, const tl_tuning *tuning) {
    for (size_t v = 0; v < judge->config->adjust_count; v++) {
        tl_account_adjust *adjust = &judge->adjust[v];
        if (is_real(judge, v)) {
            adjust->lower = fmax(tuning->adjust[v].lower, adjust->least);
            adjust->upper = fmin(tuning->adjust[v].upper, adjust->most);
        }
    }
}

/* After a reset the window says nothing about the following steps. The usual |Δu| stays. */
static void forget(tl_lock_monitor *judge) {
    judge->tally.steps[judge->tally.state] += judge->pending + judge->part[judge->at].steps;
    judge->pending = 0;
    memset(judge->part, 0, sizeof judge->part);
    judge->parts = 0;
    judge->at = 0;
    judge->u_count = 0;
    judge->astray = false;
}

/* ---- collecting ---- */

void tl_lock_monitor_sample(tl_lock_monitor *judge, const tl_sample *sample) {
    tl_lock_part *part = &judge->part[judge->at];
    part->samples++;
    for (size_t i = 0; i < judge->config->signal_count; i++) {
        bool is_one = !judge->config->signals[i].is_reading; /* another look-up of the signal counts already */
        part->bad[i] += is_one && sample->quality[i] != TL_GOOD ? 1 : 0;
    }
}

static bool is_compared(const tl_lock_monitor *judge, const tl_record *record) {
    bool compared = false;
    for (size_t i = 0; i < judge->config->match_count; i++) {
        compared = compared || (measure(judge, i).weight > 0.0 && record->measured_quality[i] == TL_GOOD);
    }
    return compared && record->outcome != TL_FREE && record->outcome != TL_FREE_RUN;
}

/* The step itself had no good measurement, but its horizon had some: such a twin does not run free.
 */
static bool is_searched(const tl_record *record) {
    return record->outcome == TL_FIRST_GUESS || record->outcome == TL_OPTIMISED || record->outcome == TL_BEST_SO_FAR ||
           (record->outcome == TL_NOMINAL && isfinite(record->objective));
}

/* Error of a committed step in tolerances: the root of the weighted mean square of all matched
 * outputs. */
static double distance(const tl_lock_monitor *judge, const tl_record *record) {
    double sum = 0.0;
    double weights = 0.0;
    for (size_t i = 0; i < judge->config->match_count; i++) {
        const struct tl_lock_measure by = measure(judge, i);
        if (by.weight > 0.0 && record->measured_quality[i] == TL_GOOD) {
            double error = (record->y[i] - record->measured[i]) / by.tolerance;
            sum += by.weight * error * error;
            weights += by.weight;
        }
    }
    return sqrt(sum / fmax(weights, 1.0)); /* weights with a sum below 1 must not make it stricter than J */
}

/* Largest factor of J with the monitor's tolerances, compared with those of the search. Infinite if
 * an output that counts has no weight in the search. */
static double larger_objective(const tl_lock_monitor *judge) {
    double most = 1.0;
    for (size_t i = 0; i < judge->config->match_count; i++) {
        const struct tl_lock_measure own = measure_of(judge->config, i);
        const struct tl_lock_measure by = measure(judge, i);
        double wider = own.tolerance / by.tolerance;
        double larger = wider * wider * by.weight / own.weight;
        if (by.weight > 0.0 && !(larger <= most)) {
            most = isnan(larger) ? HUGE_VAL : larger;
        }
    }
    return most;
}

/* The error of a stroke is that of its search. It is within tolerance if the search ended so. */
static double distance_of_stroke(const tl_lock_monitor *judge, const tl_record *record) {
    double larger = judge->tolerances == NULL ? 1.0 : larger_objective(judge);
    double size = sqrt(larger * record->objective);
    bool within =
        (record->outcome == TL_FIRST_GUESS || record->outcome == TL_OPTIMISED) && (larger <= 1.0 || size < 1.0);
    return within ? 0.0 : size < 1.0 ? 1.0 : size;
}

/* Adds the error to the part, and returns it. */
static double see_tolerance(const tl_lock_monitor *judge, const tl_record *record, tl_lock_part *part) {
    double away = has_strokes(judge->config) ? distance_of_stroke(judge, record) : distance(judge, record);
    part->outside += away < 1.0 ? 0 : 1; /* NaN counts as outside */
    part->far += away < FAR_AWAY ? 0 : 1;
    part->worst = away <= part->worst ? part->worst : away;
    return away;
}

/* Returns true if the search evaluated candidates and did not time out. A step at nominal u may
 * have no J, because nothing was searched. */
static bool has_objective(const tl_record *record) {
    return record->stop != TL_STOP_TIME && (record->flags & TL_FLAG_WITHOUT_NOMINAL) == 0 &&
           (record->outcome == TL_FIRST_GUESS || record->outcome == TL_OPTIMISED || record->outcome == TL_BEST_SO_FAR);
}

static bool has_run_away(const tl_lock_monitor *judge, const tl_record *record, double away) {
    bool ran_away = !(away < RUNAWAY) || (has_objective(record) && !isfinite(record->objective));
    for (size_t i = 0; i < judge->config->match_count; i++) {
        ran_away = ran_away || !isfinite(record->y[i]);
    }
    return ran_away;
}

/* At a bound, and further from nominal than a negligible distance. */
static bool is_at_bound(const tl_account_adjust *adjust, double u, double nominal) {
    bool is_there = u <= adjust->lower || u >= adjust->upper;
    return is_there && fabs(u - nominal) > NEGLIGIBLE * adjust->step;
}

static void see_bounds(tl_lock_monitor *judge, size_t v, const tl_record *record, tl_lock_part *part) {
    bool is_there = is_at_bound(&judge->adjust[v], record->u[v], record->nominal[v]);
    part->at_bound[v] += is_there ? 1 : 0;
    tl_bound_stay_step(&judge->stay[v], tl_time_of_step(0, judge->config->step, record->step), is_there);
}

static void see_cycle(const tl_lock_monitor *judge, size_t v, uint32_t cycling[TL_LOCK_PERIODS + 1]) {
    double least = judge->u[0][v];
    double most = least;
    for (uint32_t period = 1; period <= TL_LOCK_PERIODS && period < judge->u_count; period++) {
        double then = judge->u[period][v];
        double way = most - least; /* range of u in the steps in between */
        if (period > 1 && way >= judge->adjust[v].step && fabs(judge->u[0][v] - then) <= SAME_PLACE * way) {
            cycling[period]++;
        }
        least = then < least ? then : least;
        most = then > most ? then : most;
    }
}

static void widen(tl_lock_range *range, double value, bool first) {
    range->least = first || value < range->least ? value : range->least;
    range->most = first || value > range->most ? value : range->most;
}

/* Returns true if a matched output moved far in one step, and much further than its measurement
 * moves. */
static bool has_jumped(const tl_lock_monitor *judge, size_t i, const tl_record *record) {
    const struct tl_lock_measure by = measure(judge, i);
    double simulated = fabs(record->y[i] - judge->y[i]);
    bool far = !(simulated < FAR_AWAY * by.tolerance) && !(simulated < MUCH_MORE * judge->stride[i]);
    return far && by.weight > 0.0 && record->measured_quality[i] == TL_GOOD;
}

static void see_outputs(tl_lock_monitor *judge, const tl_record *record, tl_lock_part *part) {
    bool jumped = false;
    for (size_t i = 0; i < judge->config->match_count && judge->u_count != 0; i++) {
        double step = fabs(record->measured[i] - judge->measured[i]);
        double faded = FADING * judge->stride[i];
        judge->stride[i] =
            step > faded ? step : faded; /* decays slowly, because readings do not change between two messages */
        jumped = has_jumped(judge, i, record) || jumped;
    }
    part->jumps += jumped ? 1 : 0;
    memcpy(judge->y, record->y, judge->config->match_count * sizeof record->y[0]);
    memcpy(judge->measured, record->measured, judge->config->match_count * sizeof record->measured[0]);
}

static void see_corrections(tl_lock_monitor *judge, const tl_record *record, tl_lock_part *part) {
    size_t count = judge->config->adjust_count;
    memmove(judge->u[1], judge->u[0], sizeof judge->u - sizeof judge->u[0]);
    memcpy(judge->u[0], record->u, count * sizeof record->u[0]);
    judge->u_count += judge->u_count <= TL_LOCK_PERIODS ? 1 : 0;
    for (size_t v = 0; v < count; v++) {
        double u = record->u[v];
        widen(&part->u[v], u, part->steps == 0);
        if (is_real(judge, v)) {
            part->correction[v] += fabs(u - record->nominal[v]);
            see_bounds(judge, v, record, part);
            see_cycle(judge, v, part->cycling[v]);
        }
    }
}

/* ---- the window ---- */

static void add_part(const tl_lock_part *part, const tl_config *config, window *all) {
    bool first = all->steps == 0;
    all->steps += part->steps;
    all->free += part->free;
    all->between += part->between;
    all->outside += part->outside;
    all->far += part->far;
    all->jumps += part->jumps;
    all->ran_away += part->ran_away;
    all->differed += part->differed;
    all->samples += part->samples;
    all->worst = part->worst <= all->worst ? all->worst : part->worst;
    for (size_t i = 0; i < config->signal_count; i++) {
        all->bad[i] += part->bad[i];
    }
    for (size_t v = 0; v < config->adjust_count; v++) {
        all->at_bound[v] += part->at_bound[v];
        all->correction[v] += part->correction[v];
        widen(&all->u[v], part->u[v].least, first);
        widen(&all->u[v], part->u[v].most, false);
        for (int period = 0; period <= TL_LOCK_PERIODS; period++) {
            all->cycling[v][period] += part->cycling[v][period];
        }
    }
}

static void add_window(const tl_lock_monitor *judge, window *all) {
    memset(all, 0, sizeof *all);
    for (uint32_t i = 0; i < TL_LOCK_PARTS; i++) {
        if (judge->part[i].steps != 0) {
            add_part(&judge->part[i], judge->config, all);
        }
    }
}

/* ---- determining the state ---- */

static double share(uint32_t count, uint32_t of) {
    return of == 0 ? 0.0 : (double)count / (double)of;
}

static bool is_beyond(double value, const limit *of, bool inside) {
    return value >= (inside ? of->leave : of->enter);
}

static uint32_t count_compared(const tl_lock_part *all) {
    return all->steps - all->free - all->between;
}

static bool is_in(const tl_lock_monitor *judge, tl_lock_state state) {
    return judge->judged && judge->tally.state == state;
}

static const char *units(const tl_lock_monitor *judge) {
    return has_strokes(judge->config) ? "strokes" : "steps";
}

/* Appends to a cause. Does nothing if `cause` is NULL. */
static void write_cause(char *cause, const char *format, ...) TL_PRINTF(2, 3);

static void write_cause(char *cause, const char *format, ...) {
    if (cause != NULL) {
        size_t length = strlen(cause);
        va_list arguments;
        va_start(arguments, format);
        (void)vsnprintf(cause + length, TL_LOCK_CAUSE - length, format, arguments);
        va_end(arguments);
    }
}

/* The following functions write the cause if they return true. */
static bool judge_free(const tl_lock_monitor *judge, const window *all, char *cause) {
    double free = share(count_compared(all) == 0 ? all->steps : all->free, all->steps);
    bool is_free = count_compared(all) == 0 || is_beyond(free, &FREE, is_in(judge, TL_LOCK_FREE));
    if (is_free) {
        write_cause(cause, "no matched signal was good in %.0f %% of the last %u %s (limit %.0f %%)", HUNDRED * free,
                    (unsigned)all->steps, units(judge), HUNDRED * FREE.enter);
    }
    return is_free;
}

/* Finds the first adjusted variable whose u is in a limit cycle, and the period in steps. Returns
 * false if there is none. */
static bool find_cycle(const tl_lock_monitor *judge, const window *all, size_t *variable, int *period) {
    for (size_t v = 0; v < judge->config->adjust_count; v++) {
        for (int p = 2; p <= TL_LOCK_PERIODS; p++) {
            if (share(all->cycling[v][p], all->steps) >= IN_CYCLE) {
                *variable = v;
                *period = p;
                return true;
            }
        }
    }
    return false;
}

/* A twin that has returned to the plant in the newest part is not reset. */
static bool is_still_astray(const tl_lock_part *newest) {
    uint32_t compared = count_compared(newest);
    return share(newest->far, compared) >= ASTRAY && share(newest->jumps, compared) >= ASTRAY;
}

static bool judge_lost(tl_lock_monitor *judge, const window *all, char *cause) {
    bool inside = is_in(judge, TL_LOCK_LOST);
    uint32_t compared = count_compared(all);
    double outside = share(all->outside, compared);
    double far = share(all->far, compared);
    size_t which = 0;
    int period = 0;
    judge->astray = far >= ASTRAY && share(all->jumps, compared) >= ASTRAY && is_still_astray(&judge->part[judge->at]);
    bool cycles = find_cycle(judge, all, &which, &period) && is_beyond(outside, &OUTSIDE_IN_CYCLE, inside);
    if (all->ran_away != 0) {
        write_cause(cause,
                    "an output, or J, has run away: it was off by %.0e tolerances or more, or not finite, in %u of "
                    "the last %u %s",
                    RUNAWAY, (unsigned)all->ran_away, (unsigned)all->steps, units(judge));
    } else if (is_beyond(far, &FAR_OUTSIDE, inside)) {
        write_cause(cause,
                    "%.0f %% of the last %u %s are off by %.0f tolerances or more (limit %.0f %%), at worst by %.3g",
                    HUNDRED * far, (unsigned)compared, units(judge), FAR_AWAY, HUNDRED * FAR_OUTSIDE.enter, all->worst);
    } else if (cycles || is_beyond(outside, &OUTSIDE, inside)) {
        write_cause(cause, "%.0f %% of the last %u %s are out of tolerance (limit %.0f %%)", HUNDRED * outside,
                    (unsigned)compared, units(judge), HUNDRED * (cycles ? OUTSIDE_IN_CYCLE.enter : OUTSIDE.enter));
    } else {
        return false;
    }
    if (cycles) {
        const tl_lock_range *u = &all->u[which];
        write_cause(cause, "; %.60s swings between %.4g and %.4g every %d %s", judge->config->adjust[which].variable,
                    u->least, u->most, period, units(judge));
    }
    return true;
}

static bool judge_degraded(const tl_lock_monitor *judge, const window *all, char *cause) {
    if (all->differed != 0) {
        write_cause(cause, "an FMU was found not to come back to where it was, before %u of the last %u steps",
                    (unsigned)all->differed, (unsigned)all->steps);
        return true;
    }
    for (size_t i = 0; i < judge->config->signal_count; i++) {
        double bad = share(all->bad[i], all->samples);
        if (is_beyond(bad, &BAD, is_in(judge, TL_LOCK_DEGRADED))) {
            write_cause(cause, "plant.%.60s was not good in %.0f %% of the last %u samples (limit %.0f %%)",
                        judge->config->signals[i].plan.name, HUNDRED * bad, (unsigned)all->samples,
                        HUNDRED * BAD.enter);
            return true;
        }
    }
    return false;
}

static double mean_correction(const window *all, size_t v) {
    return all->steps == 0 ? 0.0 : all->correction[v] / (double)all->steps;
}

static limit unusual(const tl_lock_monitor *judge, size_t v) {
    double floor = NEGLIGIBLE * judge->adjust[v].step;
    return (limit){BEYOND_USUAL.enter * judge->usual[v] + floor, BEYOND_USUAL.leave * judge->usual[v] + floor};
}

static bool judge_tracking(const tl_lock_monitor *judge, const window *all, char *cause) {
    bool inside = is_in(judge, TL_LOCK_TRACKING);
    for (size_t v = 0; v < judge->config->adjust_count; v++) {
        const char *variable = judge->config->adjust[v].variable;
        double at_bound = share(all->at_bound[v], all->steps);
        double correction = mean_correction(all, v);
        const limit of = unusual(judge, v);
        if (is_real(judge, v) && is_beyond(at_bound, &AT_BOUND, inside)) {
            write_cause(cause, "%.60s is at a bound in %.0f %% of the last %u %s (limit %.0f %%)", variable,
                        HUNDRED * at_bound, (unsigned)all->steps, units(judge), HUNDRED * AT_BOUND.enter);
            return true;
        }
        if (is_real(judge, v) && judge->learned >= TL_LOCK_LEARNS && is_beyond(correction, &of, inside)) {
            write_cause(cause,
                        "%.60s is corrected by %.3g on average over the last %u %s, and usually by %.3g (limit %.3g)",
                        variable, correction, (unsigned)all->steps, units(judge), judge->usual[v], of.enter);
            return true;
        }
    }
    return false;
}

static tl_lock_state judge_window(tl_lock_monitor *judge, const window *all, char *cause) {
    uint32_t compared = count_compared(all);
    judge->astray = false;
    if (judge_free(judge, all, cause)) {
        return TL_LOCK_FREE;
    }
    if (judge_lost(judge, all, cause)) {
        return TL_LOCK_LOST;
    }
    if (judge_degraded(judge, all, cause)) {
        return TL_LOCK_DEGRADED;
    }
    if (judge_tracking(judge, all, cause)) {
        return TL_LOCK_TRACKING;
    }
    write_cause(cause, "%.0f %% of the last %u %s are within tolerance",
                HUNDRED * (1.0 - share(all->outside, compared)), (unsigned)compared, units(judge));
    return TL_LOCK_LOCKED;
}

/* ---- over the run ---- */

/* Only a locked or tracking twin shows the usual correction. While u rests at nominal there is no
 * correction. */
static void learn(tl_lock_monitor *judge, const tl_lock_part *part) {
    if (part->rests != 0) {
        return;
    }
    if (judge->tally.state != TL_LOCK_LOCKED && judge->tally.state != TL_LOCK_TRACKING) {
        return;
    }
    judge->learned += judge->learned < TL_SYNCHRONISER_MEMORY ? 1 : 0;
    for (size_t v = 0; v < judge->config->adjust_count; v++) {
        double mean = part->correction[v] / (double)part->steps;
        judge->usual[v] += (mean - judge->usual[v]) / judge->learned;
    }
}

/* Determines the state of the window and counts the steps since the last time in it. Returns true
 * if the state has changed. */
static bool judge_now(tl_lock_monitor *judge) {
    window all;
    tl_lock_state before = judge->tally.state;
    bool first = !judge->judged;
    add_window(judge, &all);
    tl_lock_state state = judge_window(judge, &all, NULL);
    bool changed = first || state != before;
    if (changed) { /* formatted only after a change, because this is the thread of the cycle */
        judge->change.cause[0] = '\0';
        judge->change.to = judge_window(judge, &all, judge->change.cause);
    }
    judge->tally.steps[state] += judge->pending;
    judge->tally.state = state;
    judge->pending = 0;
    judge->judged = true;
    judge->tally.changes += changed && !first ? 1 : 0;
    judge->tally.losses += changed && state == TL_LOCK_LOST ? 1 : 0;
    return changed;
}

static bool has_window(const tl_lock_monitor *judge) {
    return judge->parts >= (has_strokes(judge->config) ? (uint32_t)STROKES : (uint32_t)TL_LOCK_PARTS);
}

/* Closes the full part. Returns true if the state has changed. */
static bool close_part(tl_lock_monitor *judge) {
    const tl_lock_part *full = &judge->part[judge->at];
    judge->parts += judge->parts < TL_LOCK_PARTS ? 1 : 0;
    judge->pending += full->steps;
    judge->tally.within += full->outside == 0 && full->free == 0 ? full->steps : 0;
    judge->tally.windows += has_window(judge) ? 1 : 0;
    bool changed = has_window(judge) && judge_now(judge);
    if (judge->judged) {
        learn(judge, full);
    }
    judge->at = (judge->at + 1) % TL_LOCK_PARTS;
    memset(&judge->part[judge->at], 0, sizeof judge->part[judge->at]);
    return changed;
}

/* Returns true for a stroke whose search has ended, but not for one at nominal without a search. */
static bool is_stroke(const tl_record *record) {
    return record->outcome != TL_HELD && record->outcome != TL_SEARCHING && record->outcome != TL_CAUGHT_UP &&
           (record->outcome != TL_NOMINAL || isfinite(record->objective));
}

static bool counts(const tl_lock_monitor *judge, const tl_record *record) {
    return judge->config->adjust_count != 0 && record->outcome != TL_RESUMED &&
           (!has_strokes(judge->config) || is_stroke(record));
}

const tl_lock_change *tl_lock_monitor_step(tl_lock_monitor *judge, const tl_record *record) {
    if (!counts(judge, record)) {
        return NULL;
    }
    if ((record->flags & TL_FLAG_RESET) != 0) {
        forget(judge);
    }
    tl_lock_part *part = &judge->part[judge->at];
    double away = 0.0;
    if (is_compared(judge, record)) {
        away = see_tolerance(judge, record, part);
    } else if (is_searched(record)) {
        part->between++;
    } else {
        part->free++;
    }
    if (has_run_away(judge, record, away)) {
        part->ran_away++;
        judge->tally.ran_away++;
    }
    part->rests += (record->flags & TL_FLAG_RESTS) != 0 ? 1 : 0;
    part->differed += (record->flags & TL_FLAG_DIFFERED) != 0 ? 1 : 0;
    see_outputs(judge, record, part);
    see_corrections(judge, record, part);
    part->steps++;
    return part->steps == judge->part_steps && close_part(judge) ? &judge->change : NULL;
}

void tl_lock_monitor_get(const tl_lock_monitor *judge, tl_lock_tally *tally) {
    tl_lock_monitor last = *judge;
    last.pending += last.part[last.at].steps;
    if ((!last.judged || last.part[last.at].ran_away != 0) && last.pending != 0) {
        (void)judge_now(&last);
    }
    last.tally.steps[last.tally.state] += last.pending;
    *tally = last.tally;
}
