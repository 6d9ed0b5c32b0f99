/* Summary of a run: see summary.h. */
#include "firmware/report/summary.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <string.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/text.h"
#include "firmware/monitor/finding.h"
#include "firmware/monitor/lock_monitor.h"
#include "firmware/report/changes.h"

/* ---- run end ---- */

bool tl_run_end_is_sound(const tl_summary *summary, const tl_account *account, const tl_config *config) {
    bool fits = account->components == config->component_count + 1 && account->matches == config->match_count &&
                account->adjusts == config->adjust_count;
    bool continues = (unsigned)summary->resumption.from <= (unsigned)TL_RESUMED_INPUTS;
    bool judged = (unsigned)summary->lock.state < (unsigned)TL_LOCK_STATES;
    return fits && judged && continues &&
           summary->figures.ledger_count == 0 /* its names are pointers, which the FMU process could forge */ &&
           tl_account_is_sound(account);
}

/* ---- summary ---- */

void tl_summary_add(tl_summary *summary, const tl_config *config, const tl_record *record) {
    const tl_history_step step = {
        .outcome = record->outcome,
        .stop = record->stop,
        .evaluations = record->evaluations,
        .used = record->used,
        .flags = record->flags,
    };
    for (size_t i = 0; i < config->adjust_count; i++) {
        tl_run_figures_add_adjusted(&summary->figures, i, record->u[i], record->nominal[i]);
        bool is_at_bound = record->u[i] <= config->adjust[i].lower || record->u[i] >= config->adjust[i].upper;
        summary->at_bound[i] += is_at_bound ? 1 : 0;
    }
    for (size_t i = 0; i < config->match_count; i++) {
        double difference = record->y[i] - record->measured[i];
        if (record->measured_quality[i] == TL_GOOD && isfinite(difference)) {
            summary->compared[i].count++;
            summary->compared[i].y += record->y[i];
            summary->compared[i].measured += record->measured[i];
            summary->compared[i].squares += difference * difference;
        }
    }
    tl_run_figures_add_step(&summary->figures, &step, config->step);
    summary->refused += record->refused.count;
}

void tl_summary_sample(tl_summary *summary, const tl_config *config, const tl_sample *sample) {
    summary->samples++;
    tl_ages_add_sample(&summary->ages, config, sample);
    for (size_t i = 0; i < config->signal_count; i++) {
        summary->moved[i] += sample->moved >> i & 1U;
        bool is_one = !config->signals[i].is_reading; /* its look-up is matched and counted instead */
        if (is_one && sample->quality[i] != TL_GOOD) {
            summary->not_good[i]++;
            summary->rejected[i].value = sample->values[i];
            summary->rejected[i].age = tl_sample_age(sample, i);
            summary->rejected[i].quality = sample->quality[i];
        }
    }
}

static bool is_matched(const tl_config *config, size_t signal) {
    const char *name = config->signals[signal].plan.name;
    for (size_t i = 0; i < config->match_count; i++) {
        if (strcmp(config->matched_as[i] + strlen("plant."), name) == 0) {
            return true;
        }
    }
    return false;
}

static const double MANY_LOST = 0.05; /* share of the steps: more are worth a warning */
static const double OFTEN = 0.2;      /* share of the steps at a bound that explains a loss */

/* Writes which matched signal, or which other one of an input, had no good value in half of the
 * samples or more; returns false if none. */
static bool describe_bad_signal(const tl_summary *summary, const tl_config *config, bool matched,
                                char text[TL_ERROR_TEXT]) {
    char what[TL_CONFIG_DESCRIPTION];
    for (size_t i = 0; i < config->signal_count; i++) {
        uint32_t quality = summary->rejected[i].quality;
        bool counts = matched ? is_matched(config, i) : config->signals[i].feeds && !is_matched(config, i);
        if (counts && summary->samples > 0 && 2 * summary->not_good[i] >= summary->samples &&
            quality <= TL_LAST_QUALITY) {
            tl_config_describe_quality(config, i, summary->rejected[i].value, (tl_quality)quality,
                                       summary->rejected[i].age, what);
            (void)snprintf(text, TL_ERROR_TEXT,
                           "plant.%s had no good value in %" PRIu64 " of %" PRIu64 " samples (last: %s): %s",
                           config->signals[i].plan.name, summary->not_good[i], summary->samples, what,
                           tl_config_quality_remedy(config, i, (tl_quality)quality));
            return true;
        }
    }
    return false;
}

/* Writes how far the worst output is off, and which variable was at a bound. */
static void describe_error(const tl_summary *summary, const tl_config *config, char text[TL_ERROR_TEXT]) {
    size_t worst = 0;
    double most = -1.0;
    size_t used = 0;
    for (size_t i = 0; i < config->match_count; i++) {
        double count = (double)summary->compared[i].count;
        double error = sqrt(summary->compared[i].squares / count) / config->match[i].tolerance;
        if (count > 0.0 && config->match[i].weight > 0.0 && error > most) {
            most = error;
            worst = i;
        }
    }
    if (most >= 0.0) {
        double count = (double)summary->compared[worst].count;
        used = (size_t)snprintf(text, TL_ERROR_TEXT,
                                "%.64s is %.4g on average, %.64s %.4g (rms error %.3g, tolerance %.3g): check sign, "
                                "scale and unit of the signals",
                                config->match[worst].variable, summary->compared[worst].y / count,
                                config->match[worst].to, summary->compared[worst].measured / count,
                                most * config->match[worst].tolerance, config->match[worst].tolerance);
    } else {
        used = (size_t)snprintf(text, TL_ERROR_TEXT, "check the matched signals");
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        const tl_plan_adjust *adjust = &config->adjust[i];
        double share = (double)summary->at_bound[i] / (double)(summary->figures.adjust[i].count + 1);
        if (share > OFTEN && used < TL_ERROR_TEXT) {
            (void)snprintf(text + used, TL_ERROR_TEXT - used,
                           "; %.64s was at min or max in %.0f %% of the steps: widen them, if the plant can have more",
                           adjust->variable, 100.0 * share);
            return;
        }
    }
}

static void warn_of_loss(const tl_summary *summary, const tl_config *config) {
    char text[TL_ERROR_TEXT];
    double lost = (double)summary->lock.steps[TL_LOCK_LOST] / (double)(tl_lock_tally_total(&summary->lock) + 1);
    if (lost > MANY_LOST) {
        describe_error(summary, config, text);
        tl_log(TL_LOG_WARNING, "lost in %.0f %% of the steps: %s", 100.0 * lost, text);
    }
}

static tl_status fail_never_locked(const tl_summary *summary, const tl_config *config, tl_error *error) {
    char text[TL_ERROR_TEXT];
    if (describe_bad_signal(summary, config, true, text) || describe_bad_signal(summary, config, false, text)) {
        return tl_fail(error, TL_NOT_LOCKED, "never in lock: %s", text);
    }
    if (summary->lock.steps[TL_LOCK_LOST] == 0 && summary->lock.steps[TL_LOCK_DEGRADED] != 0) {
        return tl_fail(error, TL_NOT_LOCKED,
                       "never in lock: degraded, because a signal was bad or an FMU was not restored exactly; see the "
                       "warnings, and `twinlock show` for the events of a run with --db");
    }
    if (summary->lock.windows == 0) {
        return tl_fail(error, TL_NOT_LOCKED,
                       "never in lock: the run ended before its first window of %g s: let it run longer",
                       tl_seconds(tl_lock_monitor_window(config).time));
    }
    describe_error(summary, config, text);
    return tl_fail(error, TL_NOT_LOCKED, "never in lock: %s", text);
}

tl_status tl_summary_require_lock(const tl_summary *summary, const tl_config *config, double percent, tl_error *error) {
    /* The tally does not include the earlier run, but the ticks missed in between. */
    bool is_unknown = summary->resumption.from != TL_RESUMED_NOT && summary->lock.windows < TL_LOCK_RECOVERED;
    bool is_asked = percent > 0.0 || (config->adjust_count != 0 && !is_unknown);
    if (!is_asked || (config->adjust_count != 0 && tl_lock_tally_is_enough(&summary->lock, percent))) {
        warn_of_loss(summary, config);
        return TL_OK;
    }
    if (config->adjust_count == 0) {
        return tl_fail(
            error, TL_NOT_LOCKED,
            "nothing is adjusted, so there is no lock: --require-lock %g needs \"adjust\" in the configuration",
            percent);
    }
    if (percent > 0.0) {
        return tl_fail(error, TL_NOT_LOCKED, "in lock in %.2f %% of the steps, and --require-lock asks for %g %%",
                       tl_lock_tally_percent(&summary->lock), percent);
    }
    if (summary->lock.ran_away != 0) {
        return tl_fail(error, TL_NOT_LOCKED,
                       "an output or J ran away in %" PRIu64
                       " steps. Check the model and the bounds of the adjusted variables; `twinlock show` lists the "
                       "events of a run with --db",
                       summary->lock.ran_away);
    }
    return fail_never_locked(summary, config, error);
}

/* State while a summary is printed. */
typedef struct printing {
    const tl_summary *summary;
    const tl_config *config;
    const tl_account *account;
    tl_run_figures figures; /* including what the twin itself counts */
    FILE *file;             /* of a table for people */
    int width;              /* of its first column */
} printing;

static void begin_printing(printing *page, const tl_summary *summary, const tl_config *config,
                           const tl_account *account) {
    *page = (printing){summary, config, account, summary->figures, NULL, 0};
    tl_run_figures_take_account(&page->figures, account);
}

/* Without a step there was no correction, so the means are 0. */
static double or_zero(const tl_run_adjusted *adjusted, double value) {
    return adjusted->count == 0 ? 0.0 : value;
}

static void add_executions(tl_json_writer *json, const tl_account *account) {
    tl_json_open_object(json, "executions");
    tl_json_add_count(json, "total", tl_account_executions(account));
    for (size_t i = 0; i < account->components; i++) {
        tl_json_add_count(json, account->component[i].name, account->component[i].executions);
    }
    tl_json_close(json);
}

/* Executions to verify the rollback of FMUs; no other count includes them. */
static void add_verified(tl_json_writer *json, const tl_account *account) {
    tl_json_open_object(json, "verified");
    tl_json_add_count(json, "times", account->verified);
    tl_json_add_count(json, "executions", account->verified_executions);
    tl_json_add_count(json, "differed", account->differed);
    tl_json_close(json);
}

/* Written only if there is a free-running twin. The counts in `free_twin` are those of the twin
 * process, which may include steps as a shadow before this run's figures. */
static void add_free_twin(tl_json_writer *json, const tl_run_figures *figures, const tl_account *account) {
    if (account->has_free_twin != 0) {
        tl_json_open_object(json, "free_twin");
        tl_json_add_count(json, "executions", account->free_twin.executions);
        tl_json_add_count(json, "rested_steps", figures->rested);
        tl_json_add_count(json, "rests", account->free_twin.turns);
        tl_json_add_count(json, "adopted", account->free_twin.adopted);
        tl_json_add_count(json, "renewed", account->free_twin.renewed);
        tl_json_close(json);
    }
}

/* Written only if released twins are configured; else `state` says why there are none. */
static void add_released(tl_json_writer *json, const tl_account *account) {
    if (account->released_state != TL_RELEASED_OFF) {
        tl_json_open_object(json, "released");
        tl_json_add_text(json, "state", tl_released_state_text((tl_released_state)account->released_state));
        tl_json_add_count(json, "steps", account->released_steps);
        tl_json_add_count(json, "executions", account->released.executions);
        tl_json_add_count(json, "releases", account->released.releases);
        tl_json_close(json);
    }
}

static void add_matches(tl_json_writer *json, const printing *page) {
    tl_json_open_object(json, "match");
    for (size_t i = 0; i < page->config->match_count; i++) {
        tl_json_open_object(json, page->config->match[i].variable);
        tl_figures_json_add_match(json, &page->figures, i, page->account->match[i].unit);
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void add_adjusted(tl_json_writer *json, const printing *page) {
    tl_json_open_object(json, "adjust");
    for (size_t i = 0; i < page->config->adjust_count; i++) {
        const tl_run_adjusted *adjusted = &page->figures.adjust[i];
        tl_json_open_object(json, page->config->adjust[i].variable);
        tl_json_add_number(json, "first", adjusted->first);
        tl_json_add_number(json, "last", adjusted->last);
        tl_json_add_number(json, "mean", or_zero(adjusted, tl_run_figures_mean(&page->figures, i)));
        tl_json_add_number(json, "correction_mean",
                           or_zero(adjusted, tl_run_figures_correction_mean(&page->figures, i)));
        tl_json_add_text(json, "unit", page->account->adjust[i].unit);
        tl_json_close(json);
    }
    tl_json_close(json);
}

/* Returns the measured Δo in s: the delay that the twin found, plus Δi. */
static double measured_delay(const tl_config *config, const tl_twin_delay *found) {
    const tl_config_delays *delays = config->delays;
    return tl_seconds(found->delay + (delays != NULL && delays->has_input ? delays->input.delay : 0));
}

/* An unknown value becomes null, so that missing data does not look like a perfect fit. */
static void add_seconds(tl_json_writer *json, const char *key, double seconds, bool known) {
    tl_json_add_number(json, key, known ? seconds : (double)NAN);
}

static void add_delays(tl_json_writer *json, const tl_config *config, const tl_account *account) {
    static const char *const states[] = {
        [TL_DELAY_UNKNOWN] = "unknown", [TL_DELAY_KNOWN] = "known", [TL_DELAY_LOST] = "lost"};
    const tl_config_delays *delays = config->delays;
    bool is_measured = tl_config_measures_delay(config) != TL_DELAY_NOT_MEASURED;
    if (delays == NULL && !is_measured) {
        return;
    }
    bool has_input = delays != NULL && delays->has_input;
    bool has_output = delays != NULL && delays->has_output;
    tl_json_open_object(json, "delays");
    add_seconds(json, "input_s", has_input ? tl_seconds(delays->input.delay) : 0.0, has_input);
    add_seconds(json, "output_s", has_output ? tl_seconds(delays->output.delay) : 0.0, has_output);
    if (is_measured) {
        const tl_twin_delay *found = &account->delay;
        add_seconds(json, "measured_s", measured_delay(config, found), found->state != TL_DELAY_UNKNOWN);
        tl_json_add_text(json, "state", states[found->state]);
        tl_json_add_number(json, "confidence", found->confidence);
    }
    tl_json_close(json);
}

static void add_plant(tl_json_writer *json, const tl_summary *summary, const tl_config *config) {
    tl_json_open_object(json, "plant");
    for (size_t i = 0; i < config->signal_count; i++) {
        if (config->signals[i].is_reading) {
            continue;
        }
        tl_json_open_object(json, config->signals[i].plan.name);
        tl_json_add_count(json, "samples", summary->samples);
        tl_json_add_count(json, "not_good", summary->not_good[i]);
        tl_json_add_count(json, "moved", summary->moved[i]);
        if (summary->expected[i] != 0) {
            tl_json_add_count(json, "readings", summary->readings[i]);
            tl_json_add_count(json, "expected", summary->expected[i]);
        }
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void add_ages(tl_json_writer *json, const tl_ages *ages) {
    tl_json_open_object(json, "age");
    tl_json_add_count(json, "values", ages->values);
    tl_json_add_number(json, "p50_s", tl_seconds(tl_ages_percentile(ages, 50)));
    tl_json_add_number(json, "p99_s", tl_seconds(tl_ages_percentile(ages, 99)));
    tl_json_close(json);
}

static void add_changes(tl_json_writer *json, const tl_run_changes *changes) {
    tl_changes_add_detection(json, &changes->detection);
    tl_json_open_array(json, "findings");
    for (size_t i = 0; i < changes->count; i++) {
        tl_changes_add_finding(json, &changes->finding[i], changes->started);
        tl_json_close(json);
    }
    tl_json_close(json);
}

tl_status tl_summary_print_json(const tl_summary *summary, const tl_config *config, const tl_account *account,
                                const tl_run_changes *changes, FILE *file, tl_error *error) {
    printing page;
    tl_json_writer json;
    begin_printing(&page, summary, config, account);
    tl_json_writer_begin(&json);
    tl_json_add_count(&json, "steps", page.figures.steps);
    if (config->adjust_count != 0) {
        tl_json_open_object(&json, "lock");
        tl_figures_json_add_lock(&json, &summary->lock);
        tl_json_add_count(&json, "ran_away", summary->lock.ran_away); /* no event reports this */
        tl_json_close(&json);
    }
    if (changes != NULL) {
        add_changes(&json, changes);
    }
    add_executions(&json, account);
    add_verified(&json, account);
    add_free_twin(&json, &page.figures, account);
    add_released(&json, account);
    tl_json_add_count(&json, "replayed", account->replayed);
    tl_json_add_count(&json, "evaluations", page.figures.evaluations);
    tl_json_add_count(&json, "optimised_steps", page.figures.optimised_steps);
    tl_json_add_count(&json, "rested_steps", page.figures.rested);
    tl_json_add_count(&json, "refused_trials", summary->refused);
    tl_json_add_count(&json, "refused_steps", page.figures.refused);
    add_matches(&json, &page);
    add_plant(&json, summary, config);
    add_adjusted(&json, &page);
    add_delays(&json, config, account);
    tl_execution_counts total = tl_run_figures_total(&page.figures);
    tl_json_open_object(&json, "cache");
    tl_json_add_number(&json, "saved", tl_run_component_saved(&total));
    tl_json_add_count(&json, "nodes_peak", page.figures.nodes_peak);
    tl_json_add_count(&json, "full", total.uncached);
    tl_json_close(&json);
    tl_json_open_object(&json, "ledger");
    tl_json_add_truth(&json, "complete", account->complete != 0);
    tl_figures_json_add_components(&json, &page.figures);
    tl_json_close(&json);
    tl_figures_json_add_outcomes(&json, &page.figures);
    tl_json_add_count(&json, "ticks", summary->ticks);
    tl_json_add_count(&json, "skipped", page.figures.skipped);
    tl_json_add_count(&json, "deadline_misses", summary->deadline_misses);
    tl_json_add_count(&json, "time_limited", page.figures.time_limited);
    if (summary->ticks != 0 && summary->ages.values != 0) {
        add_ages(&json, &summary->ages);
    }
    tl_figures_json_add_resumption(&json, &summary->resumption);
    if (summary->tunings != 0) {
        tl_json_open_object(&json, "tunings");
        tl_json_add_count(&json, "recorded", summary->tunings);
        tl_json_add_count(&json, "applied", summary->tunings - summary->tunings_left_out);
        tl_json_close(&json);
    }
    tl_json_add_number(&json, "wall_s", summary->wall_s);
    tl_status status = tl_json_writer_print(&json, file, error);
    tl_json_writer_free(&json);
    return status;
}

/* ---- table for people ---- */

enum { NARROWEST = 12, WIDEST = 32 }; /* of its first column */
enum { SHOWN = 10 };                  /* findings that are shown */

static void widen_column(printing *page, const char *name) {
    int length = (int)strlen(name);
    page->width = length > page->width && length <= WIDEST ? length : page->width;
}

static void print_line(const printing *page, const char *label, const char *format, ...) TL_PRINTF(3, 4);

static void print_line(const printing *page, const char *label, const char *format, ...) {
    va_list arguments;
    (void)fprintf(page->file, "  %-*s  ", page->width, label);
    va_start(arguments, format);
    (void)vfprintf(page->file, format, arguments);
    va_end(arguments);
    (void)fputc('\n', page->file);
}

/* Writes a dash where JSON has null. Even the MSE of finite values may be infinite. */
static void write_measure(double value, int digits, char *text, size_t size) {
    if (isfinite(value)) {
        (void)snprintf(text, size, "%.*g", digits, value);
    } else {
        (void)snprintf(text, size, "-");
    }
}

/* Writes for example "mm²" or "(rad/s)²"; nothing if there is no unit. */
static void write_square(const char *unit, char *text, size_t size) {
    bool compound = strpbrk(unit, "./*^ 0123456789") != NULL;
    (void)snprintf(text, size, "%s%s%s%s%s", unit[0] == '\0' ? "" : " ", compound ? "(" : "", unit, compound ? ")" : "",
                   unit[0] == '\0' ? "" : "\302\262");
}

static const char *space_before(const char *unit) {
    return unit[0] == '\0' ? "" : " ";
}

static void print_match(const printing *page, size_t match) {
    const char *name = page->config->match[match].variable;
    bool is_compared_only = page->config->match[match].weight <= 0.0 && page->config->adjust_count != 0;
    const tl_metrics *metrics = &page->figures.match[match];
    const char *unit = tl_show_unit(page->account->match[match].unit);
    char rms[32];
    char most[32];
    write_measure(sqrt(tl_run_figures_mse(&page->figures, match)), 3, rms, sizeof rms);
    write_measure(metrics->maximum, 3, most, sizeof most);
    if (metrics->pairs < 2) {
        print_line(page, name, "fewer than two good measurements: nothing to compare");
    } else {
        print_line(page, name, "error %s%s%s rms, at most %s%s%s%s", rms, space_before(unit), unit, most,
                   space_before(unit), unit, is_compared_only ? "; compared only" : "");
    }
    if (page->figures.released[match].pairs > 1) {
        write_measure(sqrt(tl_run_figures_mse_released(&page->figures, match)), 3, rms, sizeof rms);
        print_line(page, "", "%s%s%s rms without corrections, up to %" PRIu32 " steps", rms, space_before(unit), unit,
                   page->account->released_steps);
    }
    if (metrics->left_out != 0) {
        print_line(page, "", "%" PRIu64 " of %" PRIu64 " measurements or outputs were not good and are left out",
                   metrics->left_out, metrics->left_out + metrics->pairs);
    }
}

/* Matched signals are skipped, because print_match() has printed them. */
static void print_inputs(const printing *page) {
    for (size_t i = 0; i < page->config->signal_count; i++) {
        uint64_t bad = page->summary->not_good[i];
        if (page->summary->moved[i] != 0) {
            (void)fprintf(page->file,
                          "  plant.%s: %" PRIu64 " of %" PRIu64 " samples were slightly beyond a limit that an FMU "
                          "declares, and were moved to it\n",
                          page->config->signals[i].plan.name, page->summary->moved[i], page->summary->samples);
        }
        if (bad != 0 && !is_matched(page->config, i)) {
            const char *name = page->config->signals[i].plan.name;
            tl_quality quality = (tl_quality)page->summary->rejected[i].quality;
            (void)fprintf(page->file, "  plant.%s: %" PRIu64 " of %" PRIu64 " samples were not good: %s\n", name, bad,
                          page->summary->samples,
                          2 * bad < page->summary->samples ? "the last good value was held"
                                                           : tl_config_quality_remedy(page->config, i, quality));
        }
    }
}

/* Prints for a Boolean the share of steps in which u and û were on. */
static void print_boolean(const printing *page, size_t adjust) {
    const tl_run_adjusted *adjusted = &page->figures.adjust[adjust];
    double steps = (double)adjusted->count;
    double on = or_zero(adjusted, adjusted->sum / steps);
    double nominal = or_zero(adjusted, (adjusted->sum - adjusted->correction_sum) / steps);
    print_line(page, page->config->adjust[adjust].variable, "on in %.1f %% of the steps (nominal %.1f %%), last %s",
               100 * on, 100 * nominal, adjusted->last > 0.5 ? "on" : "off");
}

static void print_adjusted(const printing *page, size_t adjust) {
    const tl_run_adjusted *adjusted = &page->figures.adjust[adjust];
    const char *unit = tl_show_unit(page->account->adjust[adjust].unit);
    if (page->account->adjust[adjust].type == TL_BOOLEAN) {
        print_boolean(page, adjust);
        return;
    }
    double correction = or_zero(adjusted, tl_run_figures_correction_mean(&page->figures, adjust));
    double nominal = or_zero(adjusted, tl_run_figures_mean(&page->figures, adjust)) - correction;
    print_line(page, page->config->adjust[adjust].variable, "corrected by %+.3g%s%s on average (nominal %.5g)",
               correction, space_before(unit), unit, nominal);
}

static void print_delays(const printing *page) {
    const tl_twin_delay *found = &page->account->delay;
    tl_config_measured measured = tl_config_measures_delay(page->config);
    if (found->state == TL_DELAY_UNKNOWN && measured == TL_DELAY_USED) {
        print_line(page, "delay", "not found: confidence %.2f", found->confidence);
    } else if (found->state != TL_DELAY_UNKNOWN) {
        print_line(page, "delay", "measured \316\224o = %.4g ms%s, confidence %.2f%s",
                   measured_delay(page->config, found) * 1e3, measured == TL_DELAY_USED ? "" : " (not used)",
                   found->confidence, found->state == TL_DELAY_LOST ? ": lost" : "");
    }
}

/* ---- details for --verbose ---- */

static void print_effort(const printing *page) {
    const tl_run_figures *figures = &page->figures;
    const tl_account *account = page->account;
    tl_execution_counts total = tl_run_figures_total(figures);
    uint64_t executions = tl_account_executions(account);
    uint64_t free_executions = tl_run_figures_committed(figures) * account->components;
    print_line(page, "executions", "%" PRIu64 " (%.3f per free-running one), %" PRIu64 " evaluations", executions,
               free_executions == 0 ? 0.0 : (double)executions / (double)free_executions, figures->evaluations);
    if (page->config->adjust_count != 0) {
        print_line(page, "ledger", "predicted %s%" PRIu64 ", without saving %" PRIu64 ", saved %.0f",
                   account->complete != 0 ? "" : "at most ", total.predicted, total.plain,
                   tl_run_component_saved(&total));
    }
    if (total.repeated + total.uncached != 0) {
        print_line(page, "", "%" PRIu64 " repeated, %" PRIu64 " not cached", total.repeated, total.uncached);
    }
    if (page->summary->refused != 0) {
        print_line(page, "refused",
                   "%" PRIu64 " trials in %" PRIu64 " steps: an FMU failed, or an output was not finite",
                   page->summary->refused, figures->refused);
    }
}

static void print_free_twin(const printing *page) {
    const tl_free_twin_counts *beside = &page->account->free_twin;
    uint64_t steps = tl_run_figures_committed(&page->figures);
    if (page->account->has_free_twin != 0 && steps != 0) {
        print_line(page, "free twin",
                   "nearer in %.1f %% of the steps, so nominal values were applied, %" PRIu64 " times",
                   100.0 * (double)page->figures.rested / (double)steps, beside->turns);
        print_line(page, "", "%" PRIu64 " further executions", beside->executions);
    }
}

static void print_released(const printing *page) {
    const tl_account *account = page->account;
    if (account->released_state == TL_RELEASED_ON) {
        print_line(page, "released", "%" PRIu64 " releases, %" PRIu64 " further executions", account->released.releases,
                   account->released.executions);
    } else if (account->released_state != TL_RELEASED_OFF) {
        print_line(page, "released", "none: %s", tl_released_state_text((tl_released_state)account->released_state));
    }
}

static void print_mse(const printing *page, size_t match) {
    const tl_metrics *readings = &page->figures.readings[match];
    char mse[32];
    char square[128];
    if (page->figures.match[match].pairs < 2) {
        return;
    }
    write_square(tl_show_unit(page->account->match[match].unit), square, sizeof square);
    write_measure(tl_run_figures_mse(&page->figures, match), 5, mse, sizeof mse);
    print_line(page, page->config->match[match].variable, "MSE %s%s over the steps", mse, square);
    if (readings->pairs > 1) {
        write_measure(tl_run_figures_mse_readings(&page->figures, match), 5, mse, sizeof mse);
        print_line(page, "", "MSE %s%s at the %" PRIu64 " instants of the sensor, %" PRIu64 " readings rejected", mse,
                   square, readings->pairs, readings->left_out);
    }
}

static void print_values(const printing *page, size_t adjust) {
    const tl_run_adjusted *adjusted = &page->figures.adjust[adjust];
    if (page->account->adjust[adjust].type != TL_BOOLEAN) {
        print_line(page, page->config->adjust[adjust].variable, "first %.5g, mean %.5g, last %.5g", adjusted->first,
                   or_zero(adjusted, tl_run_figures_mean(&page->figures, adjust)), adjusted->last);
    }
}

static void print_details(const printing *page) {
    (void)fprintf(page->file, "  %-*s  ", page->width, "steps");
    (void)tl_run_figures_print_outcomes(&page->figures, "", page->file);
    (void)fputc('\n', page->file);
    print_effort(page);
    print_free_twin(page);
    print_released(page);
    for (size_t i = 0; i < page->config->match_count; i++) {
        print_mse(page, i);
    }
    for (size_t i = 0; i < page->config->adjust_count; i++) {
        print_values(page, i);
    }
}

/* An output is off without corrections: names the inputs whose sign or scale may be wrong. */
static void print_suspects(const printing *page) {
    char names[TL_LOCK_CLAUSE] = "";
    size_t used = 0;
    for (size_t i = 0; i < page->config->signal_count && used < sizeof names; i++) {
        const tl_config_signal *signal = &page->config->signals[i];
        if (signal->feeds && signal->of == i &&
            used + strlen(signal->plan.name) + sizeof ", plant., …" < sizeof names) {
            used += (size_t)snprintf(names + used, sizeof names - used, "%splant.%s", used > 0 ? ", " : "",
                                     signal->plan.name);
        }
    }
    print_line(page, "", "check sign and scale%s%s, then the model", used > 0 ? " of " : " of the signals", names);
}

static void print_standing(const printing *page) {
    char text[TL_LOCK_CLAUSE];
    tl_lock_standing_write(&page->summary->lock.standing, false, text);
    if (text[0] != '\0') {
        print_line(page, "", "%s", text);
    }
    if (page->summary->lock.standing.reason == TL_LOCK_REASON_RELEASED) {
        print_suspects(page);
    }
    tl_lock_standing_write_remedy(&page->summary->lock.standing, text);
    if (text[0] != '\0') {
        print_line(page, "", "%s", text);
    }
}

static void print_rest(const printing *page) {
    uint64_t steps = tl_run_figures_committed(&page->figures);
    if (page->account->has_free_twin == 0 && page->figures.rested != 0 && steps != 0) {
        print_line(page, "", "u rested at nominal in %.1f %% of the steps: the corrections did harm",
                   100.0 * (double)page->figures.rested / (double)steps);
    }
}

static void print_lock(const printing *page) {
    char text[TL_LOCK_SENTENCE];
    if (page->config->adjust_count == 0) {
        print_line(page, "free-running", "%" PRIu64 " steps of %g s; nothing is adjusted", page->figures.steps,
                   tl_seconds(page->config->step));
    } else {
        tl_lock_tally_write(&page->summary->lock, page->figures.outcomes[TL_HELD] > 0 ? "strokes" : "steps", text);
        print_line(page, "in lock", "%s", text);
        print_standing(page);
        print_rest(page);
    }
}

/* Signals with fewer readings than the configuration expects. */
static void print_late(const printing *page) {
    for (size_t i = 0; i < page->config->signal_count; i++) {
        const tl_summary *summary = page->summary;
        if (summary->readings[i] < summary->expected[i] / 4 * 3) {
            print_line(page, "", "plant.%s: %" PRIu64 " readings of %" PRIu64 " expected",
                       page->config->signals[i].plan.name, summary->readings[i], summary->expected[i]);
        }
    }
}

/* The verdict, and the newest findings. */
static void print_changes(const printing *page, const tl_run_changes *changes) {
    char text[TL_FINDING_TEXT];
    char cause[TL_FINDING_TEXT];
    if (!tl_changes_are_known(changes)) {
        return;
    }
    tl_changes_write_verdict(&changes->detection, tl_changes_count(changes, "open"), tl_changes_count(changes, "gone"),
                             text);
    print_line(page, "changes", "%s", text);
    for (size_t i = changes->count > SHOWN ? changes->count - SHOWN : 0; i < changes->count; i++) {
        const tl_run_finding *finding = &changes->finding[i];
        tl_changes_write_finding(finding, finding->found, changes->started, text, cause);
        print_line(page, "", "%s", text);
        if (cause[0] != '\0') {
            print_line(page, "", "cause: %s", cause);
        }
    }
}

void tl_summary_print_table(const tl_summary *summary, const tl_config *config, const tl_account *account,
                            const tl_run_changes *changes, bool verbose, FILE *file) {
    printing page;
    char text[TL_AGES_TEXT];
    begin_printing(&page, summary, config, account);
    page.file = file;
    page.width = NARROWEST;
    for (size_t i = 0; i < config->match_count; i++) {
        widen_column(&page, config->match[i].variable);
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        widen_column(&page, config->adjust[i].variable);
    }
    (void)fprintf(file, "%s\n", config->name);
    print_lock(&page);
    if (changes != NULL) {
        print_changes(&page, changes);
    }
    for (size_t i = 0; i < config->match_count; i++) {
        print_match(&page, i);
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        print_adjusted(&page, i);
    }
    print_inputs(&page);
    print_delays(&page);
    if (summary->tunings != 0) {
        print_line(&page, "tunings", "%" PRIu64 " during the run%s", summary->tunings,
                   summary->tunings_left_out == 0 ? "" : ", not applied: the run had another configuration");
    }
    if (summary->ticks != 0) {
        print_line(&page, "real time", "%" PRIu64 " ticks, %" PRIu64 " missed and caught up", summary->ticks,
                   page.figures.skipped);
        print_line(&page, "", "%" PRIu64 " deadlines missed, longest cycle %.3f ms", summary->deadline_misses,
                   tl_seconds(page.figures.longest) * 1e3);
        if (summary->ages.values != 0) {
            tl_ages_write(&summary->ages, text);
            print_line(&page, "", "%s", text);
        }
        print_late(&page);
    }
    if (verbose) {
        print_details(&page);
    }
    print_line(&page, "took", "%.3f s", summary->wall_s);
}
