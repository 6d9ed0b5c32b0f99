/* What a recorder is made with: see recorder_settings.h. */
#include "firmware/store/recorder_settings.h"

#include <stdio.h>

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
