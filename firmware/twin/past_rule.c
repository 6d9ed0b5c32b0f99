/* The rule: see past_rule.h. */
#include "firmware/twin/past_rule.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "firmware/twin/past.h"

static const tl_time FOLLOW_TIME = TL_SECOND / 2; /* for as many ticks as are led along again */

bool tl_past_refuse(char why[TL_PAST_WHY], const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(why, TL_PAST_WHY, format, arguments);
    va_end(arguments);
    return false;
}

bool tl_past_was_interrupted(int64_t run, const char *reason, char why[TL_PAST_WHY]) {
    char name[TL_PAST_NAME];
    bool interrupted = reason == NULL || strcmp(reason, "not ended cleanly") == 0 || strncmp(reason, "SIG", 3) == 0;
    return interrupted || tl_past_refuse(why, "%s ended: %.100s", tl_past_name(run, name), reason);
}

bool tl_past_is_recent(int64_t run, const tl_config *config, tl_time gap, char why[TL_PAST_WHY]) {
    char name[TL_PAST_NAME];
    if (gap < 0) {
        return tl_past_refuse(why, "by the clock %s has not happened yet", tl_past_name(run, name));
    }
    return gap <= config->record_resume ||
           tl_past_refuse(why, "nobody ran since %s for %.1f s, which is more than record.resume_s",
                          tl_past_name(run, name), tl_seconds(gap));
}

bool tl_past_is_under_way(int64_t run, const tl_config *config, int64_t last, tl_time gap, uint32_t lead,
                          char why[TL_PAST_WHY]) {
    char name[TL_PAST_NAME];
    int64_t now = last + gap / config->step;
    return config->duration == 0 || now < config->duration / config->step + (int64_t)lead ||
           tl_past_refuse(why, "the duration of %s is over", tl_past_name(run, name));
}

int64_t tl_past_most_followed(tl_time execution, size_t components) {
    tl_time each = execution * (tl_time)components;
    tl_time most = each > 0 ? FOLLOW_TIME / each : TL_PAST_TICKS;
    return most < 1 ? 1 : most < TL_PAST_TICKS ? most : TL_PAST_TICKS;
}
