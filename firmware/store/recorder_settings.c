/* What a recorder is made with: see recorder_settings.h. */
#include "firmware/store/recorder_settings.h"

#include <stdio.h>

/* ---- Of a configuration ------------------------------------------------------------------------------------------ */

void tl_recorder_settings_of(const tl_config *config, tl_recorder_names *names, tl_recorder_settings *settings) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_plan_signal *signal = &config->signals[i].plan;
        (void)snprintf(names->plant_texts[i], TL_RECORDER_NAME, "plant.%s", signal->name);
        names->plant[i] = (tl_recorder_signal){names->plant_texts[i], signal->unit, NULL, signal->type};
    }
    for (size_t i = 0; i < config->match_count; i++) {
        names->match[i] = (tl_recorder_signal){config->match[i].variable, "", config->match[i].to, TL_REAL};
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        names->adjust[i] = (tl_recorder_signal){config->adjust[i].variable, "", NULL, TL_REAL};
    }
    settings->max_bytes = config->record_max_bytes;
    settings->commit = config->record_commit;
    settings->name = config->name;
    settings->configuration = config->text;
    settings->step = config->step;
    settings->measurements = config->measurements;
    settings->plant = names->plant;
    settings->match = names->match;
    settings->adjust = names->adjust;
    settings->plant_count = config->signal_count;
    settings->match_count = config->match_count;
    settings->adjust_count = config->adjust_count;
}

/* ---- A copy ------------------------------------------------------------------------------------------------------ */

/* NULL stays NULL. */
static const char *keep_text(tl_arena *arena, const char *text, bool *kept) {
    const char *copy = text == NULL ? NULL : tl_arena_text(arena, text);
    *kept = *kept && (copy != NULL || text == NULL);
    return copy;
}

static const tl_recorder_signal *keep_signals(tl_arena *arena, const tl_recorder_signal *signals, size_t count,
                                              bool *kept) {
    tl_recorder_signal *copy = tl_arena_take(arena, count, sizeof *copy);
    *kept = *kept && copy != NULL;
    for (size_t i = 0; i < count && *kept; i++) {
        copy[i] = signals[i];
        copy[i].name = keep_text(arena, signals[i].name, kept);
        copy[i].unit = keep_text(arena, signals[i].unit, kept);
        copy[i].to = keep_text(arena, signals[i].to, kept);
    }
    return copy;
}

static const char *const *keep_texts(tl_arena *arena, const char *const *texts, size_t count, bool *kept) {
    const char **copy = tl_arena_take(arena, count, sizeof *copy);
    *kept = *kept && copy != NULL;
    for (size_t i = 0; i < count && *kept; i++) {
        copy[i] = keep_text(arena, texts[i], kept);
    }
    return copy;
}

static const tl_recorder_known *keep_known(tl_arena *arena, const tl_recorder_known *known, size_t count, bool *kept) {
    tl_recorder_known *copy = tl_arena_take(arena, count, sizeof *copy);
    *kept = *kept && copy != NULL;
    for (size_t i = 0; i < count && *kept; i++) {
        copy[i].number = known[i].number;
        copy[i].hash = keep_text(arena, known[i].hash, kept);
        copy[i].text = keep_text(arena, known[i].text, kept);
        copy[i].at = keep_text(arena, known[i].at, kept);
        copy[i].who = keep_text(arena, known[i].who, kept);
        copy[i].origin = keep_text(arena, known[i].origin, kept);
        copy[i].why = keep_text(arena, known[i].why, kept);
    }
    return copy;
}

bool tl_recorder_settings_copy(const tl_recorder_settings *settings, tl_arena *arena, tl_recorder_settings *copy) {
    bool kept = true;
    *copy = *settings;
    copy->path = keep_text(arena, settings->path, &kept);
    copy->verb = keep_text(arena, settings->verb, &kept);
    copy->name = keep_text(arena, settings->name, &kept);
    copy->configuration = keep_text(arena, settings->configuration, &kept);
    copy->known = keep_known(arena, settings->known, settings->known_count, &kept);
    copy->fmus = keep_text(arena, settings->fmus, &kept);
    copy->boot = keep_text(arena, settings->boot, &kept);
    copy->format = keep_text(arena, settings->format, &kept);
    copy->plant = keep_signals(arena, settings->plant, settings->plant_count, &kept);
    copy->match = keep_signals(arena, settings->match, settings->match_count, &kept);
    copy->adjust = keep_signals(arena, settings->adjust, settings->adjust_count, &kept);
    copy->components = keep_texts(arena, settings->components, settings->component_count, &kept);
    return kept;
}
