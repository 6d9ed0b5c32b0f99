/* The curves of a report as the JSON that page.js draws. */
#include <inttypes.h>

#include "firmware/base/show_text.h"
#include "firmware/report/html_report_parts.h"
#include "firmware/report/html_text.h"

/* One value per bucket while nothing is thinned, else two. */
static void put_channel(const tl_html_report *report, const char *key, size_t channel, FILE *file) {
    const tl_envelope *curves = &report->curves;
    (void)fprintf(file, "\"%s\":[", key);
    for (size_t i = 0; i < curves->used; i++) {
        double pair[2];
        tl_envelope_get(curves, channel, i, pair);
        (void)fputs(i == 0 ? "" : ",", file);
        tl_html_put_number(file, pair[0]);
        if (curves->width > 1) {
            (void)fputc(',', file);
            tl_html_put_number(file, pair[1]);
        }
    }
    (void)fputc(']', file);
}

/* Three that follow one another, each after what was put before. */
static void put_channels(const tl_html_report *report, const char *const keys[3], size_t first, FILE *file) {
    for (size_t i = 0; i < 3; i++) {
        (void)fputs(",\n", file);
        put_channel(report, keys[i], first + i, file);
    }
}

/* Stretches of buckets in which ŷ was not always good: [first, last, qualities]. */
static void put_bad(const tl_html_report *report, size_t channel, FILE *file) {
    const tl_envelope *curves = &report->curves;
    const char *separator = "";
    (void)fputs("\"bad\":[", file);
    for (size_t i = 0; i < curves->used;) {
        uint8_t marks = tl_envelope_marks(curves, channel, i);
        size_t last = i;
        while (last + 1 < curves->used && tl_envelope_marks(curves, channel, last + 1) == marks) {
            last++;
        }
        if (marks != 0) {
            (void)fprintf(file, "%s[%zu,%zu,%u]", separator, i, last, (unsigned)marks);
            separator = ",";
        }
        i = last + 1;
    }
    (void)fputc(']', file);
}

static void put_signal(const tl_recorder_signal *signal, FILE *file) {
    (void)fputs("\n{\"name\":", file);
    tl_html_put_string(file, signal->name);
    (void)fputs(",\"unit\":", file);
    tl_html_put_string(file, tl_show_unit(signal->unit));
    (void)fputs(",\"type\":", file);
    tl_html_put_string(file, tl_type_name(signal->type));
}

static void put_match(const tl_html_report *report, size_t match, FILE *file) {
    static const char *const keys[] = {"y", "measured", "delta"};
    const tl_html_settings *settings = &report->settings;
    size_t channel = tl_html_match_channel(report, match);
    (void)fputs(match == 0 ? "" : ",", file);
    put_signal(&settings->match[match], file);
    (void)fputs(",\"to\":", file);
    tl_html_put_string(file, settings->match[match].to);
    (void)fputs(",\"tolerance\":", file);
    tl_html_put_number(file, settings->tolerance[match]);
    put_channels(report, keys, channel, file);
    (void)fputs(",\n", file);
    put_bad(report, channel, file);
    (void)fputc('}', file);
}

static void put_adjust(const tl_html_report *report, size_t adjust, FILE *file) {
    static const char *const keys[] = {"u", "nominal", "delta"};
    (void)fputs(adjust == 0 ? "" : ",", file);
    put_signal(&report->settings.adjust[adjust], file);
    put_channels(report, keys, tl_html_adjust_channel(report, adjust), file);
    (void)fputc('}', file);
}

void tl_html_put_data(const tl_html_report *report, FILE *file) {
    const tl_html_settings *settings = &report->settings;
    const tl_envelope *curves = &report->curves;
    (void)fprintf(file, "{\"step\":%.9f,\"first\":%" PRId64 ",\"steps\":%" PRId64 ",\"width\":%" PRId64, //
                  tl_seconds(settings->step), settings->first, curves->steps, curves->width);
    (void)fputs(",\"origin\":", file);
    if (settings->live) {
        (void)fprintf(file, "%" PRId64, settings->origin);
    } else {
        (void)fputs("null", file);
    }
    (void)fputs(",\n\"match\":[", file);
    for (size_t i = 0; i < settings->match_count; i++) {
        put_match(report, i, file);
    }
    (void)fputs("],\n\"adjust\":[", file);
    for (size_t i = 0; i < settings->adjust_count; i++) {
        put_adjust(report, i, file);
    }
    (void)fputs("],\n", file);
    put_channel(report, "executions", TL_HTML_EXECUTIONS, file);
    (void)fputs(",\n", file);
    put_channel(report, "evaluations", TL_HTML_EVALUATIONS, file);
    if (settings->clock) {
        (void)fprintf(file, ",\n\"budget\":%.9g,\n", (double)settings->budget / 1e6);
        put_channel(report, "used", TL_HTML_USED, file);
    }
    (void)fputs("}\n", file);
}
