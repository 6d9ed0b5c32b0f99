/* Recorder of a twin: see twin_recorder.h. */
#include "firmware/twin/twin_recorder.h"

#include <inttypes.h>
#include <limits.h>
#include <stdio.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/report/run_figures.h"

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

void tl_twin_recorder_describe(const tl_config *config, const char *path, tl_twin_record *record) {
    *record = (tl_twin_record){.settings = {.path = path, .verb = "run"}};
    tl_twin_recorder_identify(config, record->fmus);
    tl_identity_boot(record->boot);
    tl_identity_format(record->format);
    tl_recorder_settings_of(config, &record->names, &record->settings);
    record->settings.fmus = record->fmus;
    record->settings.boot = record->boot;
    record->settings.format = record->format;
}

tl_status tl_twin_recorder_open(const tl_config *config, const tl_account *account, tl_twin_record *record,
                                tl_recorder **recorder, tl_error *error) {
    tl_twin_recorder_signals(config, account, record->names.match, record->names.adjust);
    record->settings.account = account;
    record->settings.component_count = account->components;
    return tl_recorder_open(&record->settings, recorder, error);
}

size_t tl_twin_recorder_count(const tl_twin *twin, tl_execution_counts counts[TL_RECORDER_COMPONENTS]) {
    size_t count = tl_twin_get_facts(twin).components;
    for (size_t i = 0; i < count; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(twin, i);
        counts[i] = (tl_execution_counts){
            entry.plain, entry.predicted, entry.executions, entry.repeated, entry.uncached,
        };
    }
    return count;
}

void tl_twin_recorder_start(tl_record_queue *queue, const tl_twin *twin, tl_time start) {
    static const tl_time ms = TL_SECOND / 1000;
    static tl_record_queue_start
        beginning; /* static, because it is too large for a small stack; only one thread begins runs */
    beginning = (tl_record_queue_start){
        .holds = twin == NULL,
        .resumption = {.start = start, .started = tl_utc_now() + (start - tl_clock_now(NULL)) / ms}};
    if (twin != NULL) {
        tl_account_take(twin, &beginning.account);
        beginning.resumption.start_s = beginning.account.experiment.start_s;
    }
    (void)tl_record_queue_put_start(queue, &beginning);
}

void tl_twin_recorder_put(tl_record_queue *queue, const tl_record *record, const tl_twin *twin) {
    tl_execution_counts counts[TL_RECORDER_COMPONENTS];
    (void)tl_twin_recorder_count(twin, counts);
    (void)tl_record_queue_put_step(queue, record, counts);
}

void tl_twin_recorder_check(const tl_account *account, tl_twin_recorder_on_finding *on_event, void *context) {
    for (size_t i = 0; i < account->components; i++) {
        char text[320];
        const tl_account_component *entry = &account->component[i];
        const tl_execution_counts counts = {entry->plain, entry->predicted, entry->executions, entry->repeated,
                                            entry->uncached};
        int64_t difference = tl_run_component_difference(&counts);
        if (difference > 0) {
            int length = snprintf(text, sizeof text,
                                  "%.120s: %" PRId64 " executions more than predicted: ", entry->name, difference);
            if (entry->uncached != 0) {
                (void)snprintf(text + length, sizeof text - (size_t)length,
                               "%" PRIu64 " results were not kept; raise saving.nodes", entry->uncached);
            } else {
                (void)snprintf(text + length, sizeof text - (size_t)length, "a committed step failed and was repeated");
            }
            on_event(context, text);
        }
    }
}
