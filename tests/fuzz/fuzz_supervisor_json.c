/* Fuzzes supervisor.json, the restart record, as a damaged disk or an attacker left it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/live/restarts.h"
#include "tests/fuzz/harness.h"

static void write_account(const uint8_t *data, size_t size) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s/supervisor.json", tl_fuzz_folder());
    FILE *file = fopen(path, "wb");
    if (file == NULL || fwrite(data, 1, size, file) != size || fclose(file) != 0) {
        exit(1);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static tl_restarts restarts;
    tl_error error;
    tl_log_set_level(TL_LOG_ERROR);
    write_account(data, size);
    if (tl_restarts_open(tl_fuzz_folder(), false, &restarts, &error) != TL_OK) {
        abort(); /* any file must be accepted */
    }
    if (restarts.failures > TL_RESTARTS_MOST + 1) {
        abort();
    }
    uint64_t starts = restarts.starts;
    tl_restarts_begin(&restarts, false);
    tl_restarts_end(&restarts);
    tl_restarts_close(&restarts);
    if (tl_restarts_open(tl_fuzz_folder(), false, &restarts, &error) != TL_OK || restarts.starts != starts + 1 ||
        restarts.failures != 0) {
        abort(); /* it must read what it has written */
    }
    tl_restarts_close(&restarts);
    return 0;
}
