/* What two twins of one configuration tell of its FMUs: see pair_verdict.h. */
#include "firmware/twin/pair_verdict.h"

#include <stdio.h>
#include <string.h>

/* Of a process that cannot be started the outcome says that there is no place for it. */
static tl_status try_pair(const tl_twin_child_settings *settings, bool alone, tl_twin_outcome *outcome,
                          tl_error *error) {
    tl_twin_job job = *settings->job;
    tl_twin_child_settings own = *settings;
    tl_twin_child *child = NULL;
    job.task = TL_TASK_PAIR;
    job.alone = alone;
    job.reads_back = false;
    own.job = &job;
    own.page = NULL;
    own.memory_limit *= 2;
    tl_status status = tl_twin_child_start(&own, &child, error);
    if (status == TL_TRY_AGAIN) {
        *outcome = (tl_twin_outcome){.status = status};
        (void)snprintf(outcome->text, sizeof outcome->text, "%s", error->text);
        return TL_OK;
    }
    if (status == TL_OK) {
        status = tl_twin_child_finish(child, outcome, error);
    }
    tl_twin_child_close(child);
    return status;
}

/* As far as both came. */
static bool is_same_again(const tl_twin_pair_account *first, const tl_twin_pair_account *again) {
    uint32_t steps = first->steps < again->steps ? first->steps : again->steps;
    return steps > 0 && memcmp(first->marks, again->marks, steps * sizeof *first->marks) == 0;
}

/* Both twins have stepped, and differ. */
static tl_status tell_apart(const tl_twin_child_settings *settings, const tl_twin_outcome *pair,
                            tl_pair_verdict *verdict, tl_error *error) {
    tl_twin_outcome again;
    tl_status status = try_pair(settings, true, &again, error);
    if (status == TL_OK) {
        bool is_steady = again.status == TL_OK && is_same_again(&pair->pair, &again.pair);
        verdict->kind = is_steady ? TL_PAIR_ONE_PER_PROCESS : TL_PAIR_NOT_DETERMINISTIC;
    }
    return status;
}

tl_status tl_pair_verdict_find(const tl_twin_child_settings *settings, tl_pair_verdict *verdict, tl_error *error) {
    tl_twin_outcome pair;
    tl_status status = try_pair(settings, false, &pair, error);
    if (status != TL_OK) {
        return status;
    }
    *verdict = (tl_pair_verdict){.kind = TL_PAIR_UNKNOWN, .steps = pair.pair.steps};
    (void)snprintf(verdict->component, sizeof verdict->component, "%s", pair.pair.component);
    (void)snprintf(verdict->text, sizeof verdict->text, "%s", pair.text);
    if (pair.status == TL_TRY_AGAIN) {
        return TL_OK;
    }
    if (pair.status != TL_OK && !pair.has_ended) {
        verdict->text[strcspn(verdict->text, ";")] = '\0'; /* what follows is advice for a log that nobody has seen */
    }
    if (pair.status != TL_OK) {
        verdict->kind = pair.pair.has_second != 0 ? TL_PAIR_ONE_PER_PROCESS : TL_PAIR_NOT_DETERMINISTIC;
        return TL_OK;
    }
    if (pair.text[0] != '\0') {
        return tell_apart(settings, &pair, verdict, error);
    }
    verdict->kind = pair.pair.steps > 0 ? TL_PAIR_SAME : TL_PAIR_UNKNOWN;
    return TL_OK;
}
