/* The cost of a twin: see twin_cost.h. */
#include "firmware/retune/twin_cost.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* No line of a page begins so. */
static const char BEGIN[] = "\ntwin-cost ";

void tl_twin_cost_print(const tl_twin_cost *cost, FILE *page) {
    (void)fprintf(page, "%s%" PRId64 " %" PRId64 " %" PRIu64 "\n", BEGIN + 1, cost->least, cost->worst, cost->memory);
}

/* A number from 0 on; moves on behind it. */
static bool read_number(const char **at, int64_t *number) {
    char *end = NULL;
    errno = 0;
    *number = strtoll(*at, &end, 10);
    bool is = end != *at && errno == 0 && *number >= 0;
    *at = end;
    return is;
}

/* The newest one counts: an FMU could print one before. */
static char *find_last(char *page) {
    char *found = NULL;
    for (char *at = strstr(page, BEGIN); at != NULL; at = strstr(at + 1, BEGIN)) {
        found = at;
    }
    return found;
}

bool tl_twin_cost_take(char *page, tl_twin_cost *cost) {
    char *line = find_last(page);
    int64_t memory = 0;
    if (line == NULL) {
        return false;
    }
    const char *at = line + strlen(BEGIN);
    bool is = read_number(&at, &cost->least) && read_number(&at, &cost->worst) && read_number(&at, &memory) &&
              strcmp(at, "\n") == 0;
    cost->memory = (uint64_t)memory;
    line[1] = '\0';
    return is;
}
