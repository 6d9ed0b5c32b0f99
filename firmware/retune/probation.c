/* Probation: see probation.h. */
#include "firmware/retune/probation.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include "master/base/status.h"

static const tl_time MILLISECOND = TL_SECOND / 1000;

static tl_time least_time(tl_time a, tl_time b) {
    return a < b ? a : b;
}

/* Values from a disk may be invalid. */
void tl_probation_resume(tl_probation *probation, const tl_probation_account *account) {
    *probation = (tl_probation){.account = *account};
    tl_probation_terms *terms = &probation->account.terms;
    terms->given_s = terms->given_s < 1 ? 1 : terms->given_s;
    terms->given_s = terms->given_s > TL_PROBATION_LONGEST_S ? TL_PROBATION_LONGEST_S : terms->given_s;
    terms->require_lock = fmax(0.0, fmin(100.0, terms->require_lock));
    uint64_t given_ms = 1000 * (uint64_t)terms->given_s;
    probation->account.left_ms = account->left_ms < given_ms ? account->left_ms : given_ms;
    probation->left = (tl_time)probation->account.left_ms * MILLISECOND;
    probation->grace = least_time(TL_PROBATION_GRACE, probation->left / 2);
}

void tl_probation_begin(tl_probation *probation, const tl_probation_terms *terms, const tl_run_status *before,
                        const tl_run_status *now) {
    const tl_probation_account account = {.terms = *terms,
                                          .before_steps = before->steps,
                                          .before_misses = before->deadline_misses,
                                          .left_ms = UINT64_MAX}; /* limited to the full time below */
    tl_probation_resume(probation, &account);
    probation->has_last = true;
    if (now != NULL) {
        probation->last = *now;
    }
}

/* ---- counting ---- */

static uint64_t count_since(uint64_t before, uint64_t now) {
    return now >= before ? now - before : now;
}

static const tl_lock_tally *lock_before_of(const tl_probation *probation, const tl_run_status *snapshot) {
    return tl_lock_tolerances_have_weight(&probation->account.tolerances) ? &snapshot->lock_before : &snapshot->lock;
}

/* Adds the differences since the last state. If counts went down, another run has started, and all
 * of its counts are added. */
static void count_steps(tl_probation *probation, const tl_run_status *now) {
    static const tl_run_status beginning = {.ticks = 0};
    const tl_run_status *last = now->ticks < probation->last.ticks ? &beginning : &probation->last;
    tl_probation_account *account = &probation->account;
    account->steps += count_since(last->steps, now->steps);
    account->misses += count_since(last->deadline_misses, now->deadline_misses);
    account->skipped += count_since(last->skipped, now->skipped);
    bool is_evaluated = !now->plant_is_shut;
    const tl_lock_tally *before = lock_before_of(probation, last);
    const tl_lock_tally *before_now = lock_before_of(probation, now);
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        account->lock.steps[i] += is_evaluated ? count_since(last->lock.steps[i], now->lock.steps[i]) : 0;
        account->lock_before.steps[i] += is_evaluated ? count_since(before->steps[i], before_now->steps[i]) : 0;
    }
}

static bool is_lost(const tl_run_status *snapshot, const tl_lock_tally *lock) {
    return snapshot->twin_alive && lock->state == TL_LOCK_LOST;
}

/* Adds the time only if the condition is true at its begin and at its end. */
static void measure_time(tl_probation *probation, tl_time passed, const tl_run_status *now) {
    const tl_run_status *last = &probation->last;
    tl_time excused = least_time(passed, probation->grace);
    bool stays_lost = is_lost(last, &last->lock) && is_lost(now, &now->lock);
    bool stays_lost_before =
        is_lost(last, lock_before_of(probation, last)) && is_lost(now, lock_before_of(probation, now));
    probation->grace -= excused;
    probation->lost = stays_lost ? probation->lost + passed - excused : 0;
    probation->lost_before = stays_lost_before ? probation->lost_before + passed - excused : 0;
    probation->shut = now->twin_alive && now->plant_is_shut ? probation->shut + passed : 0;
    probation->down = !now->twin_alive && !last->twin_alive ? probation->down + passed : 0;
}

/* ---- decisions ---- */

static TL_PRINTF(3, 4) tl_probation_result
    end_probation(tl_probation *probation, tl_probation_result result, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(probation->why, TL_PROBATION_WHY, format, arguments);
    va_end(arguments);
    return probation->result = result;
}

static double percent_of(uint64_t part, uint64_t whole) {
    return whole == 0 ? 0.0 : 100.0 * (double)part / (double)whole;
}

bool tl_probation_is_too_many(uint64_t misses, uint64_t steps, uint64_t misses_before, uint64_t steps_before) {
    double now = percent_of(misses, steps);
    double before = percent_of(misses_before, steps_before);
    return misses >= TL_PROBATION_MISSES && now > fmax(TL_PROBATION_MISS_PERCENT, TL_PROBATION_MISS_TIMES * before);
}

enum { WIDENED = TL_PROBATION_WIDENED + 4 };

/* " (motor.omega: tolerance 1 → 3)" */
static const char *write_widened(const tl_probation_account *account, char text[WIDENED]) {
    bool is_widened = account->widened[0] != '\0';
    (void)snprintf(text, WIDENED, "%s%s%s", is_widened ? " (" : "", account->widened, is_widened ? ")" : "");
    return text;
}

/* Decides on a rollback before the time is over. */
static tl_probation_result check_twin(tl_probation *probation, const tl_run_status *now) {
    const tl_probation_account *account = &probation->account;
    char widened[WIDENED];
    if (count_since(probation->last.twin_failures, now->twin_failures) != 0) {
        return end_probation(probation, TL_PROBATION_ROLLED_BACK, "the twin failed%s%.*s",
                             now->failure[0] != '\0' ? ": " : "", TL_RUN_FAILURE - 1, now->failure);
    }
    if (tl_probation_is_too_many(account->misses, account->steps, account->before_misses, account->before_steps)) {
        return end_probation(probation, TL_PROBATION_ROLLED_BACK,
                             "%" PRIu64 " of %" PRIu64 " deadlines missed: %.3g %% (previous version %.3g %%); %" PRIu64
                             " ticks skipped",
                             account->misses, account->steps, percent_of(account->misses, account->steps),
                             percent_of(account->before_misses, account->before_steps), account->skipped);
    }
    if (probation->lost >= TL_PROBATION_LOST) {
        return end_probation(probation, TL_PROBATION_ROLLED_BACK, "the lock was lost for %.1f s",
                             tl_seconds(probation->lost));
    }
    if (probation->lost_before >= TL_PROBATION_LOST && !account->terms.must_confirm) {
        return end_probation(probation, TL_PROBATION_ROLLED_BACK,
                             "by the previous version's tolerances, the lock was lost for %.1f s%s",
                             tl_seconds(probation->lost_before), write_widened(account, widened));
    }
    if (probation->shut >= TL_PROBATION_SHUT) {
        return end_probation(probation, TL_PROBATION_ROLLED_BACK, "plant: its sources could not be opened for %.0f s",
                             tl_seconds(probation->shut));
    }
    if (probation->down >= TL_PROBATION_START) {
        return end_probation(probation, TL_PROBATION_ROLLED_BACK, "the twin did not run for %.0f s",
                             tl_seconds(probation->down));
    }
    return end_probation(probation, TL_PROBATION_CONTINUES, "%s", "");
}

/* Decides at the end of the time: the first rule that applies. */
static tl_probation_result decide_end(tl_probation *probation, const tl_run_status *now) {
    const tl_probation_account *account = &probation->account;
    const tl_probation_terms *terms = &account->terms;
    char widened[WIDENED];
    char lost[TL_PROBATION_WHY];
    uint64_t evaluated = tl_lock_tally_total(&account->lock);
    (void)snprintf(lost, sizeof lost,
                   "by the previous version's tolerances, the lock was lost at the end of the probation%s",
                   write_widened(account, widened));
    const struct {
        bool holds;
        tl_probation_result result;
        const char *why;
    } rules[] = {
        {terms->must_confirm, TL_PROBATION_ROLLED_BACK, "it was not confirmed in time"},
        {!now->twin_alive, TL_PROBATION_ROLLED_BACK, "the twin did not run at the end of the probation"},
        {now->plant_is_shut, TL_PROBATION_ROLLED_BACK, "plant: its sources were not open at the end of the probation"},
        {tl_lock_tolerances_have_weight(&account->tolerances) && is_lost(now, &now->lock_before),
         TL_PROBATION_ROLLED_BACK, lost},
        {terms->require_lock == 0.0, TL_PROBATION_KEPT, "no failure during the probation"},
        {evaluated == 0 && now->pairs == 0 && now->steps > 0, TL_PROBATION_ROLLED_BACK,
         "no matched signal was good, so the lock could not be evaluated"},
        {evaluated == 0 && account->steps > account->skipped, TL_PROBATION_KEPT,
         "no failure during the probation; no step could be evaluated for the lock"},
        {evaluated == 0, TL_PROBATION_ROLLED_BACK,
         "the probation was too short to evaluate the lock: use a longer --probation"},
    };
    for (size_t i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        if (rules[i].holds) {
            return end_probation(probation, rules[i].result, "%s", rules[i].why);
        }
    }
    double by_own = tl_lock_tally_percent(&account->lock);
    double in_lock = fmin(by_own, tl_lock_tally_percent(&account->lock_before));
    bool is_by_before = in_lock < by_own;
    return end_probation(probation, in_lock >= terms->require_lock ? TL_PROBATION_KEPT : TL_PROBATION_ROLLED_BACK,
                         "%sin lock in %.4g %% of the steps (required %.4g %%)%s",
                         is_by_before ? "by the previous version's tolerances, " : "", in_lock, terms->require_lock,
                         is_by_before ? widened : "");
}

tl_probation_result tl_probation_feed(tl_probation *probation, tl_time passed, const tl_run_status *now) {
    if (probation->result != TL_PROBATION_CONTINUES) {
        return probation->result;
    }
    if (!probation->has_last) {
        probation->last = *now;
        probation->has_last = true;
    }
    passed = passed > 0 ? least_time(passed, probation->left) : 0;
    count_steps(probation, now);
    measure_time(probation, passed, now);
    probation->left -= passed;
    probation->account.left_ms = (uint64_t)(probation->left / MILLISECOND);
    if (check_twin(probation, now) == TL_PROBATION_CONTINUES) {
        probation->last = *now;
        return probation->left > 0 ? TL_PROBATION_CONTINUES : decide_end(probation, now);
    }
    return TL_PROBATION_ROLLED_BACK;
}

/* ---- decision of a user ---- */

tl_probation_result tl_probation_decide(tl_probation *probation, tl_probation_result result, const char *why) {
    return probation->result != TL_PROBATION_CONTINUES ? probation->result
                                                       : end_probation(probation, result, "%s", why);
}

bool tl_probation_is_lost_by_previous(const tl_probation *probation) {
    return tl_lock_tolerances_have_weight(&probation->account.tolerances) &&
           is_lost(&probation->last, &probation->last.lock_before);
}
