/* Which of two twins is nearer to the plant: see contest.h. */
#include "master/sync/contest.h"

#include <math.h>
#include <string.h>

/* Tolerances: what an error counts at most; and squared: what makes no difference. */
static const double MOST = 3.0;
static const double NEGLIGIBLE = 1e-3;

/* Tolerances, squared: what noise is at most. */
static const double MOST_NOISE = 0.25;

/* Standard errors. Few are enough: if both are about as near, it does not matter which is taken. */
static const double SURE = 1.5;

/* A twin that rests: in units of what a locked one would be off, what a trial may have and what it counts at most; and the sum at which it rests no more. */
static const double ALLOWED = 1.5;
static const double COUNTED = 4.0;
static const double TOO_MUCH = 4.0;

/* A square so many times the usual one is no usual one. */
static const double UPSET = 12.0;

/* Standard errors by which an average of late differs from the one over all that is remembered if times have changed. */
static const double CHANGED = 3.0;

/* What of a prediction's error is taken to be lasting, by the next one. */
static const double LASTING = 0.0625;

/* A value, and its standard error. */
typedef struct estimate {
    double value, error;
} estimate;

static double bounded(double error) {
    return fabs(error) <= MOST ? error : error < 0.0 ? -MOST : MOST; /* also what is not a number */
}

static double product(const double *one, const double *other) {
    double sum = 0.0;
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        sum += bounded(one[i]) * bounded(other[i]);
    }
    return sum;
}

/* ---- what is remembered ---- */

static void forget_trials(tl_contest *contest) {
    contest->count = 0;
    contest->at = 0;
    contest->since = 0;
    contest->lost = 0;
    contest->excess = 0.0;
}

static void begin_trial(tl_contest *contest) {
    contest->steps = 0;
    contest->counted = 0;
    contest->sum = (tl_contest_trial){0};
}

void tl_contest_begin_anew(tl_contest *contest) {
    forget_trials(contest);
    begin_trial(contest);
    contest->rests = false;
    contest->follows = false;
}

static void remember(tl_contest *contest, const tl_contest_trial *trial) {
    contest->trial[contest->at] = *trial;
    contest->at = (contest->at + 1) % TL_CONTEST_TRIALS;
    contest->count += contest->count < TL_CONTEST_TRIALS ? 1 : 0;
    contest->since++;
}

static void add_to(tl_contest_average *average, double value, uint32_t count) {
    average->mean += (value - average->mean) / count;
    average->square += (value * value - average->square) / count;
}

static void add(tl_contest_noise *noise, const tl_contest_noise *seen, uint32_t memory) {
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

/* The plant has changed, or was upset: what a prediction was off by then is no noise. */
static bool is_upset(const tl_contest *contest, double square) {
    return contest->known.count >= TL_CONTEST_LEAST && square > UPSET * contest->known.surprise.mean;
}

static estimate find_average(const tl_contest_average *average, uint32_t count) {
    double variance = fmax(average->square - average->mean * average->mean, 0.0);
    return (estimate){average->mean, sqrt(variance / fmax(count, 1.0))};
}

/* By how many standard errors the average of late is above the one over all that is remembered. */
static double rise(const tl_contest_average *recent, const tl_contest_average *known) {
    estimate now = find_average(recent, TL_CONTEST_RECENT);
    return (now.value - known->mean) / fmax(now.error, NEGLIGIBLE);
}

/* What was so before is so no more. What a model does not know hides some of the noise, so that less of it is no news; more of it is: the plant is calm again, or a sensor has
 * become worse. Predictions that are better tell of either, too. */
static bool has_changed(const tl_contest *contest) {
    return contest->recent.count >= TL_CONTEST_RECENT &&
           (rise(&contest->recent.noise, &contest->known.noise) > CHANGED ||
            rise(&contest->recent.surprise, &contest->known.surprise) < -CHANGED);
}

/* Of this prediction, and of the one before it. */
static void learn_noise(tl_contest *contest, const tl_contest_trial *trial, const tl_contest_errors *errors) {
    double now[TL_MAX_MATCH];
    double before[TL_MAX_MATCH];
    subtract(errors->predicted, contest->lasting, now);
    subtract(contest->before, contest->lasting, before);
    double square = product(now, now);
    double kept = product(errors->locked, now);
    const tl_contest_noise seen = {
        .locked = {.mean = trial->locked},
        .surprise = {.mean = square},
        .kept = {.mean = kept},
        .noise = {.mean = kept - product(now, before)},
    };
    add(&contest->recent, &seen, TL_CONTEST_RECENT);
    if (has_changed(contest)) {
        contest->known = contest->recent;
    } else if (!is_upset(contest, square) && !is_upset(contest, product(before, before))) {
        add(&contest->known, &seen, TL_CONTEST_MEMORY);
    }
}

/* A prediction has ended where something was measured. */
static void learn(tl_contest *contest, const tl_contest_trial *trial, const tl_contest_errors *errors) {
    if (contest->follows) {
        learn_noise(contest, trial, errors);
        for (size_t i = 0; i < TL_MAX_MATCH; i++) {
            contest->lasting[i] += LASTING * (bounded(contest->before[i]) - contest->lasting[i]);
        }
    }
    contest->follows = true;
    memcpy(contest->before, errors->predicted, sizeof contest->before);
}

/* ---- what it says ---- */

/* What is to be taken off for the noise that was followed: 2·g·s². */
static estimate find_gain(const tl_contest *contest) {
    const tl_contest_noise *known = &contest->known;
    double part = 1.0 - known->kept.mean / fmax(known->surprise.mean, NEGLIGIBLE);
    double twice = 2.0 * fmin(fmax(part, 0.0), 1.0);
    estimate noise = find_average(&known->noise, known->count);
    double most = MOST_NOISE * contest->weight;
    double value = fmin(fmax(noise.value, 0.0), most);
    double error = fmin(noise.error, most);
    return (estimate){twice * value, twice * error};
}

/* The trial that was so many before the next one. */
static const tl_contest_trial *back(const tl_contest *contest, uint32_t by) {
    return &contest->trial[(contest->at + TL_CONTEST_TRIALS - by) % TL_CONTEST_TRIALS];
}

/* The mean of what the twin is further off than the free one, or than `than` if that is not negative; over the newest trials. */
static estimate find_mean(const tl_contest *contest, uint32_t count, double than) {
    double sum = 0.0;
    double squares = 0.0;
    for (uint32_t i = 1; i <= count; i++) {
        const tl_contest_trial *trial = back(contest, i);
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

/* What the lock does worse than the free twin, over the newest trials. */
static estimate find_harm(const tl_contest *contest, uint32_t count) {
    return sum(find_mean(contest, count, -1.0), find_gain(contest));
}

/* Whether the free twin has lost for so long that it is of no use. */
static bool is_useless(tl_contest *contest, estimate harm) {
    if (contest->count < TL_CONTEST_TRIALS || contest->since < TL_CONTEST_TRIALS) {
        return false;
    }
    contest->since = 0;
    contest->lost = is_less(harm) ? contest->lost + 1 : 0;
    return contest->lost >= TL_CONTEST_LOST;
}

static void judge_locked(tl_contest *contest, tl_contest_verdict *verdict) {
    estimate harm = find_harm(contest, contest->count);
    if (is_more(harm)) {
        verdict->turned = true;
        verdict->adopt =
            find_harm(contest, contest->count / 4).value > 0.0; /* of late as well: it does not drift away */
        contest->rests = true;
        contest->follows = false;
        forget_trials(contest);
    } else if (is_useless(contest, harm)) {
        verdict->renew = true;
        forget_trials(contest);
    }
}

/* Further off than a locked one would be, all at once or for long. */
static bool is_too_far(tl_contest *contest, const tl_contest_trial *trial) {
    estimate gain = find_gain(contest);
    double usual = fmax(contest->known.locked.mean + gain.value, NEGLIGIBLE);
    contest->excess = fmax(0.0, contest->excess + fmin(trial->locked / (usual + gain.error), COUNTED) - ALLOWED);
    if (contest->excess > TOO_MUCH) {
        return true;
    }
    return contest->count >= TL_CONTEST_LEAST &&
           is_more(sum(find_mean(contest, contest->count, usual), (estimate){0.0, gain.error}));
}

static void judge_resting(tl_contest *contest, const tl_contest_trial *trial, tl_contest_verdict *verdict) {
    if (is_too_far(contest, trial)) {
        verdict->turned = true;
        contest->rests = false;
        forget_trials(contest);
        return;
    }
    if (contest->count < TL_CONTEST_LEAST) {
        return;
    }
    estimate difference = find_mean(contest, contest->count, -1.0); /* neither has followed any noise */
    verdict->adopt = is_more(difference) && find_mean(contest, contest->count / 4, -1.0).value > 0.0;
    verdict->renew = is_less(difference);
    if (verdict->adopt || verdict->renew) {
        forget_trials(contest);
    }
}

/* A trial of which less than half could be measured says nothing. */
static void end_trial(tl_contest *contest, const tl_contest_errors *errors, bool measured,
                      tl_contest_verdict *verdict) {
    bool says = 2 * contest->counted >= contest->guard;
    tl_contest_trial trial = contest->sum;
    trial.locked /= fmax(contest->counted, 1.0);
    trial.free /= fmax(contest->counted, 1.0);
    if (says) {
        remember(contest, &trial);
    }
    if (contest->rests) {
        if (says) {
            judge_resting(contest, &trial, verdict);
        }
    } else {
        if (says && measured) {
            learn(contest, &trial, errors);
        } else {
            contest->follows = false;
        }
        if (contest->count >= TL_CONTEST_LEAST && contest->known.count >= TL_CONTEST_LEAST) {
            judge_locked(contest, verdict);
        }
    }
    begin_trial(contest);
    verdict->predict = !contest->rests;
}

tl_contest_verdict tl_contest_step(tl_contest *contest, const tl_contest_errors *errors, bool measured) {
    tl_contest_verdict verdict = {0};
    contest->weight = errors->weight;
    contest->steps++;
    if (measured) {
        contest->counted++;
        contest->sum.locked += product(errors->locked, errors->locked);
        contest->sum.free += product(errors->free, errors->free);
    }
    if (contest->steps >= contest->guard) {
        end_trial(contest, errors, measured, &verdict);
    }
    return verdict;
}

/* ---- as bytes ---- */

static void require_sound(const tl_contest *contest, tl_archive *archive) {
    tl_archive_require(archive, contest->steps < contest->guard && contest->counted <= contest->steps);
    tl_archive_require(archive, contest->count <= TL_CONTEST_TRIALS && contest->at < TL_CONTEST_TRIALS);
    tl_archive_require(archive,
                       contest->known.count <= TL_CONTEST_MEMORY && contest->recent.count <= TL_CONTEST_RECENT);
    tl_archive_require_finite(archive, contest->lasting, TL_MAX_MATCH);
    tl_archive_require_finite(archive, &contest->sum.locked, 2);
    tl_archive_require_finite(archive, &contest->trial[0].locked, 2 * (size_t)TL_CONTEST_TRIALS);
    tl_archive_require_finite(archive, &contest->known.locked.mean, 8);
    tl_archive_require_finite(archive, &contest->recent.locked.mean, 8);
    tl_archive_require_finite(archive, &contest->excess, 1);
}

void tl_contest_archive(tl_contest *contest, tl_archive *archive) {
    tl_archive_flag(archive, &contest->rests);
    tl_archive_flag(archive, &contest->follows);
    tl_archive_part(archive, contest->before, sizeof contest->before);
    tl_archive_part(archive, contest->lasting, sizeof contest->lasting);
    tl_archive_part(archive, &contest->steps, sizeof contest->steps);
    tl_archive_part(archive, &contest->counted, sizeof contest->counted);
    tl_archive_part(archive, &contest->sum, sizeof contest->sum);
    tl_archive_part(archive, contest->trial, sizeof contest->trial);
    tl_archive_part(archive, &contest->count, sizeof contest->count);
    tl_archive_part(archive, &contest->at, sizeof contest->at);
    tl_archive_part(archive, &contest->since, sizeof contest->since);
    tl_archive_part(archive, &contest->lost, sizeof contest->lost);
    tl_archive_part(archive, &contest->known, sizeof contest->known);
    tl_archive_part(archive, &contest->recent, sizeof contest->recent);
    tl_archive_part(archive, &contest->excess, sizeof contest->excess);
    if (tl_archive_is_loading(archive)) {
        require_sound(contest, archive);
    }
}
