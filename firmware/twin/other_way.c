/* Another way of leading a component back, tried: see other_way.h. */
#include "firmware/twin/other_way.h"

#include <stdio.h>
#include <string.h>

#define NOBODY SIZE_MAX

/* What is under way. */
typedef struct way_search {
    const tl_twin_child_settings *settings;
    tl_twin_job job; /* with the ways that are tried */
    tl_other_way *found;
    bool was_forked[TL_RECORDER_COMPONENTS];
} way_search;

static size_t count_of(const way_search *self) {
    return self->settings->config->component_count;
}

static tl_rollback configured(const way_search *self, size_t component) {
    return self->settings->config->components[component].rollback;
}

static bool is_changed(const way_search *self, size_t component) {
    return self->job.rollback[component] != (unsigned char)TL_ROLLBACK_NONE;
}

static tl_rollback way_of(const way_search *self, size_t component) {
    return is_changed(self, component) ? (tl_rollback)self->job.rollback[component] : configured(self, component);
}

static void set_way(way_search *self, size_t component, tl_rollback way) {
    self->job.rollback[component] = (unsigned char)way;
}

/* ---- one trial ---- */

static tl_status try_ways(const way_search *self, tl_twin_outcome *outcome, tl_error *error) {
    tl_twin_child_settings own = *self->settings;
    tl_twin_child *child = NULL;
    own.job = &self->job;
    own.page = NULL;
    tl_status status = tl_twin_child_start(&own, &child, error);
    if (status == TL_OK) {
        status = tl_twin_child_finish(child, outcome, error);
    } else if (status != TL_INTERRUPTED) {
        *outcome = (tl_twin_outcome){.status = status};
        (void)snprintf(outcome->text, sizeof outcome->text, "%s", error->text);
        status = TL_OK;
    }
    tl_twin_child_close(child);
    return status;
}

static bool has_failed(const tl_twin_outcome *tried) {
    return tried->status != TL_OK || tried->text[0] != '\0';
}

/* Who is to blame. Who ends the process before it has the component's name is the one that is led back otherwise than before, if that is one only. */
static size_t find_culprit(const way_search *self, const tl_twin_outcome *tried) {
    size_t only = NOBODY;
    size_t changed = 0;
    for (size_t i = 0; i < count_of(self); i++) {
        if (strcmp(self->settings->config->components[i].name, tried->ways.component) == 0) {
            return i;
        }
        only = is_changed(self, i) ? i : only;
        changed += is_changed(self, i) ? 1 : 0;
    }
    return tried->has_ended && changed == 1 ? only : NOBODY;
}

/* Without its name, and what is advice for a log that nobody has seen. */
static void quote(const way_search *self, size_t component, const char *said, char text[TL_ERROR_TEXT]) {
    const char *name = self->settings->config->components[component].name;
    size_t length = strlen(name);
    bool is_named = strncmp(said, name, length) == 0 && (said[length] == ':' || said[length] == ' ');
    said += is_named ? length + 1 : 0;
    said += strspn(said, " ");
    (void)snprintf(text, TL_ERROR_TEXT, "%.*s", (int)strcspn(said, ";"), said);
}

/* Nobody is to blame. `before`: with what all came back, or with what it began. */
static void give_up(const way_search *self, const tl_twin_job *before, const tl_twin_outcome *tried) {
    for (size_t i = 0; i < count_of(self); i++) {
        bool was_found = before->rollback[i] != (unsigned char)TL_ROLLBACK_NONE;
        if (self->job.rollback[i] != before->rollback[i]) {
            self->found[i].kind = was_found ? self->found[i].kind : TL_OTHER_WAY_UNKNOWN;
            quote(self, i, tried->text, self->found[i].text);
        }
    }
}

/* ---- by forking ---- */

/* It has a process of its own then, in which libraries of ours are not. False: it cannot, or has been tried. */
static bool can_fork(const way_search *self, size_t component) {
    tl_other_way *found = &self->found[component];
    if (self->was_forked[component]) {
        return false;
    }
    if (self->settings->config->components[component].library_count != 0) {
        (void)snprintf(found->text, sizeof found->text, "needs \"libraries\", which its own process would not have");
        return false;
    }
    return true;
}

/* ---- what does not come back ---- */

/* Another way for who is to blame; false: there is none. */
static bool take_next_way(way_search *self, size_t culprit, const char *why) {
    const tl_rollback now = way_of(self, culprit);
    if (now == TL_ROLLBACK_FORK) {
        self->was_forked[culprit] = true;
        quote(self, culprit, why, self->found[culprit].text); /* of the check itself nothing, since the log has it */
    }
    if (now != TL_ROLLBACK_AUTO && !is_changed(self, culprit)) {
        set_way(self, culprit, TL_ROLLBACK_AUTO);
        return true;
    }
    if (now == TL_ROLLBACK_AUTO && can_fork(self, culprit)) {
        set_way(self, culprit, TL_ROLLBACK_FORK);
        return true;
    }
    return false;
}

/* Until all come back, as *now says. *is_found is false: one does not, or it could not be found out. */
static tl_status find_any(way_search *self, const tl_twin_ways *checked, tl_twin_outcome *now, bool *is_found,
                          tl_error *error) {
    const tl_twin_job before = self->job;
    size_t culprit = NOBODY;
    bool goes_on = checked->cannot_return != 0;
    tl_status status = TL_OK;
    *now = (tl_twin_outcome){.ways = *checked};
    while (goes_on && status == TL_OK) {
        culprit = find_culprit(self, now);
        goes_on = culprit != NOBODY && take_next_way(self, culprit, now->text);
        if (goes_on) {
            status = try_ways(self, now, error);
            goes_on = status == TL_OK && has_failed(now);
        } else {
            *is_found = false;
        }
    }
    if (status != TL_OK || *is_found) {
        return status;
    }
    if (culprit == NOBODY) {
        give_up(self, &before, now);
    } else {
        self->found[culprit].kind = TL_OTHER_WAY_NONE;
    }
    return TL_OK;
}

/* ---- what comes back ---- */

/* Those that are led back by replay, by forking instead. How many there are. */
static size_t fork_replayed(way_search *self, const tl_twin_ways *ways) {
    size_t count = 0;
    for (size_t i = 0; i < count_of(self); i++) {
        if (ways->of[i].rollback == TL_ROLLBACK_REPLAY && can_fork(self, i)) {
            set_way(self, i, TL_ROLLBACK_FORK);
            count++;
        }
    }
    return count;
}

/* Found, by the ways that all were led back by in `tried`. */
static void settle(const way_search *self, const tl_twin_ways *replayed, const tl_twin_ways *tried) {
    for (size_t i = 0; i < count_of(self); i++) {
        tl_other_way *found = &self->found[i];
        bool by_replay = replayed->of[i].rollback == TL_ROLLBACK_REPLAY;
        if (found->kind == TL_OTHER_WAY_NOT_SOUGHT && is_changed(self, i)) {
            found->kind = TL_OTHER_WAY_FOUND;
            found->way = tried->of[i];
        } else if (found->kind == TL_OTHER_WAY_NOT_SOUGHT && by_replay) {
            found->kind = TL_OTHER_WAY_NONE;
        }
    }
}

/* All come back, as `base` says: some perhaps by forking as well. */
static tl_status find_forks(way_search *self, const tl_twin_ways *base, tl_error *error) {
    const tl_twin_job before = self->job;
    tl_twin_outcome now = {.ways = *base};
    size_t left = fork_replayed(self, base);
    tl_status status = TL_OK;
    bool failed = left != 0;
    while (left != 0 && failed && status == TL_OK) {
        status = try_ways(self, &now, error);
        failed = status == TL_OK && has_failed(&now);
        size_t culprit = failed ? find_culprit(self, &now) : NOBODY;
        if (failed && (culprit == NOBODY || self->job.rollback[culprit] == before.rollback[culprit])) {
            give_up(self, &before, &now);
            self->job = before;
            break;
        }
        if (failed) {
            self->was_forked[culprit] = true;
            quote(self, culprit, now.text, self->found[culprit].text);
            self->job.rollback[culprit] = before.rollback[culprit];
            left--;
        }
    }
    if (status == TL_OK) {
        settle(self, base, failed ? base : &now.ways);
    }
    return status;
}

tl_status tl_other_way_find(const tl_twin_child_settings *settings, const tl_twin_ways *checked,
                            tl_other_way found[TL_RECORDER_COMPONENTS], tl_error *error) {
    way_search self = {.settings = settings, .job = *settings->job, .found = found};
    tl_twin_outcome now;
    bool is_found = true;
    self.job.task = TL_TASK_WAYS;
    self.job.reads_back = false;
    for (size_t i = 0; i < count_of(&self); i++) {
        found[i] = (tl_other_way){
            .kind = TL_OTHER_WAY_NOT_SOUGHT,
            .comes_back = checked->cannot_return == 0 && checked->of[i].rollback == TL_ROLLBACK_REPLAY,
            .replay_steps = settings->config->components[i].replay_steps,
        };
    }
    tl_status status = find_any(&self, checked, &now, &is_found, error);
    return status == TL_OK && is_found ? find_forks(&self, &now.ways, error) : status;
}

/* ---- telling ---- */

static const char *by(tl_rollback way) {
    static const char *const words[TL_ROLLBACKS] = {
        [TL_ROLLBACK_STATE] = "by its state",
        [TL_ROLLBACK_MEMORY] = "by its memory",
        [TL_ROLLBACK_FORK] = "by forking",
        [TL_ROLLBACK_REPLAY] = "by replay",
    };
    return words[way] != NULL ? words[way] : "otherwise";
}

/* What there is to be written for it; to be given again what it had been given is a way of "auto" only. */
static const char *key_of(const tl_twin_way *way) {
    static const char *const words[TL_ROLLBACKS] = {
        [TL_ROLLBACK_STATE] = "state",
        [TL_ROLLBACK_MEMORY] = "memory",
        [TL_ROLLBACK_FORK] = "fork",
        [TL_ROLLBACK_REPLAY] = "replay",
    };
    return way->is_given_again != 0 || words[way->rollback] == NULL ? "auto" : words[way->rollback];
}

static size_t add_text(char *text, size_t used, const char *more) {
    return used + (size_t)snprintf(text + used, used < TL_OTHER_WAY_TEXT ? TL_OTHER_WAY_TEXT - used : 0, "%s", more);
}

/* Bytes that are told in MiB. */
enum { LARGE = 10000 * 1024 };

/* What it costs, and what to write. */
static void tell_found(const tl_twin_way *way, char *text, size_t used) {
    char more[200];
    if (way->is_measured != 0) {
        (void)snprintf(more, sizeof more, "; a save and a restore take %.4g \302\265s here",
                       tl_seconds(way->save + way->restore) * 1e6);
        used = add_text(text, used, more);
    }
    if (way->is_measured != 0 && way->bytes != 0) {
        bool is_process = way->rollback == TL_ROLLBACK_FORK;
        bool is_large = way->bytes >= LARGE;
        (void)snprintf(more, sizeof more, ", a state %s%.1f %s%s", is_process ? "is a process with about " : "takes ",
                       (double)way->bytes / (is_large ? 1048576.0 : 1024.0), is_large ? "MiB" : "KiB",
                       is_process ? " of its own" : "");
        used = add_text(text, used, more);
    }
    (void)snprintf(more, sizeof more, ": write \"rollback\": \"%s\" in the component", key_of(way));
    (void)add_text(text, used, more);
}

static void tell_why_not(const tl_other_way *other, const char *begin, char *text, size_t used) {
    if (other->text[0] != '\0') {
        used = add_text(text, used, begin);
        (void)add_text(text, used, other->text);
    }
}

static size_t tell_replay(const tl_other_way *other, char *text, size_t used) {
    char more[100];
    (void)snprintf(more, sizeof more, "comes back by replay, within %u steps of its beginning only",
                   (unsigned)other->replay_steps);
    return add_text(text, used, more);
}

void tl_other_way_tell(const tl_other_way *other, char text[TL_OTHER_WAY_TEXT]) {
    size_t used = 0;
    bool is_by_replay = other->comes_back || other->way.rollback == TL_ROLLBACK_REPLAY;
    text[0] = '\0';
    if (other->kind == TL_OTHER_WAY_UNKNOWN) {
        tell_why_not(
            other, other->comes_back ? "could not be tried by forking: " : "could not be tried in another way: ", text,
            0);
        return;
    }
    if (is_by_replay) {
        used = tell_replay(other, text, used);
        tell_why_not(other, ", and not by forking: ", text, used);
        used = strlen(text);
    }
    if (other->kind == TL_OTHER_WAY_NONE && !is_by_replay) {
        used = add_text(text, used, "does not come back in another way either");
        tell_why_not(other, ", nor by forking: ", text, used);
    }
    if (other->kind == TL_OTHER_WAY_FOUND && other->comes_back) {
        used = add_text(text, used, ", and exactly by forking for as long as it runs");
    } else if (other->kind == TL_OTHER_WAY_FOUND && !is_by_replay) {
        used = add_text(text, used, "comes back exactly ");
        used = add_text(text, used, by((tl_rollback)other->way.rollback));
        used =
            add_text(text, used, other->way.is_given_again != 0 ? ", if it is given again what it had been given" : "");
    }
    if (other->kind == TL_OTHER_WAY_FOUND) {
        tell_found(&other->way, text, used);
    }
}
