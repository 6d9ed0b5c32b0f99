/* Safe hold: see safe_hold.h. */
#include "firmware/twin/safe_hold.h"

#include <stdio.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/process/interrupt.h"

/* How often the log repeats what is wrong, and how long the thread sleeps at most. */
static const tl_time REMIND = 600 * TL_SECOND;
static const tl_time SHOW = TL_SECOND;
static const tl_time LOOK = TL_SECOND / 20;

/* Takes what is due up to now; returns the next tick. */
static int64_t take_samples(const tl_safe_hold_settings *settings, tl_time start, int64_t tick) {
    tl_time step = settings->config->step;
    tl_time now = tl_clock_now(NULL);
    for (; tl_time_of_step(start, step, tick) <= now; tick++) {
        tl_sample sample;
        tl_plant_input_take(settings->input, tick, tl_time_of_step(start, step, tick), &sample);
        (void)tl_outbox_put_sample(settings->outbox, &sample);
        tl_heart_beat(settings->heart);
    }
    return tick;
}

/* `left`: until the next try. */
static void describe(const tl_safe_hold_settings *settings, tl_time left, char text[TL_HEARTBEAT_STATUS]) {
    const char *recorded = settings->records ? " and recorded" : "; nothing is recorded";
    long seconds = left > 0 ? (long)((left + TL_SECOND - 1) / TL_SECOND) : 0;
    if (settings->since != 0) {
        (void)snprintf(text, TL_HEARTBEAT_STATUS,
                       "the twin begins when the saved states of its FMUs are tested. The plant is read%s", recorded);
        return;
    }
    (void)snprintf(text, TL_HEARTBEAT_STATUS,
                   "safe hold: %s %u times; next try in %ld %s. The plant is read%s. To try it now, stop and "
                   "start the run. Last failure: %s",
                   settings->missing > 0 ? "the twin could not be started" : "the twin failed",
                   settings->missing > 0 ? settings->missing : settings->failures,
                   seconds < 120 ? seconds : seconds / 60, seconds < 120 ? "s" : "min", recorded, settings->reason);
}

void tl_safe_hold(const tl_safe_hold_settings *settings) {
    static const tl_time ms = TL_SECOND / 1000;
    char text[TL_HEARTBEAT_STATUS];
    tl_time begun = tl_clock_now(NULL);
    tl_time shown = begun;
    describe(settings, settings->time, text);
    tl_journal_event(settings->journal, -1, settings->since != 0 ? TL_EVENT_INFO : TL_EVENT_ERROR, "supervisor", "%s",
                     text);
    tl_heartbeats_set_status(settings->beats, text);
    tl_time start = settings->since != 0 ? settings->since : begun + settings->config->step;
    tl_time remind = begun + REMIND;
    static tl_outbox_start beginning; /* too large for a small stack */
    beginning = (tl_outbox_start){.holds = true,
                                  .resumption = {.start = start, .started = tl_utc_now() + (start - begun) / ms}};
    (void)tl_outbox_put_start(settings->outbox, &beginning);
    for (int64_t tick = 0; tl_interrupt_requested() == NULL;) {
        tl_time due = tl_time_of_step(start, settings->config->step, tick);
        tl_time most = tl_clock_now(NULL) + LOOK;
        tl_clock_sleep_until(due < most ? due : most);
        tick = take_samples(settings, start, tick);
        tl_heart_beat(settings->heart);
        tl_journal_drain(settings->journal);
        if (tl_clock_now(NULL) - shown >= SHOW) {
            shown += SHOW;
            describe(settings, begun + settings->time - shown, text);
            tl_heartbeats_set_status(settings->beats, text);
        }
        if (shown >= remind) {
            tl_log(TL_LOG_ERROR, "%s", text);
            remind += REMIND;
        }
    }
}
