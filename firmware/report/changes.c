/* Findings in JSON and as sentences: see changes.h. */
#include "firmware/report/changes.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/text.h"
#include "firmware/monitor/change_storage.h"
#include "firmware/monitor/lock_tally.h"

/* A run that has learnt less than this part says nothing about changes. */
static const double SHORT_RUN = 0.04;

bool tl_changes_is_open(const tl_run_finding *row) {
    return strcmp(row->state, "open") == 0;
}

size_t tl_changes_count(const tl_run_changes *changes, const char *state) {
    size_t count = 0;
    for (size_t i = 0; i < changes->count; i++) {
        count += strcmp(changes->finding[i].state, state) == 0 ? 1 : 0;
    }
    return count;
}

bool tl_changes_are_known(const tl_run_changes *changes) {
    const tl_run_detection *detection = &changes->detection;
    return changes->count > 0 || detection->is_ready || detection->learnt >= SHORT_RUN * detection->needed;
}

static void add_instant(tl_json_writer *json, const char *key, double instant, int64_t started) {
    char text[TL_UTC_TEXT];
    int64_t at = isfinite(instant) ? tl_lock_utc(instant, started) : 0;
    tl_utc_text(at, text);
    tl_json_add_text(json, key, at != 0 ? text : NULL);
}

/* One name in a line. */
static void add_also(tl_json_writer *json, const char *also) {
    char name[TL_FINDING_ALSO];
    tl_json_open_array(json, "also");
    for (size_t length = 0; *also != '\0'; also += length + (also[length] != '\0' ? 1 : 0)) {
        length = strcspn(also, "\n");
        (void)snprintf(name, sizeof name, "%.*s", (int)length, also);
        tl_json_add_text(json, NULL, name);
    }
    tl_json_close(json);
}

static void add_causes(tl_json_writer *json, const char *cause) {
    tl_json_open_array(json, "causes");
    if (cause[0] != '\0') {
        tl_json_add_text(json, NULL, cause);
        if (strcmp(cause, "plant") != 0) {
            tl_json_add_text(json, NULL, "input");
        }
    }
    tl_json_close(json);
}

void tl_changes_add_finding(tl_json_writer *json, const tl_run_finding *row, int64_t started) {
    char text[TL_FINDING_TEXT];
    char cause[TL_FINDING_TEXT];
    tl_changes_write_finding(row, 0.0, started, text, cause);
    tl_json_open_object(json, NULL);
    tl_json_add_number(json, "finding", (double)row->number);
    tl_json_add_text(json, "kind", row->kind);
    tl_json_add_text(json, "variable", row->variable);
    tl_json_add_text(json, "says", row->says[0] != '\0' ? row->says : NULL);
    tl_json_add_text(json, "subject", row->subject);
    tl_json_add_number(json, "onset", row->onset);
    tl_json_add_number(json, "onset_spread_s", row->onset_spread);
    tl_json_add_number(json, "found", row->found);
    tl_json_add_number(json, "gone", row->gone);
    if (started != 0) {
        add_instant(json, "onset_at", row->onset, started);
        add_instant(json, "found_at", row->found, started);
        add_instant(json, "gone_at", row->gone, started);
    }
    tl_json_add_number(json, "size", row->size);
    tl_json_add_number(json, "size_spread", row->size_spread);
    tl_json_add_number(json, "percent", row->percent);
    tl_json_add_text(json, "unit", row->unit);
    add_also(json, row->also);
    add_causes(json, row->cause);
    tl_json_add_text(json, "state", row->state);
    tl_json_add_text(json, "text", text);
}

void tl_changes_add_detection(tl_json_writer *json, const tl_run_detection *detection) {
    tl_json_open_object(json, "detection");
    tl_json_add_text(json, "state", detection->is_ready ? "watching" : "learning");
    tl_json_add_number(json, "learnt_s", detection->learnt);
    tl_json_add_number(json, "needed_s", detection->needed);
    tl_json_add_number(json, "watched_s", detection->watched);
    tl_json_close(json);
}

void tl_changes_write_verdict(const tl_run_detection *detection, size_t open, size_t gone, char text[TL_FINDING_TEXT]) {
    enum { DURATION = 24 };
    char learnt[DURATION];
    char needed[DURATION];
    char watched[DURATION];
    tl_show_duration(detection->learnt, learnt, sizeof learnt);
    tl_show_duration(detection->needed, needed, sizeof needed);
    tl_show_duration(detection->watched, watched, sizeof watched);
    char also[40] = "";
    if (gone > 0) {
        (void)snprintf(also, sizeof also, ", %zu %s gone", gone, gone == 1 ? "is" : "are");
    }
    if (open > 0) {
        (void)snprintf(text, TL_FINDING_TEXT, "%zu lasting change%s open%s", open, open == 1 ? " is" : "s are", also);
    } else if (!detection->is_ready && detection->needed > 0.0) {
        (void)snprintf(text, TL_FINDING_TEXT, "learning: %s of %s; nothing can be said yet", learnt, needed);
    } else if (!detection->is_ready) {
        (void)snprintf(text, TL_FINDING_TEXT, "learning begins at zero; nothing can be said yet");
    } else if (gone > 0) {
        (void)snprintf(text, TL_FINDING_TEXT, "no lasting change is open%s", also);
    } else {
        (void)snprintf(text, TL_FINDING_TEXT, "no lasting change in %s, after %s of learning", watched, learnt);
    }
}

void tl_changes_write_finding(const tl_run_finding *row, double now, int64_t started, char text[TL_FINDING_TEXT],
                              char cause[TL_FINDING_TEXT]) {
    tl_finding finding;
    text[0] = cause[0] = '\0';
    if (tl_change_storage_read(row, &finding)) {
        tl_finding_write(&finding, now, started, text);
        tl_finding_write_cause(&finding, cause);
    }
}
