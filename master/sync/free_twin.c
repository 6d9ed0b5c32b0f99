/* Free-run check: see free_twin.h. */
#include "master/sync/free_twin.h"

#include <math.h>
#include <string.h>

/* ---- free-run check ---- */

/* In tolerances: largest error that counts; and squared: a negligible difference. */
static const double MOST = 3.0;
static const double NEGLIGIBLE = 1e-3;

/* Tolerances squared: largest noise. */
static const double MOST_NOISE = 0.25;

/* Standard errors. A few are enough: if both twins are about as near, either may be used. */
static const double SURE = 1.5;

/* Errors of a resting twin, in units of a locked twin's error: allowed in a trial; largest that
 * counts in a trial; and the sum of the excesses at which u stops resting. */
static const double ALLOWED = 1.5;
static const double COUNTED = 4.0;
static const double TOO_MUCH = 4.0;

/* A square this many times the usual one is an outlier. */
static const double DISTURBED = 12.0;

/* Difference of the recent from the long average, in standard errors, that shows a change of
 * conditions. */
static const double CHANGED = 3.0;

/* Part of a prediction's error that counts as lasting in the next one. */
static const double LASTING = 0.0625;

/* A value and its standard error. */
typedef struct estimate {
    double value, error;
} estimate;

static double bounded(double error) {
    return fabs(error) <= MOST ? error : error < 0.0 ? -MOST : MOST; /* also for NaN */
}

static double product(const double *one, const double *other) {
    double sum = 0.0;
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        sum += bounded(one[i]) * bounded(other[i]);
    }
    return sum;
}

/* ---- memory ---- */

static void forget_trials(tl_free_run_check *free_run_check) {
    free_run_check->count = 0;
    free_run_check->at = 0;
    free_run_check->since = 0;
    free_run_check->lost = 0;
    free_run_check->excess = 0.0;
}

static void begin_trial(tl_free_run_check *free_run_check) {
    free_run_check->steps = 0;
    free_run_check->counted = 0;
    free_run_check->sum = (tl_free_run_check_trial){0};
}

void tl_free_run_check_reset(tl_free_run_check *free_run_check) {
    forget_trials(free_run_check);
    begin_trial(free_run_check);
    free_run_check->rests = false;
    free_run_check->follows = false;
}

static void add_trial(tl_free_run_check *free_run_check, const tl_free_run_check_trial *trial) {
    free_run_check->trial[free_run_check->at] = *trial;
    free_run_check->at = (free_run_check->at + 1) % TL_FREE_RUN_CHECK_TRIALS;
    free_run_check->count += free_run_check->count < TL_FREE_RUN_CHECK_TRIALS ? 1 : 0;
    free_run_check->since++;
}

static void add_to(tl_free_run_check_average *average, double value, uint32_t count) {
    average->mean += (value - average->mean) / count;
    average->square += (value * value - average->square) / count;
}

static void add_noise(tl_free_run_check_noise *noise, const tl_free_run_check_noise *seen, uint32_t memory) {
    noise->count += noise->count < memory ? 1 : 0;
    add_to(&noise->locked, seen->locked.mean, noise->count);
    add_to(&noise->surprise, seen->surprise.mean, noise->count);
    add_to(&noise->kept, seen->kept.mean, noise->count);
    add_to(&noise->noise, seen->noise.mean, noise->count);
}

static void subtract(const double *from, const double *what, double *rest) {
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        rest[i] = bounded(from[i]) - what[i];
    }
}

/* The plant has changed or was disturbed: the error of such a prediction is not noise. */
static bool is_disturbed(const tl_free_run_check *free_run_check, double square) {
    return free_run_check->known.count >= TL_FREE_RUN_CHECK_LEAST &&
           square > DISTURBED * free_run_check->known.surprise.mean;
}

static estimate find_average(const tl_free_run_check_average *average, uint32_t count) {
    double variance = fmax(average->square - average->mean * average->mean, 0.0);
    return (estimate){average->mean, sqrt(variance / fmax(count, 1.0))};
}

/* By how many standard errors the recent average is above the long one. */
static double rise(const tl_free_run_check_average *recent, const tl_free_run_check_average *known) {
    estimate now = find_average(recent, TL_FREE_RUN_CHECK_RECENT);
    return (now.value - known->mean) / fmax(now.error, NEGLIGIBLE);
}

/* True if conditions have changed. Model errors hide a part of the noise, so a decrease of the
 * noise is no sign of a change. An increase is one: the plant is calm again, or a sensor has become
 * worse. Better predictions are a sign, too. */
static bool has_changed(const tl_free_run_check *free_run_check) {
    return free_run_check->recent.count >= TL_FREE_RUN_CHECK_RECENT &&
           (rise(&free_run_check->recent.noise, &free_run_check->known.noise) > CHANGED ||
            rise(&free_run_check->recent.surprise, &free_run_check->known.surprise) < -CHANGED);
}

/* Learns the noise from this prediction and the one before it. */
static void learn_noise(tl_free_run_check *free_run_check, const tl_free_run_check_trial *trial,
                        const tl_free_run_check_errors *errors) {
    double now[TL_MAX_MATCH];
    double before[TL_MAX_MATCH];
    subtract(errors->predicted, free_run_check->lasting, now);
    subtract(free_run_check->before, free_run_check->lasting, before);
    double square = product(now, now);
    double kept = product(errors->locked, now);
    const tl_free_run_check_noise seen = {
        .locked = {.mean = trial->locked},
        .surprise = {.mean = square},
        .kept = {.mean = kept},
        .noise = {.mean = kept - product(now, before)},
    };
    add_noise(&free_run_check->recent, &seen, TL_FREE_RUN_CHECK_RECENT);
    if (has_changed(free_run_check)) {
        free_run_check->known = free_run_check->recent;
    } else if (!is_disturbed(free_run_check, square) && !is_disturbed(free_run_check, product(before, before))) {
        add_noise(&free_run_check->known, &seen, TL_FREE_RUN_CHECK_MEMORY);
    }
}

/* Ends a prediction if something was measured. */
static void learn(tl_free_run_check *free_run_check, const tl_free_run_check_trial *trial,
                  const tl_free_run_check_errors *errors) {
    if (free_run_check->follows) {
        learn_noise(free_run_check, trial, errors);
        for (size_t i = 0; i < TL_MAX_MATCH; i++) {
            free_run_check->lasting[i] += LASTING * (bounded(free_run_check->before[i]) - free_run_check->lasting[i]);
        }
    }
    free_run_check->follows = true;
    memcpy(free_run_check->before, errors->predicted, sizeof free_run_check->before);
}

/* ---- verdict ---- */

/* The term of the used noise: 2·g·s². */
static estimate find_gain(const tl_free_run_check *free_run_check) {
    const tl_free_run_check_noise *known = &free_run_check->known;
    double part = 1.0 - known->kept.mean / fmax(known->surprise.mean, NEGLIGIBLE);
    double twice = 2.0 * fmin(fmax(part, 0.0), 1.0);
    estimate noise = find_average(&known->noise, known->count);
    double most = MOST_NOISE * free_run_check->weight;
    double value = fmin(fmax(noise.value, 0.0), most);
    double error = fmin(noise.error, most);
    return (estimate){twice * value, twice * error};
}

/* The trial `by` places before the next one. */
static const tl_free_run_check_trial *trial_before(const tl_free_run_check *free_run_check, uint32_t by) {
    return &free_run_check->trial[(free_run_check->at + TL_FREE_RUN_CHECK_TRIALS - by) % TL_FREE_RUN_CHECK_TRIALS];
}

/* Mean excess of the twin's error over the free-running one's, or over `than` if that is not
 * negative; over the newest trials. */
static estimate find_mean(const tl_free_run_check *free_run_check, uint32_t count, double than) {
    double sum = 0.0;
    double squares = 0.0;
    for (uint32_t i = 1; i <= count; i++) {
        const tl_free_run_check_trial *trial = trial_before(free_run_check, i);
        double difference = trial->locked - (than < 0.0 ? trial->free : than);
        sum += difference;
        squares += difference * difference;
    }
    double mean = sum / count;
    double variance = fmax(squares / count - mean * mean, 0.0);
    double error = sqrt(variance / (count - 1));
    return (estimate){mean, error};
}

static bool is_more(estimate found) {
    return found.value > NEGLIGIBLE && found.value >= SURE * found.error;
}

static bool is_less(estimate found) {
    return found.value < -NEGLIGIBLE && found.value <= -SURE * found.error;
}

static estimate sum(estimate one, estimate other) {
    return (estimate){one.value + other.value, hypot(one.error, other.error)};
}

/* Excess of the lock's error over that of the free-running twin, over the newest trials. */
static estimate find_harm(const tl_free_run_check *free_run_check, uint32_t count) {
    return sum(find_mean(free_run_check, count, -1.0), find_gain(free_run_check));
}

/* Whether the free-running twin has lost for so long that it is useless. */
static bool is_useless(tl_free_run_check *free_run_check, estimate harm) {
    if (free_run_check->count < TL_FREE_RUN_CHECK_TRIALS || free_run_check->since < TL_FREE_RUN_CHECK_TRIALS) {
        return false;
    }
    free_run_check->since = 0;
    free_run_check->lost = is_less(harm) ? free_run_check->lost + 1 : 0;
    return free_run_check->lost >= TL_FREE_RUN_CHECK_LOST;
}

static void check_locked(tl_free_run_check *free_run_check, tl_free_run_check_verdict *verdict) {
    estimate harm = find_harm(free_run_check, free_run_check->count);
    if (is_more(harm)) {
        verdict->turned = true;
        verdict->adopt = find_harm(free_run_check, free_run_check->count / 4).value >
                         0.0; /* recently as well: it does not drift away */
        free_run_check->rests = true;
        free_run_check->follows = false;
        forget_trials(free_run_check);
    } else if (is_useless(free_run_check, harm)) {
        verdict->renew = true;
        forget_trials(free_run_check);
    }
}

/* Whether the resting twin is further off than a locked one would be, at once or lastingly. */
static bool is_too_far(tl_free_run_check *free_run_check, const tl_free_run_check_trial *trial) {
    estimate gain = find_gain(free_run_check);
    double usual = fmax(free_run_check->known.locked.mean + gain.value, NEGLIGIBLE);
    free_run_check->excess =
        fmax(0.0, free_run_check->excess + fmin(trial->locked / (usual + gain.error), COUNTED) - ALLOWED);
    if (free_run_check->excess > TOO_MUCH) {
        return true;
    }
    return free_run_check->count >= TL_FREE_RUN_CHECK_LEAST &&
           is_more(sum(find_mean(free_run_check, free_run_check->count, usual), (estimate){0.0, gain.error}));
}

static void check_resting(tl_free_run_check *free_run_check, const tl_free_run_check_trial *trial,
                          tl_free_run_check_verdict *verdict) {
    if (is_too_far(free_run_check, trial)) {
        verdict->turned = true;
        free_run_check->rests = false;
        forget_trials(free_run_check);
        return;
    }
    if (free_run_check->count < TL_FREE_RUN_CHECK_LEAST) {
        return;
    }
    estimate difference = find_mean(free_run_check, free_run_check->count, -1.0); /* neither twin follows the noise */
    verdict->adopt = is_more(difference) && find_mean(free_run_check, free_run_check->count / 4, -1.0).value > 0.0;
    verdict->renew = is_less(difference);
    if (verdict->adopt || verdict->renew) {
        forget_trials(free_run_check);
    }
}

/* A trial of which less than half was measured does not count. */
static void end_trial(tl_free_run_check *free_run_check, const tl_free_run_check_errors *errors, bool measured,
                      tl_free_run_check_verdict *verdict) {
    bool is_counted = 2 * free_run_check->counted >= free_run_check->guard;
    tl_free_run_check_trial trial = free_run_check->sum;
    trial.locked /= fmax(free_run_check->counted, 1.0);
    trial.free /= fmax(free_run_check->counted, 1.0);
    if (is_counted) {
        add_trial(free_run_check, &trial);
    }
    if (free_run_check->rests) {
        if (is_counted) {
            check_resting(free_run_check, &trial, verdict);
        }
    } else {
        if (is_counted && measured) {
            learn(free_run_check, &trial, errors);
        } else {
            free_run_check->follows = false;
        }
        if (free_run_check->count >= TL_FREE_RUN_CHECK_LEAST &&
            free_run_check->known.count >= TL_FREE_RUN_CHECK_LEAST) {
            check_locked(free_run_check, verdict);
        }
    }
    begin_trial(free_run_check);
    verdict->predict = !free_run_check->rests;
}

tl_free_run_check_verdict tl_free_run_check_step(tl_free_run_check *free_run_check,
                                                 const tl_free_run_check_errors *errors, bool measured) {
    tl_free_run_check_verdict verdict = {0};
    free_run_check->weight = errors->weight;
    free_run_check->steps++;
    if (measured) {
        free_run_check->counted++;
        free_run_check->sum.locked += product(errors->locked, errors->locked);
        free_run_check->sum.free += product(errors->free, errors->free);
    }
    if (free_run_check->steps >= free_run_check->guard) {
        end_trial(free_run_check, errors, measured, &verdict);
    }
    return verdict;
}

/* ---- archive ---- */

static void require_sound(const tl_free_run_check *free_run_check, tl_archive *archive) {
    tl_archive_require(archive, free_run_check->steps < free_run_check->guard &&
                                    free_run_check->counted <= free_run_check->steps);
    tl_archive_require(archive, free_run_check->count <= TL_FREE_RUN_CHECK_TRIALS &&
                                    free_run_check->at < TL_FREE_RUN_CHECK_TRIALS);
    tl_archive_require(archive, free_run_check->known.count <= TL_FREE_RUN_CHECK_MEMORY &&
                                    free_run_check->recent.count <= TL_FREE_RUN_CHECK_RECENT);
    tl_archive_require_finite(archive, free_run_check->lasting, TL_MAX_MATCH);
    tl_archive_require_finite(archive, &free_run_check->sum.locked, 2);
    tl_archive_require_finite(archive, &free_run_check->trial[0].locked, 2 * (size_t)TL_FREE_RUN_CHECK_TRIALS);
    tl_archive_require_finite(archive, &free_run_check->known.locked.mean, 8);
    tl_archive_require_finite(archive, &free_run_check->recent.locked.mean, 8);
    tl_archive_require_finite(archive, &free_run_check->excess, 1);
}

void tl_free_run_check_archive(tl_free_run_check *free_run_check, tl_archive *archive) {
    tl_archive_flag(archive, &free_run_check->rests);
    tl_archive_flag(archive, &free_run_check->follows);
    tl_archive_part(archive, free_run_check->before, sizeof free_run_check->before);
    tl_archive_part(archive, free_run_check->lasting, sizeof free_run_check->lasting);
    tl_archive_part(archive, &free_run_check->steps, sizeof free_run_check->steps);
    tl_archive_part(archive, &free_run_check->counted, sizeof free_run_check->counted);
    tl_archive_part(archive, &free_run_check->sum, sizeof free_run_check->sum);
    tl_archive_part(archive, free_run_check->trial, sizeof free_run_check->trial);
    tl_archive_part(archive, &free_run_check->count, sizeof free_run_check->count);
    tl_archive_part(archive, &free_run_check->at, sizeof free_run_check->at);
    tl_archive_part(archive, &free_run_check->since, sizeof free_run_check->since);
    tl_archive_part(archive, &free_run_check->lost, sizeof free_run_check->lost);
    tl_archive_part(archive, &free_run_check->known, sizeof free_run_check->known);
    tl_archive_part(archive, &free_run_check->recent, sizeof free_run_check->recent);
    tl_archive_part(archive, &free_run_check->excess, sizeof free_run_check->excess);
    if (tl_archive_is_loading(archive)) {
        require_sound(free_run_check, archive);
    }
}

/* ---- free-running twin ---- */

/* Of each component: the free-running twin's, the prediction's, and the twin's own. */
enum { STATES = 3 };

bool tl_free_twin_init(tl_free_twin *twin, tl_arena *arena, tl_exchange *exchange, const tl_objective *objective,
                       uint32_t guard) {
    *twin = (tl_free_twin){.objective = objective, .is_enabled = guard != 0};
    if (guard == 0) {
        return true;
    }
    twin->free_run_check.guard = guard;
    exchange->extra_states += STATES;
    return tl_side_twin_init(&twin->side, arena, exchange, objective->horizon->variables, NULL) &&
           tl_side_twin_init_state(&twin->free, arena, exchange) &&
           tl_side_twin_init_state(&twin->predicted, arena, exchange);
}

tl_status tl_free_twin_begin(tl_free_twin *twin, tl_error *error) {
    twin->is_enabled = twin->is_enabled && tl_side_twin_is_possible(twin->side.exchange);
    if (!twin->is_enabled) {
        return TL_OK;
    }
    tl_exchange_keep_always(twin->side.exchange);
    tl_free_run_check_reset(&twin->free_run_check);
    twin->predicts = true;
    tl_status status = tl_snapshot_take(&twin->free, error);
    return status == TL_OK ? tl_snapshot_take(&twin->predicted, error) : status;
}

bool tl_free_twin_rests(const tl_free_twin *twin) {
    return twin->free_run_check.rests;
}

void tl_free_twin_retune(tl_free_twin *twin) {
    twin->free_run_check = (tl_free_run_check){.guard = twin->free_run_check.guard};
    twin->predicts = false;
}

/* ---- one step of both ---- */

/* Errors of these outputs; false: nothing was measured. */
static bool measure(const tl_free_twin *twin, const tl_record *record, const double *y, double *errors) {
    const tl_objective *objective = twin->objective;
    bool measured = false;
    for (size_t i = 0; i < objective->term_count; i++) {
        const tl_objective_term *term = &objective->terms[i];
        bool is_good = term->weight > 0.0 && record->measured_quality[i] == TL_GOOD && isfinite(record->y[i]);
        errors[i] = is_good ? sqrt(term->weight) * (y[i] - record->measured[i]) / term->tolerance : 0.0;
        measured = measured || is_good;
    }
    return measured;
}

/* The same for the present outputs. */
static void measure_now(const tl_free_twin *twin, const tl_record *record, double *errors) {
    double y[TL_MAX_MATCH] = {0.0};
    for (size_t i = 0; i < twin->objective->term_count; i++) {
        y[i] = tl_objective_y(twin->objective, i);
    }
    (void)measure(twin, record, y, errors);
}

static bool are_finite(const double *errors, size_t count) {
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += fabs(errors[i]);
    }
    return isfinite(sum);
}

/* Executes the record's step of one of the two. *failed: an FMU failed or a value is not finite. */
static tl_status execute_saved(tl_free_twin *twin, tl_snapshot *one, const tl_record *record, double *errors,
                               bool *failed, tl_error *error) {
    tl_status status = tl_side_twin_step(&twin->side, one, record->step, error);
    measure_now(twin, record, errors);
    status = status == TL_OK ? tl_snapshot_take(one, error) : status;
    *failed = status != TL_OK || !are_finite(errors, twin->objective->term_count);
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* Starts a prediction (`predicts`) and restarts the free-running twin (`renews`) from the twin's
 * state, which the FMUs have. */
static tl_status start_due(tl_free_twin *twin, bool predicts, bool renews, tl_error *error) {
    tl_status status = predicts ? tl_snapshot_take(&twin->predicted, error) : TL_OK;
    twin->predicts = predicts || (twin->predicts && !twin->free_run_check.rests);
    twin->counts.renewed += renews ? 1 : 0;
    return status == TL_OK && renews ? tl_snapshot_take(&twin->free, error) : status;
}

/* Executes both from the twin's state and restores it. */
static tl_status execute_both(tl_free_twin *twin, const tl_record *record, tl_free_run_check_errors *errors,
                              bool failed[2], tl_error *error) {
    uint64_t before = twin->side.count;
    tl_status status = tl_exchange_take(twin->side.exchange, record->step + 1, error);
    status = status == TL_OK ? execute_saved(twin, &twin->free, record, errors->free, &failed[0], error) : status;
    if (status == TL_OK && twin->predicts) {
        status = execute_saved(twin, &twin->predicted, record, errors->predicted, &failed[1], error);
    }
    twin->counts.executions += twin->side.count - before;
    return status == TL_OK ? tl_exchange_return(twin->side.exchange, error) : status;
}

static double sum_of_weights(const tl_objective *objective) {
    double sum = 0.0;
    for (size_t i = 0; i < objective->term_count; i++) {
        sum += objective->terms[i].weight;
    }
    return sum;
}

static void count(tl_free_twin *twin, bool rested, const tl_free_run_check_verdict *verdict) {
    twin->counts.rested += rested ? 1 : 0;
    twin->counts.turns += verdict->turned && !rested ? 1 : 0;
    twin->counts.adopted += verdict->adopt ? 1 : 0;
}

tl_status tl_free_twin_follow(tl_free_twin *twin, const tl_record *record, tl_free_run_check_verdict *verdict,
                              tl_error *error) {
    tl_free_run_check_errors errors = {.weight = sum_of_weights(twin->objective)};
    bool failed[2] = {false, false};
    *verdict = (tl_free_run_check_verdict){0};
    bool rested = twin->free_run_check.rests;
    bool measured = measure(twin, record, record->y, errors.locked);
    tl_status status = execute_both(twin, record, &errors, failed, error);
    if (status != TL_OK) {
        return status;
    }
    if (!rested && (!twin->predicts || failed[1])) { /* nothing can be compared yet, or any more */
        tl_free_run_check_reset(&twin->free_run_check);
        return start_due(twin, true, failed[0], error);
    }
    *verdict = tl_free_run_check_step(&twin->free_run_check, &errors, measured);
    count(twin, rested, verdict);
    if (verdict->adopt) {
        twin->predicts = false;
        return tl_snapshot_restore(&twin->free, error);
    }
    return start_due(twin, verdict->predict, verdict->renew || failed[0], error);
}

tl_status tl_free_twin_archive(tl_free_twin *twin, tl_archive *archive, tl_error *error) {
    if (!twin->is_enabled) {
        return TL_OK;
    }
    tl_free_run_check_archive(&twin->free_run_check, archive);
    tl_archive_flag(archive, &twin->predicts);
    tl_status status = tl_snapshot_archive(&twin->free, archive, error);
    return status == TL_OK ? tl_snapshot_archive(&twin->predicted, archive, error) : status;
}

void tl_free_twin_end_component(tl_free_twin *twin, size_t component) {
    tl_snapshot_forget(&twin->free, component);
    tl_snapshot_forget(&twin->predicted, component);
}
