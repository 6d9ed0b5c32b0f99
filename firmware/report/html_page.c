/* The page of a report: page.html, with its places filled. */
#include <string.h>

#include "firmware/report/html_report_parts.h"
#include "firmware/report/html_resources.h"
#include "firmware/report/html_text.h"

typedef struct filling {
    const tl_html_report *report;
    const tl_run_figures *figures;
    const char *ended;
    FILE *file;
} filling;

static void put(FILE *file, const tl_html_resource *resource) {
    (void)fwrite(resource->bytes, 1, resource->size, file);
}

static void put_name(const filling *page) {
    tl_html_put_text(page->file, page->report->settings.name);
}

static void put_version(const filling *page) {
    tl_html_put_text(page->file, TL_VERSION);
}

/* The two scripts, and no other, may run. */
static void put_policy(const filling *page) {
    char library[TL_HTML_DIGEST];
    char script[TL_HTML_DIGEST];
    tl_html_digest(tl_html_library.bytes, tl_html_library.size, library);
    tl_html_digest(tl_html_script.bytes, tl_html_script.size, script);
    (void)fprintf(page->file, "default-src 'none'; style-src 'unsafe-inline'; script-src '%s' '%s'", library, script);
}

static void put_library_style(const filling *page) {
    put(page->file, &tl_html_library_style);
}

static void put_style(const filling *page) {
    put(page->file, &tl_html_style);
}

static void put_library(const filling *page) {
    put(page->file, &tl_html_library);
}

static void put_script(const filling *page) {
    put(page->file, &tl_html_script);
}

static void put_licence(const filling *page) {
    put(page->file, &tl_html_licence);
}

static void put_facts(const filling *page) {
    tl_html_put_facts(page->report, page->ended, page->file);
}

static void put_figures(const filling *page) {
    tl_html_put_figures(page->report, page->figures, page->file);
}

static void put_thinning(const filling *page) {
    tl_html_put_thinning(page->report, page->file);
}

static void put_events(const filling *page) {
    tl_html_put_events(page->report, page->file);
}

static void put_data(const filling *page) {
    tl_html_put_data(page->report, page->file);
}

static const struct {
    const char *name;
    void (*put)(const filling *page);
} places[] = {
    {"name", put_name},   {"version", put_version}, {"policy", put_policy}, {"library-style", put_library_style},
    {"style", put_style}, {"library", put_library}, {"script", put_script}, {"licence", put_licence},
    {"facts", put_facts}, {"figures", put_figures}, {"events", put_events}, {"thinning", put_thinning},
    {"data", put_data},
};

/* `name` has `length` characters. One that is not listed stays as it is, for a test to find. */
static void fill(const filling *page, const char *name, size_t length) {
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        if (strlen(places[i].name) == length && memcmp(places[i].name, name, length) == 0) {
            places[i].put(page);
            return;
        }
    }
    (void)fprintf(page->file, "{{%.*s}}", (int)length, name);
}

/* Where `mark` begins in what is left, or the end. */
static const char *find(const char *from, const char *end, const char *mark) {
    while (end - from >= 2 && memcmp(from, mark, 2) != 0) {
        from++;
    }
    return end - from >= 2 ? from : end;
}

void tl_html_report_write(const tl_html_report *report, const tl_run_figures *figures, const char *ended, FILE *file) {
    const filling page = {report, figures, ended, file};
    const char *at = (const char *)tl_html_frame.bytes;
    const char *end = at + tl_html_frame.size;
    while (at < end) {
        const char *open = find(at, end, "{{");
        const char *close = find(open, end, "}}");
        (void)fwrite(at, 1, (size_t)(open - at), file);
        if (close < end) {
            fill(&page, open + 2, (size_t)(close - open) - 2);
        }
        at = close < end ? close + 2 : end;
    }
}
