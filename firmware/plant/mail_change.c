/* From one mail to another: see mail_change.h. */
#include "firmware/plant/mail_change.h"

void tl_mail_change_open(tl_mail_change *change, tl_plant_input *input, const tl_same_signals *same,
                         const tl_mailbox of_run[]) {
    *change = (tl_mail_change){.input = input};
    for (size_t i = 0; i < input->count; i++) {
        change->own[i] = input->mailboxes[i];
        change->waits[i] = i < same->count && same->of[i] != TL_NO_SUCH_SIGNAL && !input->looks[i].shows;
        if (change->waits[i]) {
            input->mailboxes[i] = of_run[same->of[i]];
            change->waiting++;
        }
    }
}

void tl_mail_change_begin(tl_mail_change *change, tl_time instant) {
    change->has_begun = true;
    change->until = instant + TL_MAIL_CHANGE_LONGEST;
}

static bool has_reading(const tl_mail_change *change, size_t signal, tl_time instant) {
    tl_reading reading;
    return tl_mailbox_at(&change->own[signal], instant - change->input->looks[signal].back, &reading) &&
           reading.quality == TL_GOOD;
}

static void change_over(tl_mail_change *change, size_t signal) {
    change->input->mailboxes[signal] = change->own[signal];
    change->waits[signal] = false;
    __atomic_store_n(&change->waiting, change->waiting - 1, __ATOMIC_RELEASE);
}

void tl_mail_change_look(tl_mail_change *change, tl_time instant) {
    if (change->waiting == 0 || !change->has_begun) {
        return;
    }
    for (size_t i = 0; i < change->input->count; i++) {
        if (change->waits[i] && (instant >= change->until || has_reading(change, i, instant))) {
            change_over(change, i);
        }
    }
}

bool tl_mail_change_is_over(const tl_mail_change *change) {
    return __atomic_load_n(&change->waiting, __ATOMIC_ACQUIRE) == 0;
}
