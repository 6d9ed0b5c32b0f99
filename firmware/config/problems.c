/* Problems of a configuration: see problems.h. */
#include "firmware/config/problems.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"

size_t tl_problems_take_line(const char **text) {
    static const char PREFIX[] = "line ";
    if (strncmp(*text, PREFIX, sizeof PREFIX - 1) != 0) {
        return 0;
    }
    char *end = NULL;
    unsigned long line = strtoul(*text + sizeof PREFIX - 1, &end, 10);
    if (strncmp(end, ": ", 2) != 0) {
        return 0;
    }
    *text = end + 2;
    return line;
}

static void say(void *context, tl_status status, const char *where, const char *text) {
    (void)status;
    const tl_problems *problems = context;
    size_t line = problems->config == NULL ? tl_problems_take_line(&text) : tl_config_line(problems->config, where);
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
