/* Forecasts: see forecast.h. */
#include "firmware/retune/forecast.h"

#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/file_bytes.h"

static double milliseconds(tl_time time) {
    return tl_seconds(time) * 1e3;
}

static double mebibytes(uint64_t bytes) {
    return (double)bytes / (1024.0 * 1024.0);
}

tl_forecast_result tl_forecast_of(const tl_trial_answer *answer, uint64_t left, char why[TL_FORECAST_TEXT]) {
    why[0] = '\0';
    if (answer->least > answer->step) {
        (void)snprintf(why, TL_FORECAST_TEXT, "a step takes %.3g ms here without any search, and has %.3g ms",
                       milliseconds(answer->least), milliseconds(answer->step));
        return TL_FORECAST_TOO_SLOW;
    }
    if (left != 0 && answer->memory > left) {
        (void)snprintf(why, TL_FORECAST_TEXT, "its twin takes %.0f MiB of memory, and the box has %.0f MiB left",
                       mebibytes(answer->memory), mebibytes(left));
        return TL_FORECAST_NO_MEMORY;
    }
    return TL_FORECAST_POSSIBLE;
}

void tl_forecast_write_time(const tl_trial_answer *answer, char text[TL_FORECAST_TEXT]) {
    double step = milliseconds(answer->step);
    double budget = milliseconds(answer->budget);
    if (answer->least == 0) {
        (void)snprintf(text, TL_FORECAST_TEXT, "how long a step takes is not known before it runs; it has %.3g ms",
                       step);
    } else if (answer->worst == 0) {
        (void)snprintf(text, TL_FORECAST_TEXT, "a step takes %.3g ms of %.3g ms", milliseconds(answer->least), step);
    } else if (answer->budget == 0 || answer->worst <= answer->budget) {
        (void)snprintf(text, TL_FORECAST_TEXT, "a step takes %.3g ms of %.3g ms, and %.3g ms with all of its search",
                       milliseconds(answer->least), step, milliseconds(answer->worst));
    } else {
        (void)snprintf(text, TL_FORECAST_TEXT,
                       "a step takes %.3g ms of %.3g ms; all of its search would take more than the budget's %.3g ms, "
                       "and is cut short then",
                       milliseconds(answer->least), step, budget);
    }
}

void tl_forecast_write_memory(const tl_trial_answer *answer, uint64_t left, char text[TL_FORECAST_TEXT]) {
    int length =
        snprintf(text, TL_FORECAST_TEXT, "its twin takes %.0f MiB of memory at most", mebibytes(answer->memory));
    if (left != 0) {
        (void)snprintf(text + length, TL_FORECAST_TEXT - (size_t)length, "; the box has %.0f MiB left",
                       mebibytes(left));
    }
}

uint64_t tl_forecast_memory_left(void) {
    static const char key[] = "MemAvailable:";
    char text[4096];
    int file = open("/proc/meminfo", O_RDONLY | O_CLOEXEC);
    ssize_t size = file < 0 ? -1 : tl_file_bytes_read(file, text, sizeof text - 1);
    if (file >= 0) {
        (void)close(file);
    }
    text[size < 0 ? 0 : size] = '\0';
    const char *line = strstr(text, key);
    return line == NULL ? 0 : 1024 * (uint64_t)strtoull(line + strlen(key), NULL, 10);
}
