/* Recorded samples for a shadow: see live_samples.h. */
#include "firmware/live/live_samples.h"

#include <stdio.h>
#include <string.h>

#include "firmware/twin/past_samples.h"

static void answer(tl_live_samples *self, tl_live_wish wish, const char *path) {
    tl_live_past_answer *given = self->answer;
    int64_t from = __atomic_load_n(&self->pulse->past_from, __ATOMIC_RELAXED);
    size_t size = 0;
    tl_error error;
    memset(given->words, 0, sizeof given->words);
    if (tl_past_samples_find(path, self->boot, from, self->past->bytes, self->past->size, &size, &error) != TL_OK) {
        given->words[0].severity = (int32_t)TL_EVENT_WARNING;
        (void)snprintf(given->words[0].text, sizeof given->words[0].text, "%.200s", error.text);
    }
    given->size = size;
    self->answered = wish;
    self->is_filled = self->is_filled || size != 0;
    __atomic_store_n(&given->wish, wish, __ATOMIC_RELEASE);
}

void tl_live_samples_look(tl_live_samples *self, const char *path) {
    tl_live_wish wish = __atomic_load_n(&self->pulse->past, __ATOMIC_ACQUIRE);
    bool begun = __atomic_load_n(&self->pulse->begun, __ATOMIC_RELAXED) != 0;
    if (wish != 0 && wish != self->answered && !begun) {
        answer(self, wish, path);
    } else if (begun && self->is_filled) {
        tl_block_forget(self->past, 0, self->past->size);
        self->is_filled = false;
    }
}
