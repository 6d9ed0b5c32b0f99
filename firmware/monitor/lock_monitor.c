/* Lock monitor: see lock_monitor.h. */
#include "firmware/monitor/lock_monitor.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* ---- variable at a bound ---- */

static const double MOST = 0.5;
static const double LITTLE = 0.25;

static void assess_stay(tl_bound_stay *stay) {
    uint64_t steps = 0;
    uint64_t there = 0;
    for (int i = 0; i < TL_BOUND_BLOCKS; i++) {
        steps += stay->steps[i];
        there += stay->there[i];
    }
    stay->share = steps == 0 ? 0.0 : (double)there / (double)steps;
    if (!stay->is_reported && stay->passed == TL_BOUND_BLOCKS && stay->share > MOST) {
        stay->is_reported = true;
        stay->turn = TL_BOUND_REACHED;
    } else if (stay->is_reported && stay->share < LITTLE) {
        stay->is_reported = false;
        stay->turn = TL_BOUND_LEFT;
    }
}

/* Clears the counts of all blocks up to `block`. */
static void begin_block(tl_bound_stay *stay, int64_t block) {
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
        assess_stay(stay);
        begin_block(stay, block);
    }
    stay->steps[stay->block % TL_BOUND_BLOCKS]++;
    stay->there[stay->block % TL_BOUND_BLOCKS] += is_there ? 1 : 0;
}

/* ---- recovery of a lost twin ---- */

void tl_recovery_init(tl_recovery *recovery, const tl_config *config, const tl_account *account) {
    *recovery = (tl_recovery){.pause = 0};
    tl_lock_monitor_init(&recovery->lock_monitor, config, account);
}

/* A twin that was in lock for TL_LOCK_RECOVERED parts has recovered, so the pause starts again from
 * its shortest. */
static void reset_pause(tl_recovery *recovery, const tl_lock_tally *tally) {
    bool is_well = tally->state == TL_LOCK_LOCKED || tally->state == TL_LOCK_CORRECTED;
    recovery->well = is_well ? recovery->well + 1 : 0;
    if (recovery->well >= TL_LOCK_RECOVERED) {
        recovery->pause = 0;
    }
}

/* Leaves out outputs that are only compared, because they do not affect the twin. */
static uint64_t find_harmful(const tl_config *config, uint64_t bad_outputs) {
    for (size_t i = 0; i < config->match_count; i++) {
        bad_outputs &= config->match[i].weight > 0.0 ? UINT64_MAX : ~((uint64_t)1 << i);
    }
    return bad_outputs;
}

/* Resumed steps never count as bad: if their FMUs had to be reset, the earlier run did it. */
static bool is_lastingly_bad(tl_recovery *recovery, const tl_record *record) {
    bool is_bad =
        record->outcome != TL_RESUMED && find_harmful(recovery->lock_monitor.config, record->bad_outputs) != 0;
    recovery->bad = is_bad ? recovery->bad + 1 : 0;
    recovery->finite = is_bad ? 0 : recovery->finite + 1;
    recovery->resets = recovery->finite >= TL_FINITE_STEPS ? 0 : recovery->resets;
    if (recovery->bad < (uint32_t)TL_NOT_FINITE_STEPS << recovery->resets) {
        return false;
    }
    recovery->bad = 0;
    recovery->resets += recovery->resets < TL_NOT_FINITE_RESETS ? 1 : 0;
    return true;
}

bool tl_recovery_step(tl_recovery *recovery, const tl_record *record, const tl_lock_change **change) {
    const tl_lock_tally *tally = &recovery->lock_monitor.tally;
    *change = tl_lock_monitor_step(&recovery->lock_monitor, record);
    bool is_bad = is_lastingly_bad(recovery, record);
    if (tally->windows == recovery->windows) {
        return is_bad;
    }
    recovery->windows = tally->windows;
    recovery->passed++;
    reset_pause(recovery, tally);
    bool is_due = recovery->lock_monitor.is_astray && recovery->passed >= recovery->pause &&
                  recovery->lock_monitor.config->event.start.signal == NULL;
    if (is_due) {
        uint32_t longer = 2 * recovery->pause;
        recovery->pause = longer == 0 ? TL_LOCK_PAUSE_FIRST : longer < TL_LOCK_PAUSE_LAST ? longer : TL_LOCK_PAUSE_LAST;
        recovery->passed = 0;
    }
    return is_due || is_bad;
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

/* Error of a released twin in tolerances, and mean Δu in search steps. */
static const limit CORRECTED = {1.0, 0.7};

/* The locked twin does harm if its error exceeds that of a released one by this factor and by this
 * part of a tolerance. */
static const double HARM = 1.2;
static const double HARM_FLOOR = 0.1;

/* This part of a first search step never counts as a correction. */
static const double NEGLIGIBLE = 0.1;

/* Steps of a block without released twins, and strokes of a block. Blocks in a release. */
enum { BLOCK_STEPS = 150, BLOCK_STROKES = 10, BLOCKS = 4 };

/* Least change of a reason's value that is reported, as a part of it. Time between two reports. */
static const double UPDATED = 0.1;
static const tl_time UPDATE_AFTER = 3600 * TL_SECOND;

/* Shortest time for which a state `corrected` lasts. */
static const tl_time CORRECTED_FOR = 60 * TL_SECOND;

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

static bool is_real(const tl_lock_monitor *monitor, size_t adjust) {
    return monitor->adjust[adjust].type == TL_REAL;
}

void tl_lock_monitor_init(tl_lock_monitor *monitor, const tl_config *config, const tl_account *account) {
    *monitor = (tl_lock_monitor){.config = config};
    monitor->part_steps = has_strokes(config) ? 1 : steps_of_part(config);
    memcpy(monitor->adjust, account->adjust, sizeof monitor->adjust);
    for (size_t i = 0; i < config->match_count; i++) {
        (void)snprintf(monitor->unit[i], TL_LOCK_UNIT, "%.*s", TL_LOCK_UNIT - 1, account->match[i].unit);
    }
    for (size_t v = 0; v < config->adjust_count; v++) {
        monitor->approved[v] = config->adjust[v].approved;
    }
    tl_frozen_watch_init(&monitor->frozen, config);
    monitor->release.block = has_strokes(config)                              ? (uint32_t)BLOCK_STROKES
                             : config->released_steps >= (uint32_t)BLOCKS * 2 ? config->released_steps / BLOCKS
                                                                              : (uint32_t)BLOCK_STEPS;
}

static struct tl_lock_measure measure_of(const tl_config *config, size_t i) {
    return (struct tl_lock_measure){config->match[i].tolerance, config->match[i].weight};
}

static struct tl_lock_measure current_measure(const tl_lock_monitor *monitor, size_t i) {
    return monitor->tolerances != NULL ? monitor->tolerances->match[i] : measure_of(monitor->config, i);
}

static void clear_release(tl_lock_monitor *monitor) {
    monitor->release = (tl_release_check){.block = monitor->release.block};
}

void tl_lock_monitor_retune(tl_lock_monitor *monitor, const tl_tuning *tuning) {
    for (size_t v = 0; v < monitor->config->adjust_count; v++) {
        tl_account_adjust *adjust = &monitor->adjust[v];
        double approved = tuning->adjust[v].approved;
        if (approved < monitor->approved[v] || approved > monitor->approved[v]) {
            monitor->approved[v] = approved;
            clear_release(monitor);
        }
        if (is_real(monitor, v)) {
            adjust->lower = fmax(tuning->adjust[v].lower, adjust->least);
            adjust->upper = fmin(tuning->adjust[v].upper, adjust->most);
        }
    }
}

/* After a reset the window says nothing about the following steps. */
static void clear_window(tl_lock_monitor *monitor) {
    monitor->tally.steps[monitor->tally.state] += monitor->pending + monitor->part[monitor->at].steps;
    monitor->pending = 0;
    memset(monitor->part, 0, sizeof monitor->part);
    monitor->parts = 0;
    monitor->at = 0;
    monitor->u_count = 0;
    monitor->is_astray = false;
    clear_release(monitor);
}

/* ---- collecting ---- */

void tl_lock_monitor_sample(tl_lock_monitor *monitor, const tl_sample *sample) {
    tl_lock_part *part = &monitor->part[monitor->at];
    part->samples++;
    for (size_t i = 0; i < monitor->config->signal_count; i++) {
        bool is_one = !monitor->config->signals[i].is_reading; /* another look-up of the signal counts already */
        part->bad[i] += is_one && sample->quality[i] != TL_GOOD ? 1 : 0;
    }
}

static bool is_good(const tl_record *record, size_t match) {
    return record->measured_quality[match] == TL_GOOD && isfinite(record->y[match]);
}

static bool is_compared(const tl_lock_monitor *monitor, const tl_record *record) {
    bool compared = false;
    for (size_t i = 0; i < monitor->config->match_count; i++) {
        compared = compared || (current_measure(monitor, i).weight > 0.0 && is_good(record, i));
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
static double step_distance(const tl_lock_monitor *monitor, const tl_record *record) {
    double sum = 0.0;
    double weights = 0.0;
    for (size_t i = 0; i < monitor->config->match_count; i++) {
        const struct tl_lock_measure by = current_measure(monitor, i);
        if (by.weight > 0.0 && is_good(record, i)) {
            double error = (record->y[i] - record->measured[i]) / by.tolerance;
            sum += by.weight * error * error;
            weights += by.weight;
        }
    }
    return sqrt(sum / fmax(weights, 1.0)); /* weights with a sum below 1 must not make it stricter than J */
}

/* Largest factor of J with the monitor's tolerances, compared with those of the search. Infinite if
 * an output that counts has no weight in the search. */
static double larger_objective(const tl_lock_monitor *monitor) {
    double most = 1.0;
    for (size_t i = 0; i < monitor->config->match_count; i++) {
        const struct tl_lock_measure own = measure_of(monitor->config, i);
        const struct tl_lock_measure by = current_measure(monitor, i);
        double wider = own.tolerance / by.tolerance;
        double larger = wider * wider * by.weight / own.weight;
        if (by.weight > 0.0 && !(larger <= most)) {
            most = isnan(larger) ? HUGE_VAL : larger;
        }
    }
    return most;
}

/* The error of a stroke is that of its search. It is within tolerance if the search ended within
 * tolerance. */
static double stroke_distance(const tl_lock_monitor *monitor, const tl_record *record) {
    double larger = monitor->tolerances == NULL ? 1.0 : larger_objective(monitor);
    double size = sqrt(larger * record->objective);
    bool within =
        (record->outcome == TL_FIRST_GUESS || record->outcome == TL_OPTIMISED) && (larger <= 1.0 || size < 1.0);
    return within ? 0.0 : size < 1.0 ? 1.0 : size;
}

/* Adds the error to the part, and returns it. */
static double add_distance(const tl_lock_monitor *monitor, const tl_record *record, tl_lock_part *part) {
    double away = has_strokes(monitor->config) ? stroke_distance(monitor, record) : step_distance(monitor, record);
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

static bool has_run_away(const tl_record *record, double away) {
    return !(away < RUNAWAY) || (has_objective(record) && !isfinite(record->objective));
}

/* At a bound, and further from nominal than a negligible distance. */
static bool is_at_bound(const tl_account_adjust *adjust, double u, double nominal) {
    bool is_there = u <= adjust->lower || u >= adjust->upper;
    return is_there && fabs(u - nominal) > NEGLIGIBLE * adjust->step;
}

static void add_bounds(tl_lock_monitor *monitor, size_t v, const tl_record *record, tl_lock_part *part) {
    bool is_there = is_at_bound(&monitor->adjust[v], record->u[v], record->nominal[v]);
    part->at_bound[v] += is_there ? 1 : 0;
    tl_bound_stay_step(&monitor->stay[v], tl_time_of_step(0, monitor->config->step, record->step), is_there);
}

static void add_cycle(const tl_lock_monitor *monitor, size_t v, uint32_t cycling[TL_LOCK_PERIODS + 1]) {
    double least = monitor->u[0][v];
    double most = least;
    for (uint32_t period = 1; period <= TL_LOCK_PERIODS && period < monitor->u_count; period++) {
        double then = monitor->u[period][v];
        double range = most - least; /* range of u in the steps in between */
        if (period > 1 && range >= monitor->adjust[v].step && fabs(monitor->u[0][v] - then) <= SAME_PLACE * range) {
            cycling[period]++;
        }
        least = then < least ? then : least;
        most = then > most ? then : most;
    }
}

static void widen_range(tl_lock_range *range, double value, bool first) {
    range->least = first || value < range->least ? value : range->least;
    range->most = first || value > range->most ? value : range->most;
}

/* Returns true if a matched output moved far in one step, and much further than its measurement
 * moves. */
static bool has_jumped(const tl_lock_monitor *monitor, size_t i, const tl_record *record) {
    const struct tl_lock_measure by = current_measure(monitor, i);
    double simulated = fabs(record->y[i] - monitor->y[i]);
    bool far = !(simulated < FAR_AWAY * by.tolerance) && !(simulated < MUCH_MORE * monitor->stride[i]);
    return far && by.weight > 0.0 && is_good(record, i) && isfinite(monitor->y[i]);
}

static void add_outputs(tl_lock_monitor *monitor, const tl_record *record, tl_lock_part *part) {
    bool jumped = false;
    for (size_t i = 0; i < monitor->config->match_count && monitor->u_count != 0; i++) {
        double step = fabs(record->measured[i] - monitor->measured[i]);
        double faded = FADING * monitor->stride[i];
        monitor->stride[i] =
            step > faded ? step : faded; /* decays slowly, because readings do not change between two messages */
        jumped = has_jumped(monitor, i, record) || jumped;
    }
    part->jumps += jumped ? 1 : 0;
    memcpy(monitor->y, record->y, monitor->config->match_count * sizeof record->y[0]);
    memcpy(monitor->measured, record->measured, monitor->config->match_count * sizeof record->measured[0]);
}

static void add_corrections(tl_lock_monitor *monitor, const tl_record *record, tl_lock_part *part) {
    size_t count = monitor->config->adjust_count;
    memmove(monitor->u[1], monitor->u[0], sizeof monitor->u - sizeof monitor->u[0]);
    memcpy(monitor->u[0], record->u, count * sizeof record->u[0]);
    monitor->u_count += monitor->u_count <= TL_LOCK_PERIODS ? 1 : 0;
    for (size_t v = 0; v < count; v++) {
        double u = record->u[v];
        widen_range(&part->u[v], u, part->steps == 0);
        if (is_real(monitor, v)) {
            add_bounds(monitor, v, record, part);
            add_cycle(monitor, v, part->cycling[v]);
        }
    }
}

/* ---- limits ---- */

static double share_of(uint32_t count, uint32_t of) {
    return of == 0 ? 0.0 : (double)count / (double)of;
}

static bool is_beyond(double value, const limit *of, bool inside) {
    return value >= (inside ? of->leave : of->enter);
}

/* ---- release check ---- */

static double square_of(double error) {
    return error * error < RUNAWAY ? error * error : RUNAWAY; /* also for NaN */
}

/* At rest the twin itself is as good as a released one. */
static void add_release(tl_lock_monitor *monitor, const tl_record *record) {
    tl_release_check *release = &monitor->release;
    bool has_released = record->release_age >= release->block;
    bool is_old = has_released || release->rests;
    const double *released = has_released ? record->released : record->y;
    release->first = release->steps == 0 ? record->step : release->first;
    release->steps++;
    release->released += is_old ? 1 : 0;
    for (size_t i = 0; i < monitor->config->match_count && is_old; i++) {
        const struct tl_lock_measure by = current_measure(monitor, i);
        if (by.weight > 0.0 && is_good(record, i)) {
            release->squares[0][i] += square_of((record->y[i] - record->measured[i]) / by.tolerance);
            release->squares[1][i] += square_of((released[i] - record->measured[i]) / by.tolerance);
            release->counted[i]++;
        }
    }
    for (size_t v = 0; v < monitor->config->adjust_count; v++) {
        const tl_account_adjust *adjust = &monitor->adjust[v];
        release->correction[v] += record->u[v] - record->nominal[v];
        release->excess[v] +=
            record->u[v] - tl_approved_u(record->nominal[v], monitor->approved[v], adjust->lower, adjust->upper);
    }
}

/* Errors of the block; the weights are those of a step's error. */
static void find_release_errors(tl_lock_monitor *monitor) {
    tl_release_check *release = &monitor->release;
    double sum[2] = {0.0, 0.0};
    double weights = 0.0;
    release->worst_error = 0.0;
    for (size_t i = 0; i < monitor->config->match_count; i++) {
        const struct tl_lock_measure by = current_measure(monitor, i);
        if (by.weight > 0.0 && release->counted[i] != 0) {
            double mean = release->squares[1][i] / release->counted[i];
            sum[0] += by.weight * release->squares[0][i] / release->counted[i];
            sum[1] += by.weight * mean;
            weights += by.weight;
            release->worst = sqrt(mean) > release->worst_error ? i : release->worst;
            release->worst_error = fmax(release->worst_error, sqrt(mean));
        }
    }
    release->error[0] = sqrt(sum[0] / fmax(weights, 1.0));
    release->error[1] = sqrt(sum[1] / fmax(weights, 1.0));
}

/* Largest mean excess of the block, in steps of the search. */
static double find_excess(tl_lock_monitor *monitor) {
    tl_release_check *release = &monitor->release;
    double most = 0.0;
    for (size_t v = 0; v < monitor->config->adjust_count; v++) {
        bool counts = is_real(monitor, v) && monitor->adjust[v].step > 0.0;
        double excess = counts ? fabs(release->excess[v]) / release->steps / monitor->adjust[v].step : 0.0;
        release->strongest = excess > most ? v : release->strongest;
        most = fmax(most, excess);
    }
    release->mean = release->correction[release->strongest] / release->steps;
    return most;
}

static bool may_rest(const tl_lock_monitor *monitor) {
    const tl_config *config = monitor->config;
    bool may = config->rests && !config->free_twin;
    for (size_t v = 0; v < config->adjust_count; v++) {
        may = may && !(monitor->approved[v] < 0.0 || monitor->approved[v] > 0.0);
    }
    return may;
}

static void assess_harm(tl_lock_monitor *monitor) {
    tl_release_check *release = &monitor->release;
    bool is_worse = release->error[0] > HARM * release->error[1] + HARM_FLOOR;
    release->in_a_row = is_worse != release->is_worse ? release->in_a_row + 1 : 0;
    if (release->in_a_row == TL_RELEASE_SURE) {
        release->is_worse = is_worse;
        release->in_a_row = 0;
        release->turn = is_worse ? TL_RELEASE_WORSE : TL_RELEASE_BETTER;
        release->rests = is_worse && may_rest(monitor);
        release->before = release->error[0];
        release->rested = 0;
    }
}

/* A twin at rest equals its released twin, so its error before the rest is what counts. */
static void assess_rest(tl_release_check *release) {
    release->rested++;
    bool is_far = release->rested > BLOCKS && !(release->error[0] <= HARM * release->before + HARM_FLOOR);
    release->in_a_row = is_far ? release->in_a_row + 1 : 0;
    if (release->in_a_row == TL_RELEASE_BACK) {
        release->rests = false;
        release->is_worse = false;
        release->in_a_row = 0;
        release->turn = TL_RELEASE_ENDS;
    }
}

/* For this long the state `corrected` lasts at least. */
static tl_time corrected_for(const tl_lock_monitor *monitor) {
    tl_time release = tl_time_of_step(0, monitor->config->step, BLOCKS * (int64_t)monitor->release.block);
    return release > CORRECTED_FOR ? release : CORRECTED_FOR;
}

/* `reason`: with its value. */
static void begin_corrected(tl_lock_monitor *monitor, const tl_lock_standing *reason, const char *variable,
                            const char *unit) {
    tl_release_check *release = &monitor->release;
    release->since = release->is_corrected ? release->since : release->first;
    release->is_corrected = true;
    release->corrected_at = release->last_step;
    release->standing = *reason;
    (void)snprintf(release->standing.variable, TL_LOCK_VARIABLE, "%.*s", TL_LOCK_VARIABLE - 1, variable);
    (void)snprintf(release->standing.unit, TL_LOCK_UNIT, "%.*s", TL_LOCK_UNIT - 1, unit);
}

/* A standing correction is the reason that a person can approve, so it comes first. */
static void begin_corrected_block(tl_lock_monitor *monitor) {
    const tl_release_check *release = &monitor->release;
    size_t v = release->strongest;
    size_t i = release->worst;
    if (release->has_excess) {
        const tl_lock_standing reason = {.reason = TL_LOCK_REASON_CORRECTION, .value = release->mean};
        begin_corrected(monitor, &reason, monitor->config->adjust[v].variable, monitor->adjust[v].unit);
    } else {
        const tl_lock_standing reason = {.reason = TL_LOCK_REASON_RELEASED,
                                         .value = release->worst_error * current_measure(monitor, i).tolerance};
        begin_corrected(monitor, &reason, monitor->config->match[i].variable, monitor->unit[i]);
    }
}

static double seconds_of_step(const tl_lock_monitor *monitor, int64_t step) {
    return tl_seconds(tl_time_of_step(0, monitor->config->step, step));
}

static void find_standing(const tl_lock_monitor *monitor, tl_lock_standing *standing) {
    *standing = monitor->release.standing;
    standing->since_s = seconds_of_step(monitor, monitor->release.since);
    standing->now_s = seconds_of_step(monitor, monitor->release.last_step);
    standing->started = monitor->started;
}

/* At least half of the block had an old released twin: its errors count. */
static void close_block(tl_lock_monitor *monitor, int64_t step) {
    tl_release_check *release = &monitor->release;
    double excess = find_excess(monitor);
    bool is_released = 2 * release->released >= release->steps;
    release->is_off = false;
    if (is_released) {
        find_release_errors(monitor);
        release->is_off = is_beyond(release->error[1], &CORRECTED, release->is_corrected);
        if (release->rests) {
            assess_rest(release);
        } else {
            assess_harm(monitor);
        }
    }
    tl_time lasted = tl_time_of_step(0, monitor->config->step, step - release->corrected_at);
    release->has_excess = is_beyond(excess, &CORRECTED, release->is_corrected);
    if (release->is_off || release->has_excess) {
        begin_corrected_block(monitor);
    } else if (lasted >= corrected_for(monitor)) {
        release->is_corrected = false;
    }
    memset(release->squares, 0, sizeof release->squares);
    memset(release->counted, 0, sizeof release->counted);
    memset(release->correction, 0, sizeof release->correction);
    memset(release->excess, 0, sizeof release->excess);
    release->steps = 0;
    release->released = 0;
}

static void step_release(tl_lock_monitor *monitor, const tl_record *record) {
    monitor->release.turn = TL_RELEASE_AS_BEFORE;
    monitor->release.last_step = record->step;
    add_release(monitor, record);
    if (monitor->release.steps >= monitor->release.block) {
        close_block(monitor, record->step);
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
        widen_range(&all->u[v], part->u[v].least, first);
        widen_range(&all->u[v], part->u[v].most, false);
        for (int period = 0; period <= TL_LOCK_PERIODS; period++) {
            all->cycling[v][period] += part->cycling[v][period];
        }
    }
}

static void add_window(const tl_lock_monitor *monitor, window *all) {
    memset(all, 0, sizeof *all);
    for (uint32_t i = 0; i < TL_LOCK_PARTS; i++) {
        if (monitor->part[i].steps != 0) {
            add_part(&monitor->part[i], monitor->config, all);
        }
    }
}

/* ---- determining the state ---- */

static uint32_t count_compared(const tl_lock_part *all) {
    return all->steps - all->free - all->between;
}

static bool is_in(const tl_lock_monitor *monitor, tl_lock_state state) {
    return monitor->judged && monitor->tally.state == state;
}

static const char *unit_name(const tl_lock_monitor *monitor) {
    return has_strokes(monitor->config) ? "strokes" : "steps";
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
static bool assess_free(const tl_lock_monitor *monitor, const window *all, char *cause) {
    double free = share_of(count_compared(all) == 0 ? all->steps : all->free, all->steps);
    bool is_free = count_compared(all) == 0 || is_beyond(free, &FREE, is_in(monitor, TL_LOCK_FREE));
    if (is_free) {
        write_cause(cause, "no matched signal was good in %.0f %% of the last %u %s (limit %.0f %%)", HUNDRED * free,
                    (unsigned)all->steps, unit_name(monitor), HUNDRED * FREE.enter);
    }
    return is_free;
}

/* Finds the first adjusted variable whose u is in a limit cycle, and the period in steps. Returns
 * false if there is none. */
static bool find_cycle(const tl_lock_monitor *monitor, const window *all, size_t *variable, int *period) {
    for (size_t v = 0; v < monitor->config->adjust_count; v++) {
        for (int p = 2; p <= TL_LOCK_PERIODS; p++) {
            if (share_of(all->cycling[v][p], all->steps) >= IN_CYCLE) {
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
    return share_of(newest->far, compared) >= ASTRAY && share_of(newest->jumps, compared) >= ASTRAY;
}

static bool assess_lost(tl_lock_monitor *monitor, const window *all, char *cause) {
    bool inside = is_in(monitor, TL_LOCK_LOST);
    uint32_t compared = count_compared(all);
    double outside = share_of(all->outside, compared);
    double far = share_of(all->far, compared);
    size_t which = 0;
    int period = 0;
    monitor->is_astray =
        far >= ASTRAY && share_of(all->jumps, compared) >= ASTRAY && is_still_astray(&monitor->part[monitor->at]);
    bool cycles = find_cycle(monitor, all, &which, &period) && is_beyond(outside, &OUTSIDE_IN_CYCLE, inside);
    if (all->ran_away != 0) {
        write_cause(
            cause,
            "an output or J has run away: off by %.0e tolerances or more, or J not finite, in %u of the last %u "
            "%s",
            RUNAWAY, (unsigned)all->ran_away, (unsigned)all->steps, unit_name(monitor));
    } else if (is_beyond(far, &FAR_OUTSIDE, inside)) {
        write_cause(
            cause, "%.0f %% of the last %u %s are off by %.0f tolerances or more (limit %.0f %%), at worst by %.3g",
            HUNDRED * far, (unsigned)compared, unit_name(monitor), FAR_AWAY, HUNDRED * FAR_OUTSIDE.enter, all->worst);
    } else if (cycles || is_beyond(outside, &OUTSIDE, inside)) {
        write_cause(cause, "%.0f %% of the last %u %s are out of tolerance (limit %.0f %%)", HUNDRED * outside,
                    (unsigned)compared, unit_name(monitor),
                    HUNDRED * (cycles ? OUTSIDE_IN_CYCLE.enter : OUTSIDE.enter));
    } else {
        return false;
    }
    if (cycles) {
        const tl_lock_range *u = &all->u[which];
        write_cause(cause, "; %.60s swings between %.4g and %.4g every %d %s", monitor->config->adjust[which].variable,
                    u->least, u->most, period, unit_name(monitor));
    }
    return true;
}

static bool assess_degraded(const tl_lock_monitor *monitor, const window *all, char *cause) {
    if (all->differed != 0) {
        write_cause(cause, "the rollback of an FMU was not exact before %u of the last %u steps",
                    (unsigned)all->differed, (unsigned)all->steps);
        return true;
    }
    for (size_t i = 0; i < monitor->config->signal_count; i++) {
        double bad = share_of(all->bad[i], all->samples);
        if (is_beyond(bad, &BAD, is_in(monitor, TL_LOCK_DEGRADED))) {
            write_cause(cause, "plant.%.60s was not good in %.0f %% of the last %u samples (limit %.0f %%)",
                        monitor->config->signals[i].plan.name, HUNDRED * bad, (unsigned)all->samples,
                        HUNDRED * BAD.enter);
            return true;
        }
    }
    return false;
}

/* A variable at a bound counts for as long as the other reasons, so that the state does not change
 * with each stay. */
static bool assess_corrected(tl_lock_monitor *monitor, const window *all) {
    bool inside = is_in(monitor, TL_LOCK_CORRECTED);
    for (size_t v = 0; v < monitor->config->adjust_count; v++) {
        if (is_real(monitor, v) && is_beyond(share_of(all->at_bound[v], all->steps), &AT_BOUND, inside)) {
            const tl_account_adjust *adjust = &monitor->adjust[v];
            bool is_lower = monitor->u[0][v] - adjust->lower < adjust->upper - monitor->u[0][v];
            const tl_lock_standing reason = {.reason = TL_LOCK_REASON_BOUND,
                                             .value = is_lower ? adjust->lower : adjust->upper};
            begin_corrected(monitor, &reason, monitor->config->adjust[v].variable, adjust->unit);
            break;
        }
    }
    return monitor->release.is_corrected;
}

/* The reason, how to approve it, and what the corrections hide. */
static void write_corrected(const tl_lock_monitor *monitor, char *cause) {
    const tl_release_check *release = &monitor->release;
    tl_lock_standing standing;
    char text[TL_LOCK_CLAUSE];
    find_standing(monitor, &standing);
    tl_lock_standing_write(&standing, true, text);
    write_cause(cause, "%s", text);
    tl_lock_standing_write_remedy(&standing, text);
    write_cause(cause, "%s%s", text[0] == '\0' ? "" : "; ", text);
    if (release->is_off && standing.reason != TL_LOCK_REASON_RELEASED) {
        write_cause(cause, "; without it %.40s is %.3g %s off", monitor->config->match[release->worst].variable,
                    release->worst_error * current_measure(monitor, release->worst).tolerance,
                    monitor->unit[release->worst]);
    }
}

static tl_lock_state assess_window(tl_lock_monitor *monitor, const window *all, char *cause) {
    uint32_t compared = count_compared(all);
    monitor->is_astray = false;
    if (assess_free(monitor, all, cause)) {
        return TL_LOCK_FREE;
    }
    if (assess_lost(monitor, all, cause)) {
        return TL_LOCK_LOST;
    }
    if (assess_degraded(monitor, all, cause)) {
        return TL_LOCK_DEGRADED;
    }
    if (assess_corrected(monitor, all)) {
        if (cause != NULL) {
            write_corrected(monitor, cause);
        }
        return TL_LOCK_CORRECTED;
    }
    write_cause(cause, "%.0f %% of the last %u %s are within tolerance",
                HUNDRED * (1.0 - share_of(all->outside, compared)), (unsigned)compared, unit_name(monitor));
    return TL_LOCK_LOCKED;
}

/* ---- over the run ---- */

/* Returns true if the reason has another kind, another variable, or a value that differs by more
 * than a tenth. */
static bool is_other_reason(const tl_lock_standing *now, const tl_lock_standing *before) {
    return now->reason != before->reason || strcmp(now->variable, before->variable) != 0 ||
           fabs(now->value - before->value) > UPDATED * fabs(before->value);
}

/* Returns true if an update is to be reported. A first block may have begun before the correction.
 */
static bool needs_update(tl_lock_monitor *monitor, tl_lock_state state, bool changed) {
    const tl_lock_standing *now = &monitor->tally.standing;
    int64_t step = monitor->release.last_step;
    int64_t hour = UPDATE_AFTER / monitor->config->step;
    bool is_corrected = state == TL_LOCK_CORRECTED;
    bool is_update =
        is_corrected && !changed && step >= monitor->update_from && is_other_reason(now, &monitor->reported);
    if (is_corrected && (changed || step >= monitor->update_from)) {
        monitor->update_from = step + (changed ? (int64_t)monitor->release.block : hour);
    }
    if (is_update || changed) {
        monitor->reported = *now;
    }
    return is_update;
}

/* Determines the state of the window and counts the steps since the last time in it. Returns true
 * if the state has changed, or an update is to be reported. */
static bool assess_now(tl_lock_monitor *monitor) {
    window all;
    tl_lock_state before = monitor->tally.state;
    bool first = !monitor->judged;
    add_window(monitor, &all);
    tl_lock_state state = assess_window(monitor, &all, NULL);
    bool changed = first || state != before;
    monitor->tally.standing = (tl_lock_standing){.reason = TL_LOCK_REASON_NONE};
    if (state == TL_LOCK_CORRECTED) {
        find_standing(monitor, &monitor->tally.standing);
    }
    monitor->change.is_update = needs_update(monitor, state, changed);
    if (changed || monitor->change.is_update) { /* formatted only then, because this is the thread of the cycle */
        monitor->change.cause[0] = '\0';
        monitor->change.to = assess_window(monitor, &all, monitor->change.cause);
    }
    monitor->tally.steps[state] += monitor->pending;
    monitor->tally.state = state;
    monitor->pending = 0;
    monitor->judged = true;
    monitor->tally.changes += changed && !first ? 1 : 0;
    monitor->tally.losses += changed && state == TL_LOCK_LOST ? 1 : 0;
    return changed || monitor->change.is_update;
}

static bool has_window(const tl_lock_monitor *monitor) {
    return monitor->parts >= (has_strokes(monitor->config) ? (uint32_t)STROKES : (uint32_t)TL_LOCK_PARTS);
}

/* Closes the full part. Returns true if the state has changed. */
static bool close_part(tl_lock_monitor *monitor) {
    const tl_lock_part *full = &monitor->part[monitor->at];
    monitor->parts += monitor->parts < TL_LOCK_PARTS ? 1 : 0;
    monitor->pending += full->steps;
    monitor->tally.windows += has_window(monitor) ? 1 : 0;
    bool changed = has_window(monitor) && assess_now(monitor);
    monitor->at = (monitor->at + 1) % TL_LOCK_PARTS;
    memset(&monitor->part[monitor->at], 0, sizeof monitor->part[monitor->at]);
    return changed;
}

/* Returns true for a stroke whose search has ended, but not for one at nominal without a search. */
static bool is_stroke(const tl_record *record) {
    return record->outcome != TL_HELD && record->outcome != TL_SEARCHING && record->outcome != TL_CAUGHT_UP &&
           (record->outcome != TL_NOMINAL || isfinite(record->objective));
}

static bool is_counted(const tl_lock_monitor *monitor, const tl_record *record) {
    return monitor->config->adjust_count != 0 && record->outcome != TL_RESUMED &&
           (!has_strokes(monitor->config) || is_stroke(record));
}

const tl_lock_change *tl_lock_monitor_step(tl_lock_monitor *monitor, const tl_record *record) {
    if (!is_counted(monitor, record)) {
        return NULL;
    }
    if ((record->flags & TL_FLAG_RESET) != 0) {
        clear_window(monitor);
    }
    tl_lock_part *part = &monitor->part[monitor->at];
    double away = 0.0;
    if (is_compared(monitor, record)) {
        away = add_distance(monitor, record, part);
    } else if (is_searched(record)) {
        part->between++;
    } else {
        part->free++;
    }
    if (has_run_away(record, away)) {
        part->ran_away++;
        monitor->tally.ran_away++;
    }
    part->differed += (record->flags & TL_FLAG_DIFFERED) != 0 ? 1 : 0;
    add_outputs(monitor, record, part);
    add_corrections(monitor, record, part);
    step_release(monitor, record);
    tl_frozen_watch_step(&monitor->frozen, record);
    part->steps++;
    return part->steps == monitor->part_steps && close_part(monitor) ? &monitor->change : NULL;
}

void tl_lock_monitor_get(const tl_lock_monitor *monitor, tl_lock_tally *tally) {
    tl_lock_monitor last = *monitor;
    last.pending += last.part[last.at].steps;
    if ((!last.judged || last.part[last.at].ran_away != 0) && last.pending != 0) {
        (void)assess_now(&last);
    }
    last.tally.steps[last.tally.state] += last.pending;
    *tally = last.tally;
}
