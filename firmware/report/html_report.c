/* The report of a run, gathered: see html_report.h. */
#include "firmware/report/html_report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/report/html_report_parts.h"

/* Points of all curves together: a page of some 7 MB at most. One curve has no more than a wide screen can tell apart, and
 * then as many again to zoom into. */
enum { POINTS = 1 << 18, MOST_BUCKETS = 1 << 13, LEAST_BUCKETS = 1 << 10 };

static size_t buckets_for(size_t channels) {
    size_t buckets = MOST_BUCKETS;
    while (buckets > LEAST_BUCKETS && buckets * channels > POINTS) {
        buckets /= 2;
    }
    return buckets;
}

double tl_html_tolerance(const tl_plan_match *match, bool synchronise) {
    return synchronise && match->weight > 0.0 ? match->tolerance : 0.0;
}

tl_status tl_html_report_create(const tl_html_settings *settings, tl_html_report **report, tl_error *error) {
    size_t channels = TL_HTML_STEP_CHANNELS + 3 * (settings->match_count + settings->adjust_count);
    tl_html_report *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a report");
    }
    made->settings = *settings;
    tl_status status = tl_envelope_init(&made->curves, channels, buckets_for(channels), error);
    if (status != TL_OK) {
        free(made);
        return status;
    }
    *report = made;
    return TL_OK;
}

void tl_html_report_destroy(tl_html_report *report) {
    if (report != NULL) {
        tl_envelope_free(&report->curves);
        free(report);
    }
}

size_t tl_html_match_channel(const tl_html_report *report, size_t match) {
    (void)report;
    return TL_HTML_STEP_CHANNELS + 3 * match;
}

size_t tl_html_adjust_channel(const tl_html_report *report, size_t adjust) {
    return TL_HTML_STEP_CHANNELS + 3 * (report->settings.match_count + adjust);
}

void tl_html_report_add_step(tl_html_report *report, const tl_record *record) {
    int64_t position = record->step - report->settings.first;
    tl_envelope *curves = &report->curves;
    tl_envelope_put(curves, TL_HTML_EXECUTIONS, position, (double)record->executions);
    tl_envelope_put(curves, TL_HTML_EVALUATIONS, position, (double)record->evaluations);
    tl_envelope_put(curves, TL_HTML_USED, position, (double)record->used / 1e6);
    report->recorded++;
}

void tl_html_report_add_output(tl_html_report *report, int64_t step, size_t match, double y, double y_hat,
                               tl_quality quality) {
    int64_t position = step - report->settings.first;
    size_t channel = tl_html_match_channel(report, match);
    bool good = quality == TL_GOOD;
    tl_envelope_put(&report->curves, channel, position, y);
    tl_envelope_put(&report->curves, channel + 1, position, good ? y_hat : (double)NAN);
    tl_envelope_put(&report->curves, channel + 2, position, good ? y - y_hat : (double)NAN);
    if (!good) {
        tl_envelope_mark(&report->curves, channel, position, (uint8_t)(1U << (unsigned)quality));
    }
}

void tl_html_report_add_adjustment(tl_html_report *report, int64_t step, size_t adjust, double u, double u_hat) {
    int64_t position = step - report->settings.first;
    size_t channel = tl_html_adjust_channel(report, adjust);
    tl_envelope_put(&report->curves, channel, position, u);
    tl_envelope_put(&report->curves, channel + 1, position, u_hat);
    tl_envelope_put(&report->curves, channel + 2, position, u - u_hat);
}

void tl_html_report_add_record(tl_html_report *report, const tl_record *record) {
    tl_html_report_add_step(report, record);
    for (size_t i = 0; i < report->settings.match_count; i++) {
        tl_html_report_add_output(report, record->step, i, record->y[i], record->y_hat[i],
                                  (tl_quality)record->y_hat_quality[i]);
    }
    for (size_t i = 0; i < report->settings.adjust_count; i++) {
        tl_html_report_add_adjustment(report, record->step, i, record->u[i], record->u_hat[i]);
    }
}

void tl_html_report_add_event(tl_html_report *report, const tl_html_event *event) {
    tl_html_entry *entry = &report->events[report->event_count++ % TL_HTML_EVENTS];
    entry->tick = event->tick;
    (void)snprintf(entry->at, sizeof entry->at, "%s", event->at);
    (void)snprintf(entry->severity, sizeof entry->severity, "%s", event->severity);
    (void)snprintf(entry->source, sizeof entry->source, "%s", event->source);
    (void)snprintf(entry->text, sizeof entry->text, "%s", event->text);
}
