/* A replay: see replay.h. */
#include "firmware/run/replay.h"

#include "firmware/base/clock.h"
#include "firmware/fmu/fmu_guard.h"
#include "firmware/process/interrupt.h"
#include "firmware/run/resume.h"
#include "firmware/text/progress.h"
#include "firmware/twin/twin_recorder.h"

enum { GUARD_INTERVAL = 16 }; /* ticks */

/* Steps i = 0 … n with n = duration/T_S. */
static int64_t last_step(const tl_config *config) {
    return config->duration == 0 ? INT64_MAX : config->duration / config->step;
}

static void keep(const tl_replay *replay, int64_t tick, const tl_record *record, tl_summary *summary) {
    const tl_config *config = &replay->assembly->config;
    tl_summary_add(summary, config, record);
    if (replay->watch != NULL) {
        tl_watch_record(replay->watch, tick, record);
    }
    if (replay->recorder != NULL) {
        tl_twin_recorder_put(replay->recorder, record, replay->assembly->twin);
    }
    if (replay->trajectory != NULL) {
        tl_trajectory_add(replay->trajectory, config, record);
    }
    if (replay->report != NULL) {
        tl_replay_report_add(replay->report, record);
    }
}

/* As configured, but without a clock; where time cut the run's search short, exactly what it had time for. */
static tl_budget budget_of(const tl_config *config, const tl_recording_tick *tick) {
    tl_budget budget = {.evaluations = config->budget_evaluations};
    if (tick->cut_short) {
        budget.evaluations = tick->evaluations < budget.evaluations ? tick->evaluations : budget.evaluations;
        budget.repeated = true;
        budget.without_nominal = tick->without_nominal;
        budget.executions = tick->executions;
    }
    return budget;
}

/* As the run did: led along, made up, or searched. */
static tl_status step_twin(const tl_replay *replay, const tl_recording_tick *tick, tl_record *record, bool *ready,
                           tl_error *error) {
    tl_twin *twin = replay->assembly->twin;
    tl_budget budget = budget_of(&replay->assembly->config, tick);
    if (tick->followed) {
        return tl_twin_follow(twin, &tick->sample, tick->u, record, ready, error);
    }
    return tick->made_up ? tl_twin_make_up(twin, &tick->sample, record, ready, error)
                         : tl_twin_step(twin, &tick->sample, &budget, record, ready, error);
}

static tl_status step(const tl_replay *replay, const tl_recording_tick *tick, tl_summary *summary, tl_error *error) {
    tl_record record;
    bool ready = false;
    tl_summary_sample(summary, &replay->assembly->config, &tick->sample);
    tl_status status = step_twin(replay, tick, &record, &ready, error);
    if (ready) {
        keep(replay, tick->sample.tick, &record, summary);
        summary->figures.skipped += record.outcome == TL_MADE_UP ? 1 : 0;
    }
    return status;
}

/* In real time: waits for the tick's instant and counts ticks that could not be met. */
static void pace(const tl_replay *replay, tl_time started, int64_t tick, tl_summary *summary) {
    if (replay->realtime) {
        tl_time period = replay->assembly->config.step;
        tl_time instant = tl_time_of_step(started, period, tick);
        tl_clock_sleep_until(instant);
        summary->deadline_misses += tl_clock_now(NULL) - instant > period ? 1 : 0;
    }
}

/* The tick at which the last wanted step is computed. In mode ahead its record is complete one tick later. */
static int64_t last_tick(const tl_replay *replay) {
    const tl_config *config = &replay->assembly->config;
    int64_t last = last_step(config);
    if (last == INT64_MAX) {
        return last;
    }
    return last + tl_twin_get_facts(replay->assembly->twin).lead;
}

static tl_status finish(const tl_replay *replay, const tl_recording_tick *tick, tl_summary *summary) {
    tl_record record;
    bool ready = false;
    tl_twin_finish(replay->assembly->twin, &tick->sample, &record, &ready);
    if (replay->recorder != NULL && ready) {
        tl_recorder_put_sample(replay->recorder, &tick->sample);
    }
    if (ready) {
        keep(replay, tick->sample.tick, &record, summary);
    }
    return TL_OK;
}

/* What goes before a tick's step: its sample, and its events. `missed` counts the ticks that the run made up before one
 * that it met, where it told so. */
static void take_sample(const tl_replay *replay, const tl_recording_tick *tick, uint64_t *missed) {
    const tl_sample *sample = &tick->sample;
    if (tick->made_up) {
        ++*missed;
    } else if (replay->watch != NULL) {
        tl_time instant = tl_time_of_step(0, replay->assembly->config.step, sample->tick);
        tl_watch_skipped(replay->watch, sample->tick, *missed, instant);
        *missed = 0;
    }
    if (replay->watch != NULL && !tick->followed) { /* that was told by the run that it is of */
        tl_watch_sample(replay->watch, sample);
    }
    if (replay->recorder != NULL) {
        tl_recorder_put_sample(replay->recorder, sample);
    }
}

/* What takes system calls is done now and then: a replayed tick may last a few microseconds. */
static void look_after_host(const tl_recording_tick *tick) {
    if (tick->sample.tick % GUARD_INTERVAL == 0) {
        tl_fmu_guard_tick();
    }
}

/* One tick is read ahead: in mode ahead a step is computed only if its measurement will come. */
static tl_status run(const tl_replay *replay, tl_progress *progress, tl_summary *summary, tl_error *error) {
    tl_recording_tick tick;
    tl_recording_tick next;
    bool end = false;
    bool ahead = replay->assembly->config.measurements == TL_AHEAD;
    int64_t last = last_tick(replay);
    uint64_t missed = 0;
    tl_time started = tl_clock_now(NULL);
    tl_status status = tl_recording_next(replay->recording, &tick, &end, error);
    while (status == TL_OK && !end) {
        bool next_end = false;
        status = tl_recording_next(replay->recording, &next, &next_end, error);
        if (status != TL_OK) {
            break;
        }
        if (ahead && (next_end || tick.sample.tick > last)) {
            return finish(replay, &tick, summary);
        }
        if (tick.sample.tick > last) {
            break;
        }
        pace(replay, started, tick.sample.tick, summary);
        take_sample(replay, &tick, &missed);
        status = step(replay, &tick, summary, error);
        look_after_host(&tick);
        if (status == TL_OK && tl_interrupt_requested() != NULL) {
            return tl_fail(error, TL_INTERRUPTED, "interrupted by %s after %llu steps", tl_interrupt_requested(),
                           (unsigned long long)summary->figures.steps);
        }
        tl_progress_update(progress, tick.sample.tick);
        tick = next;
        end = next_end;
    }
    return status;
}

/* Ticks that a record needs beyond that of its step: in mode ahead its measurement comes one later. */
static unsigned ticks_needed(const tl_replay *replay) {
    unsigned lead = (unsigned)tl_twin_get_facts(replay->assembly->twin).lead;
    return replay->assembly->config.measurements == TL_AHEAD ? lead + 1 : lead;
}

/* Where the recorded run began, if that is not where any twin does. */
static tl_status begin(const tl_replay *replay, tl_summary *summary, tl_error *error) {
    const tl_recording_beginning *beginning = tl_recording_get_beginning(replay->recording);
    if (beginning == NULL) {
        return TL_OK;
    }
    if (beginning->follows) {
        summary->resumption = beginning->resumption;
    }
    return tl_resume_replayed(replay->assembly, beginning, error);
}

tl_status tl_replay_run(const tl_replay *replay, tl_summary *summary, tl_error *error) {
    tl_progress progress;
    int64_t ticks = tl_recording_ticks(replay->recording);
    int64_t last = last_tick(replay);
    *summary = (tl_summary){0};
    tl_time started = tl_clock_now(NULL);
    tl_progress_begin(&progress, "replay", last < ticks ? last : ticks);
    tl_status status = begin(replay, summary, error);
    if (status == TL_OK) {
        status = run(replay, &progress, summary, error);
    }
    tl_progress_end(&progress);
    if (status == TL_OK && summary->figures.steps + summary->figures.skipped == 0) {
        status =
            tl_fail(error, TL_BAD_DATA,
                    "the recording ends before the first step: it has %lld ticks of %g s, and a step needs %u more "
                    "than its first",
                    (long long)ticks, tl_seconds(replay->assembly->config.step), ticks_needed(replay));
    }
    summary->wall_s = tl_seconds(tl_clock_now(NULL) - started);
    return status;
}
