/* Proposal: derives settings from a recording: see proposal.h. */
#include "firmware/monitor/proposal.h"

#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <string.h>

#include "firmware/base/json.h"
#include "firmware/base/text.h"

/* ---- proposal ---- */

static const double AT_REST = 6.0;   /* σ, if the plant is at rest: with less, the lock would only follow the noise */
static const double TOLERANCE = 3.0; /* smallest tolerance, σ */
static const double STAYS = 2.0;     /* a tolerance up to this many times the smallest is kept */
static const double HALF = 0.6;      /* a low-pass must reduce the mean square error below this share */
static const double NEARLY = 1.3;    /* up to this many times the best error is nearly as good, */
static const double NEARLY_NOTHING = 1.0 / 25; /* plus this many σ² */
static const double SHORTEST = 0.25;           /* shortest time constant, in intervals between readings */
static const double LONGEST = 2.5;       /* longest one: it would flatten motion that the recording may not show */
static const double GATE_OF_JUMP = 1.5;  /* times the largest motion of the plant between two readings */
static const double GATE_OF_NOISE = 8.0; /* at least this many σ */
static const double MOVES = 2.0;         /* times its noise: an input that moves more is worth a wait */
static const double FEW_OUTLIERS = 2;    /* with fewer, no proposal */
enum { MEDIAN = 5 };

static void write_reason(tl_proposal_reason *reason, const char *format, ...) TL_PRINTF(2, 3);

static void write_reason(tl_proposal_reason *reason, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(reason->text, sizeof reason->text, format, arguments);
    va_end(arguments);
}

/* Rounds up to two digits. */
static double rounded_up(double value) {
    double unit = value > 0.0 ? pow(10.0, floor(log10(value)) - 1.0) : 1.0;
    return value > 0.0 ? ceil(value / unit - 1e-9) * unit : 0.0;
}

/* ---- message intervals ---- */

/* Interval in whole steps that 99 % of the readings keep. */
static tl_time every_of(const tl_config *config, const tl_survey_signal *signal) {
    tl_time steps = (signal->rare + config->step - 1) / config->step;
    return (steps > 0 ? steps : 1) * config->step;
}

static bool is_too_slow(const tl_config *config, const tl_survey_signal *signal) {
    return every_of(config, signal) > TL_CONFIG_LONGEST_SHIFT * config->step;
}

/* Returns true if there is no useful line between the readings; writes the reason. */
static bool has_no_line(const tl_config *config, size_t index, const tl_survey_signal *signal,
                        tl_proposal_reason *reason) {
    const tl_plan_signal *plan = &config->signals[index].plan;
    if (plan->type != TL_REAL) {
        write_reason(reason, "not a Real: there is no value between off and on");
    } else if (config->measurements != TL_LAG) {
        write_reason(reason, "with measurements \"%s\" no step waits for the next reading",
                     tl_pairing_names[config->measurements]);
    } else if (signal->is_switched) {
        write_reason(reason, "it has only a few values: there is no value between them");
    } else if (signal->median == 0 || is_too_slow(config, signal)) {
        write_reason(reason, "its readings are too rare: a step would wait for more than %d steps",
                     (int)TL_CONFIG_LONGEST_SHIFT);
    } else {
        return false;
    }
    return true;
}

/* ---- matches ---- */

static void propose_between(const tl_config *config, const tl_survey_signal *signal, tl_proposal_match *match) {
    if (has_no_line(config, match->signal, signal, &match->why_between)) {
        return;
    }
    if (signal->most <= config->step) {
        write_reason(&match->why_between, "there is a reading in each step: a line has no effect");
        return;
    }
    match->between = TL_BETWEEN_LINE;
    write_reason(&match->why_between, "the last reading is %.3g s old on average, and a step takes %g s",
                 tl_seconds(signal->median) / 2.0, tl_seconds(config->step));
}

/* Returns the next value of the series 1, 1.5, 2, 3, 4, 5, 6, 8, 10 … after `value`. */
static tl_time next_constant(tl_time value) {
    static const double steps[] = {1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0};
    double decade = pow(10.0, floor(log10((double)value) + 1e-9));
    for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
        if (decade * steps[i] > (double)value * (1.0 + 1e-9)) {
            return llround(decade * steps[i]);
        }
    }
    return value * 2;
}

/* Returns the shortest time constant that is nearly as good as the best, in ns; 0 if none reduces
 * the error enough. *error: the remaining mean square. */
static tl_time find_low_pass(const tl_config *config, const tl_survey_signal *signal, double *error) {
    double sigma = signal->sigma;
    double square = sigma * sigma;
    tl_time first = (tl_time)(SHORTEST * (double)signal->median) + 1;
    tl_time last = (tl_time)(LONGEST * (double)signal->median);
    double least = square;
    last = last < TL_CONFIG_LONGEST_SHIFT * config->step / 2 ? last : TL_CONFIG_LONGEST_SHIFT * config->step / 2;
    for (tl_time each = next_constant(first); each <= last; each = next_constant(each)) {
        least = fmin(least, tl_smoothing_error(signal->kept, signal->kept_count, sigma, each));
    }
    for (tl_time each = next_constant(first); least < HALF * square && each <= last; each = next_constant(each)) {
        *error = tl_smoothing_error(signal->kept, signal->kept_count, sigma, each);
        if (*error <= NEARLY * least + NEARLY_NOTHING * square && *error < HALF * square) {
            return each;
        }
    }
    return 0;
}

static void propose_low_pass(const tl_config *config, const tl_survey_signal *signal, tl_proposal_match *match,
                             tl_proposal_reason *reason) {
    bool is_real = config->signals[match->signal].plan.type == TL_REAL && !signal->is_switched;
    double error = 0.0;
    if (!is_real) {
        write_reason(reason, "it has only a few values");
    } else if (signal->median == 0 || is_too_slow(config, signal)) {
        write_reason(reason, "its readings are too rare for a low-pass");
    } else if (config->measurements == TL_AHEAD) {
        write_reason(reason, "with measurements \"%s\" no step waits for a low-pass",
                     tl_pairing_names[config->measurements]);
    } else if (signal->noise.is_too_fast) {
        write_reason(reason, "the plant moves too fast between two readings for a low-pass");
    } else if (!(signal->sigma > 0.0)) {
        write_reason(reason, "there is no noise");
    } else if ((match->condition.low_pass = find_low_pass(config, signal, &error)) > 0) {
        write_reason(reason, "a low-pass of %g s reduces the error of the readings from %.3g to %.3g",
                     tl_seconds(match->condition.low_pass), signal->sigma, sqrt(error));
    } else {
        write_reason(reason, "a low-pass would remove as much of the plant's motion as of the noise");
    }
    if (match->condition.low_pass > 0 && config->measurements == TL_LAG && match->between == TL_BETWEEN_LAST) {
        match->between = TL_BETWEEN_LINE;
        write_reason(&match->why_between, "a low-pass always uses the line");
    }
}

/* A gate needs a limit for the plant's motion; a median does not. */
static void propose_rejection(const tl_config *config, const tl_survey_signal *signal, tl_proposal_match *match,
                              tl_proposal_reason *reason) {
    double gate = rounded_up(fmax(GATE_OF_JUMP * signal->jump, GATE_OF_NOISE * signal->sigma));
    double percent = 100.0 * (double)signal->outliers / (double)(signal->good > 0 ? signal->good : 1);
    if ((double)signal->outliers < FEW_OUTLIERS) {
        return;
    }
    if (signal->nearest > gate) {
        match->condition.gate = rounded_up(sqrt(gate * signal->nearest));
        write_reason(
            reason,
            "%.2g %% of the readings are outliers, nearly all off by %.3g or more; the plant moves by at most %.3g: a gate in "
            "between",
            percent, signal->nearest, signal->jump);
    } else if (config->measurements == TL_AHEAD || is_too_slow(config, signal)) {
        write_reason(
            reason,
            "%.2g %% of the readings are outliers, within the motion of the plant: no step waits for a median here",
            percent);
    } else {
        match->condition.median = MEDIAN;
        write_reason(reason,
                     "%.2g %% of the readings are outliers, within the motion of the plant: a median needs no limit",
                     percent);
    }
}

static void propose_condition(const tl_config *config, const tl_survey_signal *signal, tl_proposal_match *match) {
    tl_proposal_reason low_pass = {""};
    tl_proposal_reason rejection = {""};
    if (config->event.start.signal != NULL) {
        write_reason(&match->why_condition, "with horizon.event it would blur the time of the event");
        return;
    }
    propose_low_pass(config, signal, match, &low_pass);
    propose_rejection(config, signal, match, &rejection);
    bool both = rejection.text[0] != '\0';
    write_reason(&match->why_condition, "%.*s%s%.*s", (int)sizeof rejection.text / 2 + 50, rejection.text,
                 both ? "; " : "", (int)sizeof low_pass.text / 2, low_pass.text);
}

static void propose_tolerance(const tl_config *config, size_t index, const tl_survey_signal *signal,
                              tl_proposal_match *match) {
    const tl_plan_match *own = &config->match[index];
    double least = (signal->is_at_rest ? AT_REST : TOLERANCE) * signal->sigma;
    const char *at_most = signal->noise.is_too_fast ? " at most" : "";
    bool has_one = config->synchronise && own->weight > 0.0;
    bool is_real = config->signals[match->signal].plan.type == TL_REAL;
    if (!has_one || !is_real || config->event.start.signal != NULL || !(least > 0.0)) {
        write_reason(&match->why_tolerance, has_one ? "unchanged: there is no noise" : "none: it is only compared");
        return;
    }
    if (own->tolerance >= least && own->tolerance <= STAYS * least) {
        match->tolerance = own->tolerance;
        write_reason(&match->why_tolerance, "unchanged: %.3g times the noise of %.3g%s", own->tolerance / signal->sigma,
                     signal->sigma, at_most);
        return;
    }
    match->tolerance = rounded_up(least);
    match->is_within_noise = tl_noise_exceeds(&signal->noise, own->tolerance);
    write_reason(&match->why_tolerance, "%s times the noise of %.3g%s%s; configured is %g%s",
                 signal->is_at_rest ? "six" : "three", signal->sigma, at_most,
                 signal->is_at_rest ? ", because the plant is at rest in this recording: record it at work" : "",
                 own->tolerance, config->has_epsilon ? ", the root of epsilon" : "");
}

/* ---- inputs ---- */

static void propose_input(const tl_config *config, size_t index, const tl_survey_signal *signal,
                          tl_proposal_input *input) {
    const char *unit = config->signals[index].plan.unit;
    if (has_no_line(config, index, signal, &input->why)) {
        return;
    }
    if (signal->is_polled) {
        write_reason(&input->why, "it keeps its value from one change to the next");
    } else if (signal->move <= MOVES * signal->sigma) {
        write_reason(&input->why,
                     "it moves by %.3g %s between two readings, and its noise is %.3g: a wait is not worth it",
                     signal->move, unit, signal->sigma);
    } else {
        input->between = TL_BETWEEN_MEAN;
        write_reason(
            &input->why,
            "it moves by %.3g %s between two readings, and its noise is %.3g: the mean over a step adds no delay",
            signal->move, unit, signal->sigma);
    }
}

/* ---- all ---- */

void tl_proposal_make(const tl_config *config, const tl_survey *survey, tl_proposal *proposal) {
    memset(proposal, 0, sizeof *proposal);
    proposal->match_count = config->match_count;
    for (size_t i = 0; i < config->match_count; i++) {
        tl_proposal_match *match = &proposal->match[i];
        match->signal = tl_config_signal_of(config, config->match[i].to);
        const tl_survey_signal *signal = &survey->signals[match->signal];
        propose_between(config, signal, match);
        propose_condition(config, signal, match);
        propose_tolerance(config, i, signal, match);
        bool waits = match->between != TL_BETWEEN_LAST || match->condition.low_pass > 0 || match->condition.median > 1;
        proposal->every[match->signal] = waits ? every_of(config, signal) : proposal->every[match->signal];
    }
    for (size_t i = 0; i < survey->count; i++) {
        tl_proposal_input *input = &proposal->inputs[i];
        if (config->signals[i].feeds) {
            propose_input(config, i, &survey->signals[i], input);
        }
        bool waits = input->between != TL_BETWEEN_LAST;
        proposal->every[i] = waits ? every_of(config, &survey->signals[i]) : proposal->every[i];
    }
}

/* ---- output of the proposal ---- */

enum { INDENT = 2, DEEPER = 4, TEXT = 640 };

static const char *const BETWEEN[] = {
    [TL_BETWEEN_LAST] = "last", [TL_BETWEEN_LINE] = "line", [TL_BETWEEN_MEAN] = "mean"};

/* ---- the page ---- */

static void print_line(FILE *file, int first, const char *format, ...) TL_PRINTF(3, 4);

static void print_line(FILE *file, int first, const char *format, ...) {
    char text[TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    tl_wrapped_print(file, text, first, first + INDENT);
}

/* Prints the number and the intervals of the readings. */
static void print_times(const char *name, const tl_survey_signal *signal, FILE *file) {
    char bad[64] = "";
    if (signal->bad > 0) {
        (void)snprintf(bad, sizeof bad, ", %" PRIu64 " bad", signal->bad);
    }
    if (signal->median == 0) {
        print_line(file, INDENT, "plant.%s: %" PRIu64 " good readings%s", name, signal->good, bad);
        return;
    }
    print_line(file, INDENT,
               "plant.%s: %s%" PRIu64
               " good readings%s; interval %.3g s (median), 95 %% within %.3g s, 99 %% within %.3g s, longest %.3g s",
               name, signal->is_cut ? "the first " : "", signal->good, bad, tl_seconds(signal->median),
               tl_seconds(signal->most), tl_seconds(signal->rare), tl_seconds(signal->worst));
}

static void print_noise(const tl_config_signal *own, const tl_survey_signal *signal, FILE *file) {
    const char *unit = tl_show_unit(own->plan.unit);
    if (signal->is_switched) {
        print_line(file, DEEPER, "it is a switch: it has at most %d values", (int)TL_SURVEY_SWITCH);
        return;
    }
    if (signal->is_polled) {
        print_line(file, DEEPER, "%" PRIu64 " of them repeat the one before: it is read more often than it changes",
                   signal->repeats);
    }
    if (signal->quantum > 0.0) {
        print_line(file, DEEPER, "it is counted in steps of %.3g %s", signal->quantum, unit);
    }
    if (!signal->noise.is_enough) {
        print_line(file, DEEPER, "noise: unknown, because there are too few %s (expected at least %d)",
                   signal->is_polled ? "changes" : "readings", (int)TL_SURVEY_LEAST);
    } else if (signal->noise.is_too_fast) {
        print_line(
            file, DEEPER,
            "noise: at most %.3g %s; the plant moves too fast between two readings for an estimate (with 2, 4 and 6 "
            "neighbours: %.3g, %.3g, %.3g)",
            signal->sigma, unit, signal->noise.by_order[0], signal->noise.by_order[1], signal->noise.by_order[2]);
    } else {
        print_line(file, DEEPER, "noise: standard deviation %.3g %s", signal->sigma, unit);
    }
    if (signal->outliers > 0) {
        print_line(file, DEEPER, "outliers: %" PRIu64 " (%.3g %%), off by more than %d times the noise",
                   signal->outliers, 100.0 * (double)signal->outliers / (double)signal->good, (int)TL_NOISE_OUTLIER);
    }
}

static void print_condition(const tl_condition *condition, char *text, size_t size) {
    int used = 0;
    text[0] = '\0';
    if (condition->gate > 0.0) {
        used += snprintf(text + used, size - (size_t)used, " gate %g", condition->gate);
    }
    if (condition->median > 1) {
        used += snprintf(text + used, size - (size_t)used, " median %" PRIu32, condition->median);
    }
    if (condition->low_pass > 0) {
        used += snprintf(text + used, size - (size_t)used, " low_pass_s %g", tl_seconds(condition->low_pass));
    }
    if (used == 0) {
        (void)snprintf(text, size, " none");
    }
}

static void print_match(const tl_config *config, size_t index, const tl_proposal_match *match, FILE *file) {
    char condition[128];
    print_condition(&match->condition, condition, sizeof condition);
    (void)fprintf(file, "  match %s \342\206\224 %s\n", config->match[index].variable, config->match[index].to);
    print_line(file, DEEPER, "between \"%s\": %s", BETWEEN[match->between], match->why_between.text);
    if (config->synchronise) {
        print_line(file, DEEPER, "condition%s: %s", condition, match->why_condition.text);
        if (match->tolerance > 0.0) {
            print_line(file, DEEPER, "tolerance %g: %s", match->tolerance, match->why_tolerance.text);
        } else {
            print_line(file, DEEPER, "tolerance %s", match->why_tolerance.text);
        }
    }
}

/* Returns true if the configured filters hide the plant's motion; writes why. */
static bool is_filtered_away(const tl_config *config, size_t index, const tl_survey_signal *signal,
                             tl_proposal_reason *why) {
    const tl_condition *own = &config->conditions[index];
    double longest = 4.0 * LONGEST * tl_seconds(signal->median);
    if (own->gate > 0.0 && own->gate < TOLERANCE * signal->sigma) {
        write_reason(why,
                     "condition.gate %g is below three times the noise of the readings (%.3g): it rejects good ones; "
                     "raise it to %.2g or more, or remove it",
                     own->gate, signal->sigma, GATE_OF_NOISE * signal->sigma);
    } else if (longest > 0.0 && tl_seconds(own->low_pass) > longest) {
        write_reason(
            why,
            "condition.low_pass_s %g is long beside the interval of the readings (%.3g s): it flattens what the "
            "plant does; lower it to the proposed value, or at most to %.2g",
            tl_seconds(own->low_pass), tl_seconds(signal->median), longest);
    } else {
        return false;
    }
    return true;
}

static void print_warnings(const tl_config *config, const tl_survey *survey, const tl_proposal *proposal, FILE *file) {
    const char *title = "warnings\n";
    tl_proposal_reason why;
    for (size_t i = 0; i < proposal->match_count; i++) {
        const tl_proposal_match *match = &proposal->match[i];
        if (match->is_within_noise) {
            (void)fputs(title, file);
            title = "";
            print_line(
                file, INDENT,
                "%s: tolerance %g is below three times the noise of the readings (%.3g): the twin follows the noise, and its "
                "inner states may drift; set the proposed %g",
                config->match[i].where, config->match[i].tolerance, survey->signals[match->signal].sigma,
                match->tolerance);
        }
        if (is_filtered_away(config, i, &survey->signals[match->signal], &why)) {
            (void)fputs(title, file);
            title = "";
            print_line(file, INDENT, "%s: %s", config->match[i].where, why.text);
        }
    }
}

/* ---- the proposal as JSON ---- */

static void add_optional(tl_json_writer *json, const char *key, double value, bool is_there, bool nulls) {
    if (is_there || nulls) {
        tl_json_add_number(json, key, is_there ? value : (double)NAN);
    }
}

static void add_condition(tl_json_writer *json, const tl_condition *condition, bool nulls) {
    if (!tl_condition_is_needed(condition)) {
        if (nulls) {
            tl_json_add_text(json, "condition", NULL);
        }
        return;
    }
    tl_json_open_object(json, "condition");
    add_optional(json, "gate", condition->gate, condition->gate > 0.0, nulls);
    add_optional(json, "median", condition->median, condition->median > 1, nulls);
    add_optional(json, "low_pass_s", tl_seconds(condition->low_pass), condition->low_pass > 0, nulls);
    tl_json_close(json);
}

static void add_match(tl_json_writer *json, const tl_proposal_page *page, size_t index, bool nulls) {
    const tl_proposal_match *match = &page->proposal->match[index];
    tl_json_open_object(json, page->config->match[index].variable);
    tl_json_add_text(json, "between", BETWEEN[match->between]);
    if (page->config->synchronise) {
        add_condition(json, &match->condition, nulls);
    }
    if (match->tolerance > 0.0 && !page->config->has_epsilon) {
        tl_json_add_number(json, "tolerance", match->tolerance);
    }
    tl_json_close(json);
}

static void add_horizon(tl_json_writer *json, const tl_proposal_page *page) {
    const tl_horizon_choice *choice = page->choice;
    if (choice == NULL || choice->chosen == SIZE_MAX) {
        return;
    }
    const tl_horizon_trial *chosen = &choice->trial[choice->chosen];
    tl_json_open_object(json, "horizon");
    tl_json_add_count(json, "prediction", chosen->prediction);
    tl_json_close(json);
    if (chosen->rests != page->config->free_twin) {
        tl_json_add_truth(json, "free_twin", chosen->rests);
    }
}

static void add_matches(tl_json_writer *json, const tl_proposal_page *page, bool nulls) {
    bool synchronise = page->config->synchronise;
    if (synchronise) {
        tl_json_open_object(json, "synchronise");
    }
    tl_json_open_object(json, synchronise ? "match" : "compare");
    for (size_t i = 0; i < page->proposal->match_count; i++) {
        add_match(json, page, i, nulls);
    }
    tl_json_close(json);
    if (synchronise) {
        add_horizon(json, page);
        tl_json_close(json);
    }
}

static void add_proposal(tl_json_writer *json, const tl_proposal_page *page, bool nulls) {
    const tl_proposal *proposal = page->proposal;
    tl_json_open_object(json, "plant");
    for (size_t i = 0; i < page->survey->count; i++) {
        bool is_input = page->config->signals[i].feeds;
        if (!is_input && proposal->every[i] == 0) {
            continue;
        }
        tl_json_open_object(json, page->config->signals[i].plan.name);
        if (is_input) {
            tl_json_add_text(json, "between", BETWEEN[proposal->inputs[i].between]);
        }
        if (proposal->every[i] > 0) {
            tl_json_add_number(json, "every_s", tl_seconds(proposal->every[i]));
        }
        tl_json_close(json);
    }
    tl_json_close(json);
    if (proposal->match_count > 0) {
        add_matches(json, page, nulls);
    }
}

static tl_status print_patch(const tl_proposal_page *page, bool nulls, FILE *file, tl_error *error) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    add_proposal(&json, page, nulls);
    tl_status status = tl_json_writer_print(&json, file, error);
    tl_json_writer_free(&json);
    return status;
}

tl_status tl_proposal_print_patch(const tl_proposal_page *page, FILE *file, tl_error *error) {
    return print_patch(page, true, file, error);
}

/* ---- horizons ---- */

static void print_trial(const tl_horizon_trial *trial, bool is_chosen, FILE *file) {
    char ratio[64] = "not compared";
    if (!isnan(trial->regret) && trial->age == 0) {
        (void)snprintf(ratio, sizeof ratio, "%.3g in lock", trial->regret);
    } else if (!isnan(trial->regret)) {
        (void)snprintf(ratio, sizeof ratio, "%.3g after %.3g s", trial->regret, tl_seconds(trial->age));
    }
    (void)fprintf(file, "  %10" PRIu32 "%-10s %7.3g  %8.3g  %-19s %5.0f %%  %7.0f%s\n", trial->prediction,
                  trial->rests ? " free_twin" : "", trial->locked, trial->error, ratio,
                  100.0 * (double)trial->corrected / fmax((double)trial->steps, 1.0), (double)trial->time / 1e3,
                  is_chosen ? " *" : "");
}

static void print_horizons(const tl_proposal_page *page, FILE *file) {
    const tl_horizon_choice *choice = page->choice;
    if (choice == NULL) {
        return;
    }
    (void)fputs("horizons\n", file);
    if (choice->chosen != SIZE_MAX) {
        print_line(
            file, INDENT,
            "each replayed %.4g s, with twins released for %.4g s. Errors in tolerances, root mean square. Ratio: of "
            "mean squares, to the best horizon, where it is largest",
            tl_seconds(choice->length), tl_seconds(page->config->step * (tl_time)choice->released_steps));
        (void)fputs("  prediction          in lock  released  ratio            corrected  us/step\n", file);
        for (size_t i = 0; i < choice->count; i++) {
            if (choice->trial[i].fault[0] == '\0') {
                print_trial(&choice->trial[i], i == choice->chosen, file);
            }
        }
    }
    if (choice->note[0] != '\0') {
        print_line(file, INDENT, "%s%s", choice->chosen == SIZE_MAX ? "not tried: " : "", choice->note);
    }
}

static const char *find_horizon_reason(const tl_horizon_choice *choice) {
    const tl_horizon_trial *chosen = &choice->trial[choice->chosen];
    return (double)chosen->corrected < TL_HORIZON_CORRECTS * (double)chosen->steps
               ? "no horizon was better, but nothing had to be corrected: repeat this with a recording in which the plant "
                 "differs from the model"
           : chosen->rests
               ? "with it the released twins are nearest to the plant"
               : "the shortest horizon that corrects and whose released twins are as near to the plant as the "
                 "best ones";
}

static void print_horizon(const tl_proposal_page *page, FILE *file) {
    const tl_horizon_choice *choice = page->choice;
    if (choice != NULL && choice->chosen != SIZE_MAX) {
        const tl_horizon_trial *chosen = &choice->trial[choice->chosen];
        (void)fputs("  horizon\n", file);
        print_line(file, DEEPER, "prediction %" PRIu32 "%s: %s", chosen->prediction, chosen->rests ? ", free_twin" : "",
                   find_horizon_reason(choice));
    }
}

tl_status tl_proposal_print_page(const tl_proposal_page *page, FILE *file, tl_error *error) {
    const tl_config *config = page->config;
    const tl_survey *survey = page->survey;
    char clean[PATH_MAX];
    (void)tl_clean_text(page->recording, strlen(page->recording), clean, sizeof clean);
    (void)fprintf(file, "%s: %s\nrecording %s: %.4g s\n", config->path, config->name, clean,
                  tl_seconds(survey->length));
    for (size_t i = 0; i < survey->count; i++) {
        if (config->signals[i].feeds || config->signals[i].is_matched) {
            print_times(config->signals[i].plan.name, &survey->signals[i], file);
            print_noise(&config->signals[i], &survey->signals[i], file);
        }
    }
    print_horizons(page, file);
    (void)fputs("proposed\n", file);
    for (size_t i = 0; i < page->proposal->match_count; i++) {
        print_match(config, i, &page->proposal->match[i], file);
    }
    for (size_t i = 0; i < survey->count; i++) {
        const tl_proposal_input *input = &page->proposal->inputs[i];
        if (config->signals[i].feeds) {
            (void)fprintf(file, "  input plant.%s\n", config->signals[i].plan.name);
            print_line(file, DEEPER, "between \"%s\": %s", BETWEEN[input->between], input->why.text);
        }
    }
    print_horizon(page, file);
    print_warnings(config, survey, page->proposal, file);
    (void)fputs("add to the configuration\n", file);
    return print_patch(page, false, file, error);
}

/* ---- JSON output ---- */

static void add_signal(tl_json_writer *json, const char *name, const tl_survey_signal *signal) {
    bool is_reported = signal->noise.is_enough && !signal->is_switched;
    tl_json_open_object(json, name);
    tl_json_add_count(json, "readings", signal->good);
    tl_json_add_count(json, "bad", signal->bad);
    tl_json_add_truth(json, "cut", signal->is_cut);
    tl_json_add_number(json, "every_median_s", tl_seconds(signal->median));
    tl_json_add_number(json, "every_95_s", tl_seconds(signal->most));
    tl_json_add_number(json, "every_99_s", tl_seconds(signal->rare));
    tl_json_add_number(json, "every_worst_s", tl_seconds(signal->worst));
    tl_json_add_count(json, "repeats", signal->repeats);
    tl_json_add_truth(json, "polled", signal->is_polled);
    tl_json_add_truth(json, "switched", signal->is_switched);
    tl_json_add_number(json, "counted_in", signal->quantum > 0.0 ? signal->quantum : (double)NAN);
    tl_json_add_count(json, "outliers", signal->outliers);
    tl_json_add_number(json, "noise", is_reported ? signal->sigma : (double)NAN);
    tl_json_add_truth(json, "too_fast", is_reported && signal->noise.is_too_fast);
    tl_json_close(json);
}

static void add_reasons(tl_json_writer *json, const tl_config *config, const tl_survey *survey,
                        const tl_proposal *proposal) {
    tl_json_open_object(json, "reasons");
    for (size_t i = 0; i < proposal->match_count; i++) {
        const tl_proposal_match *match = &proposal->match[i];
        tl_json_open_object(json, config->match[i].variable);
        tl_json_add_text(json, "between", match->why_between.text);
        if (config->synchronise) {
            tl_json_add_text(json, "condition", match->why_condition.text);
            tl_json_add_text(json, "tolerance", match->why_tolerance.text);
        }
        tl_json_add_truth(json, "within_noise", match->is_within_noise);
        tl_json_close(json);
    }
    for (size_t i = 0; i < survey->count; i++) {
        char name[80];
        if (config->signals[i].feeds) {
            (void)snprintf(name, sizeof name, "plant.%s", config->signals[i].plan.name);
            tl_json_open_object(json, name);
            tl_json_add_text(json, "between", proposal->inputs[i].why.text);
            tl_json_close(json);
        }
    }
    tl_json_close(json);
}

static void add_trial(tl_json_writer *json, const tl_horizon_trial *trial) {
    tl_json_open_object(json, NULL);
    tl_json_add_count(json, "prediction", trial->prediction);
    tl_json_add_truth(json, "free_twin", trial->rests);
    tl_json_add_text(json, "fault", trial->fault[0] != '\0' ? trial->fault : NULL);
    tl_json_add_number(json, "error_locked", trial->locked);
    tl_json_add_number(json, "error_released", trial->error);
    tl_json_add_number(json, "ratio", trial->regret);
    tl_json_add_number(json, "age_s", tl_seconds(trial->age));
    tl_json_add_count(json, "steps", trial->steps);
    tl_json_add_count(json, "corrected", trial->corrected);
    tl_json_add_count(json, "evaluations", trial->evaluations);
    tl_json_add_number(json, "step_time_s", tl_seconds(trial->time));
    tl_json_close(json);
}

static void add_horizons(tl_json_writer *json, const tl_proposal_page *page) {
    const tl_horizon_choice *choice = page->choice;
    if (choice == NULL) {
        return;
    }
    tl_json_open_object(json, "horizons");
    tl_json_add_text(json, "note", choice->note[0] != '\0' ? choice->note : NULL);
    tl_json_add_number(json, "length_s", tl_seconds(choice->length));
    tl_json_add_number(json, "release_s", tl_seconds(page->config->step * (tl_time)choice->released_steps));
    tl_json_open_array(json, "trials");
    for (size_t i = 0; i < choice->count; i++) {
        add_trial(json, &choice->trial[i]);
    }
    tl_json_close(json);
    tl_json_close(json);
}

tl_status tl_proposal_print_json(const tl_proposal_page *page, FILE *file, tl_error *error) {
    const tl_survey *survey = page->survey;
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "configuration", page->config->path);
    tl_json_add_text(&json, "recording", page->recording);
    tl_json_add_number(&json, "length_s", tl_seconds(survey->length));
    tl_json_open_object(&json, "signals");
    for (size_t i = 0; i < survey->count; i++) {
        add_signal(&json, page->config->signals[i].plan.name, &survey->signals[i]);
    }
    tl_json_close(&json);
    add_horizons(&json, page);
    tl_json_open_object(&json, "proposal");
    add_proposal(&json, page, true);
    tl_json_close(&json);
    add_reasons(&json, page->config, survey, page->proposal);
    tl_status status = tl_json_writer_print(&json, file, error);
    tl_json_writer_free(&json);
    return status;
}

tl_status tl_proposal_write_patch(const tl_proposal_page *page, char **patch, tl_error *error) {
    size_t size = 0;
    FILE *file = open_memstream(patch, &size);
    tl_status status = file != NULL ? tl_proposal_print_patch(page, file, error) : TL_TRY_AGAIN;
    if (file == NULL || fclose(file) != 0) {
        status = tl_fail(error, TL_TRY_AGAIN, "not enough memory for the proposal");
    }
    return status;
}
