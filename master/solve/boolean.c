/* Boolean unknowns: the better of a value and its negation.
 *
 * Each unknown in turn is negated, with the ones before it at their better value, and stays negated
 * if that lowers J. Every unknown costs at most one evaluation, so a single one costs one
 * evaluation beyond the start. After a change an unknown keeps its value for its dwell time.
 *
 * Unknowns are independent, also those of one variable at different times: each has its own dwell
 * time, counted from its own changes.
 */
#include <string.h>

#include "master/solve/optimiser.h"

struct tl_optimiser {
    const tl_optimiser_space *space;
    bool has_committed;
    double *committed; /* committed last */
    uint32_t *resting; /* steps until it may change again */
    double *u;         /* the best so far, and the point to evaluate */
};

static tl_optimiser *create(tl_arena *arena, const tl_optimiser_space *space) {
    tl_optimiser *self = tl_arena_take(arena, 1, sizeof *self);
    double *numbers = tl_arena_take(arena, space->count, 2 * sizeof *numbers);
    uint32_t *resting = tl_arena_take(arena, space->count, sizeof *resting);
    if (self == NULL || numbers == NULL || resting == NULL) {
        return NULL;
    }
    self->space = space;
    self->committed = numbers;
    self->u = numbers + space->count;
    self->resting = resting;
    return self;
}

static double negation(double value) {
    return value < 0.5 ? 1.0 : 0.0;
}

static tl_search_end minimise(tl_optimiser *self, const tl_search *search) {
    double best = search->start_value;
    memcpy(self->u, search->start, self->space->count * sizeof *self->u);
    for (size_t i = 0; i < self->space->count; i++) {
        if (self->resting[i] > 0) {
            continue;
        }
        const double before = self->u[i];
        double value = best;
        self->u[i] = negation(before);
        if (!search->evaluate(search->context, self->u, &value, NULL)) {
            return TL_SEARCH_STOPPED;
        }
        if (value < best) {
            best = value;
        } else {
            self->u[i] = before;
        }
    }
    return TL_SEARCH_DONE;
}

/* Not even nominal is a reason to change. */
static void rest(const tl_optimiser *self, double *u) {
    for (size_t i = 0; i < self->space->count; i++) {
        if (self->resting[i] > 0) {
            u[i] = self->committed[i];
        }
    }
}

/* A value stays for its dwell time, including the step of its change. The first commit is not a
 * change. */
static void committed(tl_optimiser *self, const double *u) {
    for (size_t i = 0; i < self->space->count; i++) {
        const bool changed = self->has_committed && negation(u[i]) != negation(self->committed[i]);
        if (changed && self->space->dwell[i] > 0) {
            self->resting[i] = self->space->dwell[i] - 1;
        } else if (self->resting[i] > 0) {
            self->resting[i]--;
        }
        self->committed[i] = u[i];
    }
    self->has_committed = true;
}

static void forget(tl_optimiser *self) {
    self->has_committed = false;
    memset(self->resting, 0, self->space->count * sizeof *self->resting);
}

/* All memory is in the arena. */
static void destroy(tl_optimiser *self) {
    (void)self;
}

const tl_optimiser_class tl_boolean = {
    .name = "boolean",
    .booleans = true,
    .create = create,
    .minimise = minimise,
    .rest = rest,
    .committed = committed,
    .forget = forget,
    .destroy = destroy,
};
