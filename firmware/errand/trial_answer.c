/* Answers of trials: see trial_answer.h. */
#include "firmware/errand/trial_answer.h"

#include <string.h>

#include "firmware/outbox/run_types.h"
#include "firmware/plant/plant_mail.h"
#include "firmware/text/clean_text.h"
#include "master/base/signal.h"

/* The list is shown to people. */
static void clean_list(tl_trial_answer *answer) {
    char copy[TL_TRIAL_BLIND];
    size_t length = strnlen(answer->blind, sizeof answer->blind - 1);
    memcpy(copy, answer->blind, length);
    (void)tl_clean_text(copy, length, answer->blind, sizeof answer->blind);
}

static bool has_plant(const tl_trial_answer *answer) {
    return tl_plant_mail_can_have(answer->signals, answer->mail_bytes) && answer->other_plant <= 1 &&
           answer->lacks_input <= 1 && answer->unseen <= answer->signals &&
           (answer->unseen == 0 || answer->other_plant == 1);
}

/* No box has as much. */
static const uint64_t BYTES = (uint64_t)1 << 50;

static bool has_room(const tl_trial_answer *answer) {
    return answer->match <= TL_MAX_MATCH && answer->adjust <= TL_MAX_ADJUST &&
           answer->components < TL_RECORDER_COMPONENTS && answer->unconfined <= 1 && answer->fmu_bytes <= BYTES &&
           answer->memory <= BYTES;
}

bool tl_trial_answer_take(const tl_trial_answer *from, tl_trial_answer *answer) {
    uint32_t is_there = __atomic_load_n(&from->is_there, __ATOMIC_ACQUIRE);
    memcpy(answer, from, sizeof *answer);
    clean_list(answer);
    return is_there == 1 && has_room(answer) && has_plant(answer) && answer->step > 0 && answer->budget >= 0 &&
           answer->least >= 0 && answer->worst >= 0;
}
