/* What of a configuration a running twin can take anew. */
#include "firmware/config/config.h"

#include <string.h>

void tl_config_tuning(const tl_config *config, tl_tuning *tuning) {
    const tl_plan plan = {
        .adjust = config->adjust,
        .adjust_count = config->adjust_count,
        .match = config->match,
        .match_count = config->match_count,
        .margin = config->margin,
        .noise_floor = config->noise_floor,
        .evaluations = config->budget_evaluations,
    };
    tl_tuning_of(&plan, tuning);
    tuning->time = config->budget_time;
}

void tl_config_retune(tl_config *config, const tl_tuning *tuning) {
    for (size_t i = 0; i < config->match_count; i++) {
        config->match[i].tolerance = tuning->match[i].tolerance;
        config->match[i].weight = tuning->match[i].weight;
        config->match[i].huber = tuning->match[i].huber;
    }
    for (size_t v = 0; v < config->adjust_count; v++) {
        tl_plan_adjust *adjust = &config->adjust[v];
        const tl_tuning_adjust *now = &tuning->adjust[v];
        adjust->nominal = now->has_nominal != 0 ? now->nominal : adjust->nominal;
        adjust->lower = now->lower;
        adjust->upper = now->upper;
        adjust->deviation_penalty = now->deviation_penalty;
        adjust->rate_penalty = now->rate_penalty;
    }
    config->margin = tuning->margin;
    config->noise_floor = tuning->noise_floor;
    config->budget_evaluations = (uint32_t)tuning->evaluations;
    config->budget_time = tuning->time;
}

static void hear_nothing(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    (void)where;
    (void)text;
}

tl_status tl_config_tuning_of(const tl_config *own, const char *text, tl_tuning *tuning, tl_error *error) {
    tl_config config;
    tl_report report = {.add = hear_nothing};
    if (tl_config_read_text(own->path, text, strlen(text), &config, &report) != TL_OK) {
        return tl_fail(error, TL_BAD_DATA, "its text is no configuration");
    }
    tl_config_tuning(&config, tuning);
    tl_config_free(&config);
    return tl_tuning_check(tuning, error);
}
