/* Arrivals: see arrivals.h. */
#include "firmware/twin/arrivals.h"

static void begin(tl_arrivals *self, const tl_plant_input *input, tl_time now) {
    self->begun = now;
    for (size_t i = 0; i < input->count; i++) {
        self->since[i] = now;
        self->first[i] = tl_sample_buffer_posts(&input->buffers[i]);
        self->posts[i] = self->first[i];
    }
}

static void report(const tl_config *config, size_t signal, uint64_t posts, tl_time time, tl_journal *journal) {
    const tl_config_signal *described = &config->signals[signal];
    const tl_time interval = tl_config_interval(config, described);
    const bool is_declared = described->every > 0;
    tl_journal_event(journal, -1, TL_EVENT_WARNING, "plant",
                     "plant.%s: %llu readings in %.3g s (expected %lld, one per %g s): %s; later ones are only counted",
                     described->plan.name, (unsigned long long)posts, tl_seconds(time), (long long)(time / interval),
                     tl_seconds(interval),
                     is_declared ? "check the sender, or raise its every_s"
                                 : "the device answers slowly: check it, or raise period_s of its source");
}

void tl_arrivals_check(tl_arrivals *self, const tl_plant_input *input, const tl_config *config, tl_journal *journal,
                       tl_time now) {
    if (now < self->due) {
        return;
    }
    self->due = now + TL_ARRIVALS_CHECK;
    if (self->begun == 0) {
        begin(self, input, now);
        return;
    }
    for (size_t i = 0; i < input->count; i++) {
        const tl_time interval = tl_config_interval(config, &config->signals[i]);
        const tl_time time = now - self->since[i];
        if (interval == 0 || time < TL_ARRIVALS_LEAST * interval) {
            continue;
        }
        const uint64_t all = tl_sample_buffer_posts(&input->buffers[i]);
        const uint64_t posts = all - self->posts[i];
        self->since[i] = now;
        self->posts[i] = all;
        if (posts < (uint64_t)(time / interval) * 3 / 4 && (self->reported >> i & 1U) == 0) {
            self->reported |= UINT64_C(1) << i;
            report(config, i, posts, time, journal);
        }
    }
}

void tl_arrivals_sum_up(const tl_arrivals *self, const tl_plant_input *input, const tl_config *config, tl_time now,
                        tl_summary *summary) {
    for (size_t i = 0; i < input->count && self->begun != 0; i++) {
        const tl_time interval = tl_config_interval(config, &config->signals[i]);
        summary->readings[i] = tl_sample_buffer_posts(&input->buffers[i]) - self->first[i];
        summary->expected[i] = interval > 0 ? (uint64_t)((now - self->begun) / interval) : 0;
    }
}
