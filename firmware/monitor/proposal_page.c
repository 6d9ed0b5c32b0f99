/* What a recording tells and proposes: see proposal_page.h. */
#include "firmware/monitor/proposal_page.h"

#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <string.h>

#include "firmware/base/clean_text.h"
#include "firmware/base/json_writer.h"
#include "firmware/base/wrapped.h"

enum { INDENT = 2, DEEPER = 4, TEXT = 640 };

static const char *const BETWEEN[] = {
    [TL_BETWEEN_LAST] = "last", [TL_BETWEEN_LINE] = "line", [TL_BETWEEN_MEAN] = "mean"};

/* "1" is no unit that anybody reads. */
static const char *unit_of(const tl_config_signal *signal) {
    return strcmp(signal->plan.unit, "1") == 0 ? "" : signal->plan.unit;
}

/* ---- the page ---- */

static void print(FILE *file, int first, const char *format, ...) TL_PRINTF(3, 4);

static void print(FILE *file, int first, const char *format, ...) {
    char text[TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    tl_wrapped_print(file, text, first, first + INDENT);
}

static bool is_used(const tl_proposal *proposal, size_t signal) {
    bool used = proposal->inputs[signal].is_one;
    for (size_t i = 0; i < proposal->match_count; i++) {
        used = used || proposal->match[i].signal == signal;
    }
    return used;
}

/* How its readings come. */
static void print_times(const char *name, const tl_survey_signal *signal, FILE *file) {
    char bad[64] = "";
    if (signal->bad > 0) {
        (void)snprintf(bad, sizeof bad, ", and %" PRIu64 " that are not", signal->bad);
    }
    if (signal->median == 0) {
        print(file, INDENT, "plant.%s: %" PRIu64 " good readings%s", name, signal->good, bad);
        return;
    }
    print(file, INDENT,
          "plant.%s: %s%" PRIu64
          " good readings%s, one each %.3g s; 95 %% come within %.3g s, 99 %% within %.3g s, the longest took %.3g s",
          name, signal->is_cut ? "the first " : "", signal->good, bad, tl_seconds(signal->median),
          tl_seconds(signal->most), tl_seconds(signal->rare), tl_seconds(signal->worst));
}

static void print_noise(const tl_config_signal *own, const tl_survey_signal *signal, FILE *file) {
    const char *unit = unit_of(own);
    if (signal->is_switched) {
        print(file, DEEPER, "it is switched: it has %d values at most", (int)TL_SURVEY_SWITCH);
        return;
    }
    if (signal->is_polled) {
        print(file, DEEPER, "%" PRIu64 " of them repeat the one before: it is read more often than it changes",
              signal->repeats);
    }
    if (signal->quantum > 0.0) {
        print(file, DEEPER, "it is counted in steps of %.3g %s", signal->quantum, unit);
    }
    if (!signal->noise.is_enough) {
        print(file, DEEPER, "noise: too few %s to tell, %d are needed", signal->is_polled ? "changes" : "readings",
              (int)TL_SURVEY_LEAST);
    } else if (signal->noise.is_too_fast) {
        print(
            file, DEEPER,
            "noise: at most %.3g %s; the plant moves too fast between two readings to tell (by 2, 4 and 6 neighbours: %.3g, %.3g, %.3g)",
            signal->sigma, unit, signal->noise.by_order[0], signal->noise.by_order[1], signal->noise.by_order[2]);
    } else {
        print(file, DEEPER, "noise: standard deviation %.3g %s", signal->sigma, unit);
    }
    if (signal->outliers > 0) {
        print(file, DEEPER, "outliers: %" PRIu64 ", %.3g %%, more than %d times that off", signal->outliers,
              100.0 * (double)signal->outliers / (double)signal->good, (int)TL_NOISE_OUTLIER);
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
    print(file, DEEPER, "between \"%s\": %s", BETWEEN[match->between], match->why_between.text);
    if (config->synchronise) {
        print(file, DEEPER, "condition%s: %s", condition, match->why_condition.text);
        if (match->tolerance > 0.0) {
            print(file, DEEPER, "tolerance %g: %s", match->tolerance, match->why_tolerance.text);
        } else {
            print(file, DEEPER, "tolerance %s", match->why_tolerance.text);
        }
    }
}

static size_t print_warnings(const tl_config *config, const tl_survey *survey, const tl_proposal *proposal,
                             FILE *file) {
    size_t count = 0;
    for (size_t i = 0; i < proposal->match_count; i++) {
        const tl_proposal_match *match = &proposal->match[i];
        if (match->is_within_noise) {
            (void)fputs(count++ == 0 ? "warnings\n" : "", file);
            print(
                file, INDENT,
                "%s: its tolerance, %g, is below three times the noise of its readings, %.3g: the twin follows the noise, and states behind its outputs may drift",
                config->match[i].where, config->match[i].tolerance, survey->signals[match->signal].sigma);
        }
    }
    return count;
}

/* ---- the proposal as JSON ---- */

static void add_condition(tl_json_writer *json, const tl_condition *condition, bool nulls) {
    if (!tl_condition_is_needed(condition)) {
        if (nulls) {
            tl_json_add_null(json, "condition");
        }
        return;
    }
    tl_json_open_object(json, "condition");
    if (condition->gate > 0.0) {
        tl_json_add_number(json, "gate", condition->gate);
    } else if (nulls) {
        tl_json_add_null(json, "gate");
    }
    if (condition->median > 1) {
        tl_json_add_count(json, "median", condition->median);
    } else if (nulls) {
        tl_json_add_null(json, "median");
    }
    if (condition->low_pass > 0) {
        tl_json_add_number(json, "low_pass_s", tl_seconds(condition->low_pass));
    } else if (nulls) {
        tl_json_add_null(json, "low_pass_s");
    }
    tl_json_close(json);
}

static void add_matches(tl_json_writer *json, const tl_config *config, const tl_proposal *proposal, bool nulls) {
    if (config->synchronise) {
        tl_json_open_object(json, "synchronise");
    }
    tl_json_open_object(json, config->synchronise ? "match" : "compare");
    for (size_t i = 0; i < proposal->match_count; i++) {
        const tl_proposal_match *match = &proposal->match[i];
        tl_json_open_object(json, config->match[i].variable);
        tl_json_add_text(json, "between", BETWEEN[match->between]);
        if (config->synchronise) {
            add_condition(json, &match->condition, nulls);
        }
        if (match->tolerance > 0.0 && !config->has_epsilon) {
            tl_json_add_number(json, "tolerance", match->tolerance);
        }
        tl_json_close(json);
    }
    tl_json_close(json);
    if (config->synchronise) {
        tl_json_close(json);
    }
}

static void add_proposal(tl_json_writer *json, const tl_config *config, const tl_survey *survey,
                         const tl_proposal *proposal, bool nulls) {
    tl_json_open_object(json, "plant");
    for (size_t i = 0; i < survey->count; i++) {
        bool is_input = proposal->inputs[i].is_one;
        if (!is_input && proposal->every[i] == 0) {
            continue;
        }
        tl_json_open_object(json, config->signals[i].plan.name);
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
        add_matches(json, config, proposal, nulls);
    }
}

tl_status tl_proposal_print_page(const tl_config *config, const char *recording, const tl_survey *survey,
                                 const tl_proposal *proposal, FILE *file, tl_error *error) {
    char clean[PATH_MAX];
    tl_json_writer json;
    (void)tl_clean_text(recording, strlen(recording), clean, sizeof clean);
    (void)fprintf(file, "%s: %s\nrecording %s: %.4g s\n", config->path, config->name, clean,
                  tl_seconds(survey->length));
    for (size_t i = 0; i < survey->count; i++) {
        if (is_used(proposal, i)) {
            print_times(config->signals[i].plan.name, &survey->signals[i], file);
            print_noise(&config->signals[i], &survey->signals[i], file);
        }
    }
    (void)fputs("proposed\n", file);
    for (size_t i = 0; i < proposal->match_count; i++) {
        print_match(config, i, &proposal->match[i], file);
    }
    for (size_t i = 0; i < survey->count; i++) {
        const tl_proposal_input *input = &proposal->inputs[i];
        if (input->is_one) {
            (void)fprintf(file, "  input plant.%s\n", config->signals[i].plan.name);
            print(file, DEEPER, "between \"%s\": %s", BETWEEN[input->between], input->why.text);
        }
    }
    (void)print_warnings(config, survey, proposal, file);
    (void)fputs("to be put into the configuration\n", file);
    tl_json_writer_begin(&json);
    add_proposal(&json, config, survey, proposal, false);
    tl_status status = tl_json_writer_print(&json, file, error);
    tl_json_writer_free(&json);
    return status;
}

/* ---- for a program ---- */

static void add_signal(tl_json_writer *json, const char *name, const tl_survey_signal *signal) {
    bool is_told = signal->noise.is_enough && !signal->is_switched;
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
    tl_json_add_number(json, "noise", is_told ? signal->sigma : (double)NAN);
    tl_json_add_truth(json, "too_fast", is_told && signal->noise.is_too_fast);
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
        if (proposal->inputs[i].is_one) {
            (void)snprintf(name, sizeof name, "plant.%s", config->signals[i].plan.name);
            tl_json_open_object(json, name);
            tl_json_add_text(json, "between", proposal->inputs[i].why.text);
            tl_json_close(json);
        }
    }
    tl_json_close(json);
}

tl_status tl_proposal_print_json(const tl_config *config, const char *recording, const tl_survey *survey,
                                 const tl_proposal *proposal, FILE *file, tl_error *error) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "configuration", config->path);
    tl_json_add_text(&json, "recording", recording);
    tl_json_add_number(&json, "length_s", tl_seconds(survey->length));
    tl_json_open_object(&json, "signals");
    for (size_t i = 0; i < survey->count; i++) {
        add_signal(&json, config->signals[i].plan.name, &survey->signals[i]);
    }
    tl_json_close(&json);
    tl_json_open_object(&json, "proposal");
    add_proposal(&json, config, survey, proposal, true);
    tl_json_close(&json);
    add_reasons(&json, config, survey, proposal);
    tl_status status = tl_json_writer_print(&json, file, error);
    tl_json_writer_free(&json);
    return status;
}
