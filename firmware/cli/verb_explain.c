/* twinlock explain: names the causes that explain a change in a recorded run. */
#include <inttypes.h>
#include <math.h>
#include <string.h>
#include <sys/resource.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/output.h"
#include "firmware/base/text.h"
#include "firmware/cli/verb_job.h"
#include "firmware/live/live_role.h"
#include "firmware/monitor/change_storage.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/plant/recording.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/role.h"
#include "firmware/report/changes.h"
#include "firmware/report/show.h"
#include "firmware/store/finding_notes.h"
#include "firmware/store/history.h"
#include "firmware/twin/twin_recorder.h"

enum {
    ROWS = 8,          /* of the table, besides the set */
    NAMED = 4,         /* further causes in the sentence */
    NAME_WIDTH = 26,   /* columns of a name in a table */
    GIVEN_SPREAD = 10, /* steps: spread of an onset that the user gives */
    MIB = 1024 * 1024,
    EXPLAINER_CALL_LIMIT = 600, /* s: in a live run, where the process gets the rest of the processor time */
    TEXT = 256
};

/* Cosine from which the effects of two candidates count as alike. */
static const double ALIKE = 0.95;

typedef struct explain_verb {
    tl_verb_job *job;
    bool is_live; /* of a live run: also explains findings before the named one that belong to it */
    tl_history *history;
    const tl_history_run *run;
    int64_t started; /* t_start of a live run, ms since 1970 UTC; 0: of a replay */
    const tl_history_finding *findings;
    size_t finding_count;
    int64_t finding;  /* number of the one to be explained; 0: none */
    int64_t reaction; /* R, steps */
    tl_recording *recording;
    tl_account account;
    tl_progress progress;
    int64_t reruns;
    tl_explanation explanation;
} explain_verb;

/* ---- what to explain ---- */

static int64_t to_step(const explain_verb *self, double seconds) {
    double step = rint(seconds * 1e9 / (double)self->run->step);
    double most = (double)tl_history_last_possible(self->run);
    return (int64_t)fmin(fmax(step, 0.0), most);
}

static double to_seconds(const explain_verb *self, double step) {
    return step * tl_seconds(self->run->step);
}

/* The finding that the user wants, else the last open one, else the last one. NULL: none. */
static const tl_history_finding *choose_finding(const explain_verb *self) {
    const tl_options *options = self->job->options;
    const tl_history_finding *chosen = NULL;
    for (size_t i = 0; i < self->finding_count; i++) {
        const tl_history_finding *one = &self->findings[i];
        bool is_of_run = options->run == 0 || one->run == (int64_t)options->run;
        if (options->finding != 0
                ? (uint64_t)one->row.number == options->finding
                : is_of_run && (tl_changes_is_open(&one->row) || chosen == NULL || !tl_changes_is_open(&chosen->row))) {
            chosen = one;
        }
    }
    return chosen;
}

/* One cause may give several findings, one after the other: the first of them tells the onset. An
 * earlier one counts if it began not long before, and if its onset is recorded. */
static const tl_history_finding *find_first(const explain_verb *self, const tl_history_finding *last) {
    const tl_history_finding *first = last;
    double far = TL_EXPLANATION_AFTER * to_seconds(self, (double)self->reaction);
    double least = to_seconds(self, (double)(self->job->order.explain.least + self->reaction));
    for (const tl_history_finding *one = last; one-- > self->findings;) {
        double onset = first->row.onset;
        bool is_linked = one->run == last->run && one->row.onset > onset - far && one->row.onset > least;
        first = is_linked && one->row.onset < onset ? one : first;
    }
    return first;
}

/* The window ends where all of the findings are gone, or where another one begins. A finding less
 * than a reaction later may have the same cause. */
static void avoid_others(const explain_verb *self, const tl_history_finding *first, const tl_history_finding *last,
                         tl_explanation_order *order) {
    int64_t gone = 0;
    for (size_t i = 0; i < self->finding_count; i++) {
        const tl_history_finding *one = &self->findings[i];
        int64_t onset = to_step(self, one->row.onset);
        bool is_later = one > last && onset > order->onset + order->spread + self->reaction;
        if (one->run == self->run->run && is_later && onset < order->last) {
            order->last = onset;
        }
        if (one->run == self->run->run && one >= first && one <= last) {
            int64_t end = isfinite(one->row.gone) ? to_step(self, one->row.gone) : INT64_MAX;
            gone = end > gone ? end : gone;
        }
    }
    order->last = gone < order->last ? gone : order->last;
}

static void order_finding(explain_verb *self, const tl_history_finding *chosen) {
    tl_explanation_order *order = &self->job->order.explain;
    bool is_alone = self->job->options->finding != 0 && !self->is_live;
    const tl_history_finding *first = is_alone ? chosen : find_first(self, chosen);
    const tl_run_finding *row = &first->row;
    /* What was found late is dated badly. */
    double spread = fmax(isfinite(row->onset_spread) ? row->onset_spread : 0.0, (row->found - row->onset) / 2.0);
    self->finding = row->number;
    order->onset = to_step(self, row->onset);
    order->spread = to_step(self, spread);
    avoid_others(self, first, chosen, order);
}

static tl_status find_run(explain_verb *self, const tl_history_finding **chosen, tl_error *error) {
    const tl_options *options = self->job->options;
    tl_status status = tl_history_find(self->history, (int64_t)options->run, &self->run, error);
    status = status == TL_OK
                 ? tl_history_findings(self->history, self->run, &self->findings, &self->finding_count, error)
                 : status;
    if (status != TL_OK) {
        return status;
    }
    if (tl_show_is_live(self->run)) {
        (void)tl_utc_parse(self->run->started, &self->started);
    }
    *chosen = options->foresee || options->since.text != NULL ? NULL : choose_finding(self);
    if (*chosen != NULL) {
        self->started = (*chosen)->started;
        return tl_history_find(self->history, (*chosen)->run, &self->run, error);
    }
    if (options->finding != 0) {
        return tl_fail(error, TL_BAD_USAGE,
                       "--finding %" PRIu64 ": there is no such finding: `twinlock show %s` lists them",
                       options->finding, options->subject);
    }
    return options->foresee || options->since.text != NULL
               ? TL_OK
               : tl_fail(error, TL_BAD_USAGE,
                         "%s: has no finding to explain: name a time with --since, or use --foresee", options->subject);
}

static tl_status order_since(explain_verb *self, tl_error *error) {
    const tl_options_since *since = &self->job->options->since;
    tl_explanation_order *order = &self->job->order.explain;
    int64_t back = to_step(self, since->back_s);
    if (since->is_date && self->started == 0) {
        return tl_fail(error, TL_BAD_USAGE,
                       "--since %s: run %" PRId64 " is a replay, its steps have no date: give seconds since its start",
                       since->text, self->run->run);
    }
    order->spread = GIVEN_SPREAD;
    order->onset = since->is_date   ? to_step(self, (double)(since->at - self->started) / 1e3)
                   : since->is_time ? back
                                    : order->last - back;
    return TL_OK;
}

/* `foresee`: as if something happened one reaction before the end. */
static tl_status fill_order(explain_verb *self, const tl_history_finding *chosen, tl_error *error) {
    tl_explanation_order *order = &self->job->order.explain;
    int64_t last = -1;
    tl_status status = tl_history_last_step(self->history, self->run, &last, error);
    self->reaction = tl_explanation_reaction(self->job->config.released_steps);
    order->least = self->run->removed_before;
    order->last = last + 1;
    if (status == TL_OK && chosen != NULL) {
        order_finding(self, chosen);
    } else if (status == TL_OK && self->job->options->foresee) {
        int64_t length = order->last - order->least;
        order->foresees = 1;
        order->onset = order->last - (self->reaction < length / 2 ? self->reaction : length / 2);
    } else if (status == TL_OK) {
        status = order_since(self, error);
    }
    return status;
}

/* ---- the run again ---- */

/* Begins as near before the mark as a checkpoint permits. */
static tl_status choose_beginning(explain_verb *self, tl_error *error) {
    tl_config *config = &self->job->config;
    tl_explanation_window window;
    const tl_explanation_order *order = &self->job->order.explain;
    tl_status status = tl_explanation_plan(order, config->released_steps, order->least, &window, error);
    int64_t shift = config->input_lookup.ticks < 0 ? config->input_lookup.ticks : 0;
    int64_t before = window.mark - 1 + shift;
    config->recording_follow = before > 1 ? before : 1;
    return status;
}

static tl_status check_fmus(const explain_verb *self, tl_error *error) {
    char fmus[TL_SHA256_TEXT];
    tl_twin_recorder_identify(&self->job->config, fmus);
    return self->run->fmus[0] == '\0' || strcmp(fmus, self->run->fmus) == 0
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA,
                         "run %" PRId64 ": its FMUs are missing or have changed since: name its configuration with "
                         "--config, so that they are found beside it",
                         self->run->run);
}

static void advance(void *context) {
    explain_verb *self = context;
    tl_progress_update(&self->progress, ++self->reruns);
}

/* Repeats the run up to the end of the window. The FMU process then explains. */
static tl_status feed_ticks(explain_verb *self, tl_twin_feed *feed, tl_error *error) {
    tl_explanation_window window;
    const tl_explanation_order *order = &self->job->order.explain;
    tl_status status = tl_explanation_plan(order, self->job->config.released_steps, order->least, &window, error);
    int64_t shift = self->job->config.input_lookup.ticks > 0 ? self->job->config.input_lookup.ticks : 0;
    int64_t last = window.end + (int64_t)self->account.lead + shift + 1;
    bool end = false;
    tl_progress_begin(&self->progress, "repeat the run", last);
    for (int64_t tick = 0; status == TL_OK && !end && tick < last;) {
        tl_twin_fed fed = {0};
        status = tl_twin_feed_next(feed, &fed, &end, error);
        end = end || fed.tick == NULL;
        tick = end ? tick : fed.tick->sample.tick;
        tl_progress_update(&self->progress, tick);
    }
    tl_progress_end(&self->progress);
    if (status == TL_OK && tl_interrupt_requested() != NULL) {
        return tl_fail(error, TL_INTERRUPTED, "interrupted by %s", tl_interrupt_requested());
    }
    return status;
}

static tl_status run_twin(explain_verb *self) {
    tl_verb_job *job = self->job;
    tl_twin_feed *feed = NULL;
    tl_status status = tl_verb_job_start(job, NULL);
    status = status == TL_OK ? tl_twin_child_build(job->child, &self->account, &job->error) : status;
    if (status != TL_OK) {
        return status;
    }
    tl_config_use_bounds(&job->config, &self->account);
    tl_recording_use_limits(self->recording);
    const tl_twin_feed_settings settings = {
        .config = &job->config, .account = &self->account, .recording = self->recording, .child = job->child};
    status = tl_twin_feed_open(&settings, &feed, &job->error);
    status = status == TL_OK ? feed_ticks(self, feed, &job->error) : status;
    tl_progress_begin(&self->progress, "run the candidates", 0);
    status =
        status == TL_OK ? tl_twin_child_explain(job->child, advance, self, &self->explanation, &job->error) : status;
    tl_progress_end(&self->progress);
    tl_twin_feed_close(feed);
    return status;
}

/* ---- texts ---- */

static const char *const CHANGES[] = {[TL_EXPLAINED_OFFSET] = "offset",
                                      [TL_EXPLAINED_GAIN] = "gain",
                                      [TL_EXPLAINED_RELATIVE] = "value",
                                      [TL_EXPLAINED_DELAY] = "delay",
                                      [TL_EXPLAINED_FREEZE] = "freeze"};
static const char *const ORIGINS[] = {[TL_EXPLAINED_ADJUSTED] = "adjusted",
                                      [TL_EXPLAINED_INPUT] = "input",
                                      [TL_EXPLAINED_PARAMETER] = "parameter",
                                      [TL_EXPLAINED_SENSOR] = "sensor"};
static const char *const VERDICTS[] = {
    [TL_SCORE_NOT_BETTER] = "nothing", [TL_SCORE_FOUND] = "found", [TL_SCORE_UNEXPLAINED] = "none"};

static void write_name(const tl_explained *one, char text[TEXT]) {
    (void)snprintf(text, TEXT, "%s%.*s %s", one->origin == TL_EXPLAINED_SENSOR ? "sensor " : "", TL_ACCOUNT_TEXT,
                   one->name, CHANGES[one->change]);
}

/* For a table of 80 columns: shortens the name, not what has changed. */
static void write_short(const tl_explained *one, bool is_marked, char text[TEXT]) {
    const char *sensor = one->origin == TL_EXPLAINED_SENSOR ? "sensor " : "";
    int width = NAME_WIDTH - (int)strlen(sensor) - (int)strlen(CHANGES[one->change]);
    (void)snprintf(text, TEXT, "%s%s%.*s %s", is_marked ? "* " : "  ", sensor, width, one->name, CHANGES[one->change]);
}

/* Factor from the size in the test to the size that is shown, and its unit. */
static double scale_of(const explain_verb *self, const tl_explained *one, const char **unit) {
    bool is_relative = one->change == TL_EXPLAINED_GAIN || one->change == TL_EXPLAINED_RELATIVE;
    *unit = is_relative ? "%" : one->change == TL_EXPLAINED_DELAY ? "s" : tl_show_unit(one->unit);
    return is_relative ? 100.0 : one->change == TL_EXPLAINED_DELAY ? tl_seconds(self->run->step) : 1.0;
}

static void write_size(const explain_verb *self, const tl_explained *one, char text[TEXT]) {
    const char *unit = "";
    double scale = scale_of(self, one, &unit);
    (void)snprintf(text, TEXT, "%+.4g \302\261 %.2g%s%s", scale * one->test.size, scale * one->test.spread,
                   unit[0] == '\0' ? "" : " ", unit);
}

/* Share of what is more than noise, 0 … 1. */
static double explained_by(const explain_verb *self, const tl_explained *one) {
    const tl_score_result *result = &self->explanation.result;
    double share = (result->squares - one->test.squares) / fmax(result->squares - result->expected, 1.0);
    return fmin(fmax(share, 0.0), 1.0);
}

static double onset_of(const explain_verb *self, const tl_explained *one) {
    return to_seconds(self, (double)self->explanation.window.mark + one->test.onset);
}

static void write_onset(const explain_verb *self, double seconds, char text[TL_LOCK_INSTANT]) {
    tl_lock_instant_write(seconds, to_seconds(self, (double)self->explanation.window.end), self->started, false, text);
}

/* Other members of the set: "; also possible: a, b and 3 more". */
static void write_others(const explain_verb *self, char *text, size_t size) {
    const tl_explanation *all = &self->explanation;
    size_t count = 0;
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < all->count; i++) {
        char name[TEXT];
        bool is_other = all->candidate[i].test.is_in_set && i != all->result.best;
        count += is_other ? 1 : 0;
        if (is_other && count <= NAMED && used < size) {
            write_name(&all->candidate[i], name);
            used += (size_t)snprintf(text + used, size - used, "%s%s", count == 1 ? "; also possible: " : ", ", name);
        }
    }
    if (count > NAMED && used < size) {
        (void)snprintf(text + used, size - used, " and %zu more", count - NAMED);
    }
}

enum { SENTENCE = (NAMED + 4) * TEXT };

/* The user's words for it, with a colon; "": none. */
static void write_words(const explain_verb *self, const tl_explained *one, char text[TL_CONFIG_WORDS + 2]) {
    const tl_config *config = &self->job->config;
    text[0] = '\0';
    for (size_t i = 0; i < config->says_count; i++) {
        if (strcmp(config->says[i].name, one->name) == 0) {
            (void)snprintf(text, TL_CONFIG_WORDS + 2, "%.*s: ", TL_CONFIG_WORDS - 1, config->says[i].words);
        }
    }
}

static void write_sentence(const explain_verb *self, char text[SENTENCE]) {
    const tl_explanation *all = &self->explanation;
    char name[TEXT];
    char size[TEXT];
    char others[NAMED * TEXT];
    char words[TL_CONFIG_WORDS + 2];
    char since[TL_LOCK_INSTANT];
    if (all->result.verdict == TL_SCORE_NOT_BETTER) {
        write_onset(self, to_seconds(self, (double)all->window.onset), since);
        (void)snprintf(text, SENTENCE, "Nothing explains it yet: since %s no candidate predicts noticeably better.",
                       since);
        return;
    }
    const tl_explained *best = &all->candidate[all->result.best];
    write_name(best, name);
    write_words(self, best, words);
    write_size(self, best, size);
    write_onset(self, onset_of(self, best), since);
    write_others(self, others, sizeof others);
    if (all->result.verdict == TL_SCORE_UNEXPLAINED) {
        (void)snprintf(text, SENTENCE, "None of the candidates explains it; nearest: %s %s since %s explains %.0f %%.",
                       name, size, since, 100.0 * explained_by(self, best));
    } else {
        (void)snprintf(text, SENTENCE, "%s%s %s since %s explains it%s.", words, name, size, since, others);
    }
}

static void write_apart(const explain_verb *self, char text[SENTENCE]) {
    const tl_explanation *all = &self->explanation;
    char best[TEXT];
    char second[TEXT];
    text[0] = '\0';
    if (all->result.verdict == TL_SCORE_FOUND && all->result.apart_factor > 0.0) {
        write_name(&all->candidate[all->result.best], best);
        write_name(&all->candidate[all->result.second], second);
        (void)snprintf(text, SENTENCE, "%s and %s differ most in %s; a record %.2g times as long tells them apart.",
                       best, second, self->job->config.match[all->result.apart_output].variable,
                       all->result.apart_factor);
    }
}

/* ---- page ---- */

/* Lists the fitted candidates, the best first. */
static void rank(const explain_verb *self, size_t order[TL_EXPLANATION_MOST], size_t *count) {
    const tl_explanation *all = &self->explanation;
    *count = 0;
    for (size_t i = 0; i < all->count; i++) {
        const tl_score_candidate *one = &all->candidate[i].test;
        size_t at = *count;
        if (!one->fitted) {
            continue;
        }
        for (; at > 0 && all->candidate[order[at - 1]].test.squares > one->squares; at--) {
            order[at] = order[at - 1];
        }
        order[at] = i;
        ++*count;
    }
}

static void add_rows(const explain_verb *self, tl_show_table *table) {
    size_t order[TL_EXPLANATION_MOST];
    size_t count = 0;
    size_t others = 0;
    rank(self, order, &count);
    for (size_t i = 0; i < count; i++) {
        const tl_explained *one = &self->explanation.candidate[order[i]];
        char name[TEXT];
        char size[TEXT];
        char since[TL_LOCK_INSTANT];
        others += one->test.is_in_set ? 0 : 1;
        if (!one->test.is_in_set && others > ROWS) {
            continue;
        }
        write_short(one, one->test.is_in_set, name);
        write_size(self, one, size);
        write_onset(self, onset_of(self, one), since);
        tl_show_table_add(table, "%s", name);
        tl_show_table_add(table, "%s", size);
        tl_show_table_add(table, "%s", since);
        tl_show_table_add(table, "%.0f %%", 100.0 * explained_by(self, one));
    }
}

static void print_left_out(const explain_verb *self, FILE *file) {
    const tl_explanation *all = &self->explanation;
    if (all->fixed != 0) {
        (void)fprintf(file, "Not tried: %u fixed parameters, which FMUs accept only at their start.\n", all->fixed);
    }
    if (all->left_out != 0) {
        (void)fprintf(file, "Not tried: %u candidates beyond the first %d.\n", all->left_out, TL_EXPLANATION_MOST);
    }
}

static tl_status print_causes(const explain_verb *self, FILE *file, tl_error *error) {
    tl_show_table table;
    char text[SENTENCE];
    write_sentence(self, text);
    tl_wrapped_print(file, text, 0, 0);
    (void)fputc('\n', file);
    tl_show_table_begin(&table, tl_show_style_of(file), "lrlr");
    tl_show_table_add(&table, "%s", "  cause");
    tl_show_table_add(&table, "%s", "size");
    tl_show_table_add(&table, "%s", "since");
    tl_show_table_add(&table, "%s", "share");
    add_rows(self, &table);
    tl_status status = tl_show_table_end(&table, file, error);
    (void)fputs("\n* explains the record as well as the best one (99 %)\n", file);
    write_apart(self, text);
    if (text[0] != '\0') {
        tl_wrapped_print(file, text, 0, 0);
    }
    return status;
}

static void add_foreseen(const explain_verb *self, tl_show_table *table) {
    const tl_explanation *all = &self->explanation;
    for (size_t i = 0; i < all->count; i++) {
        const tl_explained *one = &all->candidate[i];
        char name[TEXT];
        char alike[TEXT] = "";
        const char *unit = "";
        double scale = scale_of(self, one, &unit);
        if (one->change == TL_EXPLAINED_FREEZE) {
            continue;
        }
        write_short(one, false, name);
        if (one->test.likeness > ALIKE) {
            write_short(&all->candidate[one->test.alike], false, alike);
        }
        tl_show_table_add(table, "%s", name);
        if (isfinite(one->test.noticeable)) {
            tl_show_table_add(table, "%.2g%s%s", scale * one->test.noticeable, unit[0] == '\0' ? "" : " ", unit);
        } else {
            tl_show_table_add(table, "%s", "never");
        }
        tl_show_table_add(table, "%s", alike);
    }
}

static tl_status print_foreseen(const explain_verb *self, FILE *file, tl_error *error) {
    const tl_explanation_window *window = &self->explanation.window;
    tl_show_table table;
    (void)fprintf(file, "Smallest changes that are noticed within %.4g s, by five standard deviations:\n\n",
                  to_seconds(self, (double)(window->end - window->onset)));
    tl_show_table_begin(&table, tl_show_style_of(file), "lrl");
    tl_show_table_add(&table, "%s", "  cause");
    tl_show_table_add(&table, "%s", "at least");
    tl_show_table_add(&table, "%s", "  looks like");
    add_foreseen(self, &table);
    return tl_show_table_end(&table, file, error);
}

/* ---- JSON ---- */

static void add_candidate(const explain_verb *self, tl_json_writer *json, const tl_explained *one) {
    const char *unit = "";
    double scale = scale_of(self, one, &unit);
    bool foresees = self->job->order.explain.foresees != 0;
    tl_json_open_object(json, NULL);
    tl_json_add_text(json, "name", one->name);
    tl_json_add_text(json, "origin", ORIGINS[one->origin]);
    tl_json_add_text(json, "change", CHANGES[one->change]);
    tl_json_add_text(json, "unit", unit);
    if (foresees) {
        tl_json_add_number(json, "noticeable", scale * one->test.noticeable);
        tl_json_add_number(json, "likeness", one->test.likeness);
        tl_json_add_text(json, "alike", self->explanation.candidate[one->test.alike].name);
        tl_json_add_text(json, "alike_change", CHANGES[self->explanation.candidate[one->test.alike].change]);
    } else {
        tl_json_add_truth(json, "possible", one->test.is_in_set);
        tl_json_add_number(json, "size", scale * one->test.size);
        tl_json_add_number(json, "size_spread", scale * one->test.spread);
        tl_json_add_number(json, "onset", onset_of(self, one));
        tl_json_add_number(json, "explains", 100.0 * explained_by(self, one));
    }
    tl_json_close(json);
}

static tl_status print_json(const explain_verb *self, FILE *file, tl_error *error) {
    const tl_explanation *all = &self->explanation;
    tl_json_writer json;
    size_t order[TL_EXPLANATION_MOST];
    size_t count = 0;
    char text[SENTENCE];
    tl_json_writer_begin(&json);
    tl_json_add_number(&json, "run", (double)self->run->run);
    if (self->job->order.explain.foresees == 0) {
        rank(self, order, &count);
        write_sentence(self, text);
        tl_json_add_number(&json, "finding", self->finding != 0 ? (double)self->finding : (double)NAN);
        tl_json_add_text(&json, "verdict", VERDICTS[all->result.verdict]);
        tl_json_add_text(&json, "text", text);
        write_apart(self, text);
        tl_json_add_text(&json, "apart", text[0] != '\0' ? text : NULL);
    } else {
        for (; count < all->count; count++) {
            order[count] = count;
        }
    }
    tl_json_add_number(&json, "from", to_seconds(self, (double)all->window.mark));
    tl_json_add_number(&json, "onset", to_seconds(self, (double)all->window.onset));
    tl_json_add_number(&json, "to", to_seconds(self, (double)all->window.end));
    tl_json_add_count(&json, "not_tried", (uint64_t)all->fixed + all->left_out);
    tl_json_open_array(&json, "candidates");
    for (size_t i = 0; i < count; i++) {
        add_candidate(self, &json, &all->candidate[order[i]]);
    }
    tl_json_close(&json);
    tl_status status = tl_json_writer_print(&json, file, error);
    tl_json_writer_free(&json);
    return status;
}

/* ---- the verb ---- */

/* Gives way to a run on the same box: for the processor, and if memory is short. The FMU process
 * inherits both. */
static void lower_priority(void) {
    FILE *file = fopen("/proc/self/oom_score_adj", "w");
    (void)setpriority(PRIO_PROCESS, 0, 19);
    if (file != NULL) {
        (void)fputs("1000", file);
        (void)fclose(file);
    }
}

static tl_status print_result(const explain_verb *self, FILE *file, tl_error *error) {
    const tl_options *options = self->job->options;
    if (options->json) {
        return print_json(self, file, error);
    }
    tl_status status = options->foresee ? print_foreseen(self, file, error) : print_causes(self, file, error);
    print_left_out(self, file);
    return status;
}

static tl_status save_result(const explain_verb *self, tl_error *error) {
    char text[SENTENCE];
    write_sentence(self, text);
    tl_log(TL_LOG_NOTICE, "finding %" PRId64 ": %s", self->finding, text);
    return tl_finding_notes_explain(self->job->options->subject, self->finding, text, error);
}

static tl_status explain(explain_verb *self) {
    tl_verb_job *job = self->job;
    const tl_options *options = job->options;
    const char *text = NULL;
    const tl_history_finding *chosen = NULL;
    lower_priority();
    tl_status status = tl_history_open(options->subject, &self->history, &job->error);
    status = status == TL_OK ? find_run(self, &chosen, &job->error) : status;
    if (status == TL_OK && options->save && chosen == NULL) {
        status = tl_fail(&job->error, TL_BAD_USAGE,
                         "--save: stores the answer with a finding, not with --since or --foresee");
    }
    status = status == TL_OK
                 ? tl_history_configuration_text(self->history, self->run->configuration_hash, &text, &job->error)
                 : status;
    if (status == TL_OK) {
        status = tl_verb_job_read(job, options->beside != NULL ? options->beside : options->subject, text);
    }
    status = status == TL_OK ? fill_order(self, chosen, &job->error) : status;
    if (status != TL_OK) {
        return status;
    }
    job->config.recording_run = self->run->run;
    if (job->config.match_count == 0) {
        return tl_fail(&job->error, TL_BAD_DATA, "%s: compares no output with the plant, so nothing can be explained",
                       job->config.name);
    }
    status = choose_beginning(self, &job->error);
    status = status == TL_OK ? check_fmus(self, &job->error) : status;
    status =
        status == TL_OK ? tl_recording_open(options->subject, &job->config, &self->recording, &job->error) : status;
    status = status == TL_OK ? tl_verb_job_use_recording(job, self->recording) : status;
    status = status == TL_OK ? run_twin(self) : status;
    status = status == TL_OK && options->save ? save_result(self, &job->error) : status;
    return status == TL_OK && job->output != NULL ? print_result(self, job->output, &job->error) : status;
}

static tl_status run_job(const tl_options *options, bool is_live, tl_verb_job *job) {
    static explain_verb self; /* large */
    self.is_live = is_live;
    job->options = options;
    job->order = (tl_twin_job){.task = TL_TASK_EXPLAIN, .attached = TL_ATTACHED_NONE};
    self.job = job;
    tl_status status = explain(&self);
    tl_recording_close(self.recording);
    tl_history_close(self.history);
    return status;
}

int tl_verb_explain(const tl_options *options) {
    tl_verb_job job = {.output = tl_output_claim()};
    return tl_verb_job_end(&job, run_job(options, false, &job));
}

/* A finding that cannot be explained is no failure of the run. */
int tl_explainer_role_run(void) {
    static tl_live_setup setup; /* large */
    tl_verb_job job = {.output = NULL};
    tl_status status = tl_live_role_begin(TL_LIVE_IS_EXPLAINER, &setup);
    if (status != TL_OK) {
        return tl_exit_code(status);
    }
    const tl_options options = {.subject = setup.job.database,
                                .beside = setup.config.path,
                                .finding = setup.job.finding,
                                .save = true,
                                .memory_limit_mib = (setup.job.memory_limit + MIB - 1) / MIB,
                                .unconfined = setup.job.unconfined,
                                .call_limit_s = EXPLAINER_CALL_LIMIT};
    tl_role_open_program();
    status = run_job(&options, true, &job);
    if (status != TL_OK && job.error.text[0] != '\0') {
        tl_log(TL_LOG_NOTICE, "the finding could not be explained: %s", job.error.text);
        job.error.text[0] = '\0';
    }
    return tl_verb_job_end(&job, status);
}
