/* An image of a past, as another process gives it to the twin.
 *
 * Input:  a byte that says what is put right, so that more than the first lines of the check are reached, then the image. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/twin/past.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { RIGHT_BEGINNING = 1, RIGHT_TIME = 2, RIGHT_SIGNALS = 4 };

static const tl_time NOW = 5000 * TL_SECOND;

static const char configuration[] =
    "{\"twinlock\": 1, \"name\": \"fuzz\", \"step_s\": 0.01, \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},\n"
    " \"plant\": {\"torque\": {\"unit\": \"N.m\"}, \"omega\": {\"unit\": \"rad/s\"}},\n"
    " \"connect\": [[\"plant.torque\", \"motor.M_w\"]],\n"
    " \"synchronise\": {\"adjust\": {\"motor.d\": {\"nominal\": 0.0031, \"step\": 0.12}},\n"
    "  \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0}}}}";

/* Where its size and the plain fields of the past are. */
enum { SIZE = 8, PLAIN = 16, HEAD = (PLAIN + TL_PAST_PLAIN + 15) / 16 * 16 };
enum { LAST = PLAIN + offsetof(tl_past, last), STEP = PLAIN + offsetof(tl_past, step) };
enum { START = PLAIN + offsetof(tl_past, start), SIGNALS = PLAIN + offsetof(tl_past, signals) };

static void put_right(unsigned what, unsigned char *image, size_t size) {
    static const char magic[] = {'t', 'w', 'l', 'k', 'p', 's', 't', '6'};
    const uint64_t bytes = size;
    int64_t last = 0;
    int64_t step = 0;
    if ((what & RIGHT_BEGINNING) != 0 && size >= SIZE + sizeof bytes) {
        memcpy(image, magic, sizeof magic);
        memcpy(image + SIZE, &bytes, sizeof bytes);
    }
    if ((what & RIGHT_TIME) != 0 && size >= START + sizeof(int64_t)) {
        memcpy(&last, image + LAST, sizeof last);
        memcpy(&step, image + STEP, sizeof step);
        int64_t start = (int64_t)((uint64_t)NOW - (uint64_t)last * (uint64_t)step);
        memcpy(image + START, &start, sizeof start);
    }
    if ((what & RIGHT_SIGNALS) != 0 && size >= HEAD) {
        tl_past_identify(tl_fuzz_config(configuration), (char *)image + SIGNALS);
    }
}

static void check_tick(const tl_past *past, int64_t number) {
    tl_past_tick tick;
    tl_fuzz_hold(tl_past_tick_at(past, number, &tick) && tick.sample.tick == number);
    tl_fuzz_hold(tick.has_u || !tick.resets);
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        tl_fuzz_hold(isfinite(tick.sample.values[i]) && tick.sample.quality[i] <= TL_OUTLIER);
    }
    for (size_t i = 0; i < TL_MAX_ADJUST; i++) {
        tl_fuzz_hold(isfinite(tick.u[i]));
    }
}

static void check(const tl_past *past) {
    tl_past_tick tick;
    unsigned sum = 0;
    for (size_t i = 0; i < past->checkpoint_size; i++) {
        sum += past->checkpoint[i];
    }
    tl_fuzz_hold(sum <= 255 * past->checkpoint_size);
    tl_fuzz_hold((past->from == TL_RESUMED_CHECKPOINT) == (past->checkpoint != NULL) && past->gap >= 0 &&
                 past->age >= 0);
    for (int64_t number = past->first; number <= past->last; number++) {
        check_tick(past, number);
    }
    tl_fuzz_hold(past->tuning_count <= TL_PAST_TUNINGS);
    for (size_t i = 0; i < past->tuning_count; i++) {
        tl_run_tuning tuning;
        tl_error error;
        memcpy(&tuning, past->tunings + i * sizeof tuning, sizeof tuning);
        tl_fuzz_hold(tuning.tick >= 0 && tl_tuning_check(&tuning.values, &error) == TL_OK);
    }
    tl_fuzz_hold(!tl_past_tick_at(past, past->first - 1, &tick) && !tl_past_tick_at(past, past->last + 1, &tick));
}

static void *allocate(size_t size) {
    void *bytes = malloc(size == 0 ? 1 : size);
    if (bytes == NULL) {
        exit(1);
    }
    return bytes;
}

/* Nothing in it is not looked at. */
static void write_again(const tl_past *past, const unsigned char *image, size_t size) {
    unsigned char *again = allocate(size);
    tl_past_write(past, again);
    tl_fuzz_hold(memcmp(again, image, size) == 0);
    free(again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_past past;
    tl_error error = {TL_OK, ""};
    if (size == 0) {
        return 0;
    }
    size--;
    unsigned char *image = allocate(size); /* as large as it is: what is read beyond it is noticed */
    memcpy(image, data + 1, size);
    put_right(data[0], image, size);
    tl_status status = tl_past_read(image, size, tl_fuzz_config(configuration), NOW, &past, &error);
    tl_fuzz_hold(status == TL_OK || (status == TL_BAD_DATA && error.text[0] != '\0'));
    int64_t start = 0;
    memcpy(&start, image + (size >= HEAD ? START : 0), size >= HEAD ? sizeof start : 0);
    if (status != TL_OK) {
        status = tl_past_read_samples(image, size, tl_fuzz_config(configuration), start, &past, &error);
        tl_fuzz_hold(status == TL_BAD_DATA || past.from == TL_RESUMED_NOT);
    }
    if (status == TL_OK) {
        check(&past);
        write_again(&past, image, size);
    }
    free(image);
    return 0;
}
