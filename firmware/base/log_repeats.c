/* Repeated log lines: see log_repeats.h. */
#include "firmware/base/log_repeats.h"

#include <ctype.h>
#include <stdbool.h>
#include <stdio.h>

static const tl_time QUIET = 60 * TL_SECOND;
static const tl_time LONGEST = 3600 * TL_SECOND;

static bool is_of_name(unsigned char c) {
    return isalpha(c) != 0 || c == '_' || c == '[' || c >= 0x80;
}

/* Skips the digits of numbers; those of names as in x1 differ between kinds. */
static uint64_t hash_of_kind(tl_log_level level, const char *line) {
    uint64_t hash = 0xcbf29ce484222325U ^ (uint64_t)level;
    bool in_name = false;
    for (; *line != '\0'; line++) {
        const unsigned char c = (unsigned char)*line;
        in_name = is_of_name(c) || (in_name && isdigit(c) != 0);
        if (in_name || (isdigit(c) == 0 && c != '.' && c != '-' && c != '+')) {
            hash = (hash ^ c) * 0x100000001b3U;
        }
    }
    return hash != 0 ? hash : 1;
}

/* Logs the last line of the kind with its count. */
static void log_count(tl_log_kind *kind) {
    char others[64] = "";
    if (kind->repeats > 1) {
        (void)snprintf(others, sizeof others, " (%u more were not logged)", kind->repeats - 1U);
    }
    tl_log(kind->level, "%s%s", kind->line, others);
    kind->repeats = 0;
}

static tl_log_kind *find_kind(tl_log_repeats *self, uint64_t hash) {
    tl_log_kind *oldest = &self->kinds[0];
    for (size_t i = 0; i < TL_LOG_REPEATS_KINDS; i++) {
        if (self->kinds[i].hash == hash) {
            return &self->kinds[i];
        }
        oldest = self->kinds[i].last < oldest->last ? &self->kinds[i] : oldest;
    }
    if (oldest->repeats > 0) {
        log_count(oldest);
    }
    *oldest = (tl_log_kind){.hash = hash};
    return oldest;
}

void tl_log_repeats_add(tl_log_repeats *self, tl_log_level level, const char *line, tl_time now) {
    tl_log_kind *kind = find_kind(self, hash_of_kind(level, line));
    kind->level = level;
    if (kind->repeats == 0 && now - kind->last >= QUIET) {
        kind->lines = 0;
    }
    kind->last = now;
    if (kind->lines < TL_LOG_REPEATS_FIRST) {
        kind->lines++;
        tl_log(level, "%s", line);
        return;
    }
    kind->since = kind->repeats == 0 ? now : kind->since;
    kind->repeats++;
    (void)snprintf(kind->line, sizeof kind->line, "%s", line);
}

/* Logs the counts that are due at `now`, in the order of the last lines. */
static void log_due(tl_log_repeats *self, tl_time now, tl_time quiet) {
    for (;;) {
        tl_log_kind *due = NULL;
        for (size_t i = 0; i < TL_LOG_REPEATS_KINDS; i++) {
            tl_log_kind *kind = &self->kinds[i];
            const bool is_due = kind->repeats > 0 && (now - kind->last >= quiet || now - kind->since >= LONGEST);
            due = is_due && (due == NULL || kind->last < due->last) ? kind : due;
        }
        if (due == NULL) {
            return;
        }
        log_count(due);
    }
}

void tl_log_repeats_poll(tl_log_repeats *self, tl_time now) {
    log_due(self, now, QUIET);
}

void tl_log_repeats_end(tl_log_repeats *self) {
    log_due(self, INT64_MAX, 0);
}
