/* Change detector: see change_detector.h. */
#include "firmware/monitor/change_detector.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/monitor/change_series.h"
#include "firmware/monitor/limit_window.h"

enum {
    STARTS = 64,         /* releases that are remembered */
    START_RELEASES = 10, /* left out after a start; but one, or this part of the learning time: */
    PARTS_OF_LEARNING = 10,
    RELEASE = 150, /* steps, if there are no released twins */
    GAP = 10,      /* steps without values that are a gap */
    BANKS = 4,
    LEVELS = 8, /* newest findings whose level is known, of a quantity */
    CYCLE = BANKS - 1,
    FORMAT = 2 /* of the stored bytes */
};

/* Block lengths; the last one is replaced by a longer cycle. */
static const uint32_t BLOCKS[BANKS] = {10, 30, 120, 3000};

/* Least deviation of a block mean: of a correction in search steps, of an output in tolerances. */
static const double LEAST_CORRECTION = 0.02;
static const double LEAST_OUTPUT = 0.05;

/* Least size of a finding: of an output in tolerances; of a correction as a part of û, and in
 * search steps. */
static const double LEAST_FINDING = 0.1;
static const double LEAST_SHARE = 0.01;

/* A change that has grown by this factor is a drift. */
static const double GROWN = 2.0;

/* A level is one of a finding if it is beyond their range by at most this part of the largest. */
static const double ALIKE = 0.5;

/* An output is off if its mean error since the onset exceeds this many deviations of a block. */
static const double OFF = 3.0;

/* If there is no tolerance; and a limit, because the process of the FMUs may tell any step. */
static const double LEAST = 1e-9;
static const double MOST = 1e9;

/* A correction that is outside its limits again within this many windows: the same finding. */
static const double RETURNS = 10.0;

static const double YEAR = 365.25 * 86400.0; /* s */

/* Larger numbers of steps are no data of ours. */
static const int64_t MOST_STEP = INT64_MAX / 4;

/* Longest time between two runs, s; keeps all sums of times within range. */
static const double LONGEST = 1e10;

/* Range of the levels of a quantity in a finding. */
typedef struct known_level {
    uint32_t finding; /* its number; 0: none */
    double size[2], percent[2];
} known_level;

/* One watched quantity. */
typedef struct quantity {
    bool is_output;
    uint32_t index;   /* of the adjusted variable or match */
    uint32_t finding; /* number of its open finding; 0: none */
    known_level levels[LEVELS];
    tl_change_series series[BANKS];
} quantity;

/* A released twin that was recorded. */
typedef struct recorded_release {
    int64_t from;  /* first step with its outputs */
    int64_t begun; /* step before which it was begun */
} recorded_release;

/* A finding, and the series that gave it its size. */
typedef struct tracked {
    size_t quantity, bank;
    double size, percent; /* at first */
} tracked;

/* What is stored, besides the quantities. */
typedef struct detector_state {
    int64_t started;               /* t_start, ms since 1970 UTC; 0: unknown */
    int64_t last;                  /* newest step; -1: none yet */
    int64_t left_out;              /* steps that are still left out after a start */
    bool is_ready;                 /* changes are reported */
    double ready_at;               /* since then, s */
    uint64_t frozen;               /* signals that are frozen, as bits */
    double value[TL_MAX_SIGNALS];  /* of the newest sample */
    int64_t moved[TL_MAX_SIGNALS]; /* tick at which it has changed last */
    uint32_t numbers;              /* findings so far */
    size_t count;
    tl_finding finding[TL_FINDINGS];
    tracked tracked[TL_FINDINGS];
} detector_state;

struct tl_change_detector {
    const tl_config *config;
    tl_account account;
    tl_change_report *report;
    void *context;
    int64_t tick; /* of the newest sample or step */
    detector_state state;
    recorded_release releases[STARTS];      /* release n lies at n % STARTS */
    uint64_t release;                       /* number of the newest one; 0: none yet */
    uint64_t unknown;                       /* steps in a row without any value */
    tl_limit_window windows[TL_MAX_ADJUST]; /* of the configuration's alarms; not stored */
    size_t quantities;
    quantity quantity[];
};

static double seconds_of(const tl_change_detector *detector, double step) {
    return step * tl_seconds(detector->config->step);
}

static int64_t steps_of_release(const tl_config *config) {
    return config->released_steps != 0 ? config->released_steps : RELEASE;
}

static int64_t steps_of_start(const tl_config *config) {
    int64_t release = steps_of_release(config);
    int64_t part = config->detect_learn / config->step / PARTS_OF_LEARNING;
    int64_t most = part > release ? part : release;
    return START_RELEASES * release < most ? START_RELEASES * release : most;
}

/* ---- creation ---- */

static void init_quantity(const tl_config *config, quantity *one, double least, double rate) {
    uint32_t cycle =
        (uint32_t)fmin(ceil(tl_seconds(config->detect_cycle) / tl_seconds(config->step)), UINT32_MAX / 2.0);
    for (int i = 0; i < BANKS; i++) {
        uint32_t block = i == CYCLE && cycle > BLOCKS[i] ? cycle : BLOCKS[i];
        double learn = tl_seconds(config->detect_learn) / tl_seconds(config->step) / block;
        tl_change_series_init(&one->series[i], block, (uint64_t)learn, rate * block, least);
    }
}

/* A Boolean has no search step. */
static double step_of(const tl_account *account, size_t adjust) {
    return account->adjust[adjust].type == TL_REAL ? account->adjust[adjust].step : 1.0;
}

tl_change_detector *tl_change_detector_create(const tl_config *config, const tl_account *account,
                                              tl_change_report *report, void *context) {
    size_t quantities = config->adjust_count + config->match_count;
    tl_change_detector *detector = calloc(1, sizeof *detector + quantities * sizeof(quantity));
    if (detector == NULL) {
        return NULL;
    }
    detector->config = config;
    detector->account = *account;
    detector->report = report;
    detector->context = context;
    detector->state.left_out = steps_of_start(config);
    detector->state.last = -1;
    detector->quantities = quantities;
    double series = BANKS * fmax((double)quantities, 1.0);
    double rate = config->false_alarms_per_year / series * tl_seconds(config->step) / YEAR; /* in a step */
    for (size_t i = 0; i < quantities; i++) {
        quantity *one = &detector->quantity[i];
        one->is_output = i >= config->adjust_count;
        one->index = (uint32_t)(one->is_output ? i - config->adjust_count : i);
        double least = one->is_output ? LEAST_OUTPUT * config->match[one->index].tolerance
                                      : LEAST_CORRECTION * step_of(account, one->index);
        least = fmin(fmax(least, LEAST), MOST);
        init_quantity(config, one, least, rate);
    }
    return detector;
}

void tl_change_detector_destroy(tl_change_detector *detector) {
    free(detector);
}

/* ---- findings ---- */

static tl_finding *finding_of(tl_change_detector *detector, uint32_t number) {
    for (size_t i = 0; i < detector->state.count; i++) {
        if (detector->state.finding[i].number == number) {
            return &detector->state.finding[i];
        }
    }
    return NULL;
}

/* Drops the oldest finding that is gone, else the oldest one. */
static void drop_finding(detector_state *state) {
    size_t at = 0;
    while (at < state->count && tl_finding_is_open(&state->finding[at])) {
        at++;
    }
    at = at == state->count ? 0 : at;
    state->count--;
    memmove(state->finding + at, state->finding + at + 1, (state->count - at) * sizeof *state->finding);
    memmove(state->tracked + at, state->tracked + at + 1, (state->count - at) * sizeof *state->tracked);
}

/* A new finding at the end of the list. */
static tl_finding *add_finding(tl_change_detector *detector) {
    if (detector->state.count == TL_FINDINGS) {
        drop_finding(&detector->state);
    }
    tl_finding *finding = &detector->state.finding[detector->state.count];
    *finding = (tl_finding){.number = ++detector->state.numbers};
    detector->state.tracked[detector->state.count] = (tracked){.quantity = SIZE_MAX};
    detector->state.count++;
    return finding;
}

static void report(const tl_change_detector *detector, const tl_finding *finding, tl_finding_turn turn) {
    if (detector->report != NULL) {
        detector->report(detector->context, detector->tick, finding, turn);
    }
}

/* A matched signal without "plant.", and without the "@match" of a further look-up. */
static void copy_name(const tl_change_detector *detector, const quantity *one, char name[TL_FINDING_NAME]) {
    const tl_config *config = detector->config;
    const char *from =
        one->is_output ? config->matched_as[one->index] + strlen("plant.") : config->adjust[one->index].variable;
    int length = one->is_output ? (int)strcspn(from, "@") : (int)strlen(from);
    (void)snprintf(name, TL_FINDING_NAME, "%.*s", length < TL_FINDING_NAME ? length : TL_FINDING_NAME - 1, from);
}

/* The user's words, for a variable or for "plant." and the name of a signal. */
static void copy_words(const tl_change_detector *detector, tl_finding *finding) {
    bool is_variable = finding->subject == TL_FINDING_CORRECTION;
    finding->says[0] = '\0';
    for (size_t i = 0; i < detector->config->says_count; i++) {
        const tl_config_words *says = &detector->config->says[i];
        const char *name = is_variable ? says->name : says->name + strlen("plant.");
        bool is_of_plant = strncmp(says->name, "plant.", strlen("plant.")) == 0;
        if (is_of_plant != is_variable && strcmp(name, finding->variable) == 0) {
            (void)snprintf(finding->says, sizeof finding->says, "%s", says->words);
        }
    }
}

static void name_finding(const tl_change_detector *detector, const quantity *one, tl_finding *finding) {
    const char *unit =
        one->is_output ? detector->account.match[one->index].unit : detector->account.adjust[one->index].unit;
    finding->subject = one->is_output ? TL_FINDING_OUTPUT : TL_FINDING_CORRECTION;
    finding->index = one->index;
    copy_name(detector, one, finding->variable);
    (void)snprintf(finding->unit, sizeof finding->unit, "%.*s", TL_FINDING_UNIT - 1,
                   strcmp(unit, "1") == 0 ? "" : unit);
    copy_words(detector, finding);
}

static void set_size(const tl_change_series *series, tl_finding *finding) {
    finding->size = series->size;
    finding->size_spread = series->size_spread;
    finding->percent = 100.0 * series->share;
}

static bool is_change(const tl_finding *finding) {
    return finding->kind == TL_FINDING_STEP || finding->kind == TL_FINDING_DRIFT;
}

/* True if the finding makes this quantity move, too. The released twin has no correction, so an
 * output shows the change of a correction again with each set point. A correction follows an output
 * that is matched. */
static bool moves(const tl_change_detector *detector, const tl_finding *finding, const quantity *one) {
    bool is_of_correction = finding->subject == TL_FINDING_CORRECTION;
    return one->is_output ? is_of_correction
                          : !is_of_correction && detector->config->match[finding->index].weight > 0.0;
}

/* True if the change is part of this open finding: that makes it move, or it begins at about the
 * same time, or within the longest reaction after the finding was made. */
static bool is_part_of(const tl_change_detector *detector, const tl_finding *finding, const quantity *one,
                       const tl_change_series *series) {
    uint32_t release = detector->config->released_steps;
    double reach = finding->onset_spread + seconds_of(detector, series->onset_spread + release);
    double onset = seconds_of(detector, series->onset);
    double late = finding->found + seconds_of(detector, 2.0 * series->block + release);
    return is_change(finding) && tl_finding_is_open(finding) &&
           (moves(detector, finding, one) || fabs(onset - finding->onset) <= reach ||
            seconds_of(detector, (double)detector->state.last) <= late);
}

static uint64_t bit_of(const quantity *one) {
    return (uint64_t)1 << one->index;
}

static bool is_within(double value, const double range[2]) {
    double beyond = ALIKE * fmax(fabs(value), fmax(fabs(range[0]), fabs(range[1])));
    return value >= range[0] - beyond && value <= range[1] + beyond;
}

/* Returns what is known of the quantity's levels in a finding, or NULL. */
static known_level *level_of(quantity *one, uint32_t finding) {
    for (size_t i = 0; i < LEVELS; i++) {
        if (one->levels[i].finding == finding) {
            return &one->levels[i];
        }
    }
    return NULL;
}

/* True if the series has a level of this finding, in its unit or as a part of û. */
static bool has_level(quantity *one, uint32_t finding, const tl_change_series *series) {
    const known_level *known = level_of(one, finding);
    return known != NULL && (is_within(series->size, known->size) || is_within(100.0 * series->share, known->percent));
}

/* Returns the newest finding whose level the quantity has again, or NULL. */
static tl_finding *find_again(tl_change_detector *detector, quantity *one, const tl_change_series *series) {
    for (size_t i = detector->state.count; i > 0; i--) {
        if (has_level(one, detector->state.finding[i - 1].number, series)) {
            return &detector->state.finding[i - 1];
        }
    }
    return NULL;
}

/* True if the change is the end of a finding in another quantity: it begins when that has gone. */
static bool is_end_of(const tl_change_detector *detector, const tl_finding *finding, const quantity *one,
                      const tl_change_series *series) {
    const tracked *by = &detector->state.tracked[finding - detector->state.finding];
    double reach = seconds_of(detector, series->onset_spread + series->block + detector->config->released_steps);
    return finding->is_gone && is_change(finding) && one != &detector->quantity[by->quantity] &&
           fabs(seconds_of(detector, series->onset) - finding->gone) <= reach;
}

/* Returns an open finding that began at the same time, else one that returns, else a new one; NULL
 * if the change is the end of a finding. */
static tl_finding *find_or_add(tl_change_detector *detector, quantity *one, const tl_change_series *series) {
    bool is_end = false;
    for (size_t i = 0; i < detector->state.count; i++) {
        if (is_part_of(detector, &detector->state.finding[i], one, series)) {
            return &detector->state.finding[i];
        }
        is_end = is_end || is_end_of(detector, &detector->state.finding[i], one, series);
    }
    tl_finding *known = find_again(detector, one, series);
    return known != NULL ? known : is_end ? NULL : add_finding(detector);
}

static void widen(double range[2], double value) {
    range[0] = fmin(range[0], value);
    range[1] = fmax(range[1], value);
}

/* The quantity has this level in a finding. The oldest finding is forgotten for a new one. */
static void remember_level(quantity *one, const tl_finding *finding, const tl_change_series *series) {
    double percent = 100.0 * series->share;
    known_level *known = level_of(one, finding->number);
    if (known == NULL) {
        known = &one->levels[0];
        for (size_t i = 1; i < LEVELS; i++) {
            known = one->levels[i].finding < known->finding ? &one->levels[i] : known;
        }
        *known = (known_level){finding->number, {series->size, series->size}, {percent, percent}};
    }
    widen(known->size, series->size);
    widen(known->percent, percent);
}

static void take_onset(const tl_change_detector *detector, const tl_change_series *series, tl_finding *finding) {
    finding->onset = seconds_of(detector, series->onset);
    finding->onset_spread = seconds_of(detector, series->onset_spread);
}

/* True if this onset is the same, but known better. */
static bool is_better_onset(const tl_change_detector *detector, const tl_change_series *series,
                            const tl_finding *finding) {
    double spread = seconds_of(detector, series->onset_spread);
    double apart = fabs(seconds_of(detector, series->onset) - finding->onset);
    return spread < finding->onset_spread && apart <= spread + finding->onset_spread;
}

/* A finding takes name and size of the first quantity, but a correction precedes an output. */
static bool takes_name(const tl_change_detector *detector, const tl_finding *finding, const quantity *one) {
    const tracked *by = &detector->state.tracked[finding - detector->state.finding];
    return by->quantity == SIZE_MAX || (finding->subject == TL_FINDING_OUTPUT && !one->is_output);
}

static void end_finding(tl_change_detector *detector, tl_finding *finding, double at) {
    finding->is_gone = true;
    finding->gone = at;
    for (size_t i = 0; i < detector->quantities; i++) {
        quantity *one = &detector->quantity[i];
        one->finding = one->finding == finding->number ? 0 : one->finding;
    }
    if (finding->kind != TL_FINDING_LIMIT || !finding->is_normal) {
        report(detector, finding, TL_FINDING_ENDED);
    }
}

/* Smaller changes are watched, but not reported. */
static bool is_small(const tl_change_detector *detector, const quantity *one, const tl_change_series *series) {
    double size = fabs(series->size);
    if (one->is_output) {
        return size < LEAST_FINDING * detector->config->match[one->index].tolerance;
    }
    double part = isfinite(series->share) ? LEAST_SHARE * fabs(series->size / series->share) : 0.0;
    return size < fmax(part, LEAST_CORRECTION * step_of(&detector->account, one->index));
}

/* A new level of a quantity without an open finding. */
static void take_change(tl_change_detector *detector, size_t which, size_t bank) {
    quantity *one = &detector->quantity[which];
    const tl_change_series *series = &one->series[bank];
    tl_finding *finding = is_small(detector, one, series) ? NULL : find_or_add(detector, one, series);
    if (finding == NULL) {
        return;
    }
    double now = seconds_of(detector, (double)detector->state.last);
    tracked *by = &detector->state.tracked[finding - detector->state.finding];
    bool returns = finding->is_gone;
    bool is_fresh =
        by->quantity == SIZE_MAX || (returns && now - finding->gone > tl_seconds(detector->config->detect_learn));
    one->finding = finding->number;
    *(one->is_output ? &finding->outputs : &finding->corrections) |= bit_of(one);
    remember_level(one, finding, series);
    finding->is_gone = false;
    if (is_fresh || (!returns && is_better_onset(detector, series, finding))) {
        take_onset(detector, series, finding);
    }
    finding->found = is_fresh ? now : finding->found;
    if (takes_name(detector, finding, one) || returns) {
        *by = (tracked){.quantity = which, .bank = bank, .size = series->size, .percent = 100.0 * series->share};
        name_finding(detector, one, finding);
        set_size(series, finding);
        report(detector, finding, is_fresh ? TL_FINDING_FOUND : TL_FINDING_FURTHER);
    }
}

/* The level of an open finding is known better, or has moved on. */
static void take_size(tl_change_detector *detector, quantity *one, tl_finding *finding,
                      const tl_change_series *series) {
    const tracked *by = &detector->state.tracked[finding - detector->state.finding];
    set_size(series, finding);
    remember_level(one, finding, series);
    bool has_grown = finding->size * by->size > 0.0 && fabs(finding->size) > GROWN * fabs(by->size) &&
                     !(fabs(finding->percent) <= GROWN * fabs(by->percent));
    if (has_grown && finding->kind != TL_FINDING_DRIFT) {
        finding->kind = TL_FINDING_DRIFT;
        report(detector, finding, TL_FINDING_FURTHER);
    }
}

/* The new level of a series is known. If it is neither normal nor that of the open finding, it is
 * another change. */
static void take_level(tl_change_detector *detector, size_t which, size_t bank) {
    quantity *one = &detector->quantity[which];
    const tl_change_series *series = &one->series[bank];
    tl_finding *finding = one->finding != 0 ? finding_of(detector, one->finding) : NULL;
    if (finding != NULL) {
        const tracked *by = &detector->state.tracked[finding - detector->state.finding];
        if (series->is_off && !series->is_same && is_better_onset(detector, series, finding)) {
            take_onset(detector, series, finding);
        }
        if (by->quantity != which || by->bank != bank) {
            return;
        }
        if (series->is_off && (series->is_same || has_level(one, finding->number, series))) {
            take_size(detector, one, finding, series);
            return;
        }
        end_finding(detector, finding, seconds_of(detector, series->onset));
    }
    if (series->is_off && !series->is_same) {
        take_change(detector, which, bank);
    }
}

/* ---- cause ---- */

static void add_release(tl_change_detector *detector, const tl_record *record) {
    const recorded_release *newest = &detector->releases[detector->release % STARTS];
    int64_t begun = record->step - (int64_t)record->release_age + 1;
    if (record->release_age != 0 && (detector->release == 0 || begun != newest->begun)) {
        detector->release++;
        detector->releases[detector->release % STARTS] = (recorded_release){.from = record->step, .begun = begun};
    }
}

/* Finds the first step whose recorded release was begun after an instant. Returns false if there is
 * none yet. *from 0: it is not remembered any more. */
static bool find_later_release(const tl_change_detector *detector, double step, int64_t *from) {
    uint64_t oldest = detector->release >= STARTS ? detector->release - STARTS + 1 : 1;
    for (uint64_t n = oldest; n <= detector->release; n++) {
        const recorded_release *one = &detector->releases[n % STARTS];
        if ((double)one->begun > step) {
            *from = n == oldest && oldest > 1 ? 0 : one->from;
            return true;
        }
    }
    return false;
}

static void decide_cause(const tl_change_detector *detector, tl_finding *finding) {
    const double step = tl_seconds(detector->config->step);
    double onset = finding->onset / step;
    double spread = finding->onset_spread / step;
    int64_t later = 0;
    size_t outputs = 0;
    size_t off = 0;
    size_t which = 0;
    if (!find_later_release(detector, onset - spread, &later)) {
        return;
    }
    finding->is_decided = true;
    for (size_t i = 0; i < detector->quantities; i++) {
        const quantity *one = &detector->quantity[i];
        const tl_change_series *series = &one->series[0];
        double distance = tl_change_series_distance(series, onset + spread, (double)(later - 1));
        if (one->is_output && isfinite(distance)) {
            bool differs = fabs(distance) > OFF * series->fit.scale;
            outputs++;
            off += differs ? 1 : 0;
            which = differs ? i : which;
        }
    }
    finding->cause = off > 1 ? TL_FINDING_PLANT : off == 1 && outputs > 1 ? TL_FINDING_SENSOR : TL_FINDING_NO_CAUSE;
    if (finding->cause == TL_FINDING_SENSOR) {
        copy_name(detector, &detector->quantity[which], finding->sensor);
    }
}

static void decide_causes(tl_change_detector *detector) {
    for (size_t i = 0; i < detector->state.count; i++) {
        tl_finding *finding = &detector->state.finding[i];
        if (is_change(finding) && !finding->is_decided) {
            decide_cause(detector, finding);
            if (finding->cause != TL_FINDING_NO_CAUSE) {
                report(detector, finding, TL_FINDING_FURTHER);
            }
        }
    }
}

/* ---- input ---- */

static void add_value(tl_change_detector *detector, size_t which, double value, double reference) {
    quantity *one = &detector->quantity[which];
    for (size_t bank = 0; bank < BANKS; bank++) {
        tl_series_turn turn = tl_change_series_add(&one->series[bank], detector->state.last, value, reference);
        if (turn == TL_SERIES_SETTLED) {
            take_level(detector, which, bank);
        }
        if (!detector->state.is_ready && tl_change_series_is_ready(&one->series[bank])) {
            detector->state.is_ready = true;
            detector->state.ready_at = seconds_of(detector, (double)detector->state.last);
        }
    }
}

/* Returns the value, and what it is a part of. NaN: not known. */
static double value_of(const tl_change_detector *detector, const quantity *one, const tl_record *record,
                       double *reference) {
    uint32_t i = one->index;
    if (!one->is_output) {
        bool runs_free = record->outcome == TL_FREE || record->outcome == TL_FREE_RUN;
        *reference = record->nominal[i];
        return runs_free ? (double)NAN : record->u[i] - record->nominal[i];
    }
    bool is_good = record->measured_quality[i] == TL_GOOD && record->release_age != 0 &&
                   2 * (uint64_t)record->release_age >= detector->config->released_steps;
    *reference = record->measured[i];
    return is_good ? record->measured[i] - record->released[i] : (double)NAN;
}

static void interrupt_all(tl_change_detector *detector) {
    for (size_t i = 0; i < detector->quantities; i++) {
        for (size_t bank = 0; bank < BANKS; bank++) {
            tl_change_series_interrupt(&detector->quantity[i].series[bank]);
        }
    }
    memset(detector->windows, 0, sizeof detector->windows);
}

static void interrupt_series(tl_change_detector *detector) {
    interrupt_all(detector);
    detector->state.left_out = steps_of_start(detector->config);
}

/* After a gap in the readings, released twins are wrong until they were begun after it. */
static void leave_out_gap(tl_change_detector *detector, const tl_record *record) {
    double ignored;
    bool is_known = false;
    for (size_t i = 0; i < detector->quantities && !is_known; i++) {
        is_known = isfinite(value_of(detector, &detector->quantity[i], record, &ignored));
    }
    if (is_known && detector->unknown >= GAP) {
        interrupt_all(detector);
        detector->state.left_out = steps_of_release(detector->config);
    }
    detector->unknown = is_known ? 0 : detector->unknown + 1;
}

/* ---- limits ---- */

/* The newest finding about the limits of a variable that still lasts, or was within them for a
 * short time only; else NULL. */
static tl_finding *find_limit(tl_change_detector *detector, const tl_config_alarm *alarm, double now) {
    for (size_t i = detector->state.count; i > 0; i--) {
        tl_finding *finding = &detector->state.finding[i - 1];
        if (finding->kind == TL_FINDING_LIMIT && finding->index == alarm->adjust) {
            bool is_near = now - finding->gone <= RETURNS * tl_seconds(alarm->averaging_time);
            return !finding->is_gone || is_near ? finding : NULL;
        }
    }
    return NULL;
}

static void take_outside(tl_change_detector *detector, tl_finding *finding, const tl_limit_window *window,
                         const tl_config_alarm *alarm) {
    bool is_new = finding == NULL;
    if (is_new) {
        finding = add_finding(detector);
        finding->kind = TL_FINDING_LIMIT;
        finding->is_decided = true; /* there is no cause */
        finding->onset = seconds_of(detector, (double)window->onset);
        finding->onset_spread = seconds_of(detector, (double)window->spread);
        finding->found = seconds_of(detector, (double)detector->state.last);
        finding->size = window->size;
        finding->size_spread = finding->percent = (double)NAN;
        name_finding(detector, &detector->quantity[alarm->adjust], finding);
    }
    bool returns = finding->is_gone;
    bool has_grown = fabs(window->whole) > GROWN * fabs(finding->size) || window->whole * finding->size < 0.0;
    finding->is_gone = false;
    finding->size = has_grown || returns ? window->whole : finding->size;
    if ((is_new || returns || has_grown) && !finding->is_normal) {
        report(detector, finding, is_new ? TL_FINDING_FOUND : TL_FINDING_FURTHER);
    }
}

static void watch_limits(tl_change_detector *detector, const tl_record *record) {
    double now = seconds_of(detector, (double)detector->state.last);
    for (size_t i = 0; i < detector->config->alarm_count; i++) {
        const tl_config_alarm *alarm = &detector->config->alarms[i];
        tl_limit_window *window = &detector->windows[i];
        double ignored;
        double value = value_of(detector, &detector->quantity[alarm->adjust], record, &ignored);
        tl_limit_side side =
            isfinite(value) ? tl_limit_window_add(window, alarm, detector->config->step, detector->state.last, value)
                            : TL_LIMIT_UNKNOWN;
        tl_finding *finding = side != TL_LIMIT_UNKNOWN ? find_limit(detector, alarm, now) : NULL;
        if (side == TL_LIMIT_OUTSIDE) {
            take_outside(detector, finding, window, alarm);
        } else if (finding != NULL && !finding->is_gone) {
            end_finding(detector, finding, now);
        }
    }
}

/* A variable whose alarm was removed from the configuration is within its limits. */
static void end_removed_limits(tl_change_detector *detector) {
    for (size_t i = 0; i < detector->state.count; i++) {
        tl_finding *finding = &detector->state.finding[i];
        bool is_watched = finding->kind != TL_FINDING_LIMIT || finding->is_gone;
        for (size_t k = 0; k < detector->config->alarm_count; k++) {
            is_watched = is_watched || detector->config->alarms[k].adjust == finding->index;
        }
        if (!is_watched) {
            end_finding(detector, finding, seconds_of(detector, (double)detector->state.last));
        }
    }
}

/* ---- steps and samples ---- */

void tl_change_detector_step(tl_change_detector *detector, int64_t tick, const tl_record *record) {
    if (record->outcome == TL_RESUMED || record->step <= detector->state.last) {
        return;
    }
    if ((record->flags & TL_FLAG_RESET) != 0) {
        interrupt_series(detector);
    }
    if (detector->state.last >= 0 && record->step - detector->state.last > GAP) {
        interrupt_all(detector);
    }
    detector->tick = tick;
    detector->state.last = record->step;
    add_release(detector, record);
    watch_limits(detector, record);
    if (detector->state.left_out > 0) {
        detector->state.left_out--;
        return;
    }
    leave_out_gap(detector, record);
    for (size_t i = 0; i < detector->quantities && detector->state.left_out == 0; i++) {
        double reference = 0.0;
        double value = value_of(detector, &detector->quantity[i], record, &reference);
        add_value(detector, i, value, reference);
    }
    decide_causes(detector);
}

static void take_frozen(tl_change_detector *detector, size_t signal, int64_t tick) {
    tl_finding *finding = add_finding(detector);
    finding->kind = TL_FINDING_FREEZE;
    finding->subject = TL_FINDING_SIGNAL;
    finding->index = (uint32_t)signal;
    finding->onset = seconds_of(detector, (double)detector->state.moved[signal]);
    finding->onset_spread = seconds_of(detector, 1.0);
    finding->found = seconds_of(detector, (double)tick);
    finding->percent = (double)NAN;
    (void)snprintf(finding->variable, sizeof finding->variable, "%.*s", TL_FINDING_NAME - 1,
                   detector->config->signals[signal].plan.name);
    copy_words(detector, finding);
    report(detector, finding, TL_FINDING_FOUND);
}

static void end_frozen(tl_change_detector *detector, size_t signal, double at) {
    for (size_t i = 0; i < detector->state.count; i++) {
        tl_finding *finding = &detector->state.finding[i];
        if (finding->kind == TL_FINDING_FREEZE && finding->index == signal && !finding->is_gone) {
            end_finding(detector, finding, at);
        }
    }
}

void tl_change_detector_sample(tl_change_detector *detector, const tl_sample *sample) {
    detector->tick = sample->tick;
    for (size_t i = 0; i < detector->config->signal_count; i++) {
        bool was_frozen = (detector->state.frozen >> i & 1U) != 0;
        bool moves = sample->values[i] < detector->state.value[i] || sample->values[i] > detector->state.value[i];
        bool is_frozen = sample->quality[i] == TL_FROZEN || (was_frozen && !moves);
        detector->state.moved[i] = moves ? sample->tick : detector->state.moved[i];
        detector->state.value[i] = sample->values[i];
        if (is_frozen && !was_frozen) {
            take_frozen(detector, i, sample->tick);
        } else if (was_frozen && !is_frozen) {
            end_frozen(detector, i, seconds_of(detector, (double)sample->tick));
        }
        detector->state.frozen ^= is_frozen != was_frozen ? (uint64_t)1 << i : 0U;
    }
}

tl_change_acceptance tl_change_detector_accept(tl_change_detector *detector, uint32_t number) {
    tl_finding *finding = finding_of(detector, number);
    const bool was_open = finding != NULL && !finding->is_normal;
    bool is_known = false;
    for (size_t i = 0; i < detector->quantities; i++) {
        quantity *one = &detector->quantity[i];
        known_level *known = number != 0 ? level_of(one, number) : NULL;
        for (size_t bank = 0; bank < BANKS && known != NULL; bank++) {
            tl_change_series_accept(&one->series[bank], known->size[0], known->size[1]);
        }
        if (known != NULL) {
            *known = (known_level){0};
            is_known = true;
        }
        one->finding = one->finding == number ? 0 : one->finding;
    }
    if (finding != NULL) {
        finding->is_normal = true;
    }
    is_known = is_known || (was_open && finding->kind == TL_FINDING_LIMIT); /* its limits are those of the user */
    return is_known ? TL_ACCEPTANCE_DONE : was_open ? TL_ACCEPTANCE_LATE : TL_ACCEPTANCE_NONE;
}

/* ---- results ---- */

tl_changes tl_change_detector_get(const tl_change_detector *detector) {
    tl_run_detection detection = {.is_ready = detector->state.is_ready,
                                  .needed = tl_seconds(detector->config->detect_learn)};
    for (size_t i = 0; i < detector->quantities; i++) {
        const tl_change_series *series = &detector->quantity[i].series[0];
        double learnt = seconds_of(detector, (double)(series->fit.blocks * series->block));
        detection.learnt = fmax(detection.learnt, fmin(learnt, detection.needed));
    }
    double now = seconds_of(detector, (double)detector->state.last);
    detection.watched = detection.is_ready ? fmax(now - detector->state.ready_at, 0.0) : 0.0;
    return (tl_changes){.finding = detector->state.finding, .count = detector->state.count, .detection = detection};
}

/* ---- storing ---- */

/* Identifies what the bytes belong to: this layout, these quantities and signals, these blocks. */
static void write_key(const tl_change_detector *detector, char key[TL_SHA256_TEXT]) {
    const tl_config *config = detector->config;
    char text[2 * TL_ERROR_TEXT];
    (void)snprintf(key, TL_SHA256_TEXT, "%d", FORMAT);
    (void)snprintf(text, sizeof text, "%s %zu %zu %lld", key, sizeof(detector_state), TL_SERIES_STORED,
                   (long long)config->step);
    tl_sha256(text, strlen(text), key);
    for (size_t i = 0; i < detector->quantities + config->signal_count; i++) {
        bool is_signal = i >= detector->quantities;
        const quantity *one = &detector->quantity[is_signal ? 0 : i];
        const char *name = is_signal        ? config->signals[i - detector->quantities].plan.name
                           : one->is_output ? config->matched_as[one->index]
                                            : config->adjust[one->index].variable;
        (void)snprintf(text, sizeof text, "%s %u %.*s", key, is_signal ? 0 : one->series[CYCLE].block, TL_ERROR_TEXT,
                       name);
        tl_sha256(text, strlen(text), key);
    }
}

size_t tl_change_detector_size(const tl_change_detector *detector) {
    size_t each = sizeof(uint32_t) + LEVELS * sizeof(known_level) + BANKS * TL_SERIES_STORED;
    return TL_SHA256_TEXT + sizeof detector->state + detector->quantities * each;
}

static unsigned char *put(unsigned char *to, const void *from, size_t size) {
    memcpy(to, from, size);
    return to + size;
}

static const unsigned char *take(const unsigned char *from, void *to, size_t size) {
    memcpy(to, from, size);
    return from + size;
}

void tl_change_detector_save(const tl_change_detector *detector, unsigned char *bytes) {
    char key[TL_SHA256_TEXT];
    write_key(detector, key);
    bytes = put(put(bytes, key, sizeof key), &detector->state, sizeof detector->state);
    for (size_t i = 0; i < detector->quantities; i++) {
        const quantity *one = &detector->quantity[i];
        bytes = put(put(bytes, &one->finding, sizeof one->finding), one->levels, sizeof one->levels);
        for (size_t bank = 0; bank < BANKS; bank++) {
            bytes = put(bytes, &one->series[bank], TL_SERIES_STORED);
        }
    }
}

static bool is_flag(const bool *flag) {
    unsigned char byte = 2;
    memcpy(&byte, flag, sizeof *flag);
    return byte <= 1;
}

static bool ends(const char *text, size_t size) {
    return memchr(text, '\0', size) != NULL;
}

/* The bytes may come from a damaged file. */
static bool is_sound(const tl_change_detector *detector, const detector_state *state) {
    const size_t limits[] = {
        [TL_FINDING_CORRECTION] = detector->config->adjust_count,
        [TL_FINDING_OUTPUT] = detector->config->match_count,
        [TL_FINDING_SIGNAL] = detector->config->signal_count,
    };
    bool right = state->count <= TL_FINDINGS && is_flag(&state->is_ready) && isfinite(state->ready_at) &&
                 state->left_out <= steps_of_start(detector->config) && state->last >= -1 && state->last < MOST_STEP;
    for (size_t i = 0; right && i < detector->config->signal_count; i++) {
        right = state->moved[i] > -MOST_STEP && state->moved[i] < MOST_STEP;
    }
    for (size_t i = 0; right && i < state->count; i++) {
        const tl_finding *finding = &state->finding[i];
        const tracked *by = &state->tracked[i];
        right = (unsigned)finding->kind <= TL_FINDING_LIMIT && (unsigned)finding->subject <= TL_FINDING_SIGNAL &&
                (unsigned)finding->cause <= TL_FINDING_PLANT && finding->index < limits[finding->subject] &&
                is_flag(&finding->is_gone) && is_flag(&finding->is_normal) && is_flag(&finding->is_decided) &&
                isfinite(finding->onset) && isfinite(finding->found) && isfinite(finding->gone) &&
                ends(finding->variable, sizeof finding->variable) && ends(finding->says, sizeof finding->says) &&
                ends(finding->unit, sizeof finding->unit) && ends(finding->sensor, sizeof finding->sensor) &&
                (by->quantity == SIZE_MAX || (by->quantity < detector->quantities && by->bank < BANKS));
    }
    return right;
}

bool tl_change_detector_load(tl_change_detector *detector, const unsigned char *bytes, size_t size) {
    static detector_state state; /* large; one thread at a time */
    char key[TL_SHA256_TEXT];
    bool right = true;
    write_key(detector, key);
    if (size != tl_change_detector_size(detector) || memcmp(bytes, key, sizeof key) != 0) {
        return false;
    }
    bytes = take(bytes + sizeof key, &state, sizeof state);
    if (!is_sound(detector, &state)) {
        return false;
    }
    detector->state = state;
    for (size_t i = 0; i < detector->quantities; i++) {
        quantity *one = &detector->quantity[i];
        bytes = take(take(bytes, &one->finding, sizeof one->finding), one->levels, sizeof one->levels);
        for (size_t bank = 0; bank < BANKS; bank++) {
            right = tl_change_series_load(&one->series[bank], bytes) && right;
            bytes += TL_SERIES_STORED;
        }
    }
    detector->state.is_ready = false; /* `learn_s` may be another one */
    for (size_t i = 0; i < detector->quantities; i++) {
        for (size_t bank = 0; bank < BANKS; bank++) {
            detector->state.is_ready =
                detector->state.is_ready || tl_change_series_is_ready(&detector->quantity[i].series[bank]);
        }
    }
    return right;
}

/* Times and steps count from the t_start of the new run. */
static void move_times(tl_change_detector *detector, double seconds) {
    detector_state *state = &detector->state;
    double steps = seconds / tl_seconds(detector->config->step);
    state->last = -1;
    state->ready_at -= seconds;
    for (size_t i = 0; i < state->count; i++) {
        state->finding[i].onset -= seconds;
        state->finding[i].found -= seconds;
        state->finding[i].gone -= seconds;
    }
    for (size_t i = 0; i < detector->config->signal_count; i++) {
        state->moved[i] -= (int64_t)steps;
    }
    for (size_t i = 0; i < detector->quantities; i++) {
        for (size_t bank = 0; bank < BANKS; bank++) {
            tl_change_series_move(&detector->quantity[i].series[bank], -steps);
        }
    }
}

/* What a replay has found has no calendar time, so it cannot continue. */
static void drop_findings(tl_change_detector *detector) {
    detector->state.count = 0;
    detector->state.frozen = 0;
    for (size_t i = 0; i < detector->quantities; i++) {
        detector->quantity[i].finding = 0;
    }
}

void tl_change_detector_begin(tl_change_detector *detector, const tl_account *account, int64_t started) {
    bool is_of_replay = detector->state.started == 0;
    int64_t left_out = detector->state.left_out;
    double later = is_of_replay ? seconds_of(detector, (double)detector->state.last)
                                : ((double)started - (double)detector->state.started) / 1e3;
    if (is_of_replay) {
        drop_findings(detector);
    }
    bool continues = !is_of_replay && fabs(later) <= tl_seconds(detector->config->step) / 2;
    if (!continues) {
        move_times(detector, fmin(fmax(later, -LONGEST), LONGEST));
    }
    detector->state.started = started;
    detector->account = *account;
    detector->release = 0;
    interrupt_series(detector);
    detector->state.left_out = continues ? left_out : detector->state.left_out;
    end_removed_limits(detector);
}

void tl_change_detector_number_from(tl_change_detector *detector, uint32_t last, bool is_new) {
    detector_state *state = &detector->state;
    for (size_t i = 0; is_new && i < state->count; i++) {
        state->finding[i].number += last;
    }
    for (size_t i = 0; is_new && i < detector->quantities; i++) {
        quantity *one = &detector->quantity[i];
        one->finding += one->finding != 0 ? last : 0;
        for (size_t k = 0; k < LEVELS; k++) {
            one->levels[k].finding += one->levels[k].finding != 0 ? last : 0;
        }
    }
    state->numbers = is_new ? state->numbers + last : state->numbers > last ? state->numbers : last;
}
