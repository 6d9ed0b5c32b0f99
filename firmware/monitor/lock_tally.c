/* Lock states and the steps in each: see lock_tally.h. */
#include "firmware/monitor/lock_tally.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/text.h"

bool tl_lock_tolerances_is_sound(const tl_lock_tolerances *tolerances) {
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        const struct tl_lock_measure *by = &tolerances->match[i];
        bool is_sound = isfinite(by->tolerance) && isfinite(by->weight) && by->weight >= 0.0 &&
                        (by->tolerance > 0.0 || by->weight <= 0.0);
        if (!is_sound) {
            return false;
        }
    }
    return true;
}

bool tl_lock_tolerances_have_weight(const tl_lock_tolerances *tolerances) {
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        if (tolerances->match[i].weight > 0.0) {
            return true;
        }
    }
    return false;
}

const char *tl_lock_state_name(tl_lock_state state) {
    static const char *const names[TL_LOCK_STATES] = {[TL_LOCK_FREE] = "free",
                                                      [TL_LOCK_LOCKED] = "locked",
                                                      [TL_LOCK_CORRECTED] = "corrected",
                                                      [TL_LOCK_DEGRADED] = "degraded",
                                                      [TL_LOCK_LOST] = "lost"};
    return names[state];
}

/* ---- the reason of `corrected` ---- */

/* Around variable, and value with unit, of an event. */
static const struct {
    const char *before, *between, *after;
} phrases[] = {
    [TL_LOCK_REASON_NONE] = {"", "", ""},
    [TL_LOCK_REASON_BOUND] = {"locked, corrected: ", " at bound ", " since "},
    [TL_LOCK_REASON_CORRECTION] = {"locked, corrected: ", " ", " since "},
    [TL_LOCK_REASON_RELEASED] = {"locked, but ", " ", " off without corrections since "},
};

enum { REASONS = sizeof phrases / sizeof phrases[0] };

int64_t tl_lock_utc(double instant_s, int64_t started) {
    static const double longest = 1e12;
    bool is_sound = fabs(instant_s) < longest && started > 0 && (double)started < 1e3 * longest;
    return is_sound ? started + (int64_t)(instant_s * 1e3) : 0;
}

void tl_lock_instant_write(double instant_s, double now_s, int64_t started, bool is_event, char text[TL_LOCK_INSTANT]) {
    char then[TL_UTC_TEXT];
    char now[TL_UTC_TEXT];
    char t[TL_LOCK_INSTANT / 2];
    (void)snprintf(t, sizeof t, "t = %.9g s", instant_s);
    if (started == 0) {
        (void)snprintf(text, TL_LOCK_INSTANT, "%s", t);
        return;
    }
    tl_utc_text(tl_lock_utc(instant_s, started), then);
    tl_utc_text(tl_lock_utc(now_s, started), now);
    bool is_today = strncmp(then, now, strlen("2026-11-28")) == 0;
    int length = is_today ? snprintf(text, TL_LOCK_INSTANT, "%.8s UTC", then + strlen("2026-11-28T"))
                          : snprintf(text, TL_LOCK_INSTANT, "%.10s %.5s UTC", then, then + strlen("2026-11-28T"));
    if (is_event) {
        (void)snprintf(text + length, (size_t)(TL_LOCK_INSTANT - length), " (%s)", t);
    }
}

/* The reason may come from another process. */
void tl_lock_standing_write(const tl_lock_standing *standing, bool is_event, char text[TL_LOCK_CLAUSE]) {
    char since[TL_LOCK_INSTANT];
    unsigned reason = standing->reason;
    text[0] = '\0';
    if (reason == TL_LOCK_REASON_NONE || reason >= REASONS) {
        return;
    }
    tl_lock_instant_write(standing->since_s, standing->now_s, standing->started, is_event, since);
    bool has_variable = is_event || reason != TL_LOCK_REASON_RELEASED;
    char value[32];
    (void)snprintf(value, sizeof value, reason == TL_LOCK_REASON_CORRECTION ? "%+.3g" : "%.3g", standing->value);
    (void)snprintf(text, TL_LOCK_CLAUSE, "%s%.*s%s%s%s%.*s%s%s", phrases[reason].before,
                   has_variable ? TL_LOCK_VARIABLE - 1 : 0, standing->variable,
                   has_variable ? phrases[reason].between : "", value, standing->unit[0] == '\0' ? "" : " ",
                   TL_LOCK_UNIT - 1, standing->unit, phrases[reason].after, since);
}

void tl_lock_standing_write_remedy(const tl_lock_standing *standing, char text[TL_LOCK_CLAUSE]) {
    text[0] = '\0';
    if (standing->reason == TL_LOCK_REASON_CORRECTION) {
        (void)snprintf(text, TL_LOCK_CLAUSE, "to accept it: \"approved\": %.4g in synchronise.adjust.%.*s",
                       standing->value, TL_LOCK_VARIABLE - 1, standing->variable);
    }
}

/* Copies the characters before `end`, and cuts them. */
static void copy_part(char *part, size_t size, const char *text, const char *end) {
    (void)snprintf(part, size, "%.*s", (int)(end - text), text);
}

/* Reads the rest of a text after the phrase before it. */
static bool parse_rest(const char *text, tl_lock_reason reason, tl_lock_standing *standing) {
    const char *value = strstr(text, phrases[reason].between);
    const char *after = strstr(text, phrases[reason].after);
    const char *t = after != NULL ? strstr(after, "t = ") : NULL;
    char *unit = NULL;
    if (value == NULL || t == NULL || value > after) {
        return false;
    }
    copy_part(standing->variable, sizeof standing->variable, text, value);
    standing->value = strtod(value + strlen(phrases[reason].between), &unit);
    unit += unit < after && unit[0] == ' ' ? 1 : 0;
    copy_part(standing->unit, sizeof standing->unit, unit, after);
    standing->since_s = strtod(t + strlen("t = "), NULL);
    standing->reason = reason;
    return unit <= after && isfinite(standing->since_s);
}

bool tl_lock_standing_parse(const char *text, tl_lock_standing *standing) {
    for (unsigned reason = TL_LOCK_REASON_RELEASED; reason > TL_LOCK_REASON_NONE; reason--) {
        const char *before = phrases[reason].before;
        *standing = (tl_lock_standing){.reason = TL_LOCK_REASON_NONE};
        if (strncmp(text, before, strlen(before)) == 0 &&
            parse_rest(text + strlen(before), (tl_lock_reason)reason, standing)) {
            return true;
        }
    }
    *standing = (tl_lock_standing){.reason = TL_LOCK_REASON_NONE};
    return false;
}

uint64_t tl_lock_tally_total(const tl_lock_tally *tally) {
    uint64_t total = 0;
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        total += tally->steps[i];
    }
    return total;
}

static double percent_of(const tl_lock_tally *tally, uint64_t steps) {
    uint64_t total = tl_lock_tally_total(tally);
    return total == 0 ? 0.0 : 100.0 * (double)steps / (double)total;
}

double tl_lock_tally_percent(const tl_lock_tally *tally) {
    return percent_of(tally, tally->steps[TL_LOCK_LOCKED] + tally->steps[TL_LOCK_CORRECTED]);
}

bool tl_lock_tally_is_enough(const tl_lock_tally *tally, double least) {
    double percent = tl_lock_tally_percent(tally);
    return least > 0.0 ? percent >= least : percent > 0.0 && tally->ran_away == 0;
}

void tl_lock_tally_write(const tl_lock_tally *tally, const char *unit, char text[TL_LOCK_SENTENCE]) {
    uint64_t total = tl_lock_tally_total(tally);
    if (total == 0) {
        (void)snprintf(text, TL_LOCK_SENTENCE, "unknown: there were no %s", unit);
        return;
    }
    if (tally->steps[TL_LOCK_FREE] == total) {
        (void)snprintf(text, TL_LOCK_SENTENCE, "never: no matched signal was good for long enough");
        return;
    }
    bool ever = tally->steps[TL_LOCK_LOCKED] + tally->steps[TL_LOCK_CORRECTED] != 0;
    int length =
        ever ? snprintf(text, TL_LOCK_SENTENCE, "%.1f %% of %" PRIu64 " %s", tl_lock_tally_percent(tally), total, unit)
             : snprintf(text, TL_LOCK_SENTENCE, "never in %" PRIu64 " %s", total, unit);
    length += snprintf(text + length, (size_t)(TL_LOCK_SENTENCE - length), ", at the end %s",
                       tl_lock_state_name(tally->state));
    const char *before = "; ";
    for (int i = 0; i < TL_LOCK_STATES && length < TL_LOCK_SENTENCE; i++) {
        if (i != TL_LOCK_LOCKED && tally->steps[i] != 0) {
            length += snprintf(text + length, (size_t)(TL_LOCK_SENTENCE - length), "%s%s %.1f %%", before,
                               tl_lock_state_name((tl_lock_state)i), percent_of(tally, tally->steps[i]));
            before = ", ";
        }
    }
    if (tally->ran_away != 0 && length < TL_LOCK_SENTENCE) {
        (void)snprintf(text + length, (size_t)(TL_LOCK_SENTENCE - length), "; ran away in %" PRIu64 " of them",
                       tally->ran_away);
    }
}
