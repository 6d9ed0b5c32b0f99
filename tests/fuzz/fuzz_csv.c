/* Fuzzes a CSV recording: read as a whole for a replay, and live from a FIFO. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "board/csv/csv.h"
#include "firmware/config/config.h"
#include "firmware/plant/recording.h"
#include "tests/fuzz/harness.h"

enum { MOST_TICKS = 2000 };

static const char configuration[] =
    "{\"twinlock\": 1, \"name\": \"fuzz\", \"step_s\": 0.01, \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},\n"
    " \"plant\": {\"omega\": {\"unit\": \"rad/s\", \"min\": -1000, \"max\": 1000}, \"brake\": {\"unit\": \"N.m\",\n"
    " \"stale_s\": 0.05}}, \"connect\": [[\"plant.brake\", \"motor.brake\"]]}";

/* ---- as a recording ---- */

static const tl_config *config(void) {
    return tl_fuzz_config(configuration);
}

static void check_sample(const tl_sample *sample) {
    for (size_t i = 0; i < config()->signal_count; i++) {
        if (!isfinite(sample->values[i])) {
            abort();
        }
    }
}

static void replay(const char *path) {
    tl_recording *recording = NULL;
    tl_recording_tick tick;
    tl_error error;
    bool end = false;
    memset(&tick, 0, sizeof tick);
    if (tl_recording_open(path, config(), &recording, &error) != TL_OK) {
        return;
    }
    if (tl_recording_ticks(recording) < 1) {
        abort();
    }
    for (int i = 0; i < MOST_TICKS && !end; i++) {
        if (tl_recording_next(recording, &tick, &end, &error) != TL_OK) {
            abort(); /* it was checked completely when it was opened */
        }
        if (!end) {
            check_sample(&tick.sample);
        }
    }
    tl_recording_close(recording);
}

/* ---- live ---- */

static void post(void *context, size_t channel, const tl_reading *reading) {
    (void)context;
    if (channel >= 2 || !isfinite(reading->value)) {
        abort();
    }
}

static void say(void *context, bool up, const char *text) {
    (void)context;
    (void)up;
    if (text[0] == '\0') {
        abort();
    }
}

static void play(const uint8_t *data, size_t size) {
    static const tl_csv_column columns[] = {{"omega", 1, 0}, {"brake", 0.5, -1}};
    const tl_plant_io_sink sink = {.post = post, .link = say};
    tl_csv_settings settings = {.time_column = "time", .columns = columns, .column_count = 2};
    tl_plant_io *io = NULL;
    tl_error error;
    int writer = tl_fuzz_pipe(data, size, &settings.path);
    if (tl_csv_open_live(&settings, &io, &error) != TL_OK) {
        abort();
    }
    if (size > 0) {
        tl_csv_driver.poll(io, &sink);
    }
    tl_csv_driver.close(io);
    tl_fuzz_close_pipe(writer);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char database[] = "SQLite format 3";
    if (size >= sizeof database && memcmp(data, database, sizeof database) == 0) {
        return -1; /* is another recording */
    }
    replay(tl_fuzz_file(data, size));
    play(data, size);
    return 0;
}
