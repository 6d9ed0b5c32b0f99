/* Fuzzes a configuration: its JSON, and each check that needs no other file. */
#include <stdlib.h>
#include <string.h>

#include "firmware/config/config.h"
#include "tests/fuzz/harness.h"

/* Expects a status and a text of each problem, of limited length. */
static void note(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    if (status == TL_OK || text[0] == '\0' || strlen(text) >= TL_ERROR_TEXT || strlen(where) > TL_CONFIG_MAX_BYTES) {
        abort();
    }
}

static void use(tl_config *config) {
    char path[256];
    (void)tl_config_line(config, "synchronise.solver");
    for (size_t i = 0; i < config->component_count; i++) {
        (void)tl_config_line(config, config->components[i].where);
        (void)tl_config_file_path(config, config->components[i].fmu, path, sizeof path);
    }
    tl_config_use_lookups(config);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_config config;
    tl_report report = {.add = note};
    tl_status status = tl_config_read_text("folder/input.json", (const char *)data, size, &config, &report);
    if ((status == TL_OK) != (report.count == 0)) {
        abort(); /* refused without a problem, or accepted with one */
    }
    if (status == TL_OK) {
        use(&config);
        tl_config_free(&config);
    }
    return 0;
}
