/* Storage of the change detector: see change_storage.h. */
#include "firmware/monitor/change_storage.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char PLANT[] = "plant.";

/* Names that do not fit are left out. */
static void add_name(char *also, const char *name) {
    size_t length = strlen(also);
    if (length + strlen(name) + 2 <= TL_FINDING_ALSO) {
        (void)snprintf(also + length, TL_FINDING_ALSO - length, "%s%s", length > 0 ? "\n" : "", name);
    }
}

static void list_also(const tl_finding *finding, const tl_config *config, char also[TL_FINDING_ALSO]) {
    also[0] = '\0';
    for (size_t i = 0; i < config->adjust_count; i++) {
        bool is_own = finding->subject == TL_FINDING_CORRECTION && finding->index == i;
        if ((finding->corrections >> i & 1U) != 0 && !is_own) {
            add_name(also, config->adjust[i].variable);
        }
    }
    for (size_t i = 0; i < config->match_count; i++) {
        bool is_own = finding->subject == TL_FINDING_OUTPUT && finding->index == i;
        if ((finding->outputs >> i & 1U) != 0 && !is_own) {
            add_name(also, config->match[i].variable);
        }
    }
}

static const char *write_cause(const tl_finding *finding, char cause[TL_FINDING_NAME + 8]) {
    const char *sensor = finding->cause == TL_FINDING_SENSOR ? finding->sensor : "";
    (void)snprintf(cause, TL_FINDING_NAME + 8, "%s%s", finding->cause == TL_FINDING_SENSOR ? PLANT : "", sensor);
    return finding->cause == TL_FINDING_PLANT ? "plant" : cause;
}

static tl_run_finding row_of(tl_change_storage *storage, const tl_config *config, const tl_finding *finding, size_t i) {
    bool has_size = finding->kind != TL_FINDING_FREEZE;
    list_also(finding, config, storage->also[i]);
    return (tl_run_finding){
        .number = finding->number,
        .kind = tl_finding_kind_name(finding->kind),
        .subject = tl_finding_subject_name(finding->subject),
        .variable = finding->variable,
        .says = finding->says,
        .unit = finding->unit,
        .onset = finding->onset,
        .onset_spread = finding->onset_spread,
        .found = finding->found,
        .gone = finding->is_gone ? finding->gone : (double)NAN,
        .size = has_size ? finding->size : (double)NAN,
        .size_spread = has_size ? finding->size_spread : (double)NAN,
        .percent = has_size ? finding->percent : (double)NAN,
        .also = storage->also[i],
        .cause = write_cause(finding, storage->cause[i]),
        .state = tl_finding_state_name(finding),
    };
}

bool tl_change_storage_fill(tl_change_storage *storage, const tl_config *config, const tl_change_detector *detector) {
    tl_run_changes *changes = &storage->changes;
    const tl_changes found = tl_change_detector_get(detector);
    storage->bytes = storage->bytes != NULL ? storage->bytes : malloc(tl_change_detector_size(detector));
    if (storage->bytes == NULL) {
        return false;
    }
    tl_change_detector_save(detector, storage->bytes);
    for (size_t i = 0; i < found.count; i++) {
        storage->rows[i] = row_of(storage, config, &found.finding[i], i);
    }
    changes->detection = found.detection;
    changes->finding = storage->rows;
    changes->count = found.count;
    changes->learned = storage->bytes;
    changes->size = tl_change_detector_size(detector);
    return true;
}

void tl_change_storage_release(tl_change_storage *storage) {
    free(storage->bytes);
    storage->bytes = NULL;
}

/* Texts that do not fit are no texts of ours. */
static bool copy_text(const char *from, char *to, size_t size) {
    (void)snprintf(to, size, "%s", from);
    return strlen(from) < size;
}

static bool read_cause(const char *cause, tl_finding *finding) {
    bool is_sensor = strncmp(cause, PLANT, strlen(PLANT)) == 0;
    finding->cause = is_sensor                     ? TL_FINDING_SENSOR
                     : strcmp(cause, "plant") == 0 ? TL_FINDING_PLANT
                                                   : TL_FINDING_NO_CAUSE;
    return copy_text(is_sensor ? cause + strlen(PLANT) : "", finding->sensor, sizeof finding->sensor);
}

bool tl_change_storage_read(const tl_run_finding *row, tl_finding *finding) {
    *finding = (tl_finding){.number = (uint32_t)row->number,
                            .onset = row->onset,
                            .onset_spread = row->onset_spread,
                            .found = row->found,
                            .is_gone = isfinite(row->gone),
                            .gone = isfinite(row->gone) ? row->gone : 0.0,
                            .size = row->size,
                            .size_spread = row->size_spread,
                            .percent = row->percent};
    while (strcmp(row->kind, tl_finding_kind_name(finding->kind)) != 0) {
        if (finding->kind == TL_FINDING_LIMIT) {
            return false;
        }
        finding->kind++;
    }
    while (strcmp(row->subject, tl_finding_subject_name(finding->subject)) != 0) {
        if (finding->subject == TL_FINDING_SIGNAL) {
            return false;
        }
        finding->subject++;
    }
    return read_cause(row->cause, finding) && isfinite(row->onset) && isfinite(row->found) &&
           copy_text(row->variable, finding->variable, sizeof finding->variable) &&
           copy_text(row->says, finding->says, sizeof finding->says) &&
           copy_text(row->unit, finding->unit, sizeof finding->unit);
}
