/* A candidate, until it is known to be good: see activation_parts.h. */
#include "firmware/retune/activation_parts.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/retune/box_texts.h"
#include "firmware/retune/forecast.h"
#include "firmware/retune/trial.h"
#include "firmware/retune/validator.h"

/* Reading a text of 256 KiB takes milliseconds; a loaded box has other things to do. Loading FMUs takes what it takes. */
static const tl_time VALIDATION = 20 * TL_SECOND;
static const tl_time TRIAL = 180 * TL_SECOND;
static const tl_time SAYING = 10 * TL_SECOND;

/* ---- validate ---- */

/* What the candidate is compared with, beside what is in force; NULL: not known, or the same. */
typedef struct beside {
    char *list, *file;         /* what the box says of names */
    char *kept, *commissioned; /* texts of versions: that a probation would return to, that was commissioned last */
} beside;

static void send_errand(tl_activation *self, const char *kind, const beside *others, size_t answer, tl_time limit,
                        tl_relay_line *hear) {
    char title[TL_ROLE_TITLE];
    tl_error error;
    (void)snprintf(title, sizeof title, "%s [%s]", kind, self->settings.plant);
    const tl_errand_settings settings = {
        .title = title,
        .job = {.path = self->settings.path,
                .in_force = self->before,
                .kept = others->kept,
                .commissioned = others->commissioned,
                .candidate = self->text,
                .on_the_box = others->file,
                .list = others->list,
                .list_path = self->settings.allowed,
                .memory_limit = self->settings.memory_limit,
                .unconfined = self->settings.unconfined},
        .answer = answer,
        .limit = limit,
        .be = self->settings.be,
        .hear = hear,
        .context = self,
    };
    if (tl_errand_send(&self->errand, &settings, &error) != TL_OK) {
        tl_activation_fail(self, error.text);
    }
}

/* NULL: there is no such version, or it cannot be read. */
static char *read_text_of(const tl_activation *self, const tl_version *version) {
    tl_error ignored;
    char *text = NULL;
    if (version != NULL) {
        (void)tl_versions_read(tl_activation_versions(self), version->number, &text, &ignored);
    }
    return text;
}

static void send_validator(tl_activation *self) {
    char fault[TL_BOX_FAULT] = "";
    const char *list_path = self->settings.allowed;
    const tl_versions *versions = tl_activation_versions(self);
    const beside found = {
        .list = list_path == NULL ? NULL : tl_box_read_list(list_path, fault),
        .file = tl_box_read_file(self->settings.path),
        .kept = read_text_of(self, tl_versions_get(versions, versions->probation.return_to)),
        .commissioned = read_text_of(self, tl_versions_commissioned(versions)),
    };
    if (fault[0] != '\0') {
        tl_activation_say(self, TL_CONTROL_VALIDATE, fault);
    }
    send_errand(self, TL_VALIDATOR, &found, sizeof(tl_verdict), VALIDATION, NULL); /* the verdict says all */
    free(found.list);
    free(found.file);
    free(found.kept);
    free(found.commissioned);
}

/* What runs is in memory too. */
static char *read_running(const tl_activation *self, const tl_version *version) {
    const tl_activation_host *host = self->settings.host;
    tl_error error;
    size_t size = 0;
    char line[TL_CONTROL_TEXT];
    char *text = host->text == NULL ? NULL : malloc(TL_CONTROL_MOST + 1);
    if (text == NULL || !host->text(host->context, version->hash, text, &size)) {
        free(text);
        return NULL;
    }
    bool is_mended = tl_versions_mend(tl_activation_versions(self), version->number, text, size, &error) == TL_OK;
    (void)snprintf(
        line, sizeof line, "the text of version %llu was damaged on disk, and %s%s",
        (unsigned long long)version->number,
        is_mended ? "is written anew from the run's memory" : "cannot be written anew: ", is_mended ? "" : error.text);
    tl_activation_tell(self, is_mended ? TL_EVENT_WARNING : TL_EVENT_ERROR, line);
    return text;
}

tl_status tl_activation_read(const tl_activation *activation, const tl_version *version, char **text, tl_error *error) {
    tl_error cause;
    tl_status status = tl_versions_read(tl_activation_versions(activation), version->number, text, &cause);
    if (status == TL_OK) {
        return TL_OK;
    }
    *text = read_running(activation, version);
    return *text != NULL
               ? TL_OK
               : tl_fail(error, status,
                         "%.700s; start the run anew: it begins with the newest version that can be read", cause.text);
}

void tl_activation_validate(tl_activation *self, const tl_version *in_force) {
    tl_error error;
    self->step = TL_CONTROL_VALIDATE;
    tl_activation_say(self, TL_CONTROL_VALIDATE, "the text is read, and held against the active one");
    free(self->before);
    self->before = NULL;
    if (in_force == NULL) {
        tl_activation_fail(self, "no version is active");
        return;
    }
    if (tl_activation_read(self, in_force, &self->before, &error) != TL_OK) {
        tl_activation_fail(self, error.text);
        return;
    }
    send_validator(self);
}

/* In safe hold there is no twin that could take anything, or be compared with. */
static tl_activation_way way_of(const tl_activation *self) {
    if (self->verdict.kind == TL_CHANGE_RESTART || tl_activation_view_now(self).holds) {
        return TL_ACTIVATION_BY_RESTART;
    }
    return self->verdict.kind >= TL_CHANGE_NEW_TWIN ? TL_ACTIVATION_BY_FLIP : TL_ACTIVATION_IN_PLACE;
}

static tl_control_right right_of(const tl_verdict *verdict) {
    return verdict->right == TL_CHANGE_BY_RETUNE ? TL_CONTROL_MAY_RETUNE : TL_CONTROL_MAY_COMMISSION;
}

static void try_fmus(tl_activation *self);

void tl_activation_conclude(tl_activation *self) {
    static const char *const words[] = {[TL_ACTIVATION_IN_PLACE] = "it can be activated in place",
                                        [TL_ACTIVATION_BY_FLIP] = "it can be activated without a gap",
                                        [TL_ACTIVATION_BY_RESTART] = "it can be activated, with a restart of the run"};
    if ((self->request.flags & TL_CONTROL_ONLY_CHECK) != 0) {
        tl_activation_say_end(self, TL_CONTROL_DONE, words[self->way]);
        tl_activation_forget(self);
    } else {
        tl_activation_activate(self);
    }
}

/* Whoever has compared the texts could not see it. */
static void take_other_fmus(tl_activation *self) {
    self->verdict.kind = TL_CHANGE_NEW_TWIN;
    self->verdict.right = TL_CHANGE_BY_COMMISSION;
    tl_activation_say(
        self, TL_CONTROL_VALIDATE,
        "it is the active one, but an FMU's file is another than the one that the twin has loaded (new twin); "
        "the old file is gone, so a way back is by the twin before only");
}

/* It can be read; may it be done, and how? */
static void weigh(tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    char text[TL_CONTROL_TEXT];
    tl_activation_say_changes(self);
    if (self->has_other_fmus) {
        take_other_fmus(self);
    }
    self->way = way_of(self);
    bool is_allowed = (self->request.flags & (TL_CONTROL_MAY_RESTART | TL_CONTROL_ONLY_CHECK)) != 0;
    if (verdict->right == TL_CHANGE_ON_THE_BOX && self->request.origin != TL_CONTROL_BY_RELOAD) {
        tl_activation_say_problems(self);
        tl_activation_turn_down(
            self, TL_CONTROL_FORBIDDEN,
            "it names a library, a file or an FMU that nobody on the box has named, or lets an FMU out: that is changed "
            "on the box, by twinlock reload without --right");
    } else if (right_of(verdict) > self->request.right) {
        tl_activation_say_problems(self);
        tl_activation_turn_down(self, TL_CONTROL_FORBIDDEN,
                                "it changes what takes the right to commission, and was sent with less");
    } else if (self->way == TL_ACTIVATION_BY_RESTART && !is_allowed) {
        tl_activation_write_restart(self, text, sizeof text);
        tl_activation_turn_down(self, TL_CONTROL_RESTART, text);
    } else if (self->way == TL_ACTIVATION_IN_PLACE) {
        tl_activation_conclude(self);
    } else {
        try_fmus(self);
    }
}

static void end_validation(tl_activation *self, tl_errand_state state) {
    char why[TL_ERRAND_WHY];
    char text[TL_CONTROL_TEXT];
    tl_errand_why(&self->errand, why);
    bool is_sound = state == TL_ERRAND_DONE && tl_verdict_take(tl_errand_answer(&self->errand), &self->verdict);
    tl_errand_close(&self->errand);
    if (!is_sound) {
        (void)snprintf(text, sizeof text, "nobody can read it: %s", state == TL_ERRAND_DONE ? "no verdict" : why);
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
    } else if (self->verdict.is_valid == 0) {
        tl_activation_say_problems(self);
        (void)snprintf(text, sizeof text, "%u %s", self->verdict.problems,
                       self->verdict.problems == 1 ? "problem" : "problems");
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
    } else if (self->is_return || self->settles) {
        tl_activation_way way = way_of(self);
        tl_activation_bring_back(self, way == TL_ACTIVATION_BY_FLIP ? TL_ACTIVATION_BY_RESTART : way);
    } else {
        weigh(self);
    }
}

/* ---- try ---- */

/* The name of the run's file is none that the sender knows. */
static const char *without_file(const tl_activation *self, const char *text) {
    size_t length = strlen(self->settings.path);
    bool is_named = strncmp(text, self->settings.path, length) == 0 && strncmp(text + length, ": ", 2) == 0;
    return is_named ? text + length + 2 : text;
}

/* "PATH: line 7: synchronise.margin: …": the file was never that of the run, which its processes know by name. False: it is something else. */
static bool say_problem(const tl_activation *self, const char *text) {
    tl_control_problem problem;
    char *end = NULL;
    const char *rest = without_file(self, text);
    if (rest == text) {
        return false;
    }
    memset(&problem, 0, sizeof problem);
    if (strncmp(rest, "line ", strlen("line ")) == 0) {
        unsigned long number = strtoul(rest + strlen("line "), &end, 10);
        bool is_number = end != rest + strlen("line ") && strncmp(end, ": ", 2) == 0;
        problem.line = is_number ? (uint32_t)number : 0;
        rest = is_number ? end + 2 : rest;
    }
    const char *colon = strstr(rest, ": ");
    size_t key = colon == NULL ? 0 : (size_t)(colon - rest);
    if (key > 0 && key < sizeof problem.path && strcspn(rest, " ") > key) {
        memcpy(problem.path, rest, key);
        rest = colon + 2;
    }
    (void)snprintf(problem.text, sizeof problem.text, "%s", rest);
    tl_activation_say_problem(self, &problem, 0);
    return true;
}

static void hear_trial(void *context, const char *line) {
    tl_activation *self = context;
    const char *text = line;
    int level = tl_log_level_of(line, &text);
    self->told = self->waited;
    if (say_problem(self, text)) {
        self->problems++;
    } else if (level == TL_LOG_ERROR && self->heard[0] == '\0') {
        (void)snprintf(self->heard, sizeof self->heard, "%s", text); /* said at the end, and once */
    } else {
        tl_activation_say(self, TL_CONTROL_TRY, text);
    }
}

static void try_fmus(tl_activation *self) {
    self->step = TL_CONTROL_TRY;
    self->waited = 0;
    self->told = 0;
    self->heard[0] = '\0';
    self->problems = 0;
    tl_activation_say(self, TL_CONTROL_TRY, "its FMUs are loaded, started and set back, beside the plant's");
    send_errand(self, TL_TRIAL, &(const beside){NULL, NULL, NULL, NULL}, sizeof(tl_trial_answer), TRIAL, hear_trial);
}

static void say_time(tl_activation *self) {
    char text[TL_FORECAST_TEXT];
    self->step = TL_CONTROL_PREDICT;
    tl_forecast_write_time(&self->answer, text);
    tl_activation_say(self, TL_CONTROL_PREDICT, text);
}

/* What it will take of the box, and whether that is there. */
static void predict(tl_activation *self) {
    char text[TL_FORECAST_TEXT];
    char line[TL_CONTROL_TEXT];
    uint64_t left = tl_forecast_memory_left();
    say_time(self);
    tl_forecast_write_memory(&self->answer, left, text);
    tl_activation_say(self, TL_CONTROL_PREDICT, text);
    switch (tl_forecast_of(&self->answer, left, text)) {
    case TL_FORECAST_POSSIBLE:
        tl_activation_begin_shadow(self);
        break;
    case TL_FORECAST_TOO_SLOW:
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
        break;
    case TL_FORECAST_NO_MEMORY:
        (void)snprintf(line, sizeof line, "%s: " TL_ACTIVATION_NO_ROOM, text);
        tl_activation_make_no_room(self, line);
        break;
    }
}

/* What is told already is not told again. */
static void write_fault(const tl_activation *self, const char *otherwise, char *text, size_t size) {
    if (self->heard[0] == '\0' && self->problems != 0) {
        (void)snprintf(text, size, "it cannot run: %u %s", self->problems,
                       self->problems == 1 ? "problem" : "problems");
    } else {
        (void)snprintf(text, size, "it cannot run: %s", self->heard[0] != '\0' ? self->heard : otherwise);
    }
}

static void end_trial(tl_activation *self, tl_errand_state state) {
    char why[TL_ERRAND_WHY];
    char text[TL_CONTROL_TEXT + 32];
    tl_errand_why(&self->errand, why);
    bool is_done = state == TL_ERRAND_DONE;
    bool is_sound = is_done && tl_trial_answer_take(tl_errand_answer(&self->errand), &self->answer);
    tl_errand_close(&self->errand);
    if (!is_done || (!is_sound && self->way == TL_ACTIVATION_BY_FLIP)) {
        write_fault(self, is_done ? "its trial has not said what it takes" : why, text, sizeof text);
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
    } else if (self->way == TL_ACTIVATION_BY_FLIP) {
        predict(self);
    } else {
        if (is_sound) {
            say_time(self);
        }
        tl_activation_conclude(self);
    }
}

/* FMUs may load for minutes, or for ever. */
static void say_patience(tl_activation *self, tl_time passed) {
    char text[TL_CONTROL_TEXT];
    self->waited += passed;
    if (self->step == TL_CONTROL_TRY && self->waited - self->told >= SAYING) {
        self->told = self->waited;
        (void)snprintf(text, sizeof text, "for %d s; it is ended after %d s", (int)(self->waited / TL_SECOND),
                       (int)(TRIAL / TL_SECOND));
        tl_activation_say(self, TL_CONTROL_TRY, text);
    }
}

void tl_activation_look_at_errand(tl_activation *self, tl_time passed) {
    tl_errand_state state = tl_errand_look(&self->errand);
    if (state == TL_ERRAND_GOES_ON) {
        say_patience(self, passed);
        return;
    }
    if (self->step == TL_CONTROL_VALIDATE) {
        end_validation(self, state);
    } else {
        end_trial(self, state);
    }
}
