/* An image of recorded samples, as another process gives it to a shadow.
 *
 * Input:  a byte that says what is put right, so that more than the first lines of the check are reached, then the image. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/twin/past_samples.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { RIGHT_BEGINNING = 1, RIGHT_SIGNALS = 2, RIGHT_RUN = 4, RIGHT_COUNT = 8 };

static const tl_time START = 5000 * TL_SECOND;

static const char configuration[] =
    "{\"twinlock\": 1, \"name\": \"fuzz\", \"step_s\": 0.01, \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},\n"
    " \"plant\": {\"torque\": {\"unit\": \"N.m\"}, \"omega\": {\"unit\": \"rad/s\"}},\n"
    " \"connect\": [[\"plant.torque\", \"motor.M_w\"]],\n"
    " \"synchronise\": {\"adjust\": {\"motor.d\": {\"nominal\": 0.0031, \"step\": 0.12}},\n"
    "  \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0}}}}";

/* Where the words of its head are, and how long that is. */
enum { SIZE = 8, SIGNALS = 16, COUNT = 88, TICKS = 104, STEP = 112, RUN = 120, HEAD = 128 };

static void put_word(unsigned char *at, uint64_t word) {
    memcpy(at, &word, sizeof word);
}

static void put_signals(unsigned char *image) {
    static const char *const names[] = {"plant.torque", "plant.omega"};
    char digest[TL_SHA256_TEXT] = "";
    char text[TL_SHA256_TEXT + 32];
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        (void)snprintf(text, sizeof text, "%s %s", digest, names[i]);
        tl_sha256(text, strlen(text), digest);
    }
    memcpy(image + SIGNALS, digest, sizeof digest);
    put_word(image + COUNT, sizeof names / sizeof names[0]);
}

static void put_right(unsigned what, unsigned char *image, size_t size, const tl_config *config) {
    static const char magic[] = {'t', 'w', 'l', 'k', 's', 'm', 'p', '1'};
    const tl_recorder_shape shape = {.plant = config->signal_count};
    if (size < HEAD) {
        return;
    }
    if ((what & RIGHT_BEGINNING) != 0) {
        memcpy(image, magic, sizeof magic);
        put_word(image + SIZE, size);
    }
    if ((what & RIGHT_SIGNALS) != 0) {
        put_signals(image);
        put_word(image + STEP, (uint64_t)config->step);
    }
    if ((what & RIGHT_RUN) != 0) {
        put_word(image + RUN, (uint64_t)START);
    }
    if ((what & RIGHT_COUNT) != 0) {
        put_word(image + TICKS, (size - HEAD) / tl_past_tick_bytes(&shape));
    }
}

static void check_sample(const tl_past_samples *samples, int64_t tick, const tl_config *config) {
    tl_sample sample;
    tl_fuzz_hold(tl_past_samples_at(samples, tick, config->step, &sample));
    tl_fuzz_hold(sample.tick == tick && sample.instant == START + tick * config->step);
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        bool is_there = i < config->signal_count;
        tl_fuzz_hold(isfinite(sample.values[i]) && sample.quality[i] <= TL_OUTLIER);
        tl_fuzz_hold(is_there || (sample.quality[i] == TL_NO_LINK && sample.stamps[i] == TL_TIME_NEVER));
    }
}

static void check(const tl_past_samples *samples, const tl_config *config) {
    tl_sample none;
    int64_t behind = samples->first + (int64_t)samples->count;
    tl_fuzz_hold(samples->first >= 0 && samples->count > 0 && samples->count <= TL_PAST_SAMPLES);
    for (int64_t tick = samples->first; tick < behind; tick++) {
        check_sample(samples, tick, config);
    }
    tl_fuzz_hold(!tl_past_samples_at(samples, samples->first - 1, config->step, &none));
    tl_fuzz_hold(!tl_past_samples_at(samples, behind, config->step, &none));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const tl_config *config = tl_fuzz_config(configuration);
    tl_past_samples samples;
    tl_error error = {TL_OK, ""};
    if (size == 0) {
        return 0;
    }
    size--;
    unsigned char *image = malloc(size == 0 ? 1 : size); /* as large as it is: what is read beyond it is noticed */
    if (image == NULL) {
        exit(1);
    }
    memcpy(image, data + 1, size);
    put_right(data[0], image, size, config);
    tl_status status = tl_past_samples_read(image, size, config, START, &samples, &error);
    tl_fuzz_hold(status == TL_OK || (status == TL_BAD_DATA && error.text[0] != '\0' && samples.count == 0));
    if (status == TL_OK) {
        check(&samples, config);
    }
    free(image);
    return 0;
}
