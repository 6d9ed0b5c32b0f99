/* Score test: see score_test.h. */
#include "firmware/monitor/score_test.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ORDER = 4, BLOCKS_OF_ORDER = 10, ITERATIONS = 10, HALVINGS = 4, ONSETS = 4 };

/* Deviation of noise, in parts of the largest measured value, if the residual has none. */
static const double LEAST_NOISE = 1e-7;
/* Part of the best fall of χ² from which a candidate is fitted; how many are fitted anyway. */
static const double PROMISING = 0.2;
enum { FITTED_LEAST = 8 };
/* UNEXPLAINED: the best one leaves this many times the noise, and so many standard errors more. */
static const double MUCH_MORE = 2.0;
static const double SURELY_MORE = 6.0;
static const double LONGEST_WAIT = 100.0;
/* Least part of a direction that is not in the basis yet. */
static const double NEW_PART = 1e-3;

typedef struct whitener {
    double a[ORDER];
    int order;
    double scale; /* 1/σ */
} whitener;

typedef struct scorer {
    const tl_score_test *test;
    size_t outputs, block, blocks, size; /* size: blocks · outputs */
    size_t learn, before, after;         /* blocks: of the noise, and from the onset's range on */
    size_t learnt, counted;              /* independent samples before and after */
    whitener *whitener;
    bool *is_there;
    double *steps; /* a prediction, by steps */
    double *basis; /* orthonormal: whitened effects of errors that last for the whole window */
    size_t basis_size;
    double *residual; /* whitened, without a change */
    double *work;
    double *score; /* of all candidates */
    bool *is_scored;
} scorer;

static double dot(const double *a, const double *b, size_t count) {
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* ---- blocks and whitening ---- */

/* Block means of a − b, over the steps that have a measurement. */
static void average(const scorer *self, const double *a, const double *b, double *means) {
    const double *measured = self->test->window.measured;
    for (size_t i = 0; i < self->size; i++) {
        size_t first = i / self->outputs * self->block * self->outputs + i % self->outputs;
        size_t count = 0;
        double sum = 0.0;
        for (size_t k = 0; k < self->block; k++) {
            size_t at = first + k * self->outputs;
            bool is_there = !isnan(measured[at]);
            sum += is_there ? a[at] - b[at] : 0.0;
            count += is_there ? 1 : 0;
        }
        self->is_there[i] = count != 0;
        means[i] = count != 0 ? sum / (double)count : 0.0;
    }
}

/* Filters one output in place. Blocks without all their predecessors become 0, also those before
 * the noise is learnt. Returns how many remain from block `from` on. */
static size_t filter(const scorer *self, size_t output, double *means, size_t from) {
    const whitener *own = &self->whitener[output];
    size_t count = 0;
    for (size_t block = self->blocks; block-- > 0;) {
        size_t at = block * self->outputs + output;
        double value = means[at];
        bool is_there = block >= self->learn + (size_t)own->order && self->is_there[at];
        for (int k = 1; k <= own->order && is_there; k++) {
            size_t earlier = at - (size_t)k * self->outputs;
            is_there = self->is_there[earlier];
            value -= own->a[k - 1] * means[earlier];
        }
        means[at] = is_there ? value * own->scale : 0.0;
        count += is_there && block >= from ? 1 : 0;
    }
    return count;
}

/* Projects the basis out. */
static void project(const scorer *self, double *white) {
    for (size_t i = 0; i < self->basis_size; i++) {
        const double *direction = self->basis + i * self->size;
        double part = dot(white, direction, self->size);
        for (size_t k = 0; k < self->size; k++) {
            white[k] -= part * direction[k];
        }
    }
}

/* Whitens a − b. */
static void whiten(const scorer *self, const double *a, const double *b, double *white) {
    average(self, a, b, white);
    for (size_t output = 0; output < self->outputs; output++) {
        (void)filter(self, output, white, 0);
    }
    project(self, white);
}

/* Adds a whitened direction that was projected once, unless little of it is new. */
static void add_direction(scorer *self, double before, double *direction) {
    project(self, direction); /* again: rounding */
    double square = dot(direction, direction, self->size);
    if (square > NEW_PART * before && isfinite(square)) {
        for (size_t k = 0; k < self->size; k++) {
            self->basis[self->basis_size * self->size + k] = direction[k] / sqrt(square);
        }
        self->basis_size++;
    }
}

/* Levinson and Durbin. Returns the variance of the innovation. */
static double fit_order(const double covariance[ORDER + 1], int order, double a[ORDER]) {
    double variance = covariance[0];
    for (int m = 1; m <= order && variance > 0.0; m++) {
        double old[ORDER];
        double sum = covariance[m];
        memcpy(old, a, sizeof old);
        for (int k = 1; k < m; k++) {
            sum -= old[k - 1] * covariance[m - k];
        }
        double reflection = sum / variance;
        a[m - 1] = reflection;
        for (int k = 1; k < m; k++) {
            a[k - 1] = old[k - 1] - reflection * old[m - k - 1];
        }
        variance *= 1.0 - reflection * reflection;
    }
    return variance;
}

/* `means`: block means of the residual. */
static void learn_noise(scorer *self, size_t output, const double *means, double largest) {
    whitener *own = &self->whitener[output];
    double covariance[ORDER + 1] = {0.0};
    double sum = 0.0;
    size_t count = 0;
    for (size_t block = self->learn; block < self->before; block++) {
        bool is_there = self->is_there[block * self->outputs + output];
        sum += is_there ? means[block * self->outputs + output] : 0.0;
        count += is_there ? 1 : 0;
    }
    double mean = count != 0 ? sum / (double)count : 0.0;
    for (size_t lag = 0; lag <= ORDER; lag++) {
        for (size_t block = self->learn + lag; block < self->before; block++) {
            size_t at = block * self->outputs + output;
            size_t earlier = at - lag * self->outputs;
            bool are_there = self->is_there[at] && self->is_there[earlier];
            covariance[lag] += are_there ? (means[at] - mean) * (means[earlier] - mean) / (double)count : 0.0;
        }
    }
    own->order = count / BLOCKS_OF_ORDER < ORDER ? (int)(count / BLOCKS_OF_ORDER) : ORDER;
    double variance = fit_order(covariance, own->order, own->a);
    double least = LEAST_NOISE * largest;
    own->scale = 1.0 / fmax(sqrt(fmax(variance, 0.0)), least > 0.0 ? least : LEAST_NOISE);
}

static double find_largest(const scorer *self, size_t output) {
    double largest = 0.0;
    for (size_t i = output; i < self->test->window.steps * self->outputs; i += self->outputs) {
        largest = fmax(largest, fabs(self->test->window.measured[i]));
    }
    return largest;
}

static size_t count_after(const scorer *self, size_t output) {
    size_t count = 0;
    for (size_t block = self->after; block < self->blocks; block++) {
        count += self->is_there[block * self->outputs + output] ? 1 : 0;
    }
    return count;
}

/* Also adds the constant of each output to the basis. */
static void learn_all(scorer *self) {
    const tl_score_window *window = &self->test->window;
    average(self, window->measured, window->predicted, self->work);
    for (size_t output = 0; output < self->outputs; output++) {
        learn_noise(self, output, self->work, find_largest(self, output));
    }
    for (size_t output = 0; output < self->outputs; output++) {
        for (size_t i = 0; i < self->size; i++) {
            self->work[i] = i % self->outputs == output ? 1.0 : 0.0;
        }
        self->learnt += filter(self, output, self->work, 0);
        self->counted += count_after(self, output);
        add_direction(self, 0.0, self->work);
    }
    self->learnt -= self->counted < self->learnt ? self->counted : self->learnt;
}

static double squares_after(const scorer *self, const double *white) {
    size_t from = self->after * self->outputs;
    return dot(white + from, white + from, self->size - from);
}

/* ---- scores ---- */

static bool predict(const scorer *self, size_t candidate, double size, size_t onset) {
    return self->test->predict(self->test->context, candidate, size, onset, self->steps);
}

static bool has_stopped(const scorer *self) {
    return self->test->stop != NULL && self->test->stop(self->test->context);
}

/* Adds what a candidate does if it acts in the whole window: it is an error of the model, and no
 * change. Without this, a parameter that is 3 % off looks like a change at any time. */
static void add_standing(scorer *self, size_t index, const tl_score_candidate *candidate) {
    if (!candidate->is_level && predict(self, index, candidate->probe, 0)) {
        average(self, self->steps, self->test->window.predicted, self->work);
        for (size_t output = 0; output < self->outputs; output++) {
            (void)filter(self, output, self->work, 0);
        }
        double before = dot(self->work, self->work, self->size);
        project(self, self->work);
        add_direction(self, before, self->work);
    }
}

/* Returns the fall of χ². */
static double score_one(const scorer *self, size_t index, tl_score_candidate *candidate) {
    double *score = self->score + index * self->size;
    candidate->onset = (double)self->test->window.onset;
    candidate->noticeable = (double)INFINITY;
    candidate->alike = index;
    candidate->failed = !predict(self, index, candidate->probe, self->test->window.onset);
    if (candidate->failed || candidate->is_level) {
        return 0.0;
    }
    whiten(self, self->steps, self->test->window.predicted, score);
    double square = dot(score, score, self->size) / (candidate->probe * candidate->probe);
    double product = dot(score, self->residual, self->size) / candidate->probe;
    candidate->failed = !(square > 0.0) || !isfinite(square);
    if (candidate->failed) {
        return 0.0;
    }
    self->is_scored[index] = true;
    candidate->size = fmin(fmax(product / square, candidate->least), candidate->most);
    candidate->spread = 1.0 / sqrt(square);
    candidate->noticeable = sqrt(TL_SCORE_NOTICED / square);
    return product * product / square;
}

/* The cosine of two effects; 0 if one has no score. */
static double find_likeness(const scorer *self, size_t one, size_t other) {
    const double *a = self->score + one * self->size;
    const double *b = self->score + other * self->size;
    return self->is_scored[one] && self->is_scored[other]
               ? fabs(dot(a, b, self->size)) / sqrt(dot(a, a, self->size) * dot(b, b, self->size))
               : 0.0;
}

/* Fills `alike` of all. */
static void compare_scores(const scorer *self, tl_score_candidate *candidate, size_t count) {
    for (size_t one = 0; one < count; one++) {
        for (size_t other = 0; other < count; other++) {
            double likeness = one != other ? find_likeness(self, one, other) : 0.0;
            if (likeness > candidate[one].likeness) {
                candidate[one].likeness = likeness;
                candidate[one].alike = other;
            }
        }
    }
}

/* ---- fits ---- */

typedef struct fit {
    const scorer *self;
    size_t index;
    tl_score_candidate *candidate;
    double size, onset;
    double squares; /* χ², with the prior of the onset */
    double a, b, d; /* normal equations: size, size with onset, onset */
    double *now;    /* prediction, by steps */
    double *rest;   /* whitened residual */
    double *by_size, *by_onset;
} fit;

static double prior_of(const fit *own, double onset) {
    const tl_score_window *window = &own->self->test->window;
    double distance = (onset - (double)window->onset) / fmax(window->onset_spread, 1.0);
    return distance * distance;
}

/* Evaluates χ² at a point; the prediction is in self->steps. */
static bool evaluate(const fit *own, double size, double onset, double *white, double *squares) {
    const scorer *self = own->self;
    if (!predict(self, own->index, size, (size_t)onset)) {
        return false;
    }
    whiten(self, self->test->window.measured, self->steps, white);
    *squares = dot(white, white, self->size) + prior_of(own, onset);
    return isfinite(*squares);
}

/* Whitened derivative of the prediction. */
static bool differ(const fit *own, double size, double onset, double distance, double *derivative) {
    const scorer *self = own->self;
    if (!predict(self, own->index, size, (size_t)onset)) {
        return false;
    }
    whiten(self, self->steps, own->now, derivative);
    for (size_t i = 0; i < self->size; i++) {
        derivative[i] /= distance;
    }
    return true;
}

/* `distance`: of the derivative by the onset, steps. */
static bool linearise(fit *own, double distance, double step[2]) {
    const tl_score_window *window = &own->self->test->window;
    size_t count = own->self->size;
    double probe =
        own->size + own->candidate->probe > own->candidate->most ? -own->candidate->probe : own->candidate->probe;
    double spread = fmax(window->onset_spread, 1.0);
    double later = own->onset + distance < (double)window->steps - 1.0 ? distance : -distance;
    if (!differ(own, own->size + probe, own->onset, probe, own->by_size) ||
        !differ(own, own->size, own->onset + later, later, own->by_onset)) {
        return false;
    }
    double of_onset = dot(own->by_onset, own->rest, count) - (own->onset - (double)window->onset) / (spread * spread);
    double of_size = dot(own->by_size, own->rest, count);
    own->a = dot(own->by_size, own->by_size, count);
    own->b = dot(own->by_size, own->by_onset, count);
    own->d = dot(own->by_onset, own->by_onset, count) + 1.0 / (spread * spread);
    double determinant = own->a * own->d - own->b * own->b;
    if (!(determinant > 0.0)) {
        return false;
    }
    step[0] = (of_size * own->d - of_onset * own->b) / determinant;
    step[1] = (of_onset * own->a - of_size * own->b) / determinant;
    return true;
}

static double limit_onset(const fit *own, double onset) {
    const tl_score_window *window = &own->self->test->window;
    return fmin(fmax(onset, (double)window->learn + 1.0), (double)window->steps - 2.0);
}

/* Takes the point that was evaluated last, with its residual in own->by_size. */
static void keep_point(fit *own, double size, double onset, double squares) {
    const tl_score_window *window = &own->self->test->window;
    own->size = size;
    own->onset = onset;
    own->squares = squares;
    memcpy(own->now, own->self->steps, window->steps * window->outputs * sizeof *own->now);
    memcpy(own->rest, own->by_size, own->self->size * sizeof *own->rest);
}

/* Goes as far as χ² falls. Returns whether it has fallen. */
static bool advance(fit *own, const double step[2]) {
    double part = 1.0;
    for (int i = 0; i <= HALVINGS; i++) {
        double squares = 0.0;
        double size = fmin(fmax(own->size + part * step[0], own->candidate->least), own->candidate->most);
        double onset = limit_onset(own, rint(own->onset + part * step[1]));
        if (evaluate(own, size, onset, own->by_size, &squares) && squares < own->squares) {
            keep_point(own, size, onset, squares);
            return true;
        }
        part /= 2.0;
    }
    return false;
}

/* Takes this onset, with the size that fits best if the outputs are linear in it, if χ² is less. */
static bool try_onset(fit *own, double onset) {
    const scorer *self = own->self;
    const tl_score_window *window = &self->test->window;
    double size = own->size;
    double squares = 0.0;
    onset = limit_onset(own, rint(onset));
    if (!own->candidate->is_level) {
        if (!predict(self, own->index, own->candidate->probe, (size_t)onset)) {
            return false;
        }
        whiten(self, self->steps, window->predicted, own->by_size);
        whiten(self, window->measured, window->predicted, own->by_onset);
        double reaction = dot(own->by_size, own->by_size, self->size);
        double found = dot(own->by_size, own->by_onset, self->size) / reaction * own->candidate->probe;
        size = reaction > 0.0 ? fmin(fmax(found, own->candidate->least), own->candidate->most) : size;
    }
    bool is_better = evaluate(own, size, onset, own->by_size, &squares) && squares < own->squares;
    if (is_better) {
        keep_point(own, size, onset, squares);
    }
    return is_better;
}

/* Starts at the best of several onsets, because χ² has more than one minimum, and then at the best
 * one near it. */
static bool begin_fit(fit *own) {
    double distance = fmax(own->self->test->window.onset_spread / 2.0, 1.0);
    double middle = own->onset;
    own->squares = (double)INFINITY;
    for (int i = -ONSETS; i <= ONSETS && !has_stopped(own->self); i++) {
        (void)try_onset(own, middle + (double)i * distance);
    }
    while (isfinite(own->squares) && distance > 1.0 && !has_stopped(own->self)) {
        double best = own->onset;
        distance /= 2.0;
        (void)try_onset(own, best - distance);
        (void)try_onset(own, best + distance);
    }
    return isfinite(own->squares);
}

/* `total`: χ² of the whole window. */
static void fit_one(const scorer *self, size_t index, tl_score_candidate *candidate, double *memory, double *total) {
    size_t series = self->test->window.steps * self->outputs;
    fit own = {.self = self,
               .index = index,
               .candidate = candidate,
               .size = candidate->size,
               .onset = candidate->onset,
               .now = memory,
               .rest = memory + series,
               .by_size = memory + series + self->size,
               .by_onset = memory + series + 2 * self->size};
    bool continues = begin_fit(&own);
    candidate->fitted = continues;
    double distance = self->test->window.onset_spread / 2.0;
    for (int i = 0; i < ITERATIONS && continues; i++) {
        double step[2] = {0.0, 0.0};
        double before = own.squares;
        distance = fmax(1.0, rint(distance / 2.0)); /* the response to a step has edges: go nearer */
        continues = linearise(&own, distance, step) && !has_stopped(self);
        bool is_better = continues && advance(&own, step) && before - own.squares > 0.01;
        continues = continues && (is_better || distance > 1.0);
    }
    double information = own.d > 0.0 ? own.a - own.b * own.b / own.d : own.a;
    candidate->size = own.size;
    candidate->onset = own.onset;
    candidate->spread = information > 0.0 ? 1.0 / sqrt(information) : (double)INFINITY;
    candidate->squares = candidate->fitted ? squares_after(self, own.rest) : 0.0;
    *total = own.squares;
}

/* ---- the answer ---- */

/* Marks the candidates that are to be fitted. */
static void choose(const double *fall, const tl_score_candidate *candidate, size_t count, bool *chosen) {
    double best = 0.0;
    for (size_t i = 0; i < count; i++) {
        best = fmax(best, fall[i]);
    }
    for (size_t i = 0; i < count; i++) {
        size_t better = 0;
        for (size_t k = 0; k < count; k++) {
            better += fall[k] > fall[i] || (k < i && !(fall[k] < fall[i])) ? 1 : 0;
        }
        bool is_promising = fall[i] >= PROMISING * best && fall[i] > 0.0 && better < TL_SCORE_FITTED;
        chosen[i] =
            !candidate[i].failed && (candidate[i].is_level || is_promising || (better < FITTED_LEAST && fall[i] > 0.0));
    }
}

/* How the first two of the set can be told apart. */
static void find_difference(const scorer *self, const tl_score_candidate *candidate, double rival, double *memory,
                            tl_score_result *result) {
    const tl_score_candidate *best = &candidate[result->best];
    const tl_score_candidate *second = &candidate[result->second];
    size_t series = self->test->window.steps * self->outputs;
    double largest = 0.0;
    if (result->second == result->best || !predict(self, result->best, best->size, (size_t)best->onset)) {
        return;
    }
    memcpy(memory, self->steps, series * sizeof *memory);
    if (!predict(self, result->second, second->size, (size_t)second->onset)) {
        return;
    }
    whiten(self, memory, self->steps, self->work);
    for (size_t output = 0; output < self->outputs; output++) {
        double sum = 0.0;
        for (size_t i = output; i < self->size; i += self->outputs) {
            sum += self->work[i] * self->work[i];
        }
        result->apart_output = sum > largest ? output : result->apart_output;
        largest = fmax(largest, sum);
    }
    double factor = rival / dot(self->work, self->work, self->size);
    result->apart_factor = factor > 1.0 && factor < LONGEST_WAIT ? factor : 0.0;
}

static void conclude(const scorer *self, tl_score_candidate *candidate, const double *total, size_t count,
                     double *memory, tl_score_result *result) {
    double before = dot(self->residual, self->residual, self->size);
    bool any = false;
    for (size_t i = 0; i < count; i++) {
        if (candidate[i].fitted && (!any || total[i] < total[result->best])) {
            result->best = i;
            any = true;
        }
    }
    result->squares = squares_after(self, self->residual);
    result->expected = (double)self->counted;
    result->second = result->best;
    if (!any || before - total[result->best] < TL_SCORE_NOTICED) {
        result->verdict = TL_SCORE_NOT_BETTER;
        return;
    }
    double ratio = candidate[result->best].squares / fmax(result->expected, 1.0);
    double doubt = sqrt(2.0 / fmax(result->expected, 1.0) + 2.0 / fmax((double)self->learnt, 1.0));
    result->verdict = ratio > MUCH_MORE && ratio - 1.0 > SURELY_MORE * doubt ? TL_SCORE_UNEXPLAINED : TL_SCORE_FOUND;
    double rival = TL_SCORE_RIVAL * fmax(1.0, ratio);
    for (size_t i = 0; i < count; i++) {
        candidate[i].spread *= sqrt(fmax(1.0, ratio));
        candidate[i].is_in_set = candidate[i].fitted && total[i] - total[result->best] <= rival;
        bool is_second = candidate[i].is_in_set && i != result->best &&
                         (result->second == result->best || total[i] < total[result->second]);
        result->second = is_second ? i : result->second;
    }
    find_difference(self, candidate, rival, memory, result);
}

static bool run(scorer *self, tl_score_candidate *candidate, size_t count, double *memory, tl_score_result *result) {
    double *fall = memory;
    double *total = fall + count;
    double *rest = total + count;
    bool *chosen = calloc(count, sizeof *chosen);
    bool done = chosen != NULL;
    for (size_t i = 0; i < count && done; i++) {
        add_standing(self, i, &candidate[i]);
        done = !has_stopped(self);
    }
    whiten(self, self->test->window.measured, self->test->window.predicted, self->residual);
    for (size_t i = 0; i < count && done; i++) {
        fall[i] = score_one(self, i, &candidate[i]);
        done = !has_stopped(self);
    }
    if (done) {
        compare_scores(self, candidate, count);
        choose(fall, candidate, count, chosen);
    }
    for (size_t i = 0; i < count && done && !self->test->only_foresees; i++) {
        if (chosen[i]) {
            fit_one(self, i, &candidate[i], rest, &total[i]);
        }
        done = !has_stopped(self);
    }
    if (done) {
        conclude(self, candidate, total, count, rest, result);
    }
    free(chosen);
    return done;
}

bool tl_score_test_run(const tl_score_test *test, tl_score_candidate *candidate, size_t count,
                       tl_score_result *result) {
    const tl_score_window *window = &test->window;
    size_t block = (window->steps + TL_SCORE_BLOCKS - 1) / TL_SCORE_BLOCKS;
    size_t blocks = window->steps / block;
    size_t spread = (size_t)window->onset_spread;
    size_t onset = window->onset > window->learn + spread ? window->onset - spread : window->learn;
    scorer self = {.test = test,
                   .outputs = window->outputs,
                   .block = block,
                   .blocks = blocks,
                   .size = blocks * window->outputs,
                   .learn = window->learn / block,
                   .before = onset / block,
                   .after = onset / block};
    size_t series = window->steps * window->outputs;
    double *memory = calloc(2 * series + self.size * (2 * count + window->outputs + 6) + 2 * count, sizeof *memory);
    self.whitener = calloc(window->outputs + 1, sizeof *self.whitener);
    self.is_there = calloc(self.size + 1, sizeof *self.is_there);
    self.is_scored = calloc(count + 1, sizeof *self.is_scored);
    bool done = memory != NULL && self.whitener != NULL && self.is_there != NULL && self.is_scored != NULL;
    *result = (tl_score_result){.verdict = TL_SCORE_NOT_BETTER};
    if (done) {
        self.steps = memory;
        self.residual = memory + series;
        self.work = self.residual + self.size;
        self.score = self.work + self.size;
        self.basis = self.score + count * self.size;
        learn_all(&self);
        done = run(&self, candidate, count, self.basis + (count + window->outputs) * self.size, result);
    }
    free(self.is_scored);
    free(self.is_there);
    free(self.whitener);
    free(memory);
    return done;
}
