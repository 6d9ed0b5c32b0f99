/* Finding: see finding.h. */
#include "firmware/monitor/finding.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/text.h"
#include "firmware/monitor/lock_tally.h"

const char *tl_finding_kind_name(tl_finding_kind kind) {
    static const char *const names[] = {[TL_FINDING_STEP] = "step",
                                        [TL_FINDING_DRIFT] = "drift",
                                        [TL_FINDING_FREEZE] = "freeze",
                                        [TL_FINDING_LIMIT] = "limit"};
    return names[kind];
}

const char *tl_finding_subject_name(tl_finding_subject subject) {
    static const char *const names[] = {
        [TL_FINDING_CORRECTION] = "correction", [TL_FINDING_OUTPUT] = "output", [TL_FINDING_SIGNAL] = "signal"};
    return names[subject];
}

bool tl_finding_is_open(const tl_finding *finding) {
    return !finding->is_gone && !finding->is_normal;
}

const char *tl_finding_state_name(const tl_finding *finding) {
    return finding->is_normal ? "normal" : finding->is_gone ? "gone" : "open";
}

/* "+5 %" in brackets; nothing if there is no percentage. */
static void write_percent(const tl_finding *finding, char *text, size_t size) {
    text[0] = '\0';
    if (isfinite(finding->percent)) {
        (void)snprintf(text, size, " (%+.2g %%)", finding->percent);
    }
}

static void write_size(const tl_finding *finding, char *text, size_t size) {
    char percent[32];
    const char *space = finding->unit[0] == '\0' ? "" : " ";
    write_percent(finding, percent, sizeof percent);
    if (finding->kind == TL_FINDING_FREEZE) {
        (void)snprintf(text, size, "plant.%s: frozen", finding->variable);
    } else if (finding->subject == TL_FINDING_CORRECTION) {
        (void)snprintf(text, size, "%s: correction %s%+.3g%s%s%s%s", finding->variable,
                       finding->kind == TL_FINDING_DRIFT ? "drifts, now " : "", finding->size, space, finding->unit,
                       percent, finding->kind == TL_FINDING_LIMIT ? ", outside its limits" : "");
    } else {
        (void)snprintf(text, size, "plant.%s: %s%+.3g%s%s%s against the model", finding->variable,
                       finding->kind == TL_FINDING_DRIFT ? "drifts, now " : "", finding->size, space, finding->unit,
                       percent);
    }
}

void tl_finding_write(const tl_finding *finding, double now, int64_t started, char text[TL_FINDING_TEXT]) {
    char size[TL_FINDING_NAME + 128];
    char since[TL_LOCK_INSTANT];
    char gone[TL_LOCK_INSTANT] = "";
    write_size(finding, size, sizeof size);
    tl_lock_instant_write(finding->onset, now, started, false, since);
    if (finding->is_gone) {
        tl_lock_instant_write(finding->gone, now, started, false, gone);
    }
    (void)snprintf(text, TL_FINDING_TEXT, "%s%s%s %s %s \302\261 %.2g s%s%s", finding->says,
                   finding->says[0] == '\0' ? "" : ": ", size, finding->is_gone ? "from" : "since", since,
                   finding->onset_spread, finding->is_gone ? " to " : "", gone);
}

void tl_finding_write_cause(const tl_finding *finding, char text[TL_FINDING_TEXT]) {
    text[0] = '\0';
    if (finding->cause == TL_FINDING_SENSOR) {
        (void)snprintf(text, TL_FINDING_TEXT, "sensor plant.%s, or an input that acts on it alone", finding->sensor);
    } else if (finding->cause == TL_FINDING_PLANT) {
        (void)snprintf(text, TL_FINDING_TEXT, "the plant, not one sensor");
    }
}
