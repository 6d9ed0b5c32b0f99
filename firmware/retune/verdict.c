/* Verdicts: see verdict.h. */
#include "firmware/retune/verdict.h"

#include <stddef.h>
#include <string.h>

#include "firmware/base/clean_text.h"
#include "firmware/config/change_rules.h"

/* Ends it, and takes out what could command a terminal. `room` is at most TL_CONTROL_TEXT. */
static void clean(char *text, size_t room) {
    char copy[TL_CONTROL_TEXT];
    size_t length = strnlen(text, room - 1);
    memcpy(copy, text, length);
    (void)tl_clean_text(copy, length, text, room);
}

static void clean_problem(tl_control_problem *problem) {
    clean(problem->path, sizeof problem->path);
    clean(problem->text, sizeof problem->text);
}

static void clean_change(tl_control_change *change) {
    clean(change->path, sizeof change->path);
    clean(change->before, sizeof change->before);
    clean(change->after, sizeof change->after);
    clean(change->kind, sizeof change->kind);
    clean(change->right, sizeof change->right);
}

bool tl_verdict_take(const tl_verdict *from, tl_verdict *verdict) {
    uint32_t is_there = __atomic_load_n(&from->is_there, __ATOMIC_ACQUIRE);
    memcpy(verdict, from, sizeof *verdict);
    if (is_there != 1 || verdict->is_valid > 1 || verdict->kind >= TL_CHANGE_KINDS ||
        verdict->right >= TL_CHANGE_RIGHTS || !tl_lock_yardstick_is_sound(&verdict->yardstick) || verdict->window < 0 ||
        verdict->window > TL_VERDICT_LONGEST) {
        return false;
    }
    clean(verdict->name, sizeof verdict->name);
    clean(verdict->widened, sizeof verdict->widened);
    for (size_t i = 0; i < TL_VERDICT_PROBLEMS; i++) {
        clean_problem(&verdict->problem[i]);
    }
    for (size_t i = 0; i < TL_VERDICT_CHANGES; i++) {
        clean_change(&verdict->change[i]);
    }
    return verdict->is_valid == 0 || tl_tuning_check(&verdict->tuning, NULL) == TL_OK;
}
