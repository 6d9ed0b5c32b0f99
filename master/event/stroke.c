/* One stroke, run again: see stroke.h. */
#include "master/event/stroke.h"

#include <math.h>

enum { STATES = 5 };

bool tl_stroke_init(tl_stroke *stroke, tl_arena *arena, const tl_stroke_settings *settings) {
    tl_exchange *exchange = settings->lock->exchange;
    size_t matched = settings->lock->objective.matched;
    tl_snapshot **const names[STATES] = {&stroke->start, &stroke->live, &stroke->walker, &stroke->mark, &stroke->best};
    *stroke = (tl_stroke){
        .lock = settings->lock,
        .event = settings->event,
        .live_course = tl_arena_take(arena, settings->samples * matched, sizeof *stroke->live_course),
        .course_size = settings->samples,
        .y = tl_arena_take(arena, matched, sizeof *stroke->y),
    };
    bool placed = stroke->live_course != NULL && stroke->y != NULL;
    for (size_t i = 0; i < STATES && placed; i++) {
        *names[i] = &stroke->states[i];
        placed = tl_snapshot_init(&stroke->states[i], arena, exchange->components, exchange->component_count,
                                  exchange->values, exchange->values_size);
    }
    return placed;
}

void tl_stroke_forget(tl_stroke *stroke, size_t component) {
    for (size_t i = 0; i < STATES; i++) {
        tl_snapshot_forget(&stroke->states[i], component);
    }
}

/* ---- the live twin ---- */

static double *course_at(const tl_stroke *stroke, int64_t tick) {
    return &stroke->live_course[(size_t)tick % stroke->course_size * stroke->lock->objective.matched];
}

void tl_stroke_note(tl_stroke *stroke, int64_t tick) {
    stroke->now = tick;
    tl_objective_matched(&stroke->lock->objective, course_at(stroke, tick));
}

tl_status tl_stroke_begin(tl_stroke *stroke, int64_t tick, tl_error *error) {
    stroke->begin = tick;
    return tl_snapshot_take(stroke->start, error);
}

/* Keeps the live twin, before the FMUs are led elsewhere. */
static tl_status go_away(tl_stroke *stroke, tl_error *error) {
    tl_status status = stroke->away ? TL_OK : tl_snapshot_take(stroke->live, error);
    stroke->away = stroke->away || status == TL_OK;
    return status;
}

tl_status tl_stroke_leave(tl_stroke *stroke, tl_error *error) {
    tl_status status = TL_OK;
    if (!stroke->away) {
        return TL_OK;
    }
    if (stroke->loaded) {
        status = tl_snapshot_take(stroke->walker, error);
    }
    stroke->loaded = false;
    stroke->away = false;
    return status == TL_OK ? tl_snapshot_restore(stroke->live, error) : status;
}

/* ---- judging ---- */

static bool is_there(const tl_stroke *stroke, double value) {
    bool on = value < 0.0 || value > 0.0;
    return on != stroke->event.falls;
}

static bool plant_is_there(const tl_stroke *stroke, int64_t tick, bool *measured) {
    const tl_sample *sample = tl_plant_sample(&stroke->lock->exchange->plant, tick + stroke->event.shift);
    *measured = sample->quality[stroke->event.signal] == TL_GOOD;
    return is_there(stroke, sample->values[stroke->event.signal]);
}

bool tl_stroke_begin_search(tl_stroke *stroke) {
    bool measured = false;
    stroke->best_u = (double)NAN;
    for (int64_t tick = stroke->first; tick <= stroke->last && !measured; tick++) {
        (void)plant_is_there(stroke, tick, &measured);
    }
    return measured;
}

/* What the outputs y of one sample of the window say. */
static void judge(tl_stroke *stroke, int64_t tick, const double *y) {
    bool measured = false;
    bool simulated = is_there(stroke, y[stroke->event.match]);
    bool real = plant_is_there(stroke, tick, &measured);
    stroke->sum += tl_objective_sample(&stroke->lock->objective, tick, y);
    stroke->here += simulated ? 1 : 0;
    stroke->missing += simulated ? 0 : 1;
    stroke->arrival = simulated && tick < stroke->arrival ? tick : stroke->arrival;
    if (measured) {
        stroke->late += (int32_t)real - (int32_t)simulated;
    }
}

double tl_stroke_value(const tl_stroke *stroke) {
    return stroke->sum;
}

/* Which of two instants is the later one; of equals what else the window says: a signal that is soon gone again is there longer
 * where it comes sooner. */
tl_event_side tl_stroke_side(const tl_stroke *stroke) {
    if (stroke->missing == 0) {
        return TL_EVENT_BEFORE;
    }
    if (stroke->here == 0) {
        return TL_EVENT_AFTER;
    }
    int64_t late = stroke->arrival != stroke->met ? stroke->arrival - stroke->met : stroke->late;
    return late > 0 ? TL_EVENT_LATE : late < 0 ? TL_EVENT_EARLY : TL_EVENT_EXACT;
}

/* ---- candidates ---- */

static void begin_candidate(tl_stroke *stroke, double u, int64_t at) {
    stroke->u = u;
    stroke->at = at;
    stroke->sum = 0.0;
    stroke->here = 0;
    stroke->missing = 0;
    stroke->arrival = INT64_MAX;
    stroke->late = 0;
    stroke->walking = true;
    stroke->loaded = true;
    stroke->unkept = false;
    stroke->supposed = false;
}

static tl_status load(tl_stroke *stroke, const tl_snapshot *from, tl_error *error) {
    tl_status status = go_away(stroke, error);
    return status == TL_OK ? tl_snapshot_restore(from, error) : status;
}

tl_status tl_stroke_try(tl_stroke *stroke, double u, tl_error *error) {
    tl_status status = load(stroke, stroke->start, error);
    begin_candidate(stroke, u, stroke->begin);
    return status;
}

tl_status tl_stroke_try_live(tl_stroke *stroke, double u, tl_error *error) {
    int64_t known = stroke->now < stroke->last ? stroke->now : stroke->last;
    tl_status status = known < stroke->last ? go_away(stroke, error) : TL_OK;
    begin_candidate(stroke, u, known);
    stroke->unkept = true;
    stroke->loaded = stroke->away;
    for (int64_t tick = stroke->first; tick <= known; tick++) {
        judge(stroke, tick, course_at(stroke, tick));
    }
    return status;
}

tl_status tl_stroke_follow(tl_stroke *stroke, double u, tl_error *error) {
    bool kept = stroke->best_u <= u && stroke->best_u >= u;
    tl_status status = load(stroke, kept ? stroke->best : stroke->start, error);
    begin_candidate(stroke, u, kept ? stroke->best_at : stroke->begin);
    stroke->unkept = true;
    return status;
}

/* Keeps the candidate where it has used nothing that is only stood for, as late as that is. */
static tl_status mark(tl_stroke *stroke, tl_error *error) {
    bool due = stroke->at == stroke->now || (stroke->at == stroke->last && stroke->at < stroke->now);
    if (!due || stroke->at > stroke->last || stroke->unkept || stroke->supposed) {
        return TL_OK;
    }
    stroke->mark_at = stroke->at;
    return tl_snapshot_take(stroke->mark, error);
}

tl_status tl_stroke_return(tl_stroke *stroke, tl_error *error) {
    tl_status status = stroke->loaded ? TL_OK : load(stroke, stroke->walker, error);
    stroke->loaded = stroke->loaded || status == TL_OK;
    return status;
}

tl_status tl_stroke_walk(tl_stroke *stroke, tl_error *error) {
    tl_lock *lock = stroke->lock;
    tl_exchange_set_adjusted(lock->exchange, 0, stroke->u);
    tl_status status = tl_exchange_try(lock->exchange, stroke->at, 0, error);
    tl_ledger_walked(&lock->ledger, status == TL_OK, status == TL_OK ? SIZE_MAX : lock->exchange->failed);
    if (status != TL_OK) {
        return status;
    }
    stroke->at++;
    stroke->supposed = stroke->supposed || stroke->at > stroke->now;
    if (stroke->at >= stroke->first && stroke->at <= stroke->last) {
        tl_objective_matched(&lock->objective, stroke->y);
        judge(stroke, stroke->at, stroke->y);
    }
    return mark(stroke, error);
}

void tl_stroke_keep(tl_stroke *stroke) {
    tl_snapshot *mark = stroke->mark;
    stroke->mark = stroke->best;
    stroke->best = mark;
    stroke->best_at = stroke->mark_at;
    stroke->best_u = stroke->u;
}

void tl_stroke_drop(tl_stroke *stroke) {
    stroke->walking = false;
    stroke->loaded = false;
}

void tl_stroke_adopt(tl_stroke *stroke) {
    tl_stroke_drop(stroke);
    stroke->away = false;
}
