/* Event horizon: its plan, its strokes, and its search: see event_horizon.h. */
#include "master/event/event_horizon.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "master/base/arena.h"
#include "master/base/estimate.h"
#include "master/base/status.h"
#include "master/event/event_search.h"
#include "master/graph/snapshot.h"
#include "master/sync/synchroniser.h"

/* ---- Stroke: simulates one stroke of the plant again with another u, as the candidate of an event
 * horizon.
 *
 * Purpose: simulates the co-simulation from the saved start of the stroke, one macro step at a time
 *          and over as many cycles as needed. It evaluates the window, and keeps the state of the
 *          best candidate at the present instant.
 * States:  tl_stroke_try(), _try_live(), _follow() and _return() replace the live twin in the FMUs;
 *          tl_stroke_leave() restores it.
 * Thread:  the twin's. Memory: the arena, at start-up; states belong to the FMUs.
 */

/* The event: a matched Boolean output and the plant signal it is matched with. */
typedef struct tl_stroke_event {
    size_t match; /* index of the output among those with a weight */
    size_t signal;
    int32_t shift; /* the plant at t_j is in the sample of tick j + this (Δo) */
    bool falls;    /* the event is there while they are false */
} tl_stroke_event;

typedef struct tl_stroke {
    tl_synchroniser *synchroniser;
    tl_stroke_event event;
    int64_t now;         /* newest tick of the live twin */
    int64_t begin;       /* tick of the stroke's start */
    int64_t event_tick;  /* of the plant's event */
    int64_t first;       /* of the window's first sample */
    int64_t last;        /* of its last sample */
    double *live_course; /* y of the matched outputs as committed, by tick in a ring */
    size_t course_size;
    double *y;
    tl_snapshot states[5];
    tl_snapshot *start;
    tl_snapshot *live;
    tl_snapshot *candidate; /* the candidate between two cycles */
    tl_snapshot *mark;      /* the candidate at the present, or at the window's end */
    tl_snapshot *best;
    int64_t mark_at;
    int64_t best_at;
    double best_u;          /* NaN: none is kept of this stroke */
    bool live_saved;        /* the FMUs are those of a candidate; `live` holds the live twin */
    bool has_candidate;     /* there is a candidate */
    bool loaded;            /* the FMUs are in its state */
    bool needs_no_mark;     /* it need not be kept: it continues the live twin, or is the winner */
    bool used_estimate;     /* it has used the newest sample in place of a later one */
    double u;               /* of the candidate */
    int64_t at;             /* tick it has reached */
    double sum;             /* J so far */
    uint32_t with_event;    /* samples of the window with the simulated event */
    uint32_t without_event; /* without it */
    int64_t arrival;        /* tick of the first sample of the window with it; INT64_MAX: none */
    int32_t late;           /* samples with the plant's event only, minus those with the simulated one only */
} tl_stroke;

typedef struct tl_stroke_settings {
    tl_synchroniser *synchroniser; /* complete; it must outlive the stroke */
    tl_stroke_event event;
    size_t
        samples; /* kept samples of the plant and outputs of the live twin: a search may start late, after missed ticks */
} tl_stroke_settings;

/* ---- event plan ---- */

static size_t steps_of(tl_time time, tl_time step) {
    return (size_t)((time + step / 2) / step);
}

/* T_F/2, at least 1; and the longest stroke. */
static size_t tl_event_plan_half(const tl_plan *plan) {
    size_t half = steps_of(plan->event.window, plan->step) / 2;
    return half > 0 ? half : 1;
}

static size_t tl_event_plan_longest(const tl_plan *plan) {
    return steps_of(plan->event.longest, plan->step);
}

/* Index of the signal of an edge; SIZE_MAX: not a signal of the plan. */
static size_t tl_event_plan_signal(const tl_plan *plan, const tl_plan_edge *edge) {
    for (size_t i = 0; i < plan->signal_count; i++) {
        if (strncmp(edge->signal, "plant.", 6) == 0 && strcmp(plan->signals[i].name, edge->signal + 6) == 0) {
            return i;
        }
    }
    return SIZE_MAX;
}

static void check_edge(const tl_plan *plan, const tl_plan_edge *edge, const char *key, tl_report *report) {
    size_t index = tl_event_plan_signal(plan, edge);
    if (index == SIZE_MAX) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where, "\"%s\": found \"%s\", expected \"plant.SIGNAL\"", key,
                      edge->signal);
    } else if (plan->signals[index].type != TL_BOOLEAN) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where,
                      "\"%s\": %s is %s, expected a Boolean signal: give it \"type\": \"boolean\"", key, edge->signal,
                      tl_type_name(plan->signals[index].type));
    }
}

static void check_matches(const tl_plan *plan, tl_report *report) {
    bool matched = false;
    for (size_t i = 0; i < plan->match_count; i++) {
        const tl_plan_match *match = &plan->match[i];
        matched = matched || (match->weight > 0.0 && strcmp(match->to, plan->event.end.signal) == 0);
    }
    if (!matched) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where,
                      "no match with a weight above 0 has \"to\": \"%s\", the end of the stroke: add one",
                      plan->event.end.signal);
    }
}

static void check_times(const tl_plan *plan, tl_report *report) {
    const tl_plan_event *event = &plan->event;
    if (plan->step <= 0) {
        return;
    }
    if (event->window < 2 * plan->step || event->longest / 2 < event->window / 2) {
        tl_report_add(report, TL_BAD_DATA, event->where,
                      "\"window_s\": found %g s, expected at least two macro steps (%g s) and at most \"longest_s\"",
                      tl_seconds(event->window), 2.0 * tl_seconds(plan->step));
    }
    if (event->longest / plan->step > TL_LONGEST_STROKE) {
        tl_report_add(report, TL_BAD_DATA, event->where,
                      "\"longest_s\": found %g s, expected at most %d macro steps (%g s)", tl_seconds(event->longest),
                      TL_LONGEST_STROKE, TL_LONGEST_STROKE * tl_seconds(plan->step));
    }
}

void tl_event_plan_check(const tl_plan *plan, tl_report *report) {
    check_edge(plan, &plan->event.start, "start", report);
    check_edge(plan, &plan->event.end, "end", report);
    check_matches(plan, report);
    check_times(plan, report);
    if (plan->adjust_count != 1) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.adjust",
                      "found %u variables, expected one: an event horizon adjusts one variable",
                      (unsigned)plan->adjust_count);
    }
    if (plan->measurements == TL_AHEAD) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.horizon.measurements",
                      "found \"ahead\", expected \"lag\" or \"hold\" with horizon.event");
    }
    if (plan->measure.lags != 0) {
        tl_report_add(report, TL_BAD_DATA, "delays",
                      "measured delays cannot be used with horizon.event: configure chains");
    }
    if (plan->shape == TL_DYNAMIC || plan->prediction != 0) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where,
                      "\"prediction\" and \"shape\" cannot be used with \"event\": remove them");
    }
}

size_t tl_event_plan_window(const tl_plan *plan) {
    return 2 * tl_event_plan_longest(plan) + 2 * tl_event_plan_half(plan) + 4;
}

/* ---- stroke ---- */

enum { STROKE_STATES = 5 };

/* Returns false if memory is out. */
static bool tl_stroke_init(tl_stroke *stroke, tl_arena *arena, const tl_stroke_settings *settings) {
    tl_exchange *exchange = settings->synchroniser->exchange;
    size_t matched = settings->synchroniser->objective.matched;
    tl_snapshot **const names[STROKE_STATES] = {&stroke->start, &stroke->live, &stroke->candidate, &stroke->mark,
                                                &stroke->best};
    *stroke = (tl_stroke){
        .synchroniser = settings->synchroniser,
        .event = settings->event,
        .live_course = tl_arena_take(arena, settings->samples * matched, sizeof *stroke->live_course),
        .course_size = settings->samples,
        .y = tl_arena_take(arena, matched, sizeof *stroke->y),
    };
    bool placed = stroke->live_course != NULL && stroke->y != NULL;
    for (size_t i = 0; i < STROKE_STATES && placed; i++) {
        *names[i] = &stroke->states[i];
        placed = tl_snapshot_init(&stroke->states[i], arena, exchange->components, exchange->component_count,
                                  exchange->values, exchange->values_size);
    }
    return placed;
}

static void tl_stroke_forget(tl_stroke *stroke, size_t component) {
    for (size_t i = 0; i < STROKE_STATES; i++) {
        tl_snapshot_forget(&stroke->states[i], component);
    }
}

/* ---- the live twin ---- */

static double *course_at(const tl_stroke *stroke, int64_t tick) {
    return &stroke->live_course[(size_t)tick % stroke->course_size * stroke->synchroniser->objective.matched];
}

/* Notes the outputs of the live twin at a tick. */
static void tl_stroke_note(tl_stroke *stroke, int64_t tick) {
    stroke->now = tick;
    tl_objective_matched(&stroke->synchroniser->objective, course_at(stroke, tick));
}

/* Saves the live twin at the start of a stroke. */
static tl_status tl_stroke_begin(tl_stroke *stroke, int64_t tick, tl_error *error) {
    stroke->begin = tick;
    return tl_snapshot_take(stroke->start, error);
}

/* Saves the live twin before the FMUs simulate a candidate. */
static tl_status save_live(tl_stroke *stroke, tl_error *error) {
    tl_status status = stroke->live_saved ? TL_OK : tl_snapshot_take(stroke->live, error);
    stroke->live_saved = stroke->live_saved || status == TL_OK;
    return status;
}

static tl_status tl_stroke_leave(tl_stroke *stroke, tl_error *error) {
    tl_status status = TL_OK;
    if (!stroke->live_saved) {
        return TL_OK;
    }
    if (stroke->loaded) {
        status = tl_snapshot_take(stroke->candidate, error);
    }
    stroke->loaded = false;
    stroke->live_saved = false;
    return status == TL_OK ? tl_snapshot_restore(stroke->live, error) : status;
}

/* ---- evaluation ---- */

static bool is_event(const tl_stroke *stroke, double value) {
    bool on = value < 0.0 || value > 0.0;
    return on != stroke->event.falls;
}

static bool plant_has_event(const tl_stroke *stroke, int64_t tick, bool *measured) {
    const tl_sample *sample = tl_plant_sample(&stroke->synchroniser->exchange->plant, tick + stroke->event.shift);
    *measured = sample->quality[stroke->event.signal] == TL_GOOD;
    return is_event(stroke, sample->values[stroke->event.signal]);
}

/* Starts a search without any candidate. Returns false if the window has no good sample of the end
 * signal. */
static bool tl_stroke_begin_search(tl_stroke *stroke) {
    bool measured = false;
    stroke->best_u = (double)NAN;
    for (int64_t tick = stroke->first; tick <= stroke->last && !measured; tick++) {
        (void)plant_has_event(stroke, tick, &measured);
    }
    return measured;
}

/* Evaluates the outputs y at one sample of the window. */
static void add_sample(tl_stroke *stroke, int64_t tick, const double *y) {
    bool measured = false;
    bool simulated = is_event(stroke, y[stroke->event.match]);
    bool real = plant_has_event(stroke, tick, &measured);
    stroke->sum += tl_objective_sample(&stroke->synchroniser->objective, tick, y);
    stroke->with_event += simulated ? 1 : 0;
    stroke->without_event += simulated ? 0 : 1;
    stroke->arrival = simulated && tick < stroke->arrival ? tick : stroke->arrival;
    if (measured) {
        stroke->late += (int32_t)real - (int32_t)simulated;
    }
}

/* Result of the candidate over the window: J without penalties, and the time of its event. */
static double tl_stroke_value(const tl_stroke *stroke) {
    return stroke->sum;
}

/* Time of the simulated event relative to the plant's. If both are in the same step, the durations
 * within the window decide: a simulated event that lasts longer counts as early. */
static tl_event_side tl_stroke_side(const tl_stroke *stroke) {
    if (stroke->without_event == 0) {
        return TL_EVENT_BEFORE;
    }
    if (stroke->with_event == 0) {
        return TL_EVENT_AFTER;
    }
    int64_t late = stroke->arrival != stroke->event_tick ? stroke->arrival - stroke->event_tick : stroke->late;
    return late > 0 ? TL_EVENT_LATE : late < 0 ? TL_EVENT_EARLY : TL_EVENT_EXACT;
}

/* ---- candidates ---- */

static void begin_candidate(tl_stroke *stroke, double u, int64_t at) {
    stroke->u = u;
    stroke->at = at;
    stroke->sum = 0.0;
    stroke->with_event = 0;
    stroke->without_event = 0;
    stroke->arrival = INT64_MAX;
    stroke->late = 0;
    stroke->has_candidate = true;
    stroke->loaded = true;
    stroke->needs_no_mark = false;
    stroke->used_estimate = false;
}

static tl_status load(tl_stroke *stroke, const tl_snapshot *from, tl_error *error) {
    tl_status status = save_live(stroke, error);
    return status == TL_OK ? tl_snapshot_restore(from, error) : status;
}

/* Starts a candidate at the start of the stroke; or takes the live twin, if u was the same for the
 * whole stroke. */
static tl_status tl_stroke_try(tl_stroke *stroke, double u, tl_error *error) {
    tl_status status = load(stroke, stroke->start, error);
    begin_candidate(stroke, u, stroke->begin);
    return status;
}

static tl_status tl_stroke_try_live(tl_stroke *stroke, double u, tl_error *error) {
    int64_t known = stroke->now < stroke->last ? stroke->now : stroke->last;
    tl_status status = known < stroke->last ? save_live(stroke, error) : TL_OK;
    begin_candidate(stroke, u, known);
    stroke->needs_no_mark = true;
    stroke->loaded = stroke->live_saved;
    for (int64_t tick = stroke->first; tick <= known; tick++) {
        add_sample(stroke, tick, course_at(stroke, tick));
    }
    return status;
}

/* Continues the winner to the present: from its mark, or from the start of the stroke. */
static tl_status tl_stroke_follow(tl_stroke *stroke, double u, tl_error *error) {
    bool kept = stroke->best_u <= u && stroke->best_u >= u;
    tl_status status = load(stroke, kept ? stroke->best : stroke->start, error);
    begin_candidate(stroke, u, kept ? stroke->best_at : stroke->begin);
    stroke->needs_no_mark = true;
    return status;
}

/* Saves the candidate at the newest sample, or at the end of the window if that is earlier. Later
 * samples do not exist yet. */
static tl_status mark_candidate(tl_stroke *stroke, tl_error *error) {
    bool due = stroke->at == stroke->now || (stroke->at == stroke->last && stroke->at < stroke->now);
    if (!due || stroke->at > stroke->last || stroke->needs_no_mark || stroke->used_estimate) {
        return TL_OK;
    }
    stroke->mark_at = stroke->at;
    return tl_snapshot_take(stroke->mark, error);
}

/* Restores the candidate; executes one macro step of it; and restores the live twin for this cycle.
 */
static tl_status tl_stroke_return(tl_stroke *stroke, tl_error *error) {
    tl_status status = stroke->loaded ? TL_OK : load(stroke, stroke->candidate, error);
    stroke->loaded = stroke->loaded || status == TL_OK;
    return status;
}

static tl_status tl_stroke_walk(tl_stroke *stroke, tl_error *error) {
    tl_synchroniser *synchroniser = stroke->synchroniser;
    tl_exchange_set_adjusted(synchroniser->exchange, 0, stroke->u);
    tl_status status = tl_exchange_try(synchroniser->exchange, stroke->at, 0, error);
    tl_ledger_walked(&synchroniser->ledger, NULL, status == TL_OK,
                     status == TL_OK ? SIZE_MAX : synchroniser->exchange->failed);
    if (status != TL_OK) {
        return status;
    }
    stroke->at++;
    stroke->used_estimate = stroke->used_estimate || stroke->at > stroke->now;
    if (stroke->at >= stroke->first && stroke->at <= stroke->last) {
        tl_objective_matched(&synchroniser->objective, stroke->y);
        add_sample(stroke, stroke->at, stroke->y);
    }
    return mark_candidate(stroke, error);
}

/* Keeps the mark of the best candidate so far. */
static void tl_stroke_keep(tl_stroke *stroke) {
    tl_snapshot *mark = stroke->mark;
    stroke->mark = stroke->best;
    stroke->best = mark;
    stroke->best_at = stroke->mark_at;
    stroke->best_u = stroke->u;
}

/* Drops the candidate; or makes it the twin. */
static void tl_stroke_drop(tl_stroke *stroke) {
    stroke->has_candidate = false;
    stroke->loaded = false;
}

static void tl_stroke_adopt(tl_stroke *stroke) {
    tl_stroke_drop(stroke);
    stroke->live_saved = false;
}

/* ---- event horizon ---- */

typedef enum event_phase {
    WAITING,   /* for the start of a stroke */
    STROKE,    /* for its end */
    WINDOW,    /* until the window is complete */
    SEARCHING, /* evaluating candidates */
    FOLLOWING, /* continuing the winner to the present */
    CONFIRMING /* done, but the newest sample has replaced later ones of the window */
} event_phase;

/* Edge of a signal of the plant. */
typedef struct event_edge {
    size_t signal;
    bool falls;
    bool effect; /* measured; else a command */
} event_edge;

struct tl_event_horizon {
    tl_synchroniser *synchroniser;
    tl_event_search search;
    tl_stroke stroke;
    event_edge start;
    event_edge end;
    int64_t half;      /* T_F/2, macro steps */
    int64_t longest;   /* macro steps */
    int64_t kept;      /* samples that are still kept */
    bool holds_values; /* hold */
    event_phase phase;
    bool own_course; /* the live twin has run the whole stroke with u */
    double u;        /* in use */
    double winner;
    tl_outcome outcome;   /* of the winner */
    tl_stop stop;         /* why its search stopped */
    double value;         /* J of the winner */
    double before;        /* u at the start of the stroke */
    tl_time restore_cost; /* most ns to restore a candidate, decaying */
    tl_time leave_cost;   /* most ns to save it and restore the live twin, decaying */
};

static double nominal_of(const tl_event_horizon *self) {
    return tl_exchange_nominal(self->synchroniser->exchange, 0);
}

/* ---- build ---- */

/* The matched output of the event; a checked plan has exactly one. */
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

tl_event_horizon *tl_event_horizon_create(tl_arena *arena, tl_synchroniser *synchroniser, const tl_plan *plan) {
    tl_event_horizon *self = tl_arena_take(arena, 1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    const tl_adjusted *adjusted = &synchroniser->adjusted[0];
    self->synchroniser = synchroniser;
    self->start.falls = plan->event.start.falls;
    self->end.falls = plan->event.end.falls;
    self->end.effect = true;
    self->start.signal = tl_event_plan_signal(plan, &plan->event.start);
    self->end.signal = tl_event_plan_signal(plan, &plan->event.end);
    self->half = (int64_t)tl_event_plan_half(plan);
    self->longest = (int64_t)tl_event_plan_longest(plan);
    self->kept = (int64_t)tl_event_plan_window(plan) - 2;
    self->holds_values = plan->measurements == TL_HOLD;
    self->u = nominal_of(self);
    const tl_stroke_settings stroke = {.synchroniser = synchroniser,
                                       .event = find_event(&synchroniser->objective, self->end),
                                       .samples = tl_event_plan_window(plan)};
    const tl_event_search_settings search = {.solver = synchroniser->solver,
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

/* The plant at t_tick: commands are looked up as inputs, effects as measurements. */
static const tl_sample *sample_of(const tl_event_horizon *self, event_edge edge, int64_t tick) {
    const tl_plant *plant = &self->synchroniser->exchange->plant;
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

/* Whether the edge comes at this tick. A bad value is replaced by the last good one, so the edge
 * comes with the first good value. *sure: the value before was good, so the plant's edge was at
 * this tick. */
static bool has_edge(const tl_event_horizon *self, event_edge edge, int64_t tick, bool *sure) {
    *sure = tick > 0 && is_good(self, edge, tick - 1);
    return tick > 0 && is_on(self, edge, tick) && !is_on(self, edge, tick - 1);
}

/* Whether the best candidate may be used: it must be better than nominal; without that comparison
 * it is not used. */
static bool is_worth(const tl_event_horizon *self, const tl_event_candidate *best) {
    const tl_event_candidate *nominal = tl_event_search_find(&self->search, nominal_of(self));
    return best->value < TL_OBJECTIVE_TOLERANCE ||
           (nominal != NULL && best->value <= (1.0 - self->synchroniser->margin) * nominal->value &&
            best->value < nominal->value);
}

/* Abandons the search of the stroke. The best u so far is used without its state. */
static void abandon(tl_event_horizon *self, tl_record *record) {
    if (self->phase == SEARCHING && self->search.count > 0) {
        const tl_event_candidate *best = tl_event_search_best(&self->search);
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
    stroke->event_tick = tick;
    self->phase = WINDOW;
    if (self->holds_values) {
        begin_search(self, record);
    }
}

/* If the end signal has returned within the window, the search drops its candidates and waits for
 * the window's end. The search has used the newest sample in place of this one. */
static void confirm_event(tl_event_horizon *self, int64_t tick) {
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

/* Updates the phase from the newest sample. */
static tl_status follow_plant(tl_event_horizon *self, int64_t tick, tl_record *record, tl_error *error) {
    bool sure = false;
    confirm_event(self, tick);
    if (has_edge(self, self->start, tick, &sure)) {
        return begin_stroke(self, tick, sure, record, error);
    }
    if (self->phase == STROKE && has_edge(self, self->end, tick, &sure)) {
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

/* Whether the live twin is the candidate with this u. */
static bool is_live(const tl_event_horizon *self, double u) {
    return self->own_course && is_u(self, u);
}

static tl_status try_candidate(tl_event_horizon *self, double u, tl_error *error) {
    return is_live(self, u) ? tl_stroke_try_live(&self->stroke, u, error) : tl_stroke_try(&self->stroke, u, error);
}

/* Makes the winner the twin. The result of the search is recorded now, because the step in which it
 * was known depends on the available time. */
static void adopt_winner(tl_event_horizon *self, tl_record *record) {
    bool stood_for = self->stroke.now < self->stroke.last;
    const tl_event_candidate *nominal = tl_event_search_find(&self->search, nominal_of(self));
    self->own_course = self->own_course && is_u(self, self->winner);
    self->u = self->winner;
    self->phase = stood_for ? CONFIRMING : WAITING;
    record->outcome = self->outcome;
    record->stop = self->stop;
    record->objective = isfinite(self->value) ? self->value : (double)NAN;
    record->objective_nominal = nominal != NULL && isfinite(nominal->value) ? nominal->value : (double)NAN;
    record->flags |= tl_event_search_met_plateau(&self->search) ? TL_FLAG_PLATEAU : 0U;
}

/* The best candidate if it may be used. Otherwise the u at the start of the stroke, if it is as
 * good as nominal; otherwise nominal, which was tried. */
static const tl_event_candidate *choose_winner(const tl_event_horizon *self, const tl_event_candidate *best) {
    const tl_event_candidate *nominal = tl_event_search_find(&self->search, nominal_of(self));
    const tl_event_candidate *present_u = tl_event_search_find(&self->search, self->before);
    if (is_worth(self, best) || nominal == NULL) {
        return best;
    }
    bool stays = present_u != NULL && isfinite(present_u->value) && present_u->value <= nominal->value;
    return stays ? present_u : nominal;
}

static tl_stop stop_reason(const tl_event_horizon *self, const tl_event_candidate *best) {
    if (best->value < TL_OBJECTIVE_TOLERANCE) {
        return TL_STOP_TOLERANCE;
    }
    return tl_event_search_is_full(&self->search) ? TL_STOP_EVALUATIONS : TL_STOP_SOLVER;
}

static tl_outcome outcome_of(const tl_event_horizon *self, const tl_event_candidate *best,
                             const tl_event_candidate *winner) {
    if (best->value < TL_OBJECTIVE_TOLERANCE) {
        return best == &self->search.candidates[0] ? TL_FIRST_GUESS : TL_OPTIMISED;
    }
    return winner == tl_event_search_find(&self->search, nominal_of(self)) ? TL_NOMINAL : TL_BEST_SO_FAR;
}

/* Chooses the winner and how it becomes the twin. */
static tl_status conclude_search(tl_event_horizon *self, tl_record *record, tl_error *error) {
    const tl_event_candidate *best = tl_event_search_best(&self->search);
    const tl_event_candidate *winner = choose_winner(self, best);
    self->stop = stop_reason(self, best);
    self->outcome = outcome_of(self, best, winner);
    self->winner = winner->u;
    self->value = winner->value;
    if (is_live(self, self->winner)) {
        adopt_winner(self, record);
        return TL_OK;
    }
    self->phase = FOLLOWING;
    return tl_stroke_follow(&self->stroke, self->winner, error);
}

/* Starts the next candidate or ends the search. The last evaluation is reserved for nominal. In a
 * repeated search the u before the first search comes second. */
static tl_status start_next(tl_event_horizon *self, tl_record *record, tl_error *error) {
    tl_event_search *search = &self->search;
    double u = search->count == 0 ? self->u : self->before;
    bool again = search->count == 1 && tl_event_search_find(search, u) == NULL;
    double ignored = 0.0;
    bool nominal_known = tl_event_search_find(search, nominal_of(self)) != NULL;
    bool room = search->count + (nominal_known ? 0 : 1) < search->most;
    if (search->count == 0 || (room && tl_event_search_next(search, again ? &ignored : &u))) {
        return try_candidate(self, u, error);
    }
    bool within = tl_event_search_best(search)->value < TL_OBJECTIVE_TOLERANCE;
    if (!within && !nominal_known && !tl_event_search_is_full(search)) {
        return try_candidate(self, nominal_of(self), error);
    }
    return conclude_search(self, record, error);
}

/* Ends a candidate that has passed the window or has failed. */
static void end_candidate(tl_event_horizon *self, bool failed, tl_record *record) {
    tl_synchroniser *synchroniser = self->synchroniser;
    tl_stroke *stroke = &self->stroke;
    double nominal = nominal_of(self);
    double value = HUGE_VAL;
    if (!failed) {
        value = tl_stroke_value(stroke) + tl_objective_penalise(&synchroniser->objective, &stroke->u, &nominal,
                                                                &self->u, synchroniser->memory.residuals);
        value = isfinite(value) ? value : HUGE_VAL;
    }
    if (failed && record->refused.count++ == 0) {
        record->flags |= TL_FLAG_REFUSED;
        record->refused.index = (uint32_t)synchroniser->exchange->failed;
        record->refused.u = stroke->u;
    }
    tl_event_search_report(&self->search, stroke->u, value, failed ? TL_EVENT_UNKNOWN : tl_stroke_side(stroke));
    const tl_event_candidate *last = &self->search.candidates[self->search.count - 1];
    if (!failed && !stroke->needs_no_mark && tl_event_search_best(&self->search) == last) {
        tl_stroke_keep(stroke);
    }
    tl_stroke_drop(stroke);
    record->evaluations++;
}

/* Whether the candidate or the winner has reached its end. */
static bool is_complete(const tl_event_horizon *self) {
    const tl_stroke *stroke = &self->stroke;
    return self->phase == FOLLOWING ? stroke->at >= stroke->now : stroke->at >= stroke->last;
}

static void complete_candidate(tl_event_horizon *self, tl_record *record) {
    if (self->phase == SEARCHING) {
        end_candidate(self, false, record);
        return;
    }
    tl_stroke_adopt(&self->stroke);
    adopt_winner(self, record);
}

/* Drops a winner that fails on its way to the present. */
static tl_status handle_failure(tl_event_horizon *self, tl_status status, tl_record *record) {
    if (status != TL_FMU_FAILED) {
        return status;
    }
    if (self->phase == SEARCHING) {
        end_candidate(self, true, record);
        return TL_OK;
    }
    self->winner = self->u;
    abandon(self, record);
    return TL_OK;
}

/* Whether this cycle has time for one more macro step and for saving the candidate. A repetition
 * executes as many steps as the original cycle. */
static bool has_time(const tl_event_horizon *self, const tl_budget *budget, uint64_t begun) {
    tl_exchange *exchange = self->synchroniser->exchange;
    if (budget->repeated) {
        return exchange->executions + exchange->plant.executions - begun < budget->executions;
    }
    if (budget->now == NULL) {
        return true;
    }
    (void)tl_costs_lap(&exchange->costs);
    tl_time cost = self->leave_cost + (self->stroke.loaded ? 0 : self->restore_cost) + tl_exchange_cost(exchange, 1);
    return tl_duration(budget->started, exchange->costs.read) + cost <= budget->time;
}

/* ns since the last clock reading without executions; 0 without a clock. */
static tl_time lap(const tl_event_horizon *self) {
    tl_costs *costs = &self->synchroniser->exchange->costs;
    return costs->now != NULL ? tl_costs_lap(costs) : 0;
}

/* Executes one macro step of the candidate from where it was saved. */
static tl_status step_candidate(tl_event_horizon *self, tl_record *record, tl_error *error) {
    tl_status status = TL_OK;
    if (!self->stroke.loaded) {
        status = tl_stroke_return(&self->stroke, error);
        self->restore_cost = tl_duration_expect(self->restore_cost, lap(self));
    }
    return status == TL_OK ? handle_failure(self, tl_stroke_walk(&self->stroke, error), record) : status;
}

/* Continues the search as far as time allows. The first candidate starts even if there is no time,
 * because it is the live twin as it is now. */
static tl_status continue_search(tl_event_horizon *self, const tl_budget *budget, uint64_t begun, tl_record *record,
                                 tl_error *error) {
    tl_status status = TL_OK;
    while (status == TL_OK && (self->phase == SEARCHING || self->phase == FOLLOWING)) {
        if (self->stroke.has_candidate && is_complete(self)) {
            complete_candidate(self, record);
        } else if ((self->stroke.has_candidate || self->search.count > 0) && !has_time(self, budget, begun)) {
            record->stop = TL_STOP_TIME;
            break;
        } else if (!self->stroke.has_candidate) {
            status = start_next(self, record, error);
        } else {
            status = step_candidate(self, record, error);
        }
    }
    return status;
}

/* Runs the search of this cycle and restores the live twin. */
static tl_status run_search(tl_event_horizon *self, const tl_budget *budget, uint64_t begun, tl_record *record,
                            tl_error *error) {
    tl_status status = continue_search(self, budget, begun, record, error);
    if (status != TL_OK) {
        return status;
    }
    if (!self->stroke.live_saved) {
        self->restore_cost = tl_duration_fade(self->restore_cost); /* else one slow restore would end all searches */
        self->leave_cost = tl_duration_fade(self->leave_cost);
        return TL_OK;
    }
    (void)lap(self);
    status = tl_stroke_leave(&self->stroke, error);
    self->leave_cost = tl_duration_expect(self->leave_cost, lap(self));
    return status;
}

/* ---- the step ---- */

/* Executes one macro step of the live twin. It is not final, because it will be rolled back. */
static tl_status step_once(tl_event_horizon *self, int64_t step, tl_error *error) {
    tl_exchange_set_adjusted(self->synchroniser->exchange, 0, self->u);
    return tl_exchange_try(self->synchroniser->exchange, step, 0, error);
}

/* Uses nominal again if an FMU fails with a u of a search. */
static tl_status step_live(tl_event_horizon *self, int64_t step, tl_record *record, tl_error *error) {
    tl_synchroniser *synchroniser = self->synchroniser;
    bool corrected = !is_u(self, nominal_of(self));
    tl_status status = corrected ? tl_snapshot_take(self->stroke.live, error) : TL_OK;
    if (status != TL_OK) {
        return status; /* `live` is older: it cannot be restored */
    }
    status = step_once(self, step, error);
    if (status == TL_FMU_FAILED && corrected) {
        tl_ledger_walked(&synchroniser->ledger, NULL, 0, synchroniser->exchange->failed);
        status = tl_snapshot_restore(self->stroke.live, error);
        self->u = nominal_of(self);
        self->own_course = false;
        record->outcome = TL_NOMINAL;
        status = status == TL_OK ? step_once(self, step, error) : status;
    }
    if (status == TL_OK) {
        tl_ledger_commit(&synchroniser->ledger, NULL);
        tl_stroke_note(&self->stroke, step + 1);
    }
    return status;
}

static void begin_record(const tl_event_horizon *self, int64_t step, tl_record *record) {
    tl_record_begin(record, step);
    record->outcome = TL_HELD;
    record->nominal[0] = nominal_of(self);
}

/* Records the committed values; a search may have changed them. */
static void fill_record(const tl_event_horizon *self, tl_record *record) {
    const tl_objective *objective = &self->synchroniser->objective;
    bool busy = self->phase == SEARCHING || self->phase == FOLLOWING;
    for (size_t i = 0; i < objective->term_count; i++) {
        record->y[i] = tl_objective_y(objective, i);
    }
    record->u[0] = self->u;
    record->outcome = busy && record->outcome == TL_HELD ? TL_SEARCHING : record->outcome;
}

tl_status tl_event_horizon_step(tl_event_horizon *self, int64_t step, const tl_budget *budget, tl_record *record,
                                tl_error *error) {
    tl_exchange *exchange = self->synchroniser->exchange;
    uint64_t begun = exchange->executions + exchange->plant.executions;
    begin_record(self, step, record);
    tl_costs_begin(&exchange->costs, budget == NULL ? NULL : budget->now, budget == NULL ? NULL : budget->context);
    tl_status status = step_live(self, step, record, error);
    (void)lap(self);
    status = status == TL_OK ? follow_plant(self, step + 1, record, error) : status;
    if (status == TL_OK && budget != NULL) {
        status = run_search(self, budget, begun, record, error);
    }
    fill_record(self, record);
    record->outcome = budget == NULL ? TL_CAUGHT_UP : record->outcome;
    return status;
}

tl_status tl_event_horizon_follow(tl_event_horizon *self, int64_t step, double u, tl_record *record, tl_error *error) {
    self->own_course = self->own_course && is_u(self, u);
    self->u = u;
    tl_status status = tl_event_horizon_step(self, step, NULL, record, error);
    record->outcome = TL_RESUMED;
    return status;
}

void tl_event_horizon_abandon(tl_event_horizon *self) {
    tl_stroke_drop(&self->stroke);
    self->phase = WAITING;
    self->own_course = false;
}

bool tl_event_horizon_reset(tl_event_horizon *self) {
    bool was_running = self->phase != WAITING && self->phase != CONFIRMING;
    tl_event_horizon_abandon(self);
    self->u = nominal_of(self);
    return was_running;
}

void tl_event_horizon_retune(tl_event_horizon *self, const tl_tuning *tuning, bool begun) {
    const tl_adjusted *adjusted = &self->synchroniser->adjusted[0];
    tl_event_search_retune(&self->search, adjusted->lower, adjusted->upper, (size_t)tuning->evaluations);
    self->u = begun ? self->u : nominal_of(self);
    if (self->phase == SEARCHING) { /* its result is not comparable with later ones */
        tl_stroke_drop(&self->stroke);
        self->phase = WINDOW;
    }
}

void tl_event_horizon_archive(tl_event_horizon *self, tl_archive *archive) {
    tl_archive_part(archive, &self->u, sizeof self->u);
    tl_archive_require_finite(archive, &self->u, 1);
}
