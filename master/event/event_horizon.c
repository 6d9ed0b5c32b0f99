/* The event horizon: see event_horizon.h. */
#include "master/event/event_horizon.h"

#include <math.h>

#include "master/base/duration.h"
#include "master/event/event_plan.h"
#include "master/event/event_search.h"
#include "master/event/stroke.h"

typedef enum event_phase {
    WAITING,   /* for the start of a stroke */
    STROKE,    /* for its end */
    WINDOW,    /* for the window to be complete */
    SEARCHING, /* candidates are tried */
    FOLLOWING, /* the winner is led on to the present */
    CONFIRMING /* done, while part of the window is still stood for */
} event_phase;

/* A signal of the plant that comes, or goes. */
typedef struct event_edge {
    size_t signal;
    bool falls;
    bool effect; /* measured, else a command */
} event_edge;

struct tl_event_horizon {
    tl_lock *lock;
    tl_event_search search;
    tl_stroke stroke;
    event_edge start;
    event_edge end;
    int64_t half;    /* T_F/2, macro steps */
    int64_t longest; /* macro steps */
    int64_t kept;    /* samples that can be gone back */
    bool stands_in;  /* hold */
    event_phase phase;
    bool own_course; /* the live twin has gone through the whole stroke with u */
    double u;        /* in force */
    double winner;
    tl_outcome outcome; /* of the winner, */
    tl_stop stop;       /* why its search ended, */
    double value;       /* and its J */
    double before;      /* u at the start of the stroke */
    tl_time going;      /* ns that going to a candidate and */
    tl_time leaving;    /* leaving it take, at most, fading */
};

static double nominal_of(const tl_event_horizon *self) {
    return tl_exchange_nominal(self->lock->exchange, 0);
}

/* ---- build ---- */

/* Which matched output tells of the event; one does, in a plan that was checked. */
static tl_stroke_event find_event(const tl_objective *objective, event_edge end) {
    size_t match = 0;
    for (size_t i = 0; i < objective->term_count; i++) {
        const tl_objective_term *term = &objective->terms[i];
        if (term->weight > 0.0 && term->signal == end.signal) {
            return (tl_stroke_event){match, end.signal, term->shift, end.falls};
        }
        match += term->weight > 0.0;
    }
    return (tl_stroke_event){0};
}

tl_event_horizon *tl_event_horizon_create(tl_arena *arena, tl_lock *lock, const tl_plan *plan) {
    tl_event_horizon *self = tl_arena_take(arena, 1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    const tl_adjusted *adjusted = &lock->adjusted[0];
    self->lock = lock;
    self->start.falls = plan->event.start.falls;
    self->end.falls = plan->event.end.falls;
    self->end.effect = true;
    self->start.signal = tl_event_plan_signal(plan, &plan->event.start);
    self->end.signal = tl_event_plan_signal(plan, &plan->event.end);
    self->half = (int64_t)tl_event_plan_half(plan);
    self->longest = (int64_t)tl_event_plan_longest(plan);
    self->kept = (int64_t)tl_event_plan_window(plan) - 2;
    self->stands_in = plan->measurements == TL_HOLD;
    self->u = nominal_of(self);
    const tl_stroke_settings stroke = {
        .lock = lock, .event = find_event(&lock->objective, self->end), .samples = tl_event_plan_window(plan)};
    const tl_event_search_settings search = {.solver = lock->solver,
                                             .step = adjusted->step,
                                             .lower = adjusted->lower,
                                             .upper = adjusted->upper,
                                             .stagnation = plan->stagnation,
                                             .evaluations =
                                                 plan->evaluations != 0 ? plan->evaluations : TL_PLAN_EVALUATIONS};
    bool placed = tl_stroke_init(&self->stroke, arena, &stroke) && tl_event_search_init(&self->search, arena, &search);
    return placed ? self : NULL;
}

uint32_t tl_event_horizon_steps(const tl_event_horizon *self) {
    return (uint32_t)(self->longest + self->half);
}

void tl_event_horizon_forget(tl_event_horizon *self, size_t component) {
    if (self != NULL) {
        tl_stroke_forget(&self->stroke, component);
    }
}

void tl_event_horizon_end(tl_event_horizon *self) {
    if (self != NULL) {
        tl_event_search_end(&self->search);
    }
}

/* ---- the plant ---- */

/* The plant of t_tick: a command is looked up as inputs are, an effect as measurements are. */
static const tl_sample *sample_of(const tl_event_horizon *self, event_edge edge, int64_t tick) {
    const tl_plant *plant = &self->lock->exchange->plant;
    return tl_plant_sample(plant, tick + (edge.effect ? self->stroke.event.shift : plant->shift));
}

static bool is_on(const tl_event_horizon *self, event_edge edge, int64_t tick) {
    const tl_sample *sample = sample_of(self, edge, tick);
    bool on = sample->values[edge.signal] < 0.0 || sample->values[edge.signal] > 0.0;
    return on != edge.falls;
}

static bool is_good(const tl_event_horizon *self, event_edge edge, int64_t tick) {
    return sample_of(self, edge, tick)->quality[edge.signal] == TL_GOOD;
}

/* Has it come at this tick? Values that are not good are held, so that it comes with the first good one; `sure`: just then. */
static bool comes(const tl_event_horizon *self, event_edge edge, int64_t tick, bool *sure) {
    *sure = tick > 0 && is_good(self, edge, tick - 1);
    return tick > 0 && is_on(self, edge, tick) && !is_on(self, edge, tick - 1);
}

/* Is the best trial to be used? Better than nominal, as in any step; what cannot be compared with it is not. */
static bool is_worth(const tl_event_horizon *self, const tl_event_trial *best) {
    const tl_event_trial *nominal = tl_event_search_find(&self->search, nominal_of(self));
    return best->value < TL_OBJECTIVE_TOLERANCE ||
           (nominal != NULL && best->value <= (1.0 - self->lock->margin) * nominal->value &&
            best->value < nominal->value);
}

/* The stroke is not searched, or not any further. What has been found so far is used, but for its state. */
static void abandon(tl_event_horizon *self, tl_record *record) {
    if (self->phase == SEARCHING && self->search.count > 0) {
        const tl_event_trial *best = tl_event_search_best(&self->search);
        self->u = is_worth(self, best) ? best->u : self->u;
    } else if (self->phase == FOLLOWING) {
        self->u = self->winner;
    }
    tl_stroke_drop(&self->stroke);
    self->phase = WAITING;
    record->flags |= TL_FLAG_ABANDONED;
}

static void begin_search(tl_event_horizon *self, tl_record *record) {
    tl_event_search_begin(&self->search);
    self->phase = SEARCHING;
    if (!tl_stroke_begin_search(&self->stroke)) {
        abandon(self, record);
    }
}

static tl_status begin_stroke(tl_event_horizon *self, int64_t tick, bool sure, tl_record *record, tl_error *error) {
    if (self->phase != WAITING && self->phase != CONFIRMING) {
        abandon(self, record);
    }
    self->phase = sure ? STROKE : WAITING;
    self->before = self->u;
    self->own_course = true;
    return tl_stroke_begin(&self->stroke, tick, error);
}

static void meet_event(tl_event_horizon *self, int64_t tick, bool sure, tl_record *record) {
    tl_stroke *stroke = &self->stroke;
    int64_t first = tick - self->half;
    if (!sure) {
        abandon(self, record);
        return;
    }
    stroke->first = first > stroke->begin ? first : stroke->begin + 1;
    stroke->last = tick + self->half;
    stroke->met = tick;
    self->phase = WINDOW;
    if (self->stands_in) {
        begin_search(self, record);
    }
}

/* Did the end signal go back, where the newest sample stood for this one? Then the window's end is waited for. */
static void confirm(tl_event_horizon *self, int64_t tick) {
    bool open = self->phase == SEARCHING || self->phase == FOLLOWING || self->phase == CONFIRMING;
    if (!open || tick > self->stroke.last) {
        self->phase = self->phase == CONFIRMING ? WAITING : self->phase;
        return;
    }
    if (is_good(self, self->end, tick) && !is_on(self, self->end, tick)) {
        tl_stroke_drop(&self->stroke);
        self->phase = WINDOW;
    }
}

/* What the newest sample means for the stroke. */
static tl_status follow_plant(tl_event_horizon *self, int64_t tick, tl_record *record, tl_error *error) {
    bool sure = false;
    confirm(self, tick);
    if (comes(self, self->start, tick, &sure)) {
        return begin_stroke(self, tick, sure, record, error);
    }
    if (self->phase == STROKE && comes(self, self->end, tick, &sure)) {
        meet_event(self, tick, sure, record);
    } else if (self->phase == STROKE && tick - self->stroke.begin > self->longest) {
        abandon(self, record);
    }
    if (self->phase == WINDOW && tick >= self->stroke.last) {
        begin_search(self, record);
    }
    bool busy = self->phase == SEARCHING || self->phase == FOLLOWING;
    if (busy && tick - self->stroke.begin >= self->kept) {
        abandon(self, record);
    }
    return TL_OK;
}

/* ---- the search ---- */

static bool is_u(const tl_event_horizon *self, double u) {
    return !(u < self->u) && !(u > self->u);
}

/* Is the live twin what a candidate with this u would be? */
static bool is_live(const tl_event_horizon *self, double u) {
    return self->own_course && is_u(self, u);
}

static tl_status try(tl_event_horizon *self, double u, tl_error *error) {
    return is_live(self, u) ? tl_stroke_try_live(&self->stroke, u, error) : tl_stroke_try(&self->stroke, u, error);
}

/* The winner is the twin. All that is told of the search is told now: in which step it was known depends on the time there was. */
static void settle(tl_event_horizon *self, tl_record *record) {
    bool stood_for = self->stroke.now < self->stroke.last;
    const tl_event_trial *nominal = tl_event_search_find(&self->search, nominal_of(self));
    self->own_course = self->own_course && is_u(self, self->winner);
    self->u = self->winner;
    self->phase = stood_for ? CONFIRMING : WAITING;
    record->outcome = self->outcome;
    record->stop = self->stop;
    record->objective = isfinite(self->value) ? self->value : (double)NAN;
    record->objective_nominal = nominal != NULL && isfinite(nominal->value) ? nominal->value : (double)NAN;
    record->flags |= tl_event_search_met_plateau(&self->search) ? TL_FLAG_PLATEAU : 0U;
}

/* The best trial, if it is worth it. Else what was in force when the stroke began, if it is as good as nominal; else nominal,
 * which has been tried then. */
static const tl_event_trial *choose(const tl_event_horizon *self, const tl_event_trial *best) {
    const tl_event_trial *nominal = tl_event_search_find(&self->search, nominal_of(self));
    const tl_event_trial *in_force = tl_event_search_find(&self->search, self->before);
    if (is_worth(self, best) || nominal == NULL) {
        return best;
    }
    bool stays = in_force != NULL && isfinite(in_force->value) && in_force->value <= nominal->value;
    return stays ? in_force : nominal;
}

static tl_stop why_ended(const tl_event_horizon *self, const tl_event_trial *best) {
    if (best->value < TL_OBJECTIVE_TOLERANCE) {
        return TL_STOP_TOLERANCE;
    }
    return tl_event_search_is_full(&self->search) ? TL_STOP_EVALUATIONS : TL_STOP_SOLVER;
}

static tl_outcome outcome_of(const tl_event_horizon *self, const tl_event_trial *best, const tl_event_trial *winner) {
    if (best->value < TL_OBJECTIVE_TOLERANCE) {
        return best == &self->search.trials[0] ? TL_FIRST_GUESS : TL_OPTIMISED;
    }
    return winner == tl_event_search_find(&self->search, nominal_of(self)) ? TL_NOMINAL : TL_BEST_SO_FAR;
}

/* Which trial wins, and how it becomes the twin. */
static tl_status conclude(tl_event_horizon *self, tl_record *record, tl_error *error) {
    const tl_event_trial *best = tl_event_search_best(&self->search);
    const tl_event_trial *winner = choose(self, best);
    self->stop = why_ended(self, best);
    self->outcome = outcome_of(self, best, winner);
    self->winner = winner->u;
    self->value = winner->value;
    if (is_live(self, self->winner)) {
        settle(self, record);
        return TL_OK;
    }
    self->phase = FOLLOWING;
    return tl_stroke_follow(&self->stroke, self->winner, error);
}

/* No candidate is at hand: the next one, or the end of the search. The last place is kept for nominal. Where a search is made
 * again, what was in force before the first one comes second. */
static tl_status proceed(tl_event_horizon *self, tl_record *record, tl_error *error) {
    tl_event_search *search = &self->search;
    double u = search->count == 0 ? self->u : self->before;
    bool again = search->count == 1 && tl_event_search_find(search, u) == NULL;
    double ignored = 0.0;
    bool nominal_known = tl_event_search_find(search, nominal_of(self)) != NULL;
    bool room = search->count + (nominal_known ? 0 : 1) < search->most;
    if (search->count == 0 || (room && tl_event_search_next(search, again ? &ignored : &u))) {
        return try(self, u, error);
    }
    bool within = tl_event_search_best(search)->value < TL_OBJECTIVE_TOLERANCE;
    if (!within && !nominal_known && !tl_event_search_is_full(search)) {
        return try(self, nominal_of(self), error);
    }
    return conclude(self, record, error);
}

/* The candidate has been through the window, or has failed. */
static void tell(tl_event_horizon *self, bool failed, tl_record *record) {
    tl_lock *lock = self->lock;
    tl_stroke *stroke = &self->stroke;
    double nominal = nominal_of(self);
    double value = HUGE_VAL;
    if (!failed) {
        value = tl_stroke_value(stroke) +
                tl_objective_penalise(&lock->objective, &stroke->u, &nominal, &self->u, lock->memory.residuals);
        value = isfinite(value) ? value : HUGE_VAL;
    }
    tl_event_search_tell(&self->search, stroke->u, value, failed ? TL_EVENT_UNKNOWN : tl_stroke_side(stroke));
    const tl_event_trial *last = &self->search.trials[self->search.count - 1];
    if (!failed && !stroke->unkept && tl_event_search_best(&self->search) == last) {
        tl_stroke_keep(stroke);
    }
    tl_stroke_drop(stroke);
    record->evaluations++;
}

/* Is a candidate that is being searched, or the winner, where it has to be? */
static bool has_arrived(const tl_event_horizon *self) {
    const tl_stroke *stroke = &self->stroke;
    return self->phase == FOLLOWING ? stroke->at >= stroke->now : stroke->at >= stroke->last;
}

static void arrive(tl_event_horizon *self, tl_record *record) {
    if (self->phase == SEARCHING) {
        tell(self, false, record);
        return;
    }
    tl_stroke_adopt(&self->stroke);
    settle(self, record);
}

/* A winner that fails on its way to the present is none. */
static tl_status fail(tl_event_horizon *self, tl_status status, tl_record *record) {
    if (status != TL_FMU_FAILED) {
        return status;
    }
    if (self->phase == SEARCHING) {
        tell(self, true, record);
        return TL_OK;
    }
    self->winner = self->u;
    abandon(self, record);
    return TL_OK;
}

/* Has this cycle room for one more macro step, and for leaving the candidate? A repetition takes as many executions. */
static bool has_room(const tl_event_horizon *self, const tl_budget *budget, uint64_t begun) {
    tl_exchange *exchange = self->lock->exchange;
    if (budget->repeated) {
        return exchange->executions + exchange->plant.executions - begun < budget->executions;
    }
    if (budget->now == NULL) {
        return true;
    }
    (void)tl_costs_lap(&exchange->costs);
    tl_time cost = self->leaving + (self->stroke.loaded ? 0 : self->going) + tl_exchange_cost(exchange, 1);
    return tl_duration(budget->started, exchange->costs.read) + cost <= budget->time;
}

/* ns since the clock was read last, beside executions; 0 without a clock. */
static tl_time lap(const tl_event_horizon *self) {
    tl_costs *costs = &self->lock->exchange->costs;
    return costs->now != NULL ? tl_costs_lap(costs) : 0;
}

/* One macro step of the candidate, from where it was left. */
static tl_status walk(tl_event_horizon *self, tl_record *record, tl_error *error) {
    tl_status status = TL_OK;
    if (!self->stroke.loaded) {
        status = tl_stroke_return(&self->stroke, error);
        self->going = tl_duration_expect(self->going, lap(self));
    }
    return status == TL_OK ? fail(self, tl_stroke_walk(&self->stroke, error), record) : status;
}

/* As much of the search as there is room for. The first candidate is the live twin as it is now, and cannot begin later. */
static tl_status spend(tl_event_horizon *self, const tl_budget *budget, uint64_t begun, tl_record *record,
                       tl_error *error) {
    tl_status status = TL_OK;
    while (status == TL_OK && (self->phase == SEARCHING || self->phase == FOLLOWING)) {
        if (self->stroke.walking && has_arrived(self)) {
            arrive(self, record);
        } else if ((self->stroke.walking || self->search.count > 0) && !has_room(self, budget, begun)) {
            record->stop = TL_STOP_TIME;
            break;
        } else if (!self->stroke.walking) {
            status = proceed(self, record, error);
        } else {
            status = walk(self, record, error);
        }
    }
    return status;
}

/* The search of this cycle, and back to the live twin. */
static tl_status search(tl_event_horizon *self, const tl_budget *budget, uint64_t begun, tl_record *record,
                        tl_error *error) {
    tl_status status = spend(self, budget, begun, record, error);
    if (status != TL_OK) {
        return status;
    }
    if (!self->stroke.away) {
        self->going = tl_duration_fade(self->going); /* or one stall would end all searches */
        self->leaving = tl_duration_fade(self->leaving);
        return TL_OK;
    }
    (void)lap(self);
    status = tl_stroke_leave(&self->stroke, error);
    self->leaving = tl_duration_expect(self->leaving, lap(self));
    return status;
}

/* ---- the step ---- */

/* One macro step of the live twin. It is not the last word: it will be gone back. */
static tl_status take_step(tl_event_horizon *self, int64_t step, tl_error *error) {
    tl_exchange_set_adjusted(self->lock->exchange, 0, self->u);
    return tl_exchange_try(self->lock->exchange, step, 0, error);
}

/* Where an FMU fails with a u that was found, nominal is used again. */
static tl_status step_live(tl_event_horizon *self, int64_t step, tl_record *record, tl_error *error) {
    tl_lock *lock = self->lock;
    bool corrected = !is_u(self, nominal_of(self));
    tl_status status = corrected ? tl_snapshot_take(self->stroke.live, error) : TL_OK;
    if (status != TL_OK) {
        return status; /* what is in `live` is older: there is nothing to go back to */
    }
    status = take_step(self, step, error);
    if (status == TL_FMU_FAILED && corrected) {
        tl_ledger_walked(&lock->ledger, 0, lock->exchange->failed);
        status = tl_snapshot_restore(self->stroke.live, error);
        self->u = nominal_of(self);
        self->own_course = false;
        record->outcome = TL_NOMINAL;
        status = status == TL_OK ? take_step(self, step, error) : status;
    }
    if (status == TL_OK) {
        tl_ledger_commit(&lock->ledger, NULL);
        tl_stroke_note(&self->stroke, step + 1);
    }
    return status;
}

static void begin_record(const tl_event_horizon *self, int64_t step, tl_record *record) {
    tl_record_begin(record, step);
    record->outcome = TL_HELD;
    record->u_hat[0] = nominal_of(self);
}

/* What was committed; a search may have changed it. */
static void fill_record(const tl_event_horizon *self, tl_record *record) {
    const tl_objective *objective = &self->lock->objective;
    bool busy = self->phase == SEARCHING || self->phase == FOLLOWING;
    for (size_t i = 0; i < objective->term_count; i++) {
        record->y[i] = tl_objective_y(objective, i);
    }
    record->u[0] = self->u;
    record->outcome = busy && record->outcome == TL_HELD ? TL_SEARCHING : record->outcome;
}

tl_status tl_event_horizon_step(tl_event_horizon *self, int64_t step, const tl_budget *budget, tl_record *record,
                                tl_error *error) {
    tl_exchange *exchange = self->lock->exchange;
    uint64_t begun = exchange->executions + exchange->plant.executions;
    begin_record(self, step, record);
    tl_costs_begin(&exchange->costs, budget == NULL ? NULL : budget->now, budget == NULL ? NULL : budget->context);
    tl_status status = step_live(self, step, record, error);
    (void)lap(self);
    status = status == TL_OK ? follow_plant(self, step + 1, record, error) : status;
    if (status == TL_OK && budget != NULL) {
        status = search(self, budget, begun, record, error);
    }
    fill_record(self, record);
    record->outcome = budget == NULL ? TL_MADE_UP : record->outcome;
    return status;
}

tl_status tl_event_horizon_follow(tl_event_horizon *self, int64_t step, double u, tl_record *record, tl_error *error) {
    self->own_course = self->own_course && is_u(self, u);
    self->u = u;
    tl_status status = tl_event_horizon_step(self, step, NULL, record, error);
    record->outcome = TL_FOLLOWED;
    return status;
}

void tl_event_horizon_go_on(tl_event_horizon *self) {
    tl_stroke_drop(&self->stroke);
    self->phase = WAITING;
    self->own_course = false;
}

bool tl_event_horizon_begin_anew(tl_event_horizon *self) {
    bool under_way = self->phase != WAITING && self->phase != CONFIRMING;
    tl_event_horizon_go_on(self);
    self->u = nominal_of(self);
    return under_way;
}

void tl_event_horizon_retune(tl_event_horizon *self, const tl_tuning *tuning, bool begun) {
    const tl_adjusted *adjusted = &self->lock->adjusted[0];
    tl_event_search_retune(&self->search, adjusted->lower, adjusted->upper, (size_t)tuning->evaluations);
    self->u = begun ? self->u : nominal_of(self);
    if (self->phase == SEARCHING) { /* what was found is not to be compared with what comes */
        tl_stroke_drop(&self->stroke);
        self->phase = WINDOW;
    }
}

void tl_event_horizon_archive(tl_event_horizon *self, tl_archive *archive) {
    tl_archive_part(archive, &self->u, sizeof self->u);
    tl_archive_require_finite(archive, &self->u, 1);
}
