/* Problems of a configuration, told to a person: one log line each.
 *
 * Purpose: the tl_report that verbs hand down. A line reads "file: line N: JSON path: what was found, what was expected".
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_PROBLEMS_H
#define TL_FIRMWARE_CONFIG_PROBLEMS_H

#include <stddef.h>

#include "firmware/config/config.h"
#include "master/base/status.h"

typedef struct tl_problems {
    tl_report report;
    const char *file;
    const tl_config *config; /* NULL while the file is still being read */
} tl_problems;

void tl_problems_init(tl_problems *problems, const char *file);

/* The line that a problem's text begins with ("line 12: found …"), which is how the reader says it; *text then begins behind it. 0: none. */
size_t tl_problems_take_line(const char **text);

#endif
