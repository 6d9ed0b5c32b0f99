/* The activator of a run: see live_activator.h. */
#include "firmware/live/live_activator.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/live/restarts.h"
#include "firmware/retune/control.h"

static const tl_time PAUSE_FIRST = TL_SECOND / 4;
static const tl_time PAUSE_LAST = 300 * TL_SECOND; /* a full disk may stay full */
static const tl_time QUIET = 60 * TL_SECOND;       /* between two lines about failures */
static const tl_time PAUSE_OF_CLIENT = TL_SECOND;  /* a client waits no longer */

static tl_live_activator_pulse *pulse_of(const tl_live_activator *self) {
    return self->pulse.bytes;
}

tl_status tl_live_activator_open(tl_live_activator *activator, const char *path, tl_error *error) {
    *activator = (tl_live_activator){.listener = -1, .pulse = {.descriptor = -1}};
    tl_status status =
        tl_block_make("twinlock activator", tl_live_activator_bytes(), TL_BLOCK_THEY_WRITE, &activator->pulse, error);
    tl_error why;
    if (status == TL_OK && path != NULL && tl_control_listen(path, &activator->listener, &why) != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s; the run goes on, and its configuration cannot be changed", why.text);
    }
    activator->wants = true; /* it sees to what was not finished */
    return status;
}

/* ---- its ends ---- */

static void rest(tl_live_activator *self, tl_time now, bool failed) {
    self->pause = !failed ? 0 : self->pause == 0 ? PAUSE_FIRST : 2 * self->pause;
    self->pause = self->pause > PAUSE_LAST ? PAUSE_LAST : self->pause;
    self->rests = now;
    self->wants = failed;
}

static void describe(const tl_live_activator *self, char reason[TL_RESTARTS_REASON]) {
    if (self->is_silent) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "it gave no sign of life");
    } else if (self->role.signal != 0) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "it was ended by signal %d (%s)", self->role.signal,
                       strsignal(self->role.signal));
    } else {
        (void)snprintf(reason, TL_RESTARTS_REASON, "it ended with exit code %d", self->role.code);
    }
}

/* A life in which it did its work is forgiven. */
static void note_end(tl_live_activator *self, const tl_live_activator_host *host, tl_time now) {
    char reason[TL_RESTARTS_REASON];
    int code = 0;
    tl_farewell farewell = tl_heartbeats_get_farewell(&pulse_of(self)->beats, &code);
    bool is_orderly = self->role.signal == 0 && self->role.code == 0 &&
                      (farewell == TL_FAREWELL_OVER || farewell == TL_FAREWELL_ASKED);
    rest(self, now, !is_orderly);
    if (is_orderly || self->was_told) {
        return;
    }
    self->untold++;
    if (self->told == 0 || now - self->told >= QUIET) {
        describe(self, reason);
        host->tell(host->context, self->untold, reason);
        self->told = now;
        self->untold = 0;
    }
}

static void look_at_living(tl_live_activator *self, const tl_live_activator_host *host, tl_time now) {
    tl_time silence = 0;
    if (tl_role_watch(&self->role)) {
        note_end(self, host, now);
        return;
    }
    if (!self->is_silent && tl_heartbeats_look(&pulse_of(self)->beats, &self->seen, now, &silence) != NULL) {
        self->is_silent = true;
        (void)kill(self->role.pid, SIGKILL); /* a dead disk may keep it from dying: nobody waits */
    }
}

static void begin(tl_live_activator *self, const tl_live_activator_host *host, tl_time now) {
    tl_heartbeats_clear(&pulse_of(self)->beats);
    self->seen = (tl_heartbeats_seen){.looked = 0};
    self->wants = false;
    self->is_silent = false;
    self->role = (tl_role){.pid = host->begin(host->context)};
    if (self->role.pid == 0) {
        rest(self, now, true);
    }
}

/* After a failure work that is left waits for the whole pause, and a client for a second. */
static bool is_needed(const tl_live_activator *self, tl_time now) {
    tl_time rested = now - self->rests;
    bool is_asked = rested >= PAUSE_OF_CLIENT || rested >= self->pause;
    return (self->wants && rested >= self->pause) || (is_asked && tl_control_is_knocked_at(self->listener));
}

bool tl_live_activator_look(tl_live_activator *activator, const tl_live_activator_host *host, bool ends) {
    tl_time now = tl_clock_now(NULL);
    if (activator->listener < 0) {
        return false;
    }
    if (activator->role.pid != 0) {
        if (ends && !activator->was_told) {
            activator->was_told = true;
            (void)kill(activator->role.pid, SIGTERM);
        }
        look_at_living(activator, host, now);
    } else if (!ends && is_needed(activator, now)) {
        begin(activator, host, now);
    }
    return __atomic_load_n(&pulse_of(activator)->restart, __ATOMIC_ACQUIRE) != 0;
}

void tl_live_activator_close(tl_live_activator *activator, const char *path) {
    if (activator->role.pid != 0) {
        (void)kill(activator->role.pid, SIGKILL); /* reaped when this process ends */
    }
    if (activator->listener >= 0) {
        (void)close(activator->listener);
        (void)unlink(path);
    }
    tl_block_close(&activator->pulse);
    *activator = (tl_live_activator){.listener = -1, .pulse = {.descriptor = -1}};
}
