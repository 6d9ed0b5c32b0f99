/* Problems of a configuration: see problems.h. */
#include "firmware/problems.h"

#include "firmware/log.h"

static void say(void *context, tl_status status, const char *where, const char *text) {
    (void)status;
    const tl_problems *problems = context;
    size_t line = problems->config == NULL ? 0 : tl_config_line(problems->config, where);
    const char *separator = where[0] == '\0' ? "" : ": ";
    if (line != 0) {
        tl_log(TL_LOG_ERROR, "%s: line %zu: %s%s%s", problems->file, line, where, separator, text);
    } else {
        tl_log(TL_LOG_ERROR, "%s: %s%s%s", problems->file, where, separator, text);
    }
}

void tl_problems_init(tl_problems *problems, const char *file) {
    *problems = (tl_problems){.report = {.add = say, .context = problems}, .file = file};
}
