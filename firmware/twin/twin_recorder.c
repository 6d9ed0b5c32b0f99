/* The recorder of a twin: see twin_recorder.h. */
#include "firmware/twin/twin_recorder.h"

#include <inttypes.h>
#include <limits.h>
#include <stdio.h>

#include "firmware/base/clock.h"
#include "firmware/base/identity.h"
#include "firmware/report/run_figures.h"
#include "firmware/text/utc.h"

enum { PLANT_NAME = 80 }; /* "plant." and at most 63 characters */

void tl_twin_recorder_signals(const tl_config *config, const tl_account *account,
                              tl_recorder_signal match[TL_MAX_MATCH], tl_recorder_signal adjust[TL_MAX_ADJUST]) {
    for (size_t i = 0; i < config->match_count; i++) {
        match[i] = (tl_recorder_signal){config->match[i].variable, account->match[i].unit, config->match[i].to,
                                        account->match[i].type};
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        adjust[i] =
            (tl_recorder_signal){config->adjust[i].variable, account->adjust[i].unit, NULL, account->adjust[i].type};
    }
}

void tl_twin_recorder_identify(const tl_config *config, char text[TL_SHA256_TEXT]) {
    char found[TL_RECORDER_COMPONENTS][PATH_MAX];
    const char *paths[TL_RECORDER_COMPONENTS];
    size_t count = config->component_count < TL_RECORDER_COMPONENTS ? config->component_count : TL_RECORDER_COMPONENTS;
    for (size_t i = 0; i < count; i++) {
        (void)tl_config_fmu_path(config, config->components[i].fmu, found[i], sizeof found[i]);
        paths[i] = found[i];
    }
    tl_identity_files(paths, count, text);
}

/* The plant's signals as the recorder names them. */
static void plant_signals(const tl_config *config, char names[TL_MAX_SIGNALS][PLANT_NAME],
                          tl_recorder_signal plant[TL_MAX_SIGNALS]) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_plan_signal *signal = &config->signals[i].plan;
        (void)snprintf(names[i], PLANT_NAME, "plant.%s", signal->name);
        plant[i] = (tl_recorder_signal){names[i], signal->unit, NULL, signal->type};
    }
}

tl_status tl_twin_recorder_open(const tl_twin_recorder_settings *settings, tl_recorder **recorder, tl_error *error) {
    const tl_config *config = settings->config;
    const tl_account *account = settings->account;
    const char *components[TL_RECORDER_COMPONENTS];
    char names[TL_MAX_SIGNALS][PLANT_NAME];
    tl_recorder_signal plant[TL_MAX_SIGNALS];
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
    char fmus[TL_SHA256_TEXT];
    char boot[TL_IDENTITY_TEXT];
    char format[TL_IDENTITY_TEXT];
    plant_signals(config, names, plant);
    if (account != NULL) {
        tl_twin_recorder_identify(config, fmus);
    } else {
        tl_identity_files(NULL, 0, fmus);
    }
    tl_identity_boot(boot);
    tl_identity_format(format);
    tl_recorder_settings made = {
        .path = settings->path,
        .max_bytes = config->record_max_bytes,
        .commit = config->record_commit,
        .verb = settings->verb,
        .name = config->name,
        .configuration = config->text,
        .step = config->step,
        .measurements = config->measurements,
        .plant = plant,
        .match = match,
        .adjust = adjust,
        .plant_count = config->signal_count,
        .fmus = fmus,
        .boot = boot,
        .format = format,
        .components = components,
        .wait_when_full = settings->wait_when_full,
        .beats = settings->beats,
    };
    if (account != NULL) {
        tl_twin_recorder_signals(config, account, match, adjust);
        for (size_t i = 0; i < account->components; i++) {
            components[i] = account->component[i].name;
        }
        made.prediction = account->prediction;
        made.lead = account->lead;
        made.match_count = config->match_count;
        made.adjust_count = config->adjust_count;
        made.component_count = account->components;
    }
    return tl_recorder_open(&made, recorder, error);
}

size_t tl_twin_recorder_count(const tl_twin *twin, tl_recorder_component counts[TL_RECORDER_COMPONENTS]) {
    size_t count = tl_twin_get_facts(twin).components;
    for (size_t i = 0; i < count; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(twin, i);
        counts[i] = (tl_recorder_component){
            entry.plain, entry.predicted, entry.executions, entry.caught_up, entry.unstored,
        };
    }
    return count;
}

void tl_twin_recorder_start(tl_outbox *outbox, const tl_twin *twin, tl_time start) {
    static const tl_time ms = TL_SECOND / 1000;
    static tl_outbox_start beginning; /* too large for a small stack; one thread begins runs */
    beginning = (tl_outbox_start){
        .resumption = {.start = start, .started = tl_utc_now() + (start - tl_clock_now(NULL)) / ms}};
    tl_account_take(twin, &beginning.account);
    (void)tl_outbox_put_start(outbox, &beginning);
}

void tl_twin_recorder_put(tl_outbox *outbox, const tl_record *record, const tl_twin *twin) {
    tl_recorder_component counts[TL_RECORDER_COMPONENTS];
    (void)tl_twin_recorder_count(twin, counts);
    (void)tl_outbox_put_step(outbox, record, counts);
}

void tl_twin_recorder_check(const tl_account *account, tl_twin_recorder_hear *hear, void *context) {
    for (size_t i = 0; i < account->components; i++) {
        char text[320];
        const tl_account_component *entry = &account->component[i];
        const tl_recorder_component counts = {entry->plain, entry->predicted, entry->executions, entry->caught_up,
                                              entry->unstored};
        int64_t difference = tl_run_component_difference(&counts);
        if (difference > 0) {
            (void)snprintf(text, sizeof text,
                           "%s: %" PRId64 " executions more than predicted: results found no room (%" PRIu64
                           ", see saving.nodes), or a committed step failed and was repeated",
                           entry->name, difference, entry->unstored);
            hear(context, text);
        }
    }
}
