/* twinlock show: what was corrected, when and why. */
#include <ctype.h>
#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/show/show.h"
#include "firmware/verbs/verbs.h"

typedef struct show_options {
    const char *path;
    int64_t run; /* 0: the last one */
    bool json;
    bool csv;
    tl_show_csv_table table;
    bool all_events;
    const char *since;
    const char *report;
} show_options;

static void print_help(FILE *file) {
    (void)fputs("usage: twinlock show DATABASE [options]\n\n"
                "Shows what a run that was recorded had to correct, when and why: how well the twin followed, Δu per\n"
                "adjusted variable and since when, events. Works while the run is going on.\n\n"
                "  --run N|last  which run; default: the last one\n"
                "  --since TIME  only what came after: a date (UTC: 2026-11-21, 2026-11-21T10:02), or how far back\n"
                "                from the run's end (90s, 15m, 8h, 2d)\n"
                "  --events      all events, not only the last ten\n"
                "  --json        print one JSON object\n"
                "  --csv TABLE   print a table as CSV: outputs, adjustments, steps, samples or events\n"
                "  --report FILE write a page with key figures, plots and events, for a browser and for paper\n"
                "  --help        this text\n",
                file);
}

/* ---- Options ----------------------------------------------------------------------------------------------------- */

static bool parse_run(const char *text, int64_t *run) {
    char *end = NULL;
    if (strcmp(text, "last") == 0) {
        *run = 0;
        return true;
    }
    errno = 0;
    long long number = strtoll(text, &end, 10);
    *run = number;
    return errno == 0 && isdigit((unsigned char)text[0]) && *end == '\0' && number > 0;
}

static bool parse_table(const char *text, tl_show_csv_table *table) {
    static const char *const names[] = {
        [TL_SHOW_OUTPUTS] = "outputs", [TL_SHOW_ADJUSTMENTS] = "adjustments", [TL_SHOW_STEPS] = "steps",
        [TL_SHOW_SAMPLES] = "samples", [TL_SHOW_EVENTS] = "events",
    };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (strcmp(text, names[i]) == 0) {
            *table = (tl_show_csv_table)i;
            return true;
        }
    }
    return false;
}

/* "90s", "15m", "8h", "2d". */
static bool parse_back(const char *text, double *seconds) {
    static const char letters[] = "smhd";
    static const double factors[] = {1.0, 60.0, 3600.0, 86400.0};
    char *end = NULL;
    double number = strtod(text, &end);
    const char *letter = *end == '\0' ? NULL : strchr(letters, *end);
    if (!isdigit((unsigned char)text[0]) || letter == NULL || end[1] != '\0' || !isfinite(number)) {
        return false;
    }
    *seconds = number * factors[letter - letters];
    return true;
}

static bool is_time(const char *text) {
    double seconds = 0.0;
    int64_t at = 0;
    return parse_back(text, &seconds) || tl_utc_parse(text, &at);
}

static int refuse(const char *option, const char *found, const char *expected) {
    (void)fprintf(stderr, "twinlock show: %s: found \"%s\", expected %s\n", option, found, expected);
    return 3;
}

/* 0: go on; else the exit code + 1. */
static int take_option(int option, show_options *options) {
    switch (option) {
    case 'r':
        return parse_run(optarg, &options->run) ? 0 : refuse("--run", optarg, "the number of a run, or last");
    case 's':
        options->since = optarg;
        return is_time(optarg) ? 0 : refuse("--since", optarg, "a date such as 2026-11-21T10:02, or 90s, 15m, 8h, 2d");
    case 'e':
        options->all_events = true;
        return 0;
    case 'j':
        options->json = true;
        return 0;
    case 'c':
        options->csv = true;
        return parse_table(optarg, &options->table)
                   ? 0
                   : refuse("--csv", optarg, "outputs, adjustments, steps, samples or events");
    case 'R':
        options->report = optarg;
        return 0;
    case 'h':
        print_help(stdout);
        return 1;
    default:
        print_help(stderr);
        return 3;
    }
}

static int parse(int argc, char **argv, show_options *options) {
    static const struct option LONG[] = {
        {"run", required_argument, NULL, 'r'}, {"since", required_argument, NULL, 's'},
        {"events", no_argument, NULL, 'e'},    {"json", no_argument, NULL, 'j'},
        {"csv", required_argument, NULL, 'c'}, {"report", required_argument, NULL, 'R'},
        {"help", no_argument, NULL, 'h'},      {NULL, 0, NULL, 0},
    };
    for (int option = 0; (option = getopt_long(argc, argv, "h", LONG, NULL)) != -1;) {
        int result = take_option(option, options);
        if (result != 0) {
            return result;
        }
    }
    if (optind != argc - 1 || options->json + options->csv + (options->report != NULL) > 1) {
        (void)fputs("twinlock show: expected exactly one database, and at most one of --json, --csv and --report\n\n",
                    stderr);
        print_help(stderr);
        return 3;
    }
    options->path = argv[optind];
    return 0;
}

/* ---- Since when -------------------------------------------------------------------------------------------------- */

static int64_t step_at(double seconds, tl_time step) {
    double number = ceil(seconds * 1e9 / (double)step);
    return number < 0.0 ? 0 : number > 4e18 ? INT64_MAX / 4 : (int64_t)number;
}

/* So far back from the run's last tick, and from its last commit. */
static tl_status go_back(tl_show_request *request, double seconds, tl_error *error) {
    int64_t last = -1;
    int64_t committed = 0;
    tl_status status = tl_history_last_step(request->history, request->run, &last, error);
    if (status == TL_OK && last >= 0) {
        int64_t back = step_at(seconds, request->run->step);
        request->from_step = back > last + 1 ? 0 : last + 1 - back;
    }
    if (status == TL_OK && tl_utc_parse(request->run->committed, &committed)) {
        tl_utc_text(committed - (int64_t)fmin(seconds * 1e3, 1e15), request->from_at);
    }
    return status;
}

static tl_status choose_since(tl_show_request *request, const char *since, tl_error *error) {
    double seconds = 0.0;
    int64_t at = 0;
    int64_t started = 0;
    if (since == NULL) {
        return TL_OK;
    }
    if (parse_back(since, &seconds)) {
        return go_back(request, seconds, error);
    }
    if (!tl_show_is_live(request->run)) {
        return tl_fail(
            error, TL_BAD_USAGE,
            "--since %s: run %lld is a replay, its steps have no date; say how far back from its end, such as 90s",
            since, (long long)request->run->run);
    }
    (void)tl_utc_parse(since, &at);
    (void)tl_utc_parse(request->run->started, &started);
    tl_utc_text(at, request->from_at);
    request->from_step = step_at((double)(at - started) / 1e3, request->run->step);
    return TL_OK;
}

/* ---- The verb ---------------------------------------------------------------------------------------------------- */

static tl_status print(const tl_show_request *request, const show_options *options, tl_error *error) {
    if (options->csv) {
        return tl_show_csv(request, options->table, stdout, error);
    }
    if (options->report != NULL) {
        return tl_show_report(request, options->report, error);
    }
    return options->json ? tl_show_json(request, stdout, error) : tl_show_page(request, stdout, error);
}

static tl_status show(const show_options *options, tl_error *error) {
    tl_show_request request = {
        .path = options->path, .all_events = options->all_events, .style = tl_show_style_of(stdout)};
    tl_status status = tl_history_open(options->path, &request.history, error);
    if (status == TL_OK) {
        status = tl_history_find(request.history, options->run, &request.run, error);
    }
    if (status == TL_OK) {
        status = choose_since(&request, options->since, error);
    }
    if (status == TL_OK) {
        status = print(&request, options, error);
    }
    if (status == TL_BAD_DATA) {
        tl_history_diagnose(request.history, error);
    }
    tl_history_close(request.history);
    if ((fflush(stdout) != 0 || ferror(stdout)) && status == TL_OK) {
        status = tl_fail(error, TL_TRY_AGAIN, "standard output: %s", strerror(errno));
    }
    return status;
}

int tl_verb_show(int argc, char **argv) {
    show_options options = {0};
    tl_error error = {TL_OK, ""};
    int parsed = parse(argc, argv, &options);
    if (parsed != 0) {
        return parsed - 1;
    }
    tl_status status = show(&options, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}
