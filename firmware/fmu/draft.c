/* Draft of a configuration: see draft.h. */
#include "firmware/fmu/draft.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/json.h"
#include "firmware/fmu/common_units.h"

/* ---- names ---- */

enum { LONGEST = 320 };

const char *tl_draft_fmu_name(const tl_draft *draft, size_t index) {
    return draft->fmus[index].name;
}

const char *tl_draft_signal_name(const tl_draft *draft, size_t index) {
    return draft->signals[index].name;
}

/* Of ASCII. */
static bool is_letter(char character) {
    return (character >= '0' && character <= '9') || (character >= 'A' && character <= 'Z') ||
           (character >= 'a' && character <= 'z');
}

static char lower(char character) {
    return character >= 'A' && character <= 'Z' ? (char)(character - 'A' + 'a') : character;
}

void tl_draft_name(const char *text, const char *(*name_of)(const tl_draft *draft, size_t index), const tl_draft *draft,
                   size_t count, char name[TL_DRAFT_NAME]) {
    enum { NUMBER = 4 }; /* characters left for a number */
    size_t length = 0;
    if ((text[0] >= '0' && text[0] <= '9') || text[0] == '\0' || strcmp(text, "plant") == 0) {
        name[length++] = '_';
    }
    for (; *text != '\0' && length + NUMBER < TL_DRAFT_NAME; text++) {
        name[length++] = is_letter(*text) ? *text : '_';
    }
    name[length] = '\0';
    int number = 1;
    for (size_t i = 0; i < count; i++) {
        if (strcmp(name_of(draft, i), name) == 0) {
            (void)snprintf(name + length, TL_DRAFT_NAME - length, "_%d", ++number);
            i = SIZE_MAX; /* compares with all again */
        }
    }
}

void tl_draft_variable(const tl_draft *draft, size_t fmu, const tl_variable *variable, char path[TL_DRAFT_PATH]) {
    (void)snprintf(path, TL_DRAFT_PATH, "%s.%s", draft->fmus[fmu].name, variable->name);
}

/* Copies letters and digits only, in lower case. */
static void reduce(const char *text, char reduced[LONGEST]) {
    size_t length = 0;
    for (const char *at = text; *at != '\0' && length + 1 < LONGEST; at++) {
        reduced[length] = lower(*at);
        length += is_letter(*at) ? 1 : 0;
    }
    reduced[length] = '\0';
}

static bool are_alike(const char *one, const char *other) {
    char first[LONGEST];
    char second[LONGEST];
    reduce(one, first);
    reduce(other, second);
    return first[0] != '\0' && strcmp(first, second) == 0;
}

/* How well a name fits a variable; 0: not. */
static int find_fit(const tl_draft *draft, const tl_draft_port *port, const char *name) {
    char path[TL_DRAFT_PATH];
    const char *dot = strrchr(port->variable->name, '.');
    tl_draft_variable(draft, port->fmu, port->variable, path);
    return are_alike(name, path)                          ? 4
           : are_alike(name, port->variable->name)        ? 3
           : dot != NULL && are_alike(name, dot + 1)      ? 2
           : are_alike(name, port->variable->description) ? 1
                                                          : 0;
}

/* ---- connections ---- */

static bool is_input(const tl_draft_port *port) {
    return port->variable->causality == TL_INPUT;
}

static void find_ports(tl_draft *draft) {
    for (size_t k = 0; k < draft->fmu_count; k++) {
        const tl_model *model = draft->fmus[k].model;
        for (size_t i = 0; i < model->variable_count && draft->port_count < TL_DRAFT_PORTS; i++) {
            const tl_variable *variable = &model->variables[i];
            bool is_port = variable->causality == TL_INPUT || variable->causality == TL_OUTPUT;
            if (is_port && !variable->is_ambiguous &&
                strlen(draft->fmus[k].name) + strlen(variable->name) + 2 < TL_DRAFT_PATH) {
                draft->ports[draft->port_count++] =
                    (tl_draft_port){.fmu = k, .variable = variable, .from = SIZE_MAX, .signal = SIZE_MAX};
            }
        }
    }
}

static const char *unit_of(const tl_variable *variable) {
    return variable->unit != NULL ? variable->unit->name : "";
}

static bool may_feed(const tl_draft_port *output, const tl_draft_port *input) {
    const char *unit = unit_of(output->variable);
    const char *other = unit_of(input->variable);
    return !is_input(output) && output->fmu != input->fmu && output->variable->type == input->variable->type &&
           (unit[0] == '\0' || other[0] == '\0' || strcmp(unit, other) == 0) &&
           are_alike(output->variable->name, input->variable->name);
}

/* The only output that may feed the input; SIZE_MAX: none, or several. */
static size_t find_output(const tl_draft *draft, const tl_draft_port *input) {
    size_t found = SIZE_MAX;
    size_t count = 0;
    for (size_t i = 0; i < draft->port_count; i++) {
        if (may_feed(&draft->ports[i], input)) {
            found = i;
            count++;
        }
    }
    return count == 1 ? found : SIZE_MAX;
}

static bool have_one_unit(const tl_draft_port *output, const tl_draft_port *input) {
    const char *unit = unit_of(output->variable);
    return !is_input(output) && is_input(input) && output->fmu != input->fmu && unit[0] != '\0' &&
           strcmp(unit, unit_of(input->variable)) == 0;
}

/* Connects the only output and the only input with a unit. */
static void guess_by_unit(tl_draft *draft, size_t index) {
    tl_draft_port *input = &draft->ports[index];
    size_t found = SIZE_MAX;
    size_t outputs = 0;
    size_t inputs = 0;
    for (size_t i = 0; i < draft->port_count; i++) {
        bool fits = have_one_unit(&draft->ports[i], input);
        found = fits ? i : found;
        outputs += fits ? 1 : 0;
    }
    for (size_t i = 0; i < draft->port_count && outputs == 1; i++) {
        inputs += have_one_unit(&draft->ports[found], &draft->ports[i]) ? 1 : 0;
    }
    if (outputs == 1 && inputs == 1) {
        input->from = found;
        input->is_guess = true;
    }
}

/* The only port that fits a signal best; SIZE_MAX: none, or several. */
static size_t find_port(const tl_draft *draft, const tl_draft_signal *signal) {
    size_t found = SIZE_MAX;
    int best = 0;
    size_t count = 0;
    for (size_t i = 0; i < draft->port_count; i++) {
        const tl_draft_port *port = &draft->ports[i];
        int fit = port->from == SIZE_MAX && port->signal == SIZE_MAX ? find_fit(draft, port, signal->name) : 0;
        int by_column = fit == 0 && signal->column[0] != '\0' && port->from == SIZE_MAX && port->signal == SIZE_MAX
                            ? find_fit(draft, port, signal->column)
                            : 0;
        fit = fit > by_column ? fit : by_column;
        count = fit > best ? 1 : fit == best ? count + 1 : count;
        found = fit > best ? i : found;
        best = fit > best ? fit : best;
    }
    return best > 0 && count == 1 ? found : SIZE_MAX;
}

static void use_signal(tl_draft *draft, size_t signal, size_t port) {
    draft->signals[signal].port = port;
    draft->ports[port].signal = signal;
    if (!is_input(&draft->ports[port]) && draft->ports[port].variable->type == TL_REAL &&
        draft->match_count < TL_MAX_MATCH) {
        draft->matches[draft->match_count++] = (tl_draft_match){.port = port, .signal = signal};
    }
}

static void make_signals(tl_draft *draft) {
    for (size_t i = 0; i < draft->port_count && draft->signal_count < TL_MAX_SIGNALS; i++) {
        const tl_draft_port *port = &draft->ports[i];
        bool is_wanted = is_input(port) ? port->from == SIZE_MAX && port->variable->type != TL_STRING
                                        : port->variable->type == TL_REAL;
        if (is_wanted) {
            tl_draft_signal *signal = &draft->signals[draft->signal_count];
            const char *dot = strrchr(port->variable->name, '.');
            *signal = (tl_draft_signal){
                .least = (double)NAN, .most = (double)NAN, .middle = (double)NAN, .sigma = (double)NAN};
            tl_draft_name(dot != NULL ? dot + 1 : port->variable->name, tl_draft_signal_name, draft,
                          draft->signal_count, signal->name);
            use_signal(draft, draft->signal_count++, i);
        }
    }
}

static bool lacks_source(const tl_draft_port *port) {
    return is_input(port) && port->from == SIZE_MAX && port->signal == SIZE_MAX && port->variable->type != TL_STRING;
}

/* Cuts the next word off *rest, in lower case; false: there is none. */
static bool next_word(const char **rest, char word[LONGEST]) {
    size_t length = 0;
    while (**rest != '\0' && !is_letter(**rest)) {
        (*rest)++;
    }
    for (; is_letter(**rest) && length + 1 < LONGEST; (*rest)++) {
        word[length++] = lower(**rest);
    }
    word[length] = '\0';
    return length > 0;
}

/* True if the description has the name as a word of at least four letters. */
static bool is_described(const tl_variable *variable, const char *name) {
    enum { SHORTEST = 4 };
    const char *rest = variable->description;
    char reduced[LONGEST];
    char word[LONGEST];
    bool is_found = false;
    reduce(name, reduced);
    while (next_word(&rest, word)) {
        is_found = is_found || (strlen(word) >= SHORTEST && strcmp(word, reduced) == 0);
    }
    return is_found;
}

/* Connects a signal with the only variable whose description has its name. */
static void guess_by_description(tl_draft *draft, size_t signal) {
    size_t found = SIZE_MAX;
    size_t count = 0;
    for (size_t i = 0; i < draft->port_count; i++) {
        const tl_draft_port *port = &draft->ports[i];
        bool is_free = port->from == SIZE_MAX && port->signal == SIZE_MAX;
        bool fits = is_free && is_described(port->variable, draft->signals[signal].name);
        found = fits ? i : found;
        count += fits ? 1 : 0;
    }
    if (count == 1) {
        use_signal(draft, signal, found);
        draft->ports[found].is_guess = true;
    }
}

/* Connects the only signal and the only input that are left. */
static void guess_last(tl_draft *draft) {
    size_t port = SIZE_MAX;
    size_t signal = SIZE_MAX;
    size_t ports = 0;
    size_t signals = 0;
    for (size_t i = 0; i < draft->port_count; i++) {
        bool lacks = lacks_source(&draft->ports[i]) && draft->ports[i].variable->type == TL_REAL;
        port = lacks ? i : port;
        ports += lacks ? 1 : 0;
    }
    for (size_t i = 0; i < draft->signal_count; i++) {
        bool is_left = draft->signals[i].port == SIZE_MAX;
        signal = is_left ? i : signal;
        signals += is_left ? 1 : 0;
    }
    if (ports == 1 && signals == 1) {
        use_signal(draft, signal, port);
        draft->ports[port].is_guess = true;
    }
}

/* A signal without use stays if it may feed an input, and if there is room. */
static void drop_unused(tl_draft *draft) {
    size_t kept = 0;
    size_t room = TL_MAX_SIGNALS;
    bool lacks = false;
    for (size_t i = 0; i < draft->signal_count; i++) {
        room -= draft->signals[i].port != SIZE_MAX ? 1 : 0;
    }
    for (size_t i = 0; i < draft->port_count; i++) {
        lacks = lacks || lacks_source(&draft->ports[i]);
    }
    for (size_t i = 0; i < draft->signal_count; i++) {
        const tl_draft_signal signal = draft->signals[i];
        bool is_used = signal.port != SIZE_MAX;
        if (is_used || (room > 0 && (lacks || signal.entry != NULL))) {
            room -= is_used ? 0 : 1;
            if (signal.port != SIZE_MAX) {
                draft->ports[signal.port].signal = kept;
            }
            for (size_t m = 0; m < draft->match_count; m++) {
                draft->matches[m].signal = draft->matches[m].signal == i ? kept : draft->matches[m].signal;
            }
            draft->signals[kept++] = signal;
        }
    }
    draft->signal_count = kept;
}

void tl_draft_link(tl_draft *draft) {
    find_ports(draft);
    for (size_t i = 0; i < draft->port_count; i++) {
        tl_draft_port *port = &draft->ports[i];
        port->from = is_input(port) ? find_output(draft, port) : SIZE_MAX;
    }
    size_t used = 0;
    for (size_t i = 0; i < draft->signal_count && used < TL_MAX_SIGNALS - 1; i++) { /* one for guess_last() */
        size_t port = find_port(draft, &draft->signals[i]);
        if (port != SIZE_MAX) {
            use_signal(draft, i, port);
            used++;
        }
    }
    for (size_t i = 0; i < draft->signal_count && used < TL_MAX_SIGNALS - 1; i++) {
        if (draft->signals[i].port == SIZE_MAX) {
            guess_by_description(draft, i);
            used += draft->signals[i].port != SIZE_MAX ? 1 : 0;
        }
    }
    for (size_t i = 0; i < draft->port_count; i++) {
        if (lacks_source(&draft->ports[i])) {
            guess_by_unit(draft, i);
        }
    }
    if (draft->signal_count == 0) {
        make_signals(draft);
    } else {
        guess_last(draft);
        drop_unused(draft);
    }
}

/* ---- tolerances and what can be adjusted ---- */

/* Rounds to so many significant digits. */
static double rounded(double value, int digits) {
    char text[32];
    (void)snprintf(text, sizeof text, "%.*g", digits, value);
    return strtod(text, NULL);
}

static double size_of(const tl_variable *variable) {
    double start = variable->has_start ? fabs(variable->start.real) : 0.0;
    return start > 0.0 ? start : variable->nominal;
}

static void propose_tolerance(const tl_draft *draft, tl_draft_match *match) {
    const tl_draft_signal *signal = &draft->signals[match->signal];
    double range = signal->most - signal->least;
    match->is_estimated = signal->sigma > 0.0;
    match->tolerance = signal->sigma > 0.0 ? 3.0 * signal->sigma
                       : range > 0.0       ? range / 100.0
                                           : size_of(draft->ports[match->port].variable) / 100.0;
    match->tolerance = rounded(match->tolerance, 3);
}

static void propose_range(const tl_draft *draft, tl_draft_candidate *candidate) {
    const tl_variable *variable = candidate->variable;
    const size_t signal = candidate->port != SIZE_MAX ? draft->ports[candidate->port].signal : SIZE_MAX;
    double range = variable->maximum - variable->minimum;
    candidate->lower = -HUGE_VAL;
    candidate->upper = HUGE_VAL;
    candidate->step = size_of(variable) / 10.0;
    if (signal != SIZE_MAX && draft->signals[signal].most > draft->signals[signal].least) {
        candidate->step = (draft->signals[signal].most - draft->signals[signal].least) / 20.0;
    } else if (isfinite(range)) {
        candidate->step = fmin(candidate->step, range / 20.0);
    } else if (candidate->port == SIZE_MAX && fabs(variable->start.real) > 0.0) {
        double small = rounded(variable->start.real / 10.0, 2);
        double large = rounded(variable->start.real * 10.0, 2);
        candidate->lower = fmax(fmin(small, large), variable->minimum);
        candidate->upper = fmin(fmax(small, large), variable->maximum);
    }
    candidate->step = rounded(candidate->step, 2);
}

/* Marks the FMUs from which a chain of connections leads to a matched output. */
static void find_reach(const tl_draft *draft, bool reaches[TL_DRAFT_FMUS]) {
    for (size_t k = 0; k < draft->fmu_count; k++) {
        reaches[k] = false;
    }
    for (size_t m = 0; m < draft->match_count; m++) {
        reaches[draft->ports[draft->matches[m].port].fmu] = true;
    }
    for (bool is_new = true; is_new;) {
        is_new = false;
        for (size_t i = 0; i < draft->port_count; i++) {
            const tl_draft_port *port = &draft->ports[i];
            if (port->from != SIZE_MAX && reaches[port->fmu] && !reaches[draft->ports[port->from].fmu]) {
                reaches[draft->ports[port->from].fmu] = is_new = true;
            }
        }
    }
}

static void add_candidate(tl_draft *draft, tl_draft_candidate candidate) {
    if (draft->candidate_count < TL_DRAFT_CANDIDATES) {
        propose_range(draft, &candidate);
        draft->candidates[draft->candidate_count] = candidate;
        draft->candidate_count += candidate.step > 0.0 ? 1 : 0;
    }
}

void tl_draft_propose(tl_draft *draft) {
    bool reaches[TL_DRAFT_FMUS];
    find_reach(draft, reaches);
    for (size_t m = 0; m < draft->match_count; m++) {
        propose_tolerance(draft, &draft->matches[m]);
    }
    for (size_t i = 0; i < draft->port_count; i++) {
        const tl_draft_port *port = &draft->ports[i];
        if (is_input(port) && port->variable->type == TL_REAL && reaches[port->fmu]) {
            add_candidate(draft, (tl_draft_candidate){.fmu = port->fmu, .variable = port->variable, .port = i});
        }
    }
    for (size_t k = 0; k < draft->fmu_count; k++) {
        const tl_model *model = draft->fmus[k].model;
        for (size_t i = 0; i < model->variable_count && reaches[k]; i++) {
            const tl_variable *variable = &model->variables[i];
            if (variable->causality == TL_PARAMETER && variable->variability == TL_TUNABLE &&
                variable->type == TL_REAL && variable->has_start && !variable->is_ambiguous &&
                strlen(draft->fmus[k].name) + strlen(variable->name) + 2 < TL_DRAFT_PATH) {
                add_candidate(draft, (tl_draft_candidate){.fmu = k, .variable = variable, .port = SIZE_MAX});
            }
        }
    }
}

/* The lower, the sooner it is chosen. */
static int rank_of(const tl_draft *draft, const tl_draft_candidate *candidate) {
    const tl_draft_port *port = candidate->port != SIZE_MAX ? &draft->ports[candidate->port] : NULL;
    bool is_fed = port != NULL && !lacks_source(port);
    bool is_far = draft->ports[draft->matches[candidate->match].port].fmu != candidate->fmu;
    return (is_fed ? 2 : 0) + (is_far ? 1 : 0);
}

static bool is_better(const tl_draft *draft, const tl_draft_candidate *one, const tl_draft_candidate *other) {
    int first = rank_of(draft, one);
    int second = rank_of(draft, other);
    return first != second ? first < second : one->most > other->most;
}

void tl_draft_choose(tl_draft *draft) {
    size_t chosen = 0;
    for (size_t m = 0; m < draft->match_count && chosen < TL_MAX_ADJUST; m++) {
        tl_draft_candidate *best = NULL;
        for (size_t i = 0; i < draft->candidate_count; i++) {
            tl_draft_candidate *candidate = &draft->candidates[i];
            bool reacts = candidate->is_tried && candidate->match == m && candidate->most > 0.0;
            best = reacts && (best == NULL || is_better(draft, candidate, best)) ? candidate : best;
        }
        if (best != NULL) {
            best->is_chosen = true;
            chosen++;
        }
    }
}

static size_t find_chosen(const tl_draft *draft, size_t match) {
    for (size_t i = 0; i < draft->candidate_count; i++) {
        if (draft->candidates[i].is_chosen && draft->candidates[i].match == match) {
            return i;
        }
    }
    return SIZE_MAX;
}

size_t tl_draft_find_next(const tl_draft *draft) {
    size_t best = SIZE_MAX;
    for (size_t i = 0; i < draft->candidate_count; i++) {
        const tl_draft_candidate *candidate = &draft->candidates[i];
        bool is_new = candidate->is_tried && candidate->most > 0.0 && !candidate->is_chosen &&
                      !candidate->is_left_out && find_chosen(draft, candidate->match) != SIZE_MAX;
        best = is_new && (best == SIZE_MAX || is_better(draft, candidate, &draft->candidates[best])) ? i : best;
    }
    return best;
}

size_t tl_draft_replace(tl_draft *draft, size_t candidate) {
    size_t replaced = find_chosen(draft, draft->candidates[candidate].match);
    draft->candidates[replaced].is_chosen = false;
    draft->candidates[replaced].is_left_out = true;
    draft->candidates[candidate].is_chosen = true;
    draft->candidates[candidate].is_left_out = false;
    return replaced;
}

/* ---- the text ---- */

static void add_copy(tl_json_writer *writer, const char *key, const cJSON *value) {
    cJSON *copy = cJSON_Duplicate(value, 1);
    if (copy == NULL || writer->open[writer->depth - 1] == NULL ||
        !cJSON_AddItemToObject(writer->open[writer->depth - 1], key, copy)) {
        cJSON_Delete(copy);
        writer->failed = true;
    }
}

static bool is_adjusted(const tl_draft *draft, tl_draft_kind kind, size_t tried, size_t candidate) {
    return kind == TL_DRAFT_TRIED ? candidate == tried
                                  : kind == TL_DRAFT_FINAL && draft->candidates[candidate].is_chosen;
}

static bool is_port_adjusted(const tl_draft *draft, tl_draft_kind kind, size_t tried, size_t port) {
    bool is_found = false;
    for (size_t i = 0; i < draft->candidate_count; i++) {
        is_found = is_found || (draft->candidates[i].port == port && is_adjusted(draft, kind, tried, i));
    }
    return is_found;
}

/* Marks the FMUs to which a chain of connections leads from an adjusted variable. */
static void find_reached(const tl_draft *draft, tl_draft_kind kind, size_t tried, bool reached[TL_DRAFT_FMUS]) {
    for (size_t k = 0; k < draft->fmu_count; k++) {
        reached[k] = false;
    }
    for (size_t i = 0; i < draft->candidate_count; i++) {
        reached[draft->candidates[i].fmu] = reached[draft->candidates[i].fmu] || is_adjusted(draft, kind, tried, i);
    }
    for (bool is_new = true; is_new;) {
        is_new = false;
        for (size_t i = 0; i < draft->port_count; i++) {
            const tl_draft_port *port = &draft->ports[i];
            if (port->from != SIZE_MAX && reached[draft->ports[port->from].fmu] && !reached[port->fmu]) {
                reached[port->fmu] = is_new = true;
            }
        }
    }
}

static void open_set(tl_json_writer *writer, bool *is_open) {
    if (!*is_open) {
        tl_json_open_object(writer, "set");
        *is_open = true;
    }
}

/* True if by its name a variable is the start value of an output: level_start, initial_level. */
static bool is_start_of(const tl_variable *variable, const tl_variable *output) {
    static const char *const words[] = {"start", "initial", "init", "0"};
    char name[LONGEST];
    char wanted[2 * LONGEST];
    char end[LONGEST];
    bool is_found = false;
    bool can_start = variable->type == TL_REAL && output->type == TL_REAL && variable->has_start &&
                     variable->causality != TL_INPUT && variable->variability != TL_CONSTANT && !variable->is_ambiguous;
    reduce(variable->name, name);
    reduce(output->name, end);
    for (size_t i = 0; i < sizeof words / sizeof words[0] && can_start; i++) {
        (void)snprintf(wanted, sizeof wanted, "%s%s", end, words[i]);
        is_found = is_found || strcmp(name, wanted) == 0;
        (void)snprintf(wanted, sizeof wanted, "%s%s", words[i], end);
        is_found = is_found || (strcmp(words[i], "0") != 0 && strcmp(name, wanted) == 0);
    }
    return is_found && strcmp(unit_of(variable), unit_of(output)) == 0;
}

/* Start values of matched outputs: the twin starts in the plant's state. */
static void write_starts(const tl_draft *draft, size_t fmu, bool *is_open, tl_json_writer *writer) {
    const tl_model *model = draft->fmus[fmu].model;
    for (size_t m = 0; m < draft->match_count; m++) {
        const tl_draft_port *port = &draft->ports[draft->matches[m].port];
        for (size_t i = 0; i < model->variable_count && port->fmu == fmu; i++) {
            char signal[sizeof "plant." + TL_DRAFT_NAME];
            if (is_start_of(&model->variables[i], port->variable)) {
                (void)snprintf(signal, sizeof signal, "plant.%s", draft->signals[draft->matches[m].signal].name);
                open_set(writer, is_open);
                tl_json_add_text(writer, model->variables[i].name, signal);
                break;
            }
        }
    }
}

/* Writes the constants of the inputs of an FMU that have no source, and start values. */
static void write_constants(const tl_draft *draft, tl_draft_kind kind, size_t tried, size_t fmu,
                            tl_json_writer *writer) {
    bool is_open = false;
    write_starts(draft, fmu, &is_open, writer);
    for (size_t i = 0; i < draft->port_count; i++) {
        const tl_draft_port *port = &draft->ports[i];
        const tl_variable *variable = port->variable;
        if (port->fmu != fmu || !is_input(port) || port->from != SIZE_MAX || port->signal != SIZE_MAX ||
            is_port_adjusted(draft, kind, tried, i)) {
            continue;
        }
        open_set(writer, &is_open);
        if (variable->type == TL_STRING) {
            tl_json_add_text(writer, variable->name, variable->has_start ? variable->start.text : "");
        } else if (variable->type == TL_BOOLEAN) {
            tl_json_add_truth(writer, variable->name, variable->has_start && variable->start.integer != 0);
        } else {
            double start = !variable->has_start        ? 0.0
                           : variable->type == TL_REAL ? variable->start.real
                                                       : (double)variable->start.integer;
            tl_json_add_number(writer, variable->name, fmin(fmax(start, variable->minimum), variable->maximum));
        }
    }
    if (is_open) {
        tl_json_close(writer);
    }
}

static void write_components(const tl_draft *draft, tl_draft_kind kind, size_t tried, tl_json_writer *writer) {
    tl_json_open_object(writer, "components");
    for (size_t k = 0; k < draft->fmu_count; k++) {
        tl_json_open_object(writer, draft->fmus[k].name);
        tl_json_add_text(writer, "fmu", draft->fmus[k].file);
        write_constants(draft, kind, tried, k, writer);
        tl_json_close(writer);
    }
    tl_json_close(writer);
}

static void write_sources(const tl_draft *draft, tl_json_writer *writer) {
    if (draft->sources != NULL) {
        add_copy(writer, "sources", draft->sources);
    } else if (draft->host != NULL) {
        tl_json_open_object(writer, "sources");
        tl_json_open_object(writer, "plc");
        tl_json_open_object(writer, "modbus_tcp");
        tl_json_add_text(writer, "host", draft->host);
        if (draft->port != 0) {
            tl_json_add_count(writer, "port", draft->port);
        }
        tl_json_close(writer);
        tl_json_close(writer);
        tl_json_close(writer);
    }
}

static tl_type type_of(const tl_draft *draft, const tl_draft_signal *signal) {
    tl_type type = signal->port != SIZE_MAX ? draft->ports[signal->port].variable->type : TL_REAL;
    return type == TL_ENUMERATION ? TL_INTEGER : type;
}

/* The address is a placeholder: `fill_in` names it. */
static void write_modbus(tl_type type, size_t index, tl_json_writer *writer) {
    tl_json_open_object(writer, "modbus");
    tl_json_add_text(writer, "source", "plc");
    tl_json_add_text(writer, "table", type == TL_BOOLEAN ? "coil" : "holding");
    tl_json_add_count(writer, "address", 2 * index);
    if (type != TL_BOOLEAN) {
        tl_json_add_text(writer, "type", type == TL_REAL ? "float32" : "int16");
    }
    tl_json_close(writer);
}

/* The FMU's unit, because values are used in it. */
static const char *signal_unit(const tl_draft *draft, const tl_draft_signal *signal) {
    const char *unit = signal->port != SIZE_MAX ? unit_of(draft->ports[signal->port].variable) : "";
    return unit[0] != '\0' ? unit : signal->unit;
}

/* Finds how the column's values become values in the FMU's unit, if the recording states another
 * one. Returns false if there is no such unit, or it is unknown. */
static bool find_conversion(const tl_draft *draft, const tl_draft_signal *signal, tl_conversion *conversion) {
    const tl_draft_port *port = signal->port != SIZE_MAX ? &draft->ports[signal->port] : NULL;
    const tl_unit *unit = port != NULL ? port->variable->unit : NULL;
    const tl_unit named = {.name = signal->unit};
    const tl_unit *known = port != NULL ? tl_model_unit(draft->fmus[port->fmu].model, signal->unit) : NULL;
    return unit != NULL && signal->unit[0] != '\0' && strcmp(signal->unit, unit->name) != 0 &&
           tl_common_units_convert(known != NULL ? known : &named, unit, conversion);
}

static void write_column(const tl_draft *draft, const tl_draft_signal *signal, tl_json_writer *writer) {
    tl_conversion conversion = {.factor = 1.0};
    const bool is_named = signal->column[0] != '\0' && strcmp(signal->column, signal->name) != 0;
    (void)find_conversion(draft, signal, &conversion);
    if (!is_named && tl_conversion_is_identity(&conversion)) {
        return;
    }
    tl_json_open_object(writer, "csv");
    if (is_named) {
        tl_json_add_text(writer, "column", signal->column);
    }
    if (conversion.factor != 1.0) {
        tl_json_add_number(writer, "scale", conversion.factor);
    }
    if (conversion.offset != 0.0) {
        tl_json_add_number(writer, "offset", conversion.offset);
    }
    tl_json_close(writer);
}

static double number_of(const cJSON *object, const char *key, double otherwise) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    return cJSON_IsNumber(item) ? item->valuedouble : otherwise;
}

static bool set_number(cJSON *object, const char *key, double value) {
    cJSON_DeleteItemFromObjectCaseSensitive(object, key);
    return cJSON_AddNumberToObject(object, key, value) != NULL;
}

/* Converts what a driver reads into the FMU's unit: its own scale and offset come first. */
static bool convert_entry(cJSON *entry, const tl_conversion *conversion, bool is_recorded) {
    static const char *const keys[] = {"csv", "modbus", "can"};
    bool is_made = true;
    if (is_recorded && !tl_conversion_is_identity(conversion) &&
        cJSON_GetObjectItemCaseSensitive(entry, "csv") == NULL) {
        is_made = cJSON_AddObjectToObject(entry, "csv") != NULL;
    }
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++) {
        cJSON *address = cJSON_GetObjectItemCaseSensitive(entry, keys[i]);
        double scale = number_of(address, "scale", 1.0) * conversion->factor;
        double offset = number_of(address, "offset", 0.0) * conversion->factor + conversion->offset;
        if (cJSON_IsObject(address) && !tl_conversion_is_identity(conversion)) {
            is_made = is_made && set_number(address, "scale", scale) && set_number(address, "offset", offset);
        }
    }
    return is_made;
}

/* A given signal; in the FMU's unit, if the plant states one that the FMU does not define. */
static void write_entry(const tl_draft *draft, const tl_draft_signal *signal, tl_json_writer *writer) {
    const tl_draft_port *port = signal->port != SIZE_MAX ? &draft->ports[signal->port] : NULL;
    tl_conversion conversion = {.factor = 1.0};
    cJSON *entry = cJSON_Duplicate(signal->entry, 1);
    if (signal->unit[0] != '\0' && port != NULL && port->variable->unit != NULL) {
        (void)find_conversion(draft, signal, &conversion);
        cJSON_DeleteItemFromObjectCaseSensitive(entry, "unit");
        writer->failed = writer->failed || cJSON_AddStringToObject(entry, "unit", port->variable->unit->name) == NULL ||
                         !convert_entry(entry, &conversion, draft->recording != NULL);
    }
    add_copy(writer, signal->name, entry);
    cJSON_Delete(entry);
}

static void write_signal(const tl_draft *draft, tl_draft_kind kind, size_t index, tl_json_writer *writer) {
    const tl_draft_signal *signal = &draft->signals[index];
    const tl_type type = type_of(draft, signal);
    const char *unit = signal_unit(draft, signal);
    if (signal->entry != NULL) {
        write_entry(draft, signal, writer);
        return;
    }
    tl_json_open_object(writer, signal->name);
    if (type != TL_REAL) {
        tl_json_add_text(writer, "type", type == TL_BOOLEAN ? "boolean" : "integer");
    } else if (unit[0] != '\0') {
        tl_json_add_text(writer, "unit", unit);
    }
    if (kind == TL_DRAFT_TRIED && type == TL_REAL && isfinite(signal->middle)) {
        tl_json_add_number(writer, "initial", signal->middle);
    }
    write_column(draft, signal, writer);
    if (draft->host != NULL) {
        write_modbus(type, index, writer);
    }
    tl_json_close(writer);
}

static void write_connection(const char *from, const char *to, tl_json_writer *writer) {
    tl_json_open_array(writer, NULL);
    tl_json_add_text(writer, NULL, from);
    tl_json_add_text(writer, NULL, to);
    tl_json_close(writer);
}

static void write_connections(const tl_draft *draft, tl_json_writer *writer) {
    char from[TL_DRAFT_PATH];
    char to[TL_DRAFT_PATH];
    tl_json_open_array(writer, "connect");
    for (size_t i = 0; i < draft->port_count; i++) {
        const tl_draft_port *port = &draft->ports[i];
        tl_draft_variable(draft, port->fmu, port->variable, to);
        if (is_input(port) && port->from != SIZE_MAX) {
            const tl_draft_port *output = &draft->ports[port->from];
            tl_draft_variable(draft, output->fmu, output->variable, from);
            write_connection(from, to, writer);
        } else if (is_input(port) && port->signal != SIZE_MAX) {
            (void)snprintf(from, sizeof from, "plant.%s", draft->signals[port->signal].name);
            write_connection(from, to, writer);
        }
    }
    tl_json_close(writer);
}

static void open_match(const tl_draft *draft, const tl_draft_match *match, tl_json_writer *writer) {
    char path[TL_DRAFT_PATH];
    char to[TL_DRAFT_PATH];
    const tl_draft_port *port = &draft->ports[match->port];
    tl_draft_variable(draft, port->fmu, port->variable, path);
    (void)snprintf(to, sizeof to, "plant.%s", draft->signals[match->signal].name);
    tl_json_open_object(writer, path);
    tl_json_add_text(writer, "to", to);
}

static void write_compare(const tl_draft *draft, tl_json_writer *writer) {
    tl_json_open_object(writer, "compare");
    for (size_t m = 0; m < draft->match_count; m++) {
        open_match(draft, &draft->matches[m], writer);
        tl_json_close(writer);
    }
    tl_json_close(writer);
}

/* An output that nothing adjusted reaches is only compared. */
static void write_matches(const tl_draft *draft, tl_draft_kind kind, size_t tried, tl_json_writer *writer) {
    bool reached[TL_DRAFT_FMUS];
    find_reached(draft, kind, tried, reached);
    tl_json_open_object(writer, "match");
    for (size_t m = 0; m < draft->match_count; m++) {
        const tl_draft_match *match = &draft->matches[m];
        open_match(draft, match, writer);
        tl_json_add_number(writer, "tolerance", match->tolerance);
        if (!reached[draft->ports[match->port].fmu]) {
            tl_json_add_count(writer, "weight", 0);
        }
        tl_json_close(writer);
    }
    tl_json_close(writer);
}

static void write_adjusted(const tl_draft *draft, const tl_draft_candidate *candidate, tl_json_writer *writer) {
    char path[TL_DRAFT_PATH];
    tl_draft_variable(draft, candidate->fmu, candidate->variable, path);
    tl_json_open_object(writer, path);
    tl_json_add_number(writer, "step", candidate->step);
    if (isfinite(candidate->lower)) {
        tl_json_add_number(writer, "min", candidate->lower);
    }
    if (isfinite(candidate->upper)) {
        tl_json_add_number(writer, "max", candidate->upper);
    }
    tl_json_close(writer);
}

static void write_synchronise(const tl_draft *draft, tl_draft_kind kind, size_t tried, tl_json_writer *writer) {
    tl_json_open_object(writer, "synchronise");
    tl_json_open_object(writer, "adjust");
    for (size_t i = 0; i < draft->candidate_count; i++) {
        if (is_adjusted(draft, kind, tried, i)) {
            write_adjusted(draft, &draft->candidates[i], writer);
        }
    }
    tl_json_close(writer);
    write_matches(draft, kind, tried, writer);
    tl_json_close(writer);
}

/* ---- what the user must fill in ---- */

static bool adjusts(const tl_draft *draft, tl_draft_kind kind, size_t tried) {
    bool is_any = false;
    for (size_t i = 0; i < draft->candidate_count; i++) {
        is_any = is_any || is_adjusted(draft, kind, tried, i);
    }
    return is_any && draft->match_count != 0;
}

/* `key`: place in the configuration. */
static void ask(tl_json_writer *writer, const char *key, const char *format, ...) TL_PRINTF(3, 4);

static void ask(tl_json_writer *writer, const char *key, const char *format, ...) {
    char text[TL_DRAFT_FILL_IN];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    tl_json_add_text(writer, key, text);
}

static void ask_for_unit(const tl_draft *draft, const tl_draft_signal *signal, tl_json_writer *writer) {
    const char *unit = signal_unit(draft, signal);
    tl_conversion conversion;
    char key[TL_DRAFT_PATH];
    char offset[32] = "";
    if (signal->unit[0] == '\0' || strcmp(signal->unit, unit) == 0) {
        return;
    }
    if (!find_conversion(draft, signal, &conversion)) {
        (void)snprintf(key, sizeof key, "plant.%s.unit", signal->name);
        ask(writer, key, "the FMU has %.40s, the plant %.40s: set scale and offset", unit, signal->unit);
    } else if (!tl_conversion_is_identity(&conversion)) {
        (void)snprintf(key, sizeof key, "plant.%s.%s", signal->name, signal->entry == NULL ? "csv" : "unit");
        if (conversion.offset != 0.0) {
            (void)snprintf(offset, sizeof offset, ", offset %.6g", conversion.offset);
        }
        ask(writer, key, "%.40s -> %.40s: %.6g%s; correct it if it is wrong", signal->unit, unit, conversion.factor,
            offset);
    }
}

static void ask_signal(const tl_draft *draft, const tl_draft_signal *signal, tl_json_writer *writer) {
    const tl_variable *variable = signal->port != SIZE_MAX ? draft->ports[signal->port].variable : NULL;
    const char *unit = signal_unit(draft, signal);
    const char *what = variable != NULL && variable->description[0] != '\0' ? variable->description : signal->name;
    char key[TL_DRAFT_PATH];
    if (signal->entry == NULL && draft->host != NULL) {
        (void)snprintf(key, sizeof key, "plant.%s.modbus", signal->name);
        ask(writer, key, "table, address, type and scale of: %.100s%s%.40s", what, unit[0] != '\0' ? ", in " : "",
            unit);
    } else if (signal->entry == NULL && signal->column[0] == '\0') {
        (void)snprintf(key, sizeof key, "plant.%s", signal->name);
        ask(writer, key, "csv, modbus, can or gpio: where it is read: %.100s", what);
    }
    if (variable == NULL) {
        (void)snprintf(key, sizeof key, "plant.%s", signal->name);
        ask(writer, key, "connect it to an input, match an output with it, or remove it");
    } else {
        ask_for_unit(draft, signal, writer);
    }
}

static void ask_for_connection(const tl_draft *draft, size_t index, tl_json_writer *writer) {
    const tl_draft_port *port = &draft->ports[index];
    char input[TL_DRAFT_PATH];
    char key[TL_DRAFT_PATH + TL_DRAFT_NAME];
    char from[TL_DRAFT_PATH];
    tl_draft_variable(draft, port->fmu, port->variable, input);
    (void)snprintf(key, sizeof key, "%s %s", is_input(port) ? "connect" : "match", input);
    if (port->is_guess && port->from != SIZE_MAX) {
        const tl_draft_port *output = &draft->ports[port->from];
        tl_draft_variable(draft, output->fmu, output->variable, from);
        ask(writer, key, "from %.120s: guessed by the unit %.40s; correct it if it is wrong", from,
            unit_of(port->variable));
    } else if (port->is_guess) {
        ask(writer, key, "from plant.%s: guessed; correct it if it is wrong", draft->signals[port->signal].name);
    } else if (lacks_source(port) && !is_port_adjusted(draft, TL_DRAFT_FINAL, 0, index)) {
        (void)snprintf(key, sizeof key, "components.%s.set.%s", draft->fmus[port->fmu].name, port->variable->name);
        ask(writer, key, "the right constant; or remove it and connect %.120s", input);
    }
}

static void ask_for_limits(const tl_draft *draft, const tl_draft_candidate *candidate, tl_json_writer *writer) {
    char path[TL_DRAFT_PATH];
    char key[TL_DRAFT_PATH + TL_DRAFT_NAME];
    bool is_limited = isfinite(fmax(candidate->lower, candidate->variable->minimum)) &&
                      isfinite(fmin(candidate->upper, candidate->variable->maximum));
    if (candidate->is_chosen && !is_limited) {
        tl_draft_variable(draft, candidate->fmu, candidate->variable, path);
        (void)snprintf(key, sizeof key, "synchronise.adjust.%s", path);
        ask(writer, key, "min and max that the plant can have");
    }
}

static void ask_for_match(const tl_draft *draft, const tl_draft_match *match, tl_json_writer *writer) {
    char path[TL_DRAFT_PATH];
    char key[TL_DRAFT_PATH + TL_DRAFT_NAME];
    if (!match->is_estimated) {
        tl_draft_variable(draft, draft->ports[match->port].fmu, draft->ports[match->port].variable, path);
        (void)snprintf(key, sizeof key, "synchronise.match.%s.tolerance", path);
        ask(writer, key, "three times the noise of the signal");
    }
}

static void write_fill_in(const tl_draft *draft, tl_json_writer *writer) {
    tl_json_open_object(writer, "fill_in");
    if (!draft->is_step_known) {
        ask(writer, "step_s", "the cycle in which the signals are read");
    }
    for (size_t i = 0; i < draft->signal_count; i++) {
        ask_signal(draft, &draft->signals[i], writer);
    }
    for (size_t i = 0; i < draft->port_count; i++) {
        ask_for_connection(draft, i, writer);
    }
    for (size_t i = 0; i < draft->candidate_count; i++) {
        ask_for_limits(draft, &draft->candidates[i], writer);
    }
    bool is_any = adjusts(draft, TL_DRAFT_FINAL, 0);
    if (draft->match_count == 0) {
        ask(writer, "synchronise.match", "the output that the plant measures");
    } else if (!is_any) {
        ask(writer, "synchronise.adjust", "what may be corrected: nothing moved a matched output");
    }
    for (size_t m = 0; m < draft->match_count && is_any; m++) {
        ask_for_match(draft, &draft->matches[m], writer);
    }
    tl_json_close(writer);
}

static void write_record(const tl_draft *draft, tl_json_writer *writer) {
    char file[TL_DRAFT_PATH];
    (void)snprintf(file, sizeof file, "%.200s.db", draft->name);
    tl_json_open_object(writer, "record");
    tl_json_add_text(writer, "file", file);
    tl_json_close(writer);
}

static void write_all(const tl_draft *draft, tl_draft_kind kind, size_t tried, tl_json_writer *writer) {
    tl_json_add_count(writer, "twinlock", 1);
    tl_json_add_text(writer, "name", draft->name);
    tl_json_add_number(writer, "step_s", draft->step_s);
    if (kind == TL_DRAFT_FINAL) {
        write_fill_in(draft, writer);
    }
    write_components(draft, kind, tried, writer);
    write_sources(draft, writer);
    tl_json_open_object(writer, "plant");
    for (size_t i = 0; i < draft->signal_count; i++) {
        write_signal(draft, kind, i, writer);
    }
    tl_json_close(writer);
    if (kind == TL_DRAFT_FINAL) {
        write_record(draft, writer);
    }
    if (draft->recording != NULL) {
        tl_json_open_object(writer, "recording");
        tl_json_add_text(writer, "file", draft->recording);
        tl_json_add_text(writer, "time_column", draft->time_column);
        tl_json_close(writer);
    }
    write_connections(draft, writer);
    if (adjusts(draft, kind, tried)) {
        write_synchronise(draft, kind, tried, writer);
    } else if (draft->match_count != 0) {
        write_compare(draft, writer);
    }
}

char *tl_draft_text(const tl_draft *draft, tl_draft_kind kind, size_t tried) {
    tl_json_writer writer;
    tl_error error;
    char *text = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&text, &size);
    tl_json_writer_begin(&writer);
    write_all(draft, kind, tried, &writer);
    tl_status status = file != NULL ? tl_json_writer_print(&writer, file, &error) : TL_TRY_AGAIN;
    tl_json_writer_free(&writer);
    if (file == NULL || fclose(file) != 0 || status != TL_OK) {
        free(text);
        return NULL;
    }
    return text;
}
