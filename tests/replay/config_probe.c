/* Reads configurations and says what the reader thinks of them; test_config_schema.py holds that against the schema.
 *
 * Usage:  config_probe FILE…
 * Output: one line "good" or "bad" per file, in order; for a bad one its problems follow, one "  path<tab>text" each.
 */
#include <stdio.h>

#include "firmware/config/config.h"

static void print(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    (void)fprintf(stdout, "  %s\t%s\n", where, text);
}

int main(int count, char **arguments) {
    for (int i = 1; i < count; i++) {
        tl_report silent = {.add = NULL};
        tl_report report = {.add = print};
        tl_config config;
        if (tl_config_read(arguments[i], &config, &silent) == TL_OK) {
            (void)puts("good");
            tl_config_free(&config);
        } else {
            (void)puts("bad");
            (void)tl_config_read(arguments[i], &config, &report);
        }
    }
    return 0;
}
