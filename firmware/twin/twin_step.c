/* Tick of an assembled twin: see twin_step.h. */
#include "firmware/twin/twin_step.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/fmu/fmu_guard.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/twin/twin_recorder.h"

/* ---- step ---- */

/* The guard's work needs system calls, and a replayed tick may take less than a microsecond. So the
 * clock is read every 16 ticks, and the guard works at most every 1 ms. A live run does it at each
 * tick. */
enum { GUARD_TICKS = 16 };
static const tl_time GUARD_INTERVAL = TL_SECOND / 1000;

size_t tl_twin_result_size(const tl_config *config, tl_twin_attached attached) {
    return offsetof(tl_twin_result, attached) +
           (attached == TL_ATTACHED_COUNTS    ? (config->component_count + 1) * sizeof(tl_execution_counts)
            : attached == TL_ATTACHED_OUTPUTS ? config->emulated_count * sizeof(double)
                                              : 0);
}

bool tl_twin_result_is_sound(const tl_twin_result *result, const tl_config *config, int64_t tick, int64_t least) {
    return result->tick == tick && result->status >= TL_OK && result->status <= TL_TRY_AGAIN && result->ready <= 1 &&
           result->identifiability.since >= 0 && result->identifiability.since <= tick &&
           (result->ready == 0 || (result->record.step >= least && result->record.step <= tick &&
                                   tl_packed_record_is_sound(&result->record, config->match_count)));
}

/* Budget without a clock, as configured. If time cut the search of the run short, exactly the
 * evaluations of that search. An emulated plant does not search. */
static tl_budget budget_of(const tl_config *config, const tl_recording_tick *tick, tl_twin_attached attached) {
    tl_budget budget = {.evaluations = attached == TL_ATTACHED_OUTPUTS ? 1 : config->budget_evaluations};
    if (tick->cut_short) {
        budget.evaluations = tick->evaluations < budget.evaluations ? tick->evaluations : budget.evaluations;
        budget.repeated = true;
        budget.without_nominal = tick->without_nominal;
        budget.executions = tick->executions;
    }
    return budget;
}

/* Repeats the kind of step in the recording: followed, caught up, or searched. */
static tl_status execute_step(const tl_assembly *assembly, const tl_recording_tick *tick, tl_twin_attached attached,
                              tl_record *record, bool *ready, tl_error *error) {
    if (tick->followed) {
        return tl_twin_follow(assembly->twin, &tick->sample, tick->u, record, ready, error);
    }
    tl_budget budget = budget_of(&assembly->config, tick, attached);
    return tick->caught_up ? tl_twin_catch_up(assembly->twin, &tick->sample, record, ready, error)
                           : tl_twin_step(assembly->twin, &tick->sample, &budget, record, ready, error);
}

static void fill_result(const tl_assembly *assembly, tl_twin_attached attached, tl_twin_result *result) {
    result->unsaved = tl_twin_unsaved(assembly->twin);
    result->identifiability = tl_twin_get_identifiability(assembly->twin);
    if (attached == TL_ATTACHED_COUNTS) {
        (void)tl_twin_recorder_count(assembly->twin, result->attached.counts);
    } else if (attached == TL_ATTACHED_OUTPUTS) {
        for (size_t i = 0; i < assembly->plan.output_count; i++) {
            result->attached.outputs[i] = tl_twin_output(assembly->twin, i);
        }
    }
}

static void tick_guard(const tl_recording_tick *tick) {
    static tl_time guarded; /* static, because the guard exists once per process */
    tl_time now = tick->sample.tick % GUARD_TICKS == 0 ? tl_clock_now(NULL) : guarded;
    if (now - guarded >= GUARD_INTERVAL) {
        guarded = now;
        tl_fmu_guard_tick(true);
    }
}

bool tl_twin_tunings_next(tl_twin_tunings *tunings, int64_t tick, tl_run_tuning *tuning) {
    if (tunings->taken == tunings->count) {
        return false;
    }
    memcpy(tuning, tunings->bytes + tunings->taken * sizeof *tuning, sizeof *tuning);
    bool is_due = tuning->tick <= tick;
    tunings->taken += is_due ? 1 : 0;
    return is_due;
}

static tl_status verify_rollback(const tl_assembly *assembly, tl_error *error) {
    tl_twin_verify_report outcome;
    tl_status status = tl_twin_verify_until(assembly->twin, TL_TIME_NEVER, &outcome, error);
    if (outcome.found) {
        tl_log(outcome.mended ? TL_LOG_WARNING : TL_LOG_ERROR, "%s", outcome.text);
    }
    return status;
}

/* Reports once per process why the twin runs free from this step on. */
static void report_free_run(const tl_assembly *assembly, const tl_twin_result *result) {
    static bool reported;
    if (reported || result->ready == 0 || (result->record.flags & TL_FLAG_NO_ROLLBACK) == 0) {
        return;
    }
    reported = true;
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    const char *name = facts.runs_free != NULL ? facts.runs_free : "an FMU";
    tl_twin_ledger entry = {.name = ""};
    for (size_t i = 0; i < facts.components && strcmp(entry.name, name) != 0; i++) {
        entry = tl_twin_get_ledger(assembly->twin, i);
    }
    const char *why = entry.replay.differs       ? "gave other results when steps were repeated"
                      : entry.replay.is_disabled ? "was rolled back to more states than can be kept"
                                                 : "has passed the limit of its rollback by replay (\"replay_steps\")";
    tl_log(
        TL_LOG_WARNING,
        "from t = %.6g s on the twin runs free, with nominal u: %.40s %s; %llu of its steps were repeated until then",
        tl_seconds(tl_time_of_step(0, assembly->config.step, result->record.step)), name, why,
        (unsigned long long)entry.replay.steps);
}

tl_status tl_twin_execute(const tl_assembly *assembly, const tl_recording_tick *tick, tl_twin_attached attached,
                          tl_recovery *recovery, tl_twin_result *result, tl_error *error) {
    const tl_lock_change *change = NULL; /* not needed: the parent monitors the lock again, and reports changes */
    bool searches = attached != TL_ATTACHED_OUTPUTS; /* an emulated plant is never reset, and does not rest */
    bool ready = false;
    if (tick->resets) { /* as recorded; the recovery at the tick before requested the same */
        tl_twin_reset(assembly->twin);
    }
    if (tick->is_decided && searches) { /* as recorded */
        tl_twin_rest(assembly->twin, tick->rests);
        tl_twin_end_released(assembly->twin, tick->ends_released);
    }
    tl_recording_tick marked;
    if (!tick->followed) {
        uint64_t frozen = tl_frozen_watch_sample(&recovery->lock_monitor.frozen, &tick->sample, tick->is_decided);
        if (frozen != 0) {
            marked = *tick;
            tl_frozen_mark(frozen, &marked.sample);
            tick = &marked;
        }
        tl_lock_monitor_sample(&recovery->lock_monitor, &tick->sample);
    }
    tl_status status = execute_step(assembly, tick, attached, &result->record, &ready, error);
    if (ready && tl_recovery_step(recovery, &result->record, &change) && searches) {
        tl_twin_reset(assembly->twin);
    }
    if (!tick->is_decided && searches) {
        tl_twin_rest(assembly->twin, recovery->lock_monitor.release.rests);
    }
    status = status == TL_OK ? verify_rollback(assembly, error) : status;
    result->tick = tick->sample.tick;
    result->status = (int32_t)status;
    result->ready = ready ? 1 : 0;
    report_free_run(assembly, result);
    fill_result(assembly, attached, result);
    tick_guard(tick);
    return status;
}

void tl_twin_execute_last(const tl_assembly *assembly, const tl_recording_tick *tick, tl_twin_attached attached,
                          tl_twin_result *result) {
    bool ready = false;
    tl_twin_finish(assembly->twin, &tick->sample, &result->record, &ready);
    result->tick = tick->sample.tick;
    result->status = (int32_t)TL_OK;
    result->ready = ready ? 1 : 0;
    fill_result(assembly, attached, result);
}

/* ---- verification ---- */

/* Writes the size of the difference, in tolerances if there is one. */
static void write_size(const tl_account_finding *finding, char *text, size_t size) {
    const char *unit = finding->unit;
    bool has_unit = unit[0] != '\0' && strcmp(unit, "1") != 0;
    bool is_close = fabs(finding->again - finding->committed) < 1e-8 * fabs(finding->committed);
    int digits = is_close ? 17 : 9; /* so that they look different */
    (void)snprintf(text, size, "%.*g%s%.12s, but %.*g when repeated", digits, finding->committed, has_unit ? " " : "",
                   has_unit ? unit : "", digits, finding->again);
    size_t length = strlen(text);
    if (isfinite(finding->tolerances)) {
        (void)snprintf(text + length, size - length, " (%.3g tolerances)", finding->tolerances);
    }
}

static void write_sentence(const tl_account_finding *finding, tl_twin_verify_report *outcome) {
    static const char *const outcomes[TL_REPAIRED_COUNT] = {
        [TL_REPAIRED_NOT] = "committed results may be wrong from now on",
        [TL_REPAIRED_BY_MEMORY] = "it is rolled back by its memory from now on",
        [TL_REPAIRED_BY_STATES] = "it is rolled back by its own states from now on",
    };
    const char *then = outcomes[finding->mended];
    if (finding->cause == (int32_t)TL_CAUSE_REFUSES) {
        (void)snprintf(outcome->text, sizeof outcome->text,
                       "%.24s: its rollback is not exact: it fails in step %lld, which had succeeded before; %s",
                       finding->component, (long long)finding->step, then);
        return;
    }
    char apart[100] = "not the same";
    if (finding->variable[0] != '\0') {
        write_size(finding, apart, sizeof apart);
    }
    const char *why = tl_twin_cause_text((tl_restore_cause)finding->cause);
    bool is_known = why[0] != '\0';
    (void)snprintf(outcome->text, sizeof outcome->text,
                   "%.24s: its rollback is not exact: %.24s was %s, %u step%s after the rollback%s%s%s; %s",
                   finding->component, finding->variable[0] != '\0' ? finding->variable : "an internal variable", apart,
                   finding->after, finding->after == 1 ? "" : "s", is_known ? " (" : "", why, is_known ? ")" : "",
                   then);
}

tl_status tl_twin_verify_until(tl_twin *twin, tl_time until, tl_twin_verify_report *outcome, tl_error *error) {
    tl_twin_finding finding;
    tl_budget left = {.now = NULL};
    if (until != TL_TIME_NEVER) {
        left.now = tl_clock_now;
        left.started = tl_clock_now(NULL);
        left.time = until - left.started;
    }
    tl_status status = tl_twin_verify(twin, &left, &finding, &outcome->found, error);
    if (outcome->found) {
        tl_account account;
        tl_account_take(twin, &account);
        (void)tl_twin_last_finding(&account, outcome);
    }
    return status;
}

bool tl_twin_last_finding(const tl_account *account, tl_twin_verify_report *outcome) {
    outcome->found = account->differed != 0;
    outcome->mended = account->finding.mended != TL_REPAIRED_NOT;
    (void)snprintf(outcome->component, sizeof outcome->component, "%.63s", account->finding.component);
    write_sentence(&account->finding, outcome);
    return outcome->found;
}
