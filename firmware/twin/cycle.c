/* The real-time cycle: see cycle.h. */
#include "firmware/twin/cycle.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/base/c_locale.h"
#include "firmware/base/clock.h"
#include "firmware/fmu/fmu_guard.h"
#include "firmware/process/host_state.h"
#include "firmware/twin/cycle_parts.h"
#include "firmware/twin/realtime.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_verify.h"

/* What FMUs may take to begin, as at the start of a run. */
static const tl_time PATIENCE_WITH_BEGINNING = 120 * TL_SECOND;

static bool is_stopped(const tl_cycle *cycle) {
    return __atomic_load_n(&cycle->stop, __ATOMIC_RELAXED);
}

static void show(tl_cycle *cycle) {
    int64_t due = cycle->next_tick - cycle->warm_up;
    tl_cycle_status *shown = &cycle->shown;
    cycle->summary.ticks = due > 0 ? (uint64_t)due : 0;
    shown->is_shadow = cycle->is_shadow;
    shown->is_live = !cycle->is_behind;
    shown->tick = cycle->next_tick - 1;
    shown->steps = cycle->summary.figures.steps;
    shown->ticks = cycle->summary.ticks;
    shown->skipped = cycle->summary.figures.skipped;
    shown->gaps = cycle->summary.gaps;
    shown->deadline_misses = cycle->summary.deadline_misses;
    shown->evaluations = cycle->summary.figures.evaluations;
    shown->timed_out = cycle->summary.figures.time_limited;
    shown->lock = cycle->rescue.judge.tally;
    shown->lock_before = cycle->second.tally;
    tl_latest_publish(&cycle->published, shown, sizeof *shown);
}

static tl_time patience(const tl_config *config) {
    return config->realtime_hang + 2 * config->step;
}

/* In mode ahead the record that is complete at its first tick is not of its own steps. */
static void count(tl_cycle *cycle, const tl_record *record) {
    const tl_config *config = &cycle->settings.assembly->config;
    if (record->step >= cycle->first_step) {
        tl_summary_add(&cycle->summary, config, record);
        cycle->shown.executions += record->executions;
        cycle->shown.used += record->used;
        for (size_t i = 0; i < config->match_count; i++) {
            tl_metrics_add(&cycle->shown.match[i], record->y[i], record->y_hat[i],
                           (tl_quality)record->y_hat_quality[i]);
        }
    }
}

static void keep(tl_cycle *cycle, int64_t tick, const tl_record *record) {
    const tl_lock_change *change = NULL;
    count(cycle, record);
    tl_watch_record(&cycle->watch, tick, record);
    if ((record->flags & TL_FLAG_RESET) != 0) {
        tl_checkpointer_hurry(&cycle->checkpointer, tick);
        tl_heart_be_patient(cycle->heart, patience(&cycle->settings.assembly->config));
    }
    if (tl_lock_rescue_step(&cycle->rescue, record, &change)) {
        tl_heart_be_patient(cycle->heart, PATIENCE_WITH_BEGINNING);
        tl_twin_reset(cycle->settings.assembly->twin);
    }
    (void)tl_lock_judge_step(&cycle->second, record);
    if (change != NULL) {
        tl_watch_lock(&cycle->watch, tick, change);
    }
    tl_watch_bounds(&cycle->watch, tick, &cycle->rescue.judge);
    if (cycle->has_run) {
        tl_twin_recorder_put(cycle->settings.outbox, record, cycle->settings.assembly->twin);
    }
    cycle->shown.record = *record;
}

/* ---- ticks ---- */

/* With what is in force from its tick on. */
static void put_sample(tl_cycle *cycle, const tl_sample *sample) {
    if (!cycle->has_run) {
        return;
    }
    if (cycle->has_tuning) {
        (void)tl_outbox_put_tuning(cycle->settings.outbox, &cycle->tuning);
        cycle->has_tuning = false;
    }
    (void)tl_outbox_put_sample(cycle->settings.outbox, sample);
}

/* In its first tick the twin begins, and its FMUs are proved. */
static void note_beginning(tl_cycle *cycle) {
    if (!cycle->has_begun) {
        cycle->has_begun = true;
        tl_heart_be_patient(cycle->heart, patience(&cycle->settings.assembly->config));
    }
}

/* One tick: searched within `budget`, or made up where that is NULL. */
static tl_status compute_tick(tl_cycle *cycle, int64_t tick, const tl_budget *budget) {
    tl_heart_beat(cycle->heart);
    tl_sample sample;
    tl_record record;
    bool ready = false;
    tl_twin *twin = cycle->settings.assembly->twin;
    tl_time instant = tl_time_of_step(cycle->start, cycle->settings.assembly->config.step, tick);
    tl_plant_input_take(cycle->settings.input, tick, instant, &sample);
    tl_watch_sample(&cycle->watch, &sample);
    tl_lock_rescue_sample(&cycle->rescue, &sample);
    tl_lock_judge_sample(&cycle->second, &sample);
    tl_summary_sample(&cycle->summary, &cycle->settings.assembly->config, &sample);
    /* There the step before is complete only now, and comes before the sample. */
    bool ahead = cycle->settings.assembly->config.measurements == TL_AHEAD;
    if (!ahead) {
        put_sample(cycle, &sample);
    }
    tl_status status = budget == NULL ? tl_twin_make_up(twin, &sample, &record, &ready, &cycle->error)
                                      : tl_twin_step(twin, &sample, budget, &record, &ready, &cycle->error);
    note_beginning(cycle);
    if (ready) {
        keep(cycle, tick, &record);
    }
    if (ahead) {
        put_sample(cycle, &sample);
        tl_cycle_hand_over_with(cycle);
    }
    if (status == TL_OK) {
        bool skipped = budget == NULL && tick >= cycle->warm_up;
        cycle->summary.figures.skipped += skipped ? 1 : 0;
        cycle->summary.gaps += skipped && !cycle->has_skipped ? 1 : 0;
        cycle->skipped += skipped ? 1 : 0;
        cycle->has_skipped = skipped;
        cycle->next_tick = tick + 1;
        status = tl_cycle_after_tick(cycle, tick, budget);
    }
    return status;
}

static tl_status compute(tl_cycle *cycle, int64_t tick, const tl_budget *budget) {
    tl_status status = tl_cycle_before_tick(cycle);
    return status == TL_OK ? compute_tick(cycle, tick, budget) : status;
}

/* A missed tick is made up; but a shadow that comes to the plant's ticks searches on its way, so that it has found its lock once it is there. */
static tl_status compute_missed(tl_cycle *cycle, const tl_budget *budget) {
    tl_budget own = *budget;
    own.started = tl_clock_now(NULL);
    return compute(cycle, cycle->next_tick, cycle->is_behind ? &own : NULL);
}

/* All that is due: missed ticks first, as many as the budget allows, then the present one. */
static tl_status catch_up(tl_cycle *cycle, const tl_budget *budget) {
    tl_time period = cycle->settings.assembly->config.step;
    tl_time start = cycle->start + tl_cycle_delay(cycle);
    int64_t present = (budget->started - start) / period;
    int64_t missed_from = cycle->next_tick;
    uint64_t skipped_before = cycle->skipped;
    tl_status status = TL_OK;
    present = present < cycle->last_tick ? present : cycle->last_tick;
    while (status == TL_OK && cycle->next_tick < present) {
        if (cycle->next_tick != missed_from && tl_clock_now(NULL) - budget->started >= budget->time) {
            break; /* the rest at the next tick */
        }
        status = compute_missed(cycle, budget);
    }
    tl_watch_skipped(&cycle->watch, present, cycle->skipped - skipped_before, tl_time_of_step(start, period, present));
    if (status == TL_OK && cycle->next_tick == present) {
        tl_cycle_be_live(cycle);
        status = compute(cycle, present, budget);
        tl_time deadline = tl_time_of_step(start, period, present + 1);
        cycle->summary.deadline_misses += tl_clock_now(NULL) > deadline ? 1 : 0;
    }
    return status;
}

/* Mode ahead: the last step's measurement is one period away. Asked to stop, nobody waits for it. */
static void finish(tl_cycle *cycle) {
    const tl_config *config = &cycle->settings.assembly->config;
    tl_time instant = tl_time_of_step(cycle->start, config->step, cycle->next_tick);
    tl_sample sample;
    tl_record record;
    bool ready = false;
    if (config->measurements != TL_AHEAD || cycle->next_tick == 0) {
        return;
    }
    if (!is_stopped(cycle)) {
        tl_clock_sleep_until(instant);
    }
    tl_plant_input_take(cycle->settings.input, cycle->next_tick, instant, &sample);
    if (tl_clock_now(NULL) < instant) {
        memset(sample.quality, TL_STALE, config->signal_count);
    }
    tl_twin_finish(cycle->settings.assembly->twin, &sample, &record, &ready);
    if (ready) {
        keep(cycle, cycle->next_tick, &record);
        put_sample(cycle, &sample);
    }
}

/* What is left until the next tick is for looking whether the FMUs still come back to where they were; some of it stays left. */
static tl_status look(tl_cycle *cycle) {
    enum { STAYS_LEFT = 8 }; /* of a period, the part */
    tl_time period = cycle->settings.assembly->config.step;
    tl_time next = tl_time_of_step(cycle->start, period, cycle->next_tick) + tl_cycle_delay(cycle);
    tl_twin_look_news news;
    tl_status status = tl_twin_look(cycle->settings.assembly->twin, next - period / STAYS_LEFT, &news, &cycle->error);
    if (news.found) {
        tl_journal_event(cycle->settings.journal, -1, news.mended ? TL_EVENT_WARNING : TL_EVENT_ERROR, "twin", "%s",
                         news.text);
    }
    return status;
}

static void run(void *context) {
    tl_cycle *cycle = context;
    const tl_config *config = &cycle->settings.assembly->config;
    tl_locale_use();
    tl_realtime_touch_stack();
    while (!is_stopped(cycle) && cycle->status == TL_OK && cycle->next_tick <= cycle->last_tick) {
        tl_time instant = tl_time_of_step(cycle->start, config->step, cycle->next_tick) + tl_cycle_delay(cycle);
        tl_clock_sleep_until(instant);
        tl_cycle_look_for_yardstick(cycle);
        tl_cycle_look_for_tuning(cycle);
        tl_cycle_look_for_flip(cycle);
        const tl_budget budget = {
            .evaluations = config->budget_evaluations,
            .time = config->budget_time,
            .started = tl_clock_now(NULL),
            .now = tl_clock_now,
        };
        if (!is_stopped(cycle) && budget.started >= instant) {
            cycle->status = catch_up(cycle, &budget);
            tl_fmu_guard_tick();
            show(cycle);
            cycle->status = cycle->status == TL_OK ? look(cycle) : cycle->status;
        }
    }
    finish(cycle);
    cycle->shown.ended = true;
    show(cycle);
    tl_heart_end(cycle->heart);
}

/* It goes on with the ticks of a run that began at `start`. */
static void go_on_at(tl_cycle *cycle, int64_t tick, tl_time start) {
    cycle->start = start;
    cycle->next_tick = tick;
    cycle->warm_up = cycle->warm_up > tick ? cycle->warm_up : tick;
}

/* Tick 0 is a period away, unless there were ticks before. */
static void find_start(tl_cycle *cycle) {
    const tl_resumption *resumption = &cycle->settings.resumed.resumption;
    const tl_cycle_place *place = &cycle->settings.place;
    tl_twin_facts facts = tl_twin_get_facts(cycle->settings.assembly->twin);
    cycle->warm_up = facts.first + facts.lead;
    cycle->start = tl_clock_now(NULL) + cycle->settings.assembly->config.step;
    if (place->is_shadow) {
        go_on_at(cycle, place->tick, place->start);
    } else if (resumption->from != TL_RESUMED_NOT) {
        go_on_at(cycle, resumption->tick, resumption->start);
    }
}

/* For the recorder: t_start is tick 0. A run that goes on with an earlier one has begun with what it has followed. */
static void begin_run(const tl_cycle *cycle) {
    const tl_cycle_settings *settings = &cycle->settings;
    if (settings->resumed.resumption.from == TL_RESUMED_NOT && !cycle->is_shadow) {
        tl_twin_recorder_start(settings->outbox, settings->assembly->twin, cycle->start);
    }
}

/* Steps i = 0 … n with n = duration/T_S. */
static int64_t last_tick(const tl_config *config, int64_t delay) {
    return config->duration == 0 ? INT64_MAX - 1 : config->duration / config->step + delay;
}

tl_status tl_cycle_start(const tl_cycle_settings *settings, tl_cycle **cycle, tl_error *error) {
    const tl_config *config = &settings->assembly->config;
    tl_account account;
    tl_cycle *started = calloc(1, sizeof *started);
    if (started == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the cycle");
    }
    started->settings = *settings;
    started->summary = settings->resumed;
    started->last_tick = last_tick(config, tl_twin_get_facts(settings->assembly->twin).lead);
    tl_watch_init(&started->watch, config, settings->journal);
    tl_account_take(settings->assembly->twin, &account);
    tl_cycle_begin_judges(started, &account);
    started->heart = tl_heart_begin(settings->beats, "cycle", PATIENCE_WITH_BEGINNING);
    tl_checkpointer_init(&started->checkpointer, settings->assembly, settings->outbox, settings->journal,
                         !settings->unreadable);
    started->is_shadow = settings->place.is_shadow;
    started->is_behind = started->is_shadow;
    started->has_run = !started->is_shadow;
    started->flip.number = settings->place.flips;
    find_start(started);
    begin_run(started);
    started->tuned = tl_outbox_tuning(settings->outbox)->number; /* what an attempt to go on has left is none of it */
    tl_fmu_thread_begin(settings->thread, run, started);
    *cycle = started;
    return TL_OK;
}

bool tl_cycle_status_now(const tl_cycle *cycle, tl_cycle_status *status) {
    return tl_latest_read(&cycle->published, status, sizeof *status);
}

tl_status tl_cycle_stop(tl_cycle *cycle, tl_summary *summary, bool *has_run, tl_error *error) {
    __atomic_store_n(&cycle->stop, true, __ATOMIC_RELAXED);
    tl_fmu_thread_hurry(cycle->settings.thread);
    *summary = cycle->summary;
    tl_lock_judge_get(&cycle->rescue.judge, &summary->lock);
    *has_run = cycle->has_run;
    *error = cycle->error;
    tl_status status = cycle->status;
    free(cycle);
    return status;
}
