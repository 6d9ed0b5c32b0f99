/* twinlock check: validates everything without running. */
#include <getopt.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/assembly.h"
#include "firmware/clock.h"
#include "firmware/log.h"
#include "firmware/measurements.h"
#include "firmware/output.h"
#include "firmware/verbs.h"

typedef struct check_options {
    const char *config;
    bool variables;
    FILE *output;
} check_options;

/* Free steps by which the time of a step is measured. */
enum { TIMED_STEPS = 200 };

static void print_help(FILE *file) {
    (void)fputs("usage: twinlock check CONFIG [options]\n\n"
                "Validates a configuration with its FMUs: keys, variables, types, units, connections, paths,\n"
                "horizon. Tells what a step will cost. Nothing is read from the plant.\n\n"
                "  --variables  list all variables of the FMUs\n"
                "  --help       this text\n",
                file);
}

/* 0: go on; else the exit code + 1. */
static int parse(int argc, char **argv, check_options *options) {
    static const struct option LONG[] = {
        {"variables", no_argument, NULL, 'v'},
        {"help", no_argument, NULL, 'h'},
        {NULL, 0, NULL, 0},
    };
    for (int option = 0; (option = getopt_long(argc, argv, "h", LONG, NULL)) != -1;) {
        switch (option) {
        case 'v':
            options->variables = true;
            break;
        case 'h':
            print_help(stdout);
            return 1;
        default:
            print_help(stderr);
            return 3;
        }
    }
    if (optind != argc - 1) {
        (void)fputs("twinlock check: expected exactly one configuration\n\n", stderr);
        print_help(stderr);
        return 3;
    }
    options->config = argv[optind];
    return 0;
}

static void print_start(const tl_variable *variable, FILE *output) {
    if (!variable->has_start) {
        (void)fprintf(output, "%12s", "");
        return;
    }
    switch (variable->type) {
    case TL_REAL:
        (void)fprintf(output, "%12.6g", variable->start.real);
        return;
    case TL_STRING:
        (void)fprintf(output, "%12.12s", variable->start.text);
        return;
    case TL_BOOLEAN:
        (void)fprintf(output, "%12s", variable->start.integer != 0 ? "true" : "false");
        return;
    case TL_INTEGER:
    case TL_ENUMERATION:
        (void)fprintf(output, "%12" PRId32, variable->start.integer);
        return;
    }
}

static void print_variables(const tl_assembly *assembly, FILE *output) {
    for (size_t i = 0; i < assembly->fmu_count; i++) {
        const tl_model *model = &assembly->fmus[i].model;
        (void)fprintf(output, "\nvariables of %s (%s)\n", model->name, assembly->fmus[i].path);
        for (size_t k = 0; k < model->variable_count; k++) {
            const tl_variable *variable = &model->variables[k];
            (void)fprintf(output, "  %-20s %-11s %-10s %-9s", variable->name, tl_type_name(variable->type),
                          tl_variability_name(variable->variability), tl_causality_name(variable->causality));
            print_start(variable, output);
            (void)fprintf(output, " %-12s %s\n", variable->unit == NULL ? "" : variable->unit->name,
                          variable->description);
        }
    }
}

static void print_components(const tl_assembly *assembly, FILE *output) {
    (void)fputs("components\n", output);
    for (size_t i = 0; i < assembly->plan.component_count; i++) {
        const tl_plan_component *component = &assembly->components[i];
        (void)fprintf(output, "  %-12s %s, %zu variables, %s\n", component->name, assembly->config.components[i].fmu,
                      component->model->variable_count,
                      component->model->capabilities.can_get_and_set_state ? "can save its state"
                                                                           : "cannot save its state");
    }
    (void)fprintf(output, "  %-12s %zu signals\n", "plant", assembly->plan.signal_count);
    (void)fputs("connections\n", output);
    for (size_t i = 0; i < assembly->plan.connection_count; i++) {
        (void)fprintf(output, "  %s \342\206\222 %s\n", assembly->plan.connections[i].from,
                      assembly->plan.connections[i].to);
    }
}

static void print_mode(const tl_assembly *assembly, FILE *output) {
    const tl_config *config = &assembly->config;
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    if (!config->synchronise) {
        (void)fprintf(output, "free-running, one step every %g s\n", tl_seconds(config->step));
        return;
    }
    (void)fprintf(output, "synchronised every %g s by %s", tl_seconds(config->step),
                  config->algorithm != NULL ? config->algorithm : "the default algorithm");
    if (config->fallback != NULL) {
        (void)fprintf(output, ", then %s", config->fallback);
    }
    (void)fprintf(output, ": T_D = %" PRIu32 ", T_P = %" PRIu32 ", measurements %s\n", facts.distance, facts.prediction,
                  tl_measurements_name(config->measurements));
}

static void print_adjusted(const tl_assembly *assembly, size_t index, FILE *output) {
    const tl_plan_adjust *adjust = &assembly->config.adjust[index];
    (void)fprintf(output, "  adjust  %s", adjust->variable);
    if (adjust->step > 0.0) {
        (void)fprintf(output, ", first step %g %s", adjust->step, tl_twin_adjust_unit(assembly->twin, index));
    }
    if (isfinite(adjust->lower) || isfinite(adjust->upper)) {
        (void)fprintf(output, ", within %g \342\200\246 %g", adjust->lower, adjust->upper);
    }
    (void)fputc('\n', output);
}

static void print_synchronisation(const tl_assembly *assembly, FILE *output) {
    const tl_config *config = &assembly->config;
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        if (config->synchronise && match->weight > 0.0) {
            (void)fprintf(output, "  match   %s \342\206\224 %s, tolerance %g %s, weight %g\n", match->variable,
                          match->to, match->tolerance, tl_twin_match_unit(assembly->twin, i), match->weight);
        } else {
            (void)fprintf(output, "  compare %s \342\206\224 %s\n", match->variable, match->to);
        }
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        print_adjusted(assembly, i, output);
    }
}

/* Time of one free step, in ns; 0 where it cannot be told without the plant's values. */
static tl_time time_step(tl_twin *twin, size_t signals) {
    tl_sample sample = {0};
    memset(sample.quality, TL_NO_LINK, signals);
    const tl_budget budget = {.evaluations = 1};
    tl_time begun = 0;
    for (int i = 0; i <= TIMED_STEPS; i++) {
        tl_record record;
        tl_error error;
        bool ready = false;
        sample.tick = i;
        if (tl_twin_step(twin, &sample, &budget, &record, &ready, &error) != TL_OK) {
            return 0;
        }
        begun = i == 0 ? tl_clock_now(NULL) : begun;
    }
    return (tl_clock_now(NULL) - begun) / TIMED_STEPS;
}

static void print_costs(const tl_assembly *assembly, FILE *output) {
    const tl_config *config = &assembly->config;
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    double period = tl_seconds(config->step);
    tl_time step = time_step(assembly->twin, config->signal_count);
    (void)fputs("cost\n", output);
    (void)fprintf(output, "  executions   %" PRIu64 " per free step", facts.executions_per_step);
    if (config->adjust_count != 0) {
        (void)fprintf(output, ", %" PRIu64 " more per evaluation, at most %" PRIu32 " evaluations a step",
                      facts.executions_per_evaluation, config->budget_evaluations);
    }
    (void)fprintf(output, "\n  memory       %.1f KiB of ours, taken at start-up\n", (double)facts.memory / 1024.0);
    if (step == 0) {
        (void)fputs("  time         not told: the FMUs cannot step with the plant's initial values\n", output);
        return;
    }
    (void)fprintf(output, "  time         %.2f \302\265s per free step here (%.3g %% of the period)",
                  tl_seconds(step) * 1e6, 100.0 * tl_seconds(step) / period);
    if (config->adjust_count != 0) {
        double evaluations = tl_seconds(config->budget_time) / (tl_seconds(step) * facts.prediction);
        (void)fprintf(output, "; the budget of %g ms has room for about %.0f evaluations",
                      tl_seconds(config->budget_time) * 1e3, fmin(evaluations, 1e6));
    }
    (void)fputc('\n', output);
}

static void print_page(const tl_assembly *assembly, FILE *output) {
    const tl_config *config = &assembly->config;
    (void)fprintf(output, "%s: %s\n", config->path, config->name);
    print_components(assembly, output);
    print_mode(assembly, output);
    print_synchronisation(assembly, output);
    print_costs(assembly, output);
    (void)fputs("no problem found\n", output);
}

int tl_verb_check(int argc, char **argv) {
    check_options options = {0};
    int parsed = parse(argc, argv, &options);
    if (parsed != 0) {
        return parsed - 1;
    }
    options.output = tl_output_claim();
    tl_assembly assembly;
    tl_status status = tl_assembly_load(options.config, &assembly);
    if (status == TL_OK) {
        print_page(&assembly, options.output);
    } else if (assembly.problems.report.count > 1) {
        tl_log(TL_LOG_ERROR, "%zu problems", assembly.problems.report.count);
    }
    if (options.variables) {
        print_variables(&assembly, options.output);
    }
    tl_assembly_free(&assembly);
    return tl_exit_code(tl_output_finish(options.output, status));
}
