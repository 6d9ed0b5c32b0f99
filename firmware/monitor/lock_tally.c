/* Lock states and the steps in each: see lock_tally.h. */
#include "firmware/monitor/lock_tally.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

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

bool tl_lock_tolerances_is_there(const tl_lock_tolerances *tolerances) {
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
