/* The real-time cycle: see cycle.h. */
#include "firmware/run/cycle.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/base/c_locale.h"
#include "firmware/base/clock.h"
#include "firmware/base/identity.h"
#include "firmware/base/latest.h"
#include "firmware/diagnose/lock_rescue.h"
#include "firmware/fmu/fmu_guard.h"
#include "firmware/process/host_state.h"
#include "firmware/run/checkpointer.h"
#include "firmware/run/realtime.h"
#include "firmware/run/watch.h"
#include "firmware/twin/twin_recorder.h"

/* What FMUs may take to begin, as at the start of a run. */
static const tl_time PATIENCE_WITH_BEGINNING = 120 * TL_SECOND;

struct tl_cycle {
    tl_cycle_settings settings;
    tl_heart *heart;
    tl_time start;     /* t_0 */
    int64_t next_tick; /* not yet computed */
    int64_t warm_up;   /* ticks at which no step is due yet */
    int64_t last_tick; /* after it the duration is over */
    bool stop;
    tl_summary summary;
    tl_watch watch;
    tl_lock_rescue rescue;
    tl_checkpointer checkpointer;
    uint32_t tuned;       /* number of the tuning that was looked at last */
    bool has_tuning;      /* one was taken, and is not in the outbox yet: */
    tl_run_tuning tuning; /* this */
    tl_status status;
    tl_error error;
    tl_cycle_status shown;
    tl_latest published; /* the same, for other threads */
};

static bool is_stopped(const tl_cycle *cycle) {
    return __atomic_load_n(&cycle->stop, __ATOMIC_RELAXED);
}

static void show(tl_cycle *cycle) {
    int64_t due = cycle->next_tick - cycle->warm_up;
    cycle->summary.ticks = due > 0 ? (uint64_t)due : 0;
    cycle->shown.steps = cycle->summary.figures.steps;
    cycle->shown.ticks = cycle->summary.ticks;
    cycle->shown.skipped = cycle->summary.figures.skipped;
    cycle->shown.deadline_misses = cycle->summary.deadline_misses;
    cycle->shown.lock = cycle->rescue.judge.tally;
    tl_latest_publish(&cycle->published, &cycle->shown, sizeof cycle->shown);
}

static tl_time patience(const tl_config *config) {
    return config->realtime_hang + 2 * config->step;
}

static void keep(tl_cycle *cycle, int64_t tick, const tl_record *record) {
    const tl_lock_change *change = NULL;
    tl_summary_add(&cycle->summary, &cycle->settings.assembly->config, record);
    tl_watch_record(&cycle->watch, tick, record);
    if ((record->flags & TL_FLAG_RESET) != 0) {
        tl_checkpointer_hurry(&cycle->checkpointer, tick);
        tl_heart_be_patient(cycle->heart, patience(&cycle->settings.assembly->config));
    }
    if (tl_lock_rescue_step(&cycle->rescue, record, &change)) {
        tl_heart_be_patient(cycle->heart, PATIENCE_WITH_BEGINNING);
        tl_twin_reset(cycle->settings.assembly->twin);
    }
    if (change != NULL) {
        tl_watch_lock(&cycle->watch, tick, change);
    }
    tl_twin_recorder_put(cycle->settings.outbox, record, cycle->settings.assembly->twin);
    cycle->shown.record = *record;
}

/* ---- another tuning ---- */

static void answer(const tl_cycle *cycle, uint32_t number, const char *why) {
    if (cycle->settings.answer != NULL) {
        tl_live_tuning_answer_with(cycle->settings.answer, number, cycle->next_tick, why);
    }
}

static void refuse_tuning(tl_cycle *cycle, const tl_live_tuning_head *head, const char *why) {
    tl_journal_event(cycle->settings.journal, cycle->next_tick, TL_EVENT_WARNING, "retune",
                     "configuration %.12s refused: %.150s", tl_identity_is_sound(head->hash) ? head->hash : "?", why);
    answer(cycle, head->number, why);
}

static void take_tuning(tl_cycle *cycle, const tl_live_tuning_head *head) {
    cycle->tuning = (tl_run_tuning){.tick = cycle->next_tick, .number = head->number, .values = head->tuning};
    memcpy(cycle->tuning.hash, head->hash, sizeof cycle->tuning.hash);
    cycle->has_tuning = true;
    cycle->summary.tunings++;
    tl_lock_judge_retune(&cycle->rescue.judge, &head->tuning);
    tl_watch_retune(&cycle->watch, cycle->next_tick, head->hash);
    answer(cycle, head->number, NULL);
}

/* There is another number than that which was looked at last. */
static void look_at_tuning(tl_cycle *cycle) {
    tl_live_tuning_head head = {.number = 0};
    tl_error error = {TL_OK, ""};
    tl_status status = tl_live_tuning_read(cycle->settings.tuning, &head, &error);
    if (status == TL_TRY_AGAIN) {
        return; /* at the next tick */
    }
    cycle->tuned = head.number;
    status = status == TL_OK ? tl_assembly_retune(cycle->settings.assembly, &head.tuning, &error) : status;
    if (status == TL_OK) {
        take_tuning(cycle, &head);
    } else {
        refuse_tuning(cycle, &head, error.text);
    }
}

static void look_for_tuning(tl_cycle *cycle) {
    const tl_live_tuning *block = cycle->settings.tuning;
    uint32_t number = block != NULL ? tl_live_tuning_number(block) : cycle->tuned;
    if (number != cycle->tuned && number % 2 == 0 && !cycle->has_tuning &&
        tl_outbox_has_room_for_tuning(cycle->settings.outbox)) {
        look_at_tuning(cycle);
    }
}

/* ---- ticks ---- */

/* With what is in force from its tick on. */
static void put_sample(tl_cycle *cycle, const tl_sample *sample) {
    if (cycle->has_tuning) {
        (void)tl_outbox_put_tuning(cycle->settings.outbox, &cycle->tuning);
        cycle->has_tuning = false;
    }
    (void)tl_outbox_put_sample(cycle->settings.outbox, sample);
}

/* One tick: searched within `budget`, or made up where that is NULL. */
static tl_status compute(tl_cycle *cycle, int64_t tick, const tl_budget *budget) {
    tl_heart_beat(cycle->heart);
    tl_sample sample;
    tl_record record;
    bool ready = false;
    tl_twin *twin = cycle->settings.assembly->twin;
    tl_time instant = tl_time_of_step(cycle->start, cycle->settings.assembly->config.step, tick);
    tl_plant_input_take(cycle->settings.input, tick, instant, &sample);
    tl_watch_sample(&cycle->watch, &sample);
    tl_lock_rescue_sample(&cycle->rescue, &sample);
    tl_summary_sample(&cycle->summary, &cycle->settings.assembly->config, &sample);
    /* There the step before is complete only now, and comes before the sample. */
    bool ahead = cycle->settings.assembly->config.measurements == TL_AHEAD;
    if (!ahead) {
        put_sample(cycle, &sample);
    }
    tl_status status = budget == NULL ? tl_twin_make_up(twin, &sample, &record, &ready, &cycle->error)
                                      : tl_twin_step(twin, &sample, budget, &record, &ready, &cycle->error);
    if (ready) {
        keep(cycle, tick, &record);
    }
    if (ahead) {
        put_sample(cycle, &sample);
    }
    if (status == TL_OK) {
        cycle->summary.figures.skipped += budget == NULL && tick >= cycle->warm_up ? 1 : 0;
        cycle->next_tick = tick + 1;
        tl_checkpointer_after(&cycle->checkpointer, tick, budget);
    }
    return status;
}

/* All that is due: missed ticks first, as many as the budget allows, then the present one. */
static tl_status catch_up(tl_cycle *cycle, const tl_budget *budget) {
    tl_time period = cycle->settings.assembly->config.step;
    int64_t present = (budget->started - cycle->start) / period;
    int64_t missed_from = cycle->next_tick;
    uint64_t skipped_before = cycle->summary.figures.skipped;
    tl_status status = TL_OK;
    present = present < cycle->last_tick ? present : cycle->last_tick;
    while (status == TL_OK && cycle->next_tick < present) {
        if (cycle->next_tick != missed_from && tl_clock_now(NULL) - budget->started >= budget->time) {
            break; /* the rest at the next tick */
        }
        status = compute(cycle, cycle->next_tick, NULL);
    }
    tl_watch_skipped(&cycle->watch, present, cycle->summary.figures.skipped - skipped_before,
                     tl_time_of_step(cycle->start, period, present));
    if (status == TL_OK && cycle->next_tick == present) {
        status = compute(cycle, present, budget);
        tl_time deadline = tl_time_of_step(cycle->start, period, present + 1);
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
        (void)tl_outbox_put_sample(cycle->settings.outbox, &sample);
    }
}

static void run(void *context) {
    tl_cycle *cycle = context;
    const tl_config *config = &cycle->settings.assembly->config;
    tl_locale_use();
    tl_realtime_touch_stack();
    while (!is_stopped(cycle) && cycle->status == TL_OK && cycle->next_tick <= cycle->last_tick) {
        tl_time instant = tl_time_of_step(cycle->start, config->step, cycle->next_tick);
        tl_clock_sleep_until(instant);
        look_for_tuning(cycle);
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
        }
    }
    finish(cycle);
    cycle->shown.ended = true;
    show(cycle);
    tl_heart_end(cycle->heart);
}

/* Tick 0 is a period away, unless there were ticks before. */
static void find_start(tl_cycle *cycle) {
    const tl_resumption *resumption = &cycle->settings.resumed.resumption;
    tl_twin_facts facts = tl_twin_get_facts(cycle->settings.assembly->twin);
    cycle->warm_up = facts.first + facts.lead;
    cycle->start = tl_clock_now(NULL) + cycle->settings.assembly->config.step;
    if (resumption->from != TL_RESUMED_NOT) {
        cycle->start = resumption->start;
        cycle->next_tick = resumption->tick;
        cycle->warm_up = cycle->warm_up > resumption->tick ? cycle->warm_up : resumption->tick;
    }
}

/* For the recorder: t_start is tick 0. A run that goes on with an earlier one has begun with what it has followed. */
static void begin_run(const tl_cycle *cycle) {
    const tl_cycle_settings *settings = &cycle->settings;
    if (settings->resumed.resumption.from == TL_RESUMED_NOT) {
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
    tl_lock_rescue_init(&started->rescue, config, &account);
    started->heart = tl_heart_begin(settings->beats, "cycle", patience(config));
    tl_checkpointer_init(&started->checkpointer, settings->assembly, settings->outbox, settings->journal);
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

tl_status tl_cycle_stop(tl_cycle *cycle, tl_summary *summary, tl_error *error) {
    __atomic_store_n(&cycle->stop, true, __ATOMIC_RELAXED);
    tl_fmu_thread_hurry(cycle->settings.thread);
    *summary = cycle->summary;
    tl_lock_judge_get(&cycle->rescue.judge, &summary->lock);
    *error = cycle->error;
    tl_status status = cycle->status;
    free(cycle);
    return status;
}
