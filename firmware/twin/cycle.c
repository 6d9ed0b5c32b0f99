/* Cycle of a live run: reads the plant, steps the twin, applies tunings, and performs handovers:
 * see cycle.h. */
#include "firmware/twin/cycle.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/fmu/fmu_guard.h"
#include "firmware/monitor/lock_monitor.h"
#include "firmware/process/interrupt.h"
#include "firmware/report/watch.h"
#include "firmware/twin/arrivals.h"
#include "firmware/twin/checkpointer.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_step.h"

/* ---- state of a cycle ---- */

struct tl_cycle {
    tl_cycle_settings settings;
    tl_thread_heartbeat *heartbeat;
    tl_time start;      /* t_0 */
    int64_t next_tick;  /* not computed yet */
    int64_t warm_up;    /* ticks before the first counted step */
    int64_t first_step; /* the first counted step */
    int64_t last_tick;  /* the duration ends after it */
    bool stop;
    bool is_shadow;
    bool is_behind;      /* a shadow that has not caught up with the plant yet */
    bool has_run;        /* a run was begun in the record queue and has not ended */
    struct {             /* the newest announced handover: */
        uint32_t number; /* its number */
        bool is_ahead;   /* it concerns this cycle and is still to be done */
        int64_t tick;    /* first tick after it */
    } handover;
    tl_resumption resumption; /* how the run after the handover began */
    uint64_t skipped;         /* number of skipped ticks */
    bool has_skipped;         /* the newest tick was skipped */
    bool was_in_time;         /* a deadline was met: neither a slow start nor a gap before it explains a later miss */
    bool has_begun;           /* the twin has begun: the normal heartbeat timeout applies */
    tl_summary summary;
    tl_watch watch;
    tl_arrivals arrivals;
    tl_recovery recovery;
    tl_lock_monitor
        second; /* monitors the same steps with the tolerances of the version that a probation may roll back to */
    tl_lock_tolerances tolerances; /* of `second` */
    tl_checkpointer checkpointer;
    uint32_t tuned;       /* number of the newest tuning that was read */
    bool was_tuned;       /* the twin has another tuning than it was built with: */
    tl_run_tuning tuning; /* the newest one */
    bool has_tuning;      /* it is not in the record queue yet */
    tl_status status;
    tl_error error;
    tl_cycle_status shown;
    tl_latest published; /* copy of `shown` for other threads */
};

/* ---- realtime ---- */

/* smallest page size of all machines */
enum { PAGE = 4096 };

int tl_realtime_lock_memory(void) {
    struct rlimit limit;
    bool unlimited = getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
    /* With a limit, locking future mappings too would make a later allocation fail. */
    return mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0 ? 0 : errno;
}

/* Reports once what may have caused a missed tick or deadline. */
static void report_missing(tl_cycle *cycle, int64_t tick) {
    tl_realtime_missing *missing = &cycle->settings.missing;
    if (missing->lock_error != 0) {
        tl_journal_event(cycle->settings.journal, tick, TL_EVENT_WARNING, "cycle",
                         "tick late: memory is not locked (%s), so a page fault may be the cause; raise LimitMEMLOCK",
                         strerror(missing->lock_error));
    }
    if (missing->priority) {
        tl_journal_event(
            cycle->settings.journal, tick, TL_EVENT_WARNING, "cycle",
            "tick late: no permission for SCHED_FIFO, so other processes may be the cause; raise LimitRTPRIO or "
            "grant CAP_SYS_NICE");
    }
    *missing = (tl_realtime_missing){.lock_error = 0};
}

/* Touches the stack in advance, so that the cycle does not fault if memory is not locked. */
__attribute__((noinline)) static void touch_stack(void) {
    volatile char room[256 * 1024];
    for (size_t i = 0; i < sizeof room; i += PAGE) {
        room[i] = 0;
    }
}

/* ---- tuning ---- */

static void apply_tuning(tl_cycle *cycle, const tl_live_tuning_head *head) {
    cycle->tuning = (tl_run_tuning){.tick = cycle->next_tick, .number = head->number, .values = head->tuning};
    memcpy(cycle->tuning.hash, head->hash, sizeof cycle->tuning.hash);
    cycle->was_tuned = true;
    cycle->has_tuning = cycle->has_run;
    cycle->summary.tunings++;
    tl_lock_monitor_retune(&cycle->recovery.lock_monitor, &head->tuning);
    tl_lock_monitor_retune(&cycle->second, &head->tuning);
    tl_watch_retune(&cycle->watch, cycle->next_tick, head->hash);
}

/* At the start of a tick: applies a tuning with a new number. */
static void poll_tuning(tl_cycle *cycle) {
    const tl_live_tuning *block = cycle->settings.tuning;
    uint32_t number = block != NULL ? tl_live_tuning_number(block) : cycle->tuned;
    bool has_room = !cycle->has_run || tl_record_queue_has_room_for_tuning(cycle->settings.queue);
    if (number == cycle->tuned || number % 2 != 0 || cycle->has_tuning || !has_room) {
        return;
    }
    tl_live_tuning_head head = {.number = 0};
    tl_error error = {TL_OK, ""};
    tl_status status = tl_live_tuning_read(block, &head, &error);
    if (status == TL_TRY_AGAIN) {
        return; /* retry at the next tick */
    }
    cycle->tuned = head.number;
    status = status == TL_OK ? tl_assembly_retune(cycle->settings.assembly, &head.tuning, &error) : status;
    if (status == TL_OK) {
        apply_tuning(cycle, &head);
    } else {
        tl_journal_event(cycle->settings.journal, cycle->next_tick, TL_EVENT_WARNING, "retune",
                         "configuration %.12s rejected: %.150s", tl_identity_is_sound(head.hash) ? head.hash : "?",
                         error.text);
    }
    tl_live_tuning_answer_with(cycle->settings.answer, head.number, cycle->next_tick,
                               status == TL_OK ? NULL : error.text);
}

/* At the start of a tick: sets the tolerances of the second lock monitor. */
static void poll_tolerances(tl_cycle *cycle) {
    tl_lock_tolerances found;
    if (cycle->settings.tuning == NULL || !tl_latest_read(&cycle->settings.tuning->tolerances, &found, sizeof found)) {
        return;
    }
    cycle->tolerances = found;
    cycle->second.tolerances = tl_lock_tolerances_have_weight(&found) ? &cycle->tolerances : NULL;
}

/* For the times in events and in the status line. */
static void set_started(tl_cycle *cycle) {
    int64_t started = cycle->settings.slot_index.started;
    cycle->watch.started = started;
    cycle->recovery.lock_monitor.started = started;
    cycle->second.started = started;
}

static void init_monitors(tl_cycle *cycle, const tl_account *account) {
    tl_recovery_init(&cycle->recovery, &cycle->settings.assembly->config, account);
    tl_lock_monitor_init(&cycle->second, &cycle->settings.assembly->config, account);
    poll_tolerances(cycle);
}

/* ---- handover: see cycle.h ---- */

static bool is_due(const tl_cycle *cycle) {
    return cycle->handover.is_ahead && cycle->next_tick >= cycle->handover.tick;
}

/* At the handover tick each cycle already has its new role. */
static tl_time start_delay(const tl_cycle *cycle) {
    bool is_shadow_then = cycle->is_shadow != is_due(cycle);
    return is_shadow_then ? cycle->settings.assembly->config.step / 4 : 0;
}

/* Publishes that this cycle has done its part. */
static void report_done(tl_cycle *cycle) {
    cycle->handover.is_ahead = false;
    __atomic_store_n(cycle->settings.slot_index.handed_over, cycle->handover.number, __ATOMIC_RELEASE);
}

/* At the start of a tick: reads a new announcement. */
static void poll_handover(tl_cycle *cycle) {
    const tl_cycle_position *slot = &cycle->settings.slot_index;
    uint32_t to = 0;
    if (slot->handover_block == NULL || cycle->handover.is_ahead ||
        !tl_handover_read(slot->handover_block, cycle->handover.number, &cycle->handover.number, &to,
                          &cycle->handover.tick)) {
        return;
    }
    cycle->handover.is_ahead = (to == slot->slot_index) == cycle->is_shadow;
    if (!cycle->handover.is_ahead) {
        report_done(cycle); /* it has that role already */
    }
}

/* Restarts the counts from 0 at the next tick. */
static void reset_counts(tl_cycle *cycle) {
    tl_twin_facts facts = tl_twin_get_facts(cycle->settings.assembly->twin);
    cycle->summary = (tl_summary){.resumption = cycle->resumption};
    cycle->arrivals = (tl_arrivals){.begun = 0};
    cycle->warm_up = facts.first + facts.lead;
    cycle->warm_up = cycle->warm_up > cycle->next_tick ? cycle->warm_up : cycle->next_tick;
    cycle->first_step = cycle->next_tick - (int64_t)facts.lead;
    cycle->shown.executions = 0;
    cycle->shown.used = cycle->shown.late = 0;
    memset(cycle->shown.match, 0, sizeof cycle->shown.match);
}

/* If the supervisor was stopped during the announcement, the two twins may have seen it at
 * different ticks. */
static void report_late_handover(const tl_cycle *cycle) {
    if (cycle->next_tick > cycle->handover.tick) {
        tl_journal_event(cycle->settings.journal, cycle->next_tick, TL_EVENT_WARNING, "handover",
                         "handover at tick %" PRId64 " was announced too late, and done at tick %" PRId64
                         ": ticks around it may be missing, or in both runs",
                         cycle->handover.tick, cycle->next_tick);
    }
}

/* ---- the shadow ---- */

/* Drops all that is not saved, in the twin and in the lock monitor, because a replay of the run has
 * to start with the same state. `size` 0: nothing is saved. */
static tl_status begin_run(tl_cycle *cycle, size_t size) {
    const tl_cycle_settings *settings = &cycle->settings;
    bool done = false;
    tl_record_queue_start start = {.holds = false};
    tl_status status = tl_twin_forget(settings->assembly->twin, &done, &cycle->error);
    if (status != TL_OK) {
        return status;
    }
    tl_account_take(settings->assembly->twin, &start.account);
    init_monitors(cycle, &start.account);
    set_started(cycle);
    cycle->resumption = (tl_resumption){
        .from = size != 0 ? TL_RESUMED_CHECKPOINT : TL_RESUMED_INPUTS,
        .run = -1, /* the run before */
        .tick = cycle->handover.tick > cycle->next_tick ? cycle->handover.tick : cycle->next_tick,
        .start_s = start.account.experiment.start_s,
        .start = settings->slot_index.start,
        .started = settings->slot_index.started,
    };
    start.resumption = cycle->resumption;
    (void)tl_record_queue_put_start(settings->queue, &start);
    if (size != 0) {
        tl_checkpointer_put(&cycle->checkpointer, cycle->next_tick - 1, size);
    }
    cycle->has_tuning = cycle->was_tuned; /* the present tuning is recorded with the first sample of the run */
    cycle->tuning.tick = cycle->next_tick;
    cycle->has_run = true;
    return TL_OK;
}

/* At a tick with enough time, or after the last one before the handover. */
static tl_status try_to_begin_run(tl_cycle *cycle, const tl_budget *budget) {
    tl_time step = cycle->settings.assembly->config.step;
    bool is_last = cycle->next_tick >= cycle->handover.tick;
    tl_time remaining = budget != NULL ? budget->time - (tl_clock_now(NULL) - budget->started) : 0;
    size_t size = 0;
    bool saved = tl_checkpointer_save(&cycle->checkpointer, is_last ? step : remaining, &size);
    return saved || is_last ? begin_run(cycle, saved ? size : 0) : TL_OK;
}

/* Reports present problems again, because the new run's events do not contain them yet. */
static void become_live(tl_cycle *cycle) {
    bool is_saved = cycle->resumption.from == TL_RESUMED_CHECKPOINT;
    cycle->is_shadow = false;
    cycle->is_behind = false;
    tl_journal_set_apart(cycle->settings.journal, false);
    tl_watch_init(&cycle->watch, &cycle->settings.assembly->config, cycle->settings.journal);
    set_started(cycle);
    reset_counts(cycle);
    tl_journal_event(cycle->settings.journal, -1, is_saved ? TL_EVENT_INFO : TL_EVENT_WARNING, "handover",
                     "this twin is live from tick %" PRId64 " on%s", cycle->resumption.tick,
                     is_saved ? ""
                              : "; its state could not be saved: a replay of this run starts from the start values");
    report_late_handover(cycle);
    report_done(cycle);
}

/* ---- the live twin ---- */

static void become_shadow(tl_cycle *cycle) {
    tl_record_queue *queue = cycle->settings.queue;
    report_late_handover(cycle);
    if (!cycle->has_tuning) { /* keep the present tuning for a later run */
        cycle->tuning = *tl_record_queue_tuning(queue);
        cycle->was_tuned = strcmp(cycle->tuning.hash, queue->configured.hash) != 0;
    }
    cycle->has_tuning = false;
    (void)tl_record_queue_put_end(queue, TL_LIVE_HANDED_OVER);
    cycle->settings.slot_index.start = cycle->start;
    cycle->settings.slot_index.started = tl_record_queue_beginning(queue)->started;
    cycle->resumption = (tl_resumption){.from = TL_RESUMED_NOT};
    cycle->has_run = false;
    cycle->is_shadow = true;
    tl_journal_set_apart(cycle->settings.journal, true);
    reset_counts(cycle);
    report_done(cycle);
}

/* ---- ticks ---- */

static tl_status before_tick(tl_cycle *cycle) {
    if (!is_due(cycle)) {
        return TL_OK;
    }
    if (!cycle->is_shadow) {
        if (cycle->settings.assembly->config.measurements !=
            TL_AHEAD) { /* in mode ahead its last record is not complete yet */
            become_shadow(cycle);
        }
        return TL_OK;
    }
    tl_status status = cycle->has_run ? TL_OK : try_to_begin_run(cycle, NULL);
    if (status == TL_OK) {
        become_live(cycle);
    }
    return status;
}

static tl_status after_tick(tl_cycle *cycle, int64_t tick, const tl_budget *budget) {
    if (cycle->has_run) {
        tl_checkpointer_after(&cycle->checkpointer, tick, budget);
    } else if (cycle->handover.is_ahead) {
        return try_to_begin_run(cycle, budget);
    } else {
        tl_checkpointer_rehearse(&cycle->checkpointer, budget);
    }
    return TL_OK;
}

/* ---- cycle ---- */

/* Heartbeat timeout while the FMUs are initialised, as at the start of a run. */
static const tl_time PATIENCE_WITH_BEGINNING = 120 * TL_SECOND;

/* With macro steps from here on, all process state is restored at each tick: the time is free, and
 * SIGTERM works again at once. */
static const tl_time LONG_STEP = TL_SECOND / 10;

static bool is_stopped(const tl_cycle *cycle) {
    return __atomic_load_n(&cycle->stop, __ATOMIC_RELAXED);
}

static void publish_status(tl_cycle *cycle) {
    int64_t due = cycle->next_tick - cycle->warm_up;
    tl_cycle_status *shown = &cycle->shown;
    cycle->summary.ticks = due > 0 ? (uint64_t)due : 0;
    shown->is_shadow = cycle->is_shadow;
    shown->has_caught_up = !cycle->is_behind;
    shown->tick = cycle->next_tick - 1;
    shown->steps = cycle->summary.figures.steps;
    shown->ticks = cycle->summary.ticks;
    shown->skipped = cycle->summary.figures.skipped;
    shown->gaps = cycle->summary.gaps;
    shown->deadline_misses = cycle->summary.deadline_misses;
    shown->evaluations = cycle->summary.figures.evaluations;
    shown->timed_out = cycle->summary.figures.time_limited;
    shown->lock = cycle->recovery.lock_monitor.tally;
    shown->lock_before = cycle->second.tally;
    memcpy(shown->adjust, cycle->summary.figures.adjust, sizeof shown->adjust);
    size_t matches = cycle->settings.assembly->config.match_count;
    tl_latest_publish(&cycle->published, shown, offsetof(tl_cycle_status, match) + matches * sizeof *shown->match);
}

static tl_time tick_timeout(const tl_config *config) {
    return config->realtime_hang + 2 * config->step;
}

static void process_record(tl_cycle *cycle, int64_t tick, const tl_record *record) {
    const tl_config *config = &cycle->settings.assembly->config;
    const tl_lock_change *change = NULL;
    if (record->step >= cycle->first_step) { /* in mode ahead the first record belongs to a step before */
        tl_summary_add(&cycle->summary, config, record);
        cycle->shown.executions += record->executions;
        cycle->shown.used += record->used;
        for (size_t i = 0; i < config->match_count; i++) {
            tl_metrics_add(&cycle->shown.match[i], record->y[i], record->measured[i],
                           (tl_quality)record->measured_quality[i]);
        }
    }
    tl_twin_identifiability identifiability = tl_twin_get_identifiability(cycle->settings.assembly->twin);
    tl_watch_record(&cycle->watch, tick, record, &identifiability);
    tl_watch_keep(&cycle->watch, tick, tl_twin_unsaved(cycle->settings.assembly->twin));
    if ((record->flags & TL_FLAG_RESET) != 0) {
        tl_checkpointer_request(&cycle->checkpointer, tick);
        if (!tl_twin_is_starting(cycle->settings.assembly->twin)) { /* else a search for start values may follow */
            tl_thread_heartbeat_set_timeout(cycle->heartbeat, tick_timeout(config));
        }
    }
    if (tl_recovery_step(&cycle->recovery, record, &change)) {
        tl_thread_heartbeat_set_timeout(cycle->heartbeat, PATIENCE_WITH_BEGINNING);
        tl_twin_reset(cycle->settings.assembly->twin);
    }
    tl_twin_rest(cycle->settings.assembly->twin, cycle->recovery.lock_monitor.release.rests);
    (void)tl_lock_monitor_step(&cycle->second, record);
    if (change != NULL) {
        tl_watch_lock(&cycle->watch, tick, change);
    }
    tl_watch_monitor(&cycle->watch, tick, &cycle->recovery.lock_monitor);
    if (cycle->has_run) {
        tl_twin_recorder_put(cycle->settings.queue, record, cycle->settings.assembly->twin);
    }
    cycle->shown.record = *record;
}

/* ---- ticks ---- */

/* Records the sample with the tuning that applies from its tick on. */
static void put_sample(tl_cycle *cycle, const tl_sample *sample) {
    if (!cycle->has_run) {
        return;
    }
    if (cycle->has_tuning) {
        (void)tl_record_queue_put_tuning(cycle->settings.queue, &cycle->tuning);
        cycle->has_tuning = false;
    }
    (void)tl_record_queue_put_sample(cycle->settings.queue, sample);
}

/* Executes one tick: searched within `budget`; NULL: caught up. */
static tl_status compute_tick(tl_cycle *cycle, int64_t tick, const tl_budget *budget) {
    tl_thread_heartbeat_beat(cycle->heartbeat);
    tl_sample sample;
    tl_record record;
    bool ready = false;
    tl_twin *twin = cycle->settings.assembly->twin;
    tl_time instant = tl_time_of_step(cycle->start, cycle->settings.assembly->config.step, tick);
    tl_plant_input_take(cycle->settings.input, tick, instant, &sample);
    tl_frozen_mark(tl_frozen_watch_sample(&cycle->recovery.lock_monitor.frozen, &sample, false), &sample);
    tl_watch_sample(&cycle->watch, &sample);
    tl_lock_monitor_sample(&cycle->recovery.lock_monitor, &sample);
    tl_lock_monitor_sample(&cycle->second, &sample);
    tl_summary_sample(&cycle->summary, &cycle->settings.assembly->config, &sample);
    if (budget != NULL) { /* a missed tick is computed later than its readings came */
        tl_arrivals_check(&cycle->arrivals, cycle->settings.input, &cycle->settings.assembly->config,
                          cycle->settings.journal, budget->started);
    }
    /* In mode ahead the record of the step before becomes complete now, and is enqueued before the
     * sample. */
    bool ahead = cycle->settings.assembly->config.measurements == TL_AHEAD;
    if (!ahead) {
        put_sample(cycle, &sample);
    }
    tl_status status = budget == NULL ? tl_twin_catch_up(twin, &sample, &record, &ready, &cycle->error)
                                      : tl_twin_step(twin, &sample, budget, &record, &ready, &cycle->error);
    if (!cycle->has_begun &&
        !tl_twin_is_starting(twin)) { /* in its first tick the twin initialises and proves the FMUs */
        cycle->has_begun = true;
        tl_thread_heartbeat_set_timeout(cycle->heartbeat, tick_timeout(&cycle->settings.assembly->config));
    }
    if (ready) {
        process_record(cycle, tick, &record);
    }
    if (ahead) {
        put_sample(cycle, &sample);
        if (is_due(cycle) && !cycle->is_shadow) { /* its last record is complete with this sample */
            become_shadow(cycle);
        }
    }
    if (status == TL_OK) {
        bool skipped = budget == NULL && tick >= cycle->warm_up;
        cycle->summary.figures.skipped += skipped ? 1 : 0;
        cycle->summary.gaps += skipped && !cycle->has_skipped ? 1 : 0;
        cycle->skipped += skipped ? 1 : 0;
        cycle->has_skipped = skipped;
        cycle->next_tick = tick + 1;
        status = after_tick(cycle, tick, budget);
    }
    return status;
}

static tl_status compute_due(tl_cycle *cycle, int64_t tick, const tl_budget *budget) {
    tl_status status = before_tick(cycle);
    return status == TL_OK ? compute_tick(cycle, tick, budget) : status;
}

/* A missed tick has no search. But a shadow that catches up with the plant does search, so that it
 * is locked when it gets there. */
static tl_status compute_missed(tl_cycle *cycle, const tl_budget *budget) {
    tl_budget own = *budget;
    own.started = tl_clock_now(NULL);
    return compute_due(cycle, cycle->next_tick, cycle->is_behind ? &own : NULL);
}

/* Executes all due ticks: missed ones first, as many as the budget permits, then the present. */
static tl_status catch_up(tl_cycle *cycle, const tl_budget *budget) {
    tl_time period = cycle->settings.assembly->config.step;
    tl_time start = cycle->start + start_delay(cycle);
    int64_t present = (budget->started - start) / period;
    int64_t missed_from = cycle->next_tick;
    uint64_t skipped_before = cycle->skipped;
    bool is_late = false;
    tl_status status = TL_OK;
    present = present < cycle->last_tick ? present : cycle->last_tick;
    while (status == TL_OK && cycle->next_tick < present) {
        if (cycle->next_tick != missed_from && tl_clock_now(NULL) - budget->started >= budget->time) {
            break; /* continue at the next tick */
        }
        status = compute_missed(cycle, budget);
    }
    tl_watch_skipped(&cycle->watch, present, cycle->skipped - skipped_before, tl_time_of_step(start, period, present));
    if (status == TL_OK && cycle->next_tick == present) {
        if (cycle->is_behind) { /* all missed ticks are done */
            cycle->is_behind = false;
            reset_counts(cycle);
        }
        status = compute_due(cycle, present, budget);
        is_late = tl_clock_now(NULL) > tl_time_of_step(start, period, present + 1);
        cycle->summary.deadline_misses += is_late ? 1 : 0;
    }
    if (cycle->was_in_time && (is_late || cycle->skipped != skipped_before)) {
        report_missing(cycle, present);
    }
    cycle->was_in_time = cycle->was_in_time || (cycle->next_tick > present && !is_late);
    return status;
}

/* Mode ahead: the measurement of the last step comes one period later. If the cycle must stop, it
 *             does not wait for it. */
static void finish_last(tl_cycle *cycle) {
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
        process_record(cycle, cycle->next_tick, &record);
        put_sample(cycle, &sample);
    }
}

/* Verifies the rollback of the FMUs in the time until the next tick, except for a reserve. */
static tl_status verify_rollback(tl_cycle *cycle) {
    enum { RESERVE = 8 }; /* reserve: this fraction of a period */
    tl_time period = cycle->settings.assembly->config.step;
    tl_time next = tl_time_of_step(cycle->start, period, cycle->next_tick) + start_delay(cycle);
    tl_twin_verify_report outcome;
    tl_status status =
        tl_twin_verify_until(cycle->settings.assembly->twin, next - period / RESERVE, &outcome, &cycle->error);
    if (outcome.found) {
        tl_journal_event(cycle->settings.journal, -1, outcome.mended ? TL_EVENT_WARNING : TL_EVENT_ERROR, "twin", "%s",
                         outcome.text);
    }
    return status;
}

static void run_cycle(void *context) {
    tl_cycle *cycle = context;
    const tl_config *config = &cycle->settings.assembly->config;
    tl_locale_use();
    touch_stack();
    while (!is_stopped(cycle) && cycle->status == TL_OK && cycle->next_tick <= cycle->last_tick) {
        tl_time instant = tl_time_of_step(cycle->start, config->step, cycle->next_tick) + start_delay(cycle);
        tl_clock_sleep_until(instant);
        poll_tolerances(cycle);
        poll_tuning(cycle);
        poll_handover(cycle);
        const tl_budget budget = {
            .evaluations = config->budget_evaluations,
            .time = config->budget_time,
            .started = tl_clock_now(NULL),
            .now = tl_clock_now,
            .unrecorded = !cycle->has_run,
        };
        if (!is_stopped(cycle) && budget.started >= instant) {
            cycle->shown.late += budget.started - instant;
            cycle->status = catch_up(cycle, &budget);
            tl_fmu_guard_tick(config->step >= LONG_STEP);
            publish_status(cycle);
            cycle->status = cycle->status == TL_OK ? verify_rollback(cycle) : cycle->status;
        }
    }
    finish_last(cycle);
    cycle->shown.ended = true;
    publish_status(cycle);
    tl_thread_heartbeat_stop(cycle->heartbeat);
}

/* Tick 0 is one period from now, unless the run is resumed. */
static void find_start(tl_cycle *cycle) {
    const tl_resumption *resumption = &cycle->settings.resumed.resumption;
    const tl_cycle_position *slot = &cycle->settings.slot_index;
    tl_twin_facts facts = tl_twin_get_facts(cycle->settings.assembly->twin);
    cycle->warm_up = facts.first + facts.lead;
    cycle->start = tl_clock_now(NULL) + cycle->settings.assembly->config.step;
    if (slot->is_shadow || resumption->from != TL_RESUMED_NOT) {
        cycle->start = slot->is_shadow ? slot->start : resumption->start;
        cycle->next_tick = slot->is_shadow ? slot->tick : resumption->tick;
    }
    cycle->warm_up = cycle->warm_up > cycle->next_tick ? cycle->warm_up : cycle->next_tick;
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
    tl_account_take(settings->assembly->twin, &account);
    started->last_tick = config->duration == 0 ? INT64_MAX - 1 : config->duration / config->step + account.lead;
    tl_watch_init(&started->watch, config, settings->journal);
    init_monitors(started, &account);
    started->heartbeat = tl_thread_heartbeat_start(settings->beats, "cycle", PATIENCE_WITH_BEGINNING);
    tl_checkpointer_init(&started->checkpointer, settings->assembly, settings->queue, settings->journal,
                         !settings->unreadable);
    started->is_shadow = settings->slot_index.is_shadow;
    started->is_behind = started->is_shadow;
    started->has_run = !started->is_shadow;
    started->handover.number = settings->slot_index.handovers;
    find_start(started);
    if (settings->resumed.resumption.from == TL_RESUMED_NOT && started->has_run) {
        tl_twin_recorder_start(settings->queue, settings->assembly->twin, started->start);
    } /* else it began when it followed the earlier run */
    if (started->has_run) {
        started->settings.slot_index.started = tl_record_queue_beginning(settings->queue)->started;
    }
    set_started(started);
    started->tuned = tl_record_queue_tuning(settings->queue)
                         ->number; /* a failed resume may have left a tuning, which does not apply */
    tl_fmu_thread_begin(settings->thread, run_cycle, started);
    *cycle = started;
    return TL_OK;
}

bool tl_cycle_status_now(const tl_cycle *cycle, tl_cycle_status *status) {
    return tl_latest_read(&cycle->published, status, sizeof *status);
}

tl_status tl_cycle_stop(tl_cycle *cycle, tl_summary *summary, bool *has_run, tl_error *error) {
    __atomic_store_n(&cycle->stop, true, __ATOMIC_RELAXED);
    tl_fmu_thread_wake_and_wait(cycle->settings.thread);
    tl_arrivals_sum_up(&cycle->arrivals, cycle->settings.input, &cycle->settings.assembly->config, tl_clock_now(NULL),
                       &cycle->summary);
    *summary = cycle->summary;
    tl_lock_monitor_get(&cycle->recovery.lock_monitor, &summary->lock);
    *has_run = cycle->has_run;
    *error = cycle->error;
    tl_status status = cycle->status;
    free(cycle);
    return status;
}

/* ---- status line ---- */

/* Appends a part if the line then still fits into a terminal. */
static void add_part(char line[TL_STATUS_LINE], const char *format, ...) TL_PRINTF(2, 3);

static void add_part(char line[TL_STATUS_LINE], const char *format, ...) {
    char part[TL_STATUS_LINE];
    size_t length = strlen(line);
    va_list arguments;
    va_start(arguments, format);
    int added = vsnprintf(part, sizeof part, format, arguments);
    va_end(arguments);
    if (added >= 0 && length + (size_t)added < TL_STATUS_LINE) {
        memcpy(line + length, part, (size_t)added + 1);
    }
}

static void add_state(char line[TL_STATUS_LINE], const tl_config *config, const tl_lock_tally *lock) {
    char clause[TL_LOCK_CLAUSE];
    tl_lock_standing_write(&lock->standing, false, clause);
    size_t length = strlen(line);
    add_part(line, "  %s",
             clause[0] != '\0'           ? clause
             : config->adjust_count != 0 ? tl_lock_state_name(lock->state)
                                         : "free-running");
    if (line[length] == '\0') { /* the clause is too long */
        char since[TL_LOCK_INSTANT];
        tl_lock_instant_write(lock->standing.since_s, lock->standing.now_s, lock->standing.started, false, since);
        add_part(line, "  locked, corrected since %s", since);
    }
}

void tl_status_line_write(const tl_config *config, const tl_cycle_status *status, uint32_t open_findings,
                          char line[TL_STATUS_LINE]) {
    const tl_record *record = &status->record;
    bool rests = (record->flags & TL_FLAG_RESTS) != 0;
    line[0] = '\0';
    add_part(line, "%8.2f s", tl_seconds(tl_time_of_step(0, config->step, record->step + 1)));
    add_state(line, config, &status->lock);
    if (open_findings != 0) {
        add_part(line, "  %" PRIu32 " %s", open_findings, open_findings == 1 ? "change" : "changes");
    }
    if (status->skipped != 0) {
        add_part(line, "  %llu ticks missed", (unsigned long long)status->skipped);
    }
    for (size_t i = 0; i < config->adjust_count && i < 2; i++) {
        const char *name = config->adjust[i].variable;
        if (rests) {
            add_part(line, "  %s at nominal", name);
        } else {
            add_part(line, "  \316\224%s %+.3g", name, record->u[i] - record->nominal[i]);
        }
    }
    for (size_t i = 0; i < config->match_count && i < 2; i++) {
        tl_quality quality = (tl_quality)record->measured_quality[i];
        if (!isfinite(record->y[i])) {
            add_part(line, "  %s not finite", config->match[i].variable);
        } else if (quality == TL_GOOD) {
            add_part(line, "  %s %.4g (plant %.4g)", config->match[i].variable, record->y[i], record->measured[i]);
        } else {
            add_part(line, "  %s %.4g (plant: %s)", config->match[i].variable, record->y[i], tl_quality_name(quality));
        }
    }
    add_part(line, "  %.2f ms", tl_seconds(record->used) * 1e3);
}

/* ---- safe hold ---- */

/* Intervals of log messages and status, and the longest sleep. */
static const tl_time HOLD_REMIND = 600 * TL_SECOND;
static const tl_time HOLD_SHOW = TL_SECOND;
static const tl_time HOLD_POLL = TL_SECOND / 20;

/* Records all samples due until now; returns the next tick. */
static int64_t hold_samples(const tl_safe_hold_settings *settings, tl_time start, int64_t tick) {
    tl_time step = settings->cycle->assembly->config.step;
    tl_time now = tl_clock_now(NULL);
    for (; tl_time_of_step(start, step, tick) <= now; tick++) {
        tl_sample sample;
        tl_plant_input_take(settings->cycle->input, tick, tl_time_of_step(start, step, tick), &sample);
        (void)tl_record_queue_put_sample(settings->cycle->queue, &sample);
        tl_thread_heartbeat_beat(settings->heartbeat);
    }
    return tick;
}

/* `remaining`: time until the next retry. */
static void describe_hold(const tl_safe_hold_settings *settings, tl_time remaining, char text[TL_HEARTBEAT_STATUS]) {
    const char *recorded = settings->records ? " and recorded" : "; nothing is recorded";
    long seconds = remaining > 0 ? (long)((remaining + TL_SECOND - 1) / TL_SECOND) : 0;
    if (settings->since != 0) {
        (void)snprintf(text, TL_HEARTBEAT_STATUS,
                       "the twin starts after the test of its FMUs' saved states. The plant is read%s", recorded);
        return;
    }
    (void)snprintf(text, TL_HEARTBEAT_STATUS,
                   "safe hold: %s %u times; next retry in %ld %s. The plant is read%s. To retry now, stop and "
                   "start the run. Last failure: %s",
                   settings->missing > 0 ? "the twin could not be started" : "the twin failed",
                   settings->missing > 0 ? settings->missing : settings->failures,
                   seconds < 120 ? seconds : seconds / 60, seconds < 120 ? "s" : "min", recorded,
                   settings->reason[0] != '\0' ? settings->reason : "unknown");
}

void tl_safe_hold(const tl_safe_hold_settings *settings) {
    char text[TL_HEARTBEAT_STATUS];
    tl_time begun = tl_clock_now(NULL);
    tl_time shown = begun;
    describe_hold(settings, settings->time, text);
    tl_journal_event(settings->cycle->journal, -1, settings->since != 0 ? TL_EVENT_INFO : TL_EVENT_ERROR, "supervisor",
                     "%s", text);
    tl_heartbeats_set_status(settings->cycle->beats, text);
    tl_time start = settings->since != 0 ? settings->since : begun + settings->cycle->assembly->config.step;
    tl_time remind = begun + HOLD_REMIND;
    tl_twin_recorder_start(settings->cycle->queue, NULL, start);
    for (int64_t tick = 0; tl_interrupt_requested() == NULL;) {
        tl_time due = tl_time_of_step(start, settings->cycle->assembly->config.step, tick);
        tl_time most = tl_clock_now(NULL) + HOLD_POLL;
        tl_clock_sleep_until(due < most ? due : most);
        tick = hold_samples(settings, start, tick);
        tl_thread_heartbeat_beat(settings->heartbeat);
        tl_journal_drain(settings->cycle->journal);
        if (tl_clock_now(NULL) - shown >= HOLD_SHOW) {
            shown += HOLD_SHOW;
            describe_hold(settings, begun + settings->time - shown, text);
            tl_heartbeats_set_status(settings->cycle->beats, text);
        }
        if (shown >= remind) {
            tl_log(TL_LOG_ERROR, "%s", text);
            remind += HOLD_REMIND;
        }
    }
}
