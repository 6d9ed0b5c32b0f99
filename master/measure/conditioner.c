/* One measurement, conditioned before it is matched: see conditioner.h. */
#include "master/measure/conditioner.h"

#include <math.h>

enum { PENDING = 2 }; /* outliers that a third must agree with */

/* The newest values and their order. Values come into the slots in turn. */
typedef struct median {
    size_t size; /* 0: there is no median */
    size_t count;
    size_t next; /* slot of the next value */
    double *values;
    size_t *order; /* the first `count`: slots, by value */
} median;

/* What comes in, as long as it is not judged. */
typedef struct arrival {
    int64_t tick;
    double value;
} arrival;

/* What came out at a tick. */
typedef struct output {
    double value;
    tl_quality quality;
} output;

struct tl_conditioner {
    double gate;  /* 0: none */
    double share; /* a of the low-pass; 0: there is none */
    int64_t delay;
    median median;
    double filtered; /* what the filters gave last */
    bool is_empty;   /* they have got nothing since they started */
    int64_t start;   /* the tick they started at */
    bool has_accepted;
    arrival accepted; /* the last one */
    arrival pending[PENDING];
    size_t pending_count;
    output latest;
    output *window; /* ring by tick */
    size_t window_size;
    int64_t newest; /* tick; −1: none */
};

bool tl_conditioner_is_needed(const tl_plan_condition *condition) {
    return condition->median > 1 || condition->low_pass > 0 || condition->gate > 0.0;
}

tl_conditioner *tl_conditioner_create(tl_arena *arena, const tl_plan_condition *condition, tl_time step,
                                      size_t window) {
    tl_conditioner *self = tl_arena_take(arena, 1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    self->gate = condition->gate;
    self->share = condition->low_pass > 0 ? -expm1(-(double)step / (double)condition->low_pass) : 0.0;
    self->delay = tl_plan_condition_delay(condition, step);
    self->median.size = condition->median > 1 ? condition->median : 0;
    self->median.values = tl_arena_take(arena, self->median.size, sizeof *self->median.values);
    self->median.order = tl_arena_take(arena, self->median.size, sizeof *self->median.order);
    self->latest = (output){0.0, TL_NO_LINK};
    self->window_size = window > 0 ? window : 1;
    self->window = tl_arena_take(arena, self->window_size, sizeof *self->window);
    self->newest = -1;
    bool has_all = self->median.values != NULL && self->median.order != NULL && self->window != NULL;
    return has_all ? self : NULL;
}

/* Takes the slot that is written next out of the order, where it is full. */
static void median_forget(median *self) {
    if (self->count < self->size) {
        return;
    }
    size_t place = 0;
    while (self->order[place] != self->next) {
        place++;
    }
    self->count--;
    for (; place < self->count; place++) {
        self->order[place] = self->order[place + 1];
    }
}

static void median_insert(median *self, double value) {
    size_t place = self->count;
    for (; place > 0 && self->values[self->order[place - 1]] > value; place--) {
        self->order[place] = self->order[place - 1];
    }
    self->order[place] = self->next;
    self->values[self->next] = value;
    self->next = (self->next + 1) % self->size;
    self->count++;
}

/* The size is odd: an even number is one on the way there, when a higher slot is a newer one. */
static double median_middle(const median *self) {
    size_t lower = self->order[(self->count - 1) / 2];
    size_t upper = self->order[self->count / 2];
    return self->values[lower > upper ? lower : upper];
}

static double median_filter(median *self, double value) {
    if (self->size == 0) {
        return value;
    }
    median_forget(self);
    median_insert(self, value);
    return median_middle(self);
}

static void start_anew(tl_conditioner *self, int64_t tick) {
    self->median.count = 0;
    self->median.next = 0;
    self->is_empty = true;
    self->start = tick;
}

static void filter(tl_conditioner *self, double value) {
    double middle = median_filter(&self->median, value);
    if (self->is_empty || self->share <= 0.0) {
        self->filtered = middle;
    } else {
        self->filtered += self->share * (middle - self->filtered);
    }
    self->is_empty = false;
}

static bool is_near(const tl_conditioner *self, double one, double other) {
    return self->gate <= 0.0 || fabs(one - other) <= self->gate;
}

/* Whether `value` is the third in a row that agree with each other. */
static bool is_new_level(const tl_conditioner *self, double value) {
    double first = self->pending[0].value;
    double second = self->pending[1].value;
    return self->pending_count == PENDING && is_near(self, first, second) && is_near(self, first, value) &&
           is_near(self, second, value);
}

/* The last PENDING outliers are kept. */
static void keep_pending(tl_conditioner *self, arrival outlier) {
    if (self->pending_count == PENDING) {
        self->pending[0] = self->pending[1];
        self->pending_count--;
    }
    self->pending[self->pending_count++] = outlier;
}

static bool is_lost(const tl_conditioner *self, int64_t tick) {
    return !self->has_accepted || tick - self->accepted.tick > TL_CONDITIONER_GAP + 1;
}

/* A good sample goes through the gate and the filters, or is an outlier. */
static tl_quality take(tl_conditioner *self, arrival sample) {
    if (is_lost(self, sample.tick)) {
        start_anew(self, sample.tick);
    } else if (!is_near(self, self->accepted.value, sample.value)) {
        if (!is_new_level(self, sample.value)) {
            keep_pending(self, sample);
            return TL_OUTLIER;
        }
        start_anew(self, self->pending[0].tick);
        filter(self, self->pending[0].value);
        filter(self, self->pending[1].value);
    }
    filter(self, sample.value);
    self->accepted = sample;
    self->has_accepted = true;
    self->pending_count = 0;
    return TL_GOOD;
}

/* Whether the filters knew the plant at the instant that their output of `tick` belongs to. */
static bool is_heard(const tl_conditioner *self, int64_t tick) {
    return self->start == 0 || tick - self->delay >= self->start;
}

void tl_conditioner_push(tl_conditioner *conditioner, int64_t tick, double value, tl_quality quality) {
    tl_quality judged = quality == TL_GOOD ? take(conditioner, (arrival){tick, value}) : quality;
    if (judged != TL_GOOD) {
        conditioner->latest.quality = judged;
    } else if (is_heard(conditioner, tick)) {
        conditioner->latest = (output){conditioner->filtered, TL_GOOD};
    }
    conditioner->window[(size_t)tick % conditioner->window_size] = conditioner->latest;
    conditioner->newest = tick;
}

double tl_conditioner_value(const tl_conditioner *conditioner, int64_t tick, tl_quality *quality) {
    int64_t known = tick < conditioner->newest ? tick : conditioner->newest;
    const output *found =
        known >= 0 ? &conditioner->window[(size_t)known % conditioner->window_size] : &conditioner->latest;
    *quality = found->quality;
    return found->value;
}

/* Of the slots, the order holds those that were filled, each once; they were filled in turn. */
static bool is_in_order(const median *self) {
    bool right = self->count <= self->size && self->next < (self->size > 0 ? self->size : 1) &&
                 (self->count == self->size || self->next == self->count);
    for (size_t i = 0; right && i < self->count; i++) {
        right = self->order[i] < self->count;
        for (size_t k = 0; right && k < i; k++) {
            right = self->order[k] != self->order[i];
        }
    }
    return right;
}

static void require_output(tl_archive *archive, const output *out) {
    tl_archive_require_finite(archive, &out->value, 1);
    tl_archive_require(archive, out->quality >= TL_GOOD && out->quality <= TL_OUTLIER);
}

static void require_arrival(tl_archive *archive, const arrival *sample, int64_t newest) {
    tl_archive_require_finite(archive, &sample->value, 1);
    tl_archive_require(archive, sample->tick >= 0 && sample->tick <= newest);
}

/* Ticks are not ahead of the newest, slots are there, and numbers are numbers. */
static void require_sound(const tl_conditioner *self, tl_archive *archive) {
    int64_t newest = self->newest > 0 ? self->newest : 0;
    tl_archive_require(archive, self->newest >= -1 && self->start >= 0 && self->start <= newest);
    tl_archive_require(archive, is_in_order(&self->median) && self->pending_count <= PENDING);
    tl_archive_require_finite(archive, self->median.values, self->median.size);
    tl_archive_require_finite(archive, &self->filtered, 1);
    require_arrival(archive, &self->accepted, newest);
    for (size_t i = 0; i < PENDING; i++) {
        require_arrival(archive, &self->pending[i], newest);
    }
    require_output(archive, &self->latest);
    for (size_t i = 0; i < self->window_size; i++) {
        require_output(archive, &self->window[i]);
    }
}

/* Member by member: what was configured, and what points to other memory, is not in it. */
void tl_conditioner_archive(tl_conditioner *conditioner, tl_archive *archive) {
    median *middle = &conditioner->median;
    tl_archive_part(archive, &middle->count, sizeof middle->count);
    tl_archive_part(archive, &middle->next, sizeof middle->next);
    tl_archive_part(archive, &conditioner->filtered, sizeof conditioner->filtered);
    tl_archive_flag(archive, &conditioner->is_empty);
    tl_archive_part(archive, &conditioner->start, sizeof conditioner->start);
    tl_archive_flag(archive, &conditioner->has_accepted);
    tl_archive_part(archive, &conditioner->accepted, sizeof conditioner->accepted);
    tl_archive_part(archive, conditioner->pending, sizeof conditioner->pending);
    tl_archive_part(archive, &conditioner->pending_count, sizeof conditioner->pending_count);
    tl_archive_part(archive, &conditioner->latest, sizeof conditioner->latest);
    tl_archive_part(archive, &conditioner->newest, sizeof conditioner->newest);
    tl_archive_part(archive, middle->values, middle->size * sizeof *middle->values);
    tl_archive_part(archive, middle->order, middle->size * sizeof *middle->order);
    tl_archive_part(archive, conditioner->window, conditioner->window_size * sizeof *conditioner->window);
    if (tl_archive_is_loading(archive) && tl_archive_is_whole(archive)) {
        require_sound(conditioner, archive);
    }
}
