/* A probe's last words: see probe.h. */
#include "tests/replay/probe.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

int tl_probe_fail(const char *text) {
    (void)fprintf(stderr, "%s: %s\n", program_invocation_short_name, text);
    return EXIT_FAILURE;
}
