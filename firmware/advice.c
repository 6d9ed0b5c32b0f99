/* Advice: see advice.h. */
#include "firmware/advice.h"

#include <inttypes.h>
#include <stdarg.h>
#include <string.h>

#include "master/sync/conditioner.h"

enum { WIDTH = 79, INDENT = 4, TEXT = 512 };

typedef struct advice {
    FILE *file;
    size_t count;
} advice;

/* A paragraph, broken between words; the first line begins further left. */
static void print_wrapped(FILE *file, const char *text) {
    size_t column = INDENT - 2;
    (void)fprintf(file, "%*s", INDENT - 2, "");
    for (const char *word = text; *word != '\0';) {
        size_t length = strcspn(word, " ");
        if (word != text && column + 1 + length > WIDTH) {
            (void)fprintf(file, "\n%*s", INDENT, "");
            column = INDENT;
        } else if (word != text) {
            (void)fputc(' ', file);
            column++;
        }
        (void)fprintf(file, "%.*s", (int)length, word);
        column += length;
        word += length + (word[length] == ' ' ? 1 : 0);
    }
    (void)fputc('\n', file);
}

static void warn(advice *given, const char *where, const char *format, ...) TL_PRINTF(3, 4);

static void warn(advice *given, const char *where, const char *format, ...) {
    char text[TEXT];
    va_list arguments;
    int length = snprintf(text, sizeof text, "%.200s: ", where);
    va_start(arguments, format);
    (void)vsnprintf(text + length, sizeof text - (size_t)length, format, arguments);
    va_end(arguments);
    (void)fputs(given->count == 0 ? "warnings\n" : "", given->file);
    print_wrapped(given->file, text);
    given->count++;
}

static void check_step(advice *given, const tl_config *config, const tl_prognosis *prognosis) {
    if (prognosis->steps == 0) {
        warn(given, "plant",
             "the FMUs cannot step with its initial values, and until there is a good measurement there is nothing "
             "else: give its signals an \"initial\"");
    }
    if (prognosis->step_time >= config->step) {
        warn(given, "step_s",
             "a free step takes %.3g ms here, and the period is %g ms: `run` cannot keep up on this machine",
             tl_seconds(prognosis->step_time) * 1e3, tl_seconds(config->step) * 1e3);
    }
}

static void check_budget(advice *given, const tl_config *config, const tl_prognosis *prognosis, size_t unknowns) {
    if (config->budget_time >= config->step) {
        warn(given, "synchronise.budget.time_s",
             "%g s is not less than step_s, %g s: a search that uses it up makes the next tick late; the default is "
             "0.6 of step_s",
             tl_seconds(config->budget_time), tl_seconds(config->step));
    }
    if (prognosis->worst_time > config->budget_time) {
        warn(given, "synchronise.budget",
             "%" PRIu32 " evaluations can take %.3g ms here, and the time is %.3g ms: it cuts such a search short, "
             "after about %" PRIu32 " of them; shorten the horizon, or give more time",
             config->budget_evaluations, tl_seconds(prognosis->worst_time) * 1e3, tl_seconds(config->budget_time) * 1e3,
             prognosis->fitting);
    }
    if (config->budget_evaluations < unknowns + 2) {
        warn(given, "synchronise.budget.evaluations",
             "%" PRIu32 " are not enough to try each of %zu unknowns once, beside the guess and nominal: give more, or "
             "make the horizon shorter or static",
             config->budget_evaluations, unknowns);
    }
}

static void check_saving(advice *given, const tl_config *config) {
    if (!config->saving.structure) {
        warn(given, "synchronise.saving.structure",
             "off: executions that can reach no matched output any more are done all the same; it changes no result");
    }
    if (!config->saving.sequences) {
        warn(given, "synchronise.saving.sequences",
             "off: what is known from an earlier execution is executed again; it changes no result");
    }
    for (size_t i = 0; i < config->component_count && config->saving.sequences; i++) {
        if (config->components[i].keep == TL_KEEP_OUTPUTS) {
            warn(given, config->components[i].where,
                 "keep \"outputs\": executions are repeated to get back to a state, beyond those predicted; worth it "
                 "only where saving a state takes longer than a step");
        }
    }
}

static void check_sources(advice *given, const tl_config *config) {
    for (size_t i = 0; i < config->source_count; i++) {
        bool used = false;
        for (size_t k = 0; k < config->signal_count; k++) {
            used = used || config->signals[k].source == i;
        }
        if (!used) {
            warn(given, config->sources[i].where, "no signal of the plant comes from it");
        }
    }
}

/* In the other modes a step waits until its measurement has come through. */
static void check_conditions(advice *given, const tl_config *config) {
    for (size_t i = 0; config->measurements == TL_AHEAD && i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        uint32_t delay = tl_conditioner_delay(&match->condition, config->step);
        if (delay > 0) {
            warn(given, match->where,
                 "its condition makes the measurement %" PRIu32
                 " sample%s late, and in mode ahead no step waits for it: "
                 "the newest there is belongs to an instant %g s back",
                 delay, delay == 1 ? "" : "s", tl_seconds(config->step) * delay);
        }
    }
}

size_t tl_advice_print(const tl_assembly *assembly, const tl_prognosis *prognosis, FILE *file) {
    const tl_config *config = &assembly->config;
    advice given = {.file = file};
    check_step(&given, config, prognosis);
    if (config->adjust_count != 0) {
        check_budget(&given, config, prognosis, tl_twin_get_facts(assembly->twin).unknowns);
        check_saving(&given, config);
        check_conditions(&given, config);
    }
    check_sources(&given, config);
    return given.count;
}
