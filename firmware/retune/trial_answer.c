/* Answers of trials: see trial_answer.h. */
#include "firmware/retune/trial_answer.h"

#include <string.h>

#include "firmware/base/clean_text.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"

/* Texts are shown to people. The longest that is copied here is `why`. */
static void clean(const char *from, char *text, size_t size) {
    char copy[TL_TRIAL_WHY];
    size_t length = strnlen(from, size - 1);
    memcpy(copy, from, length);
    (void)tl_clean_text(copy, length, text, size);
}

/* No box has as much. */
static const uint64_t BYTES = (uint64_t)1 << 50;

static bool has_room(const tl_trial_answer *answer) {
    return answer->match <= TL_MAX_MATCH && answer->adjust <= TL_MAX_ADJUST &&
           answer->components < TL_RECORDER_COMPONENTS && answer->unconfined <= 1 && answer->signals >= 1 &&
           answer->signals <= TL_MAX_SIGNALS && answer->fmu_bytes <= BYTES && answer->memory <= BYTES;
}

bool tl_trial_answer_take(const tl_trial_answer *from, tl_trial_answer *answer) {
    uint32_t is_there = __atomic_load_n(&from->is_there, __ATOMIC_ACQUIRE);
    memcpy(answer, from, sizeof *answer);
    return is_there == 1 && has_room(answer) && answer->step > 0 && answer->budget >= 0 && answer->least >= 0 &&
           answer->worst >= 0;
}

bool tl_trial_states_take(const tl_trial_states *from, char why[TL_TRIAL_WHY]) {
    bool is_there = __atomic_load_n(&from->is_there, __ATOMIC_ACQUIRE) == 1;
    clean(from->why, why, TL_TRIAL_WHY);
    return is_there;
}
