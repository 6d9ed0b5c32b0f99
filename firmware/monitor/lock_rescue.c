/* Bringing back a twin that is lost: see lock_rescue.h. */
#include "firmware/monitor/lock_rescue.h"

void tl_lock_rescue_init(tl_lock_rescue *rescue, const tl_config *config, const tl_account *account) {
    *rescue = (tl_lock_rescue){.pause = 0};
    tl_lock_judge_init(&rescue->judge, config, account);
}

void tl_lock_rescue_sample(tl_lock_rescue *rescue, const tl_sample *sample) {
    tl_lock_judge_sample(&rescue->judge, sample);
}

/* Once in lock for as long as it takes to learn what is usual, the twin is as good as any. */
static void forgive(tl_lock_rescue *rescue, const tl_lock_tally *tally) {
    bool is_well = tally->state == TL_LOCK_LOCKED || tally->state == TL_LOCK_TRACKING;
    rescue->well = is_well ? rescue->well + 1 : 0;
    if (rescue->well >= TL_LOCK_LEARNS) {
        rescue->pause = 0;
    }
}

static void note_reset(tl_lock_rescue *rescue) {
    uint32_t longer = 2 * rescue->pause;
    rescue->pause = longer == 0 ? TL_LOCK_PAUSE_FIRST : longer < TL_LOCK_PAUSE_LAST ? longer : TL_LOCK_PAUSE_LAST;
    rescue->passed = 0;
}

bool tl_lock_rescue_step(tl_lock_rescue *rescue, const tl_record *record, const tl_lock_change **change) {
    const tl_lock_tally *tally = &rescue->judge.tally;
    *change = tl_lock_judge_step(&rescue->judge, record);
    if (tally->windows == rescue->windows) {
        return false;
    }
    rescue->windows = tally->windows;
    rescue->passed++;
    forgive(rescue, tally);
    bool is_due = tl_lock_judge_is_astray(&rescue->judge) && rescue->passed >= rescue->pause &&
                  rescue->judge.config->event.start.signal == NULL;
    if (is_due) {
        note_reset(rescue);
    }
    return is_due;
}
