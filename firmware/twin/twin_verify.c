/* What is left of a tick: see twin_verify.h. */
#include "firmware/twin/twin_verify.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/clock.h"

/* How far apart, as it is judged. */
static void write_size(const tl_twin_finding *finding, char *text, size_t size) {
    const char *unit = finding->unit;
    bool has_unit = unit[0] != '\0' && strcmp(unit, "1") != 0;
    (void)snprintf(text, size, "%.9g%s%.12s, and then %.9g", finding->committed, has_unit ? " " : "",
                   has_unit ? unit : "", finding->again);
    size_t length = strlen(text);
    if (isfinite(finding->tolerances)) {
        (void)snprintf(text + length, size - length, " (%.3g tolerances)", finding->tolerances);
    }
}

static void write_sentence(const tl_twin_finding *finding, tl_twin_look_news *news) {
    static const char *const outcomes[TL_MENDED] = {
        [TL_MENDED_NOT] = "what is committed may be wrong from now on",
        [TL_MENDED_BY_MEMORY] = "it is rolled back by its memory from now on",
        [TL_MENDED_BY_STATES] = "it is rolled back by its own states from now on",
    };
    const char *then = outcomes[finding->mended];
    if (finding->variable == NULL) {
        (void)snprintf(
            news->text, sizeof news->text,
            "%.24s does not come back to where it was: led back, it fails in step %lld, which it had done; %s",
            finding->component, (long long)finding->step, then);
        return;
    }
    char apart[100];
    write_size(finding, apart, sizeof apart);
    const char *why = tl_twin_cause_text(finding->cause);
    bool is_known = why[0] != '\0';
    (void)snprintf(news->text, sizeof news->text,
                   "%.24s does not come back to where it was: %.24s was %s %u step%s after it was led back%s%s%s; %s",
                   finding->component, finding->variable, apart, finding->after, finding->after == 1 ? "" : "s",
                   is_known ? " (" : "", why, is_known ? ")" : "", then);
}

tl_status tl_twin_look(tl_twin *twin, tl_time until, tl_twin_look_news *news, tl_error *error) {
    tl_twin_finding finding;
    tl_budget left = {.now = NULL};
    if (until != TL_TIME_NEVER) {
        left.now = tl_clock_now;
        left.started = tl_clock_now(NULL);
        left.time = until - left.started;
    }
    tl_status status = tl_twin_verify(twin, &left, &finding, &news->found, error);
    if (news->found) {
        news->mended = finding.mended != TL_MENDED_NOT;
        news->component = finding.component;
        write_sentence(&finding, news);
    }
    return status;
}

bool tl_twin_look_at_account(const tl_account *account, tl_twin_look_news *news) {
    const tl_account_finding *last = &account->finding;
    const tl_twin_finding finding = {
        .component = last->component,
        .variable = last->variable[0] != '\0' ? last->variable : NULL,
        .unit = last->unit,
        .step = last->step,
        .after = last->after,
        .committed = last->committed,
        .again = last->again,
        .tolerances = last->tolerances,
        .cause = (tl_restore_cause)last->cause,
        .mended = (tl_twin_mended)last->mended,
    };
    news->found = account->differed != 0;
    news->mended = finding.mended != TL_MENDED_NOT;
    news->component = finding.component;
    write_sentence(&finding, news);
    return news->found;
}

void tl_twin_tell_no_way_back(const tl_twin *twin, int64_t step, tl_time size, char text[TL_TWIN_NO_WAY_BACK_TEXT]) {
    tl_twin_facts facts = tl_twin_get_facts(twin);
    const char *name = facts.runs_free != NULL ? facts.runs_free : "an FMU";
    tl_twin_ledger entry = {.name = ""};
    for (size_t i = 0; i < facts.components && strcmp(entry.name, name) != 0; i++) {
        entry = tl_twin_get_ledger(twin, i);
    }
    const char *why = entry.replay.differs   ? "did not do again what it had done"
                      : entry.replay.is_over ? "was tried on more ways than there is room for"
                                             : "is rolled back by replay, for so many steps only (\"replay_steps\")";
    (void)snprintf(text, TL_TWIN_NO_WAY_BACK_TEXT,
                   "from t = %.6g s on the twin runs free, with nominal u: %.40s %s; it was given %llu steps again "
                   "until then",
                   tl_seconds(tl_time_of_step(0, size, step)), name, why, (unsigned long long)entry.replay.steps);
}
