/* Fuzzes the image of a resume point (resume.h), as another process passes it to the twin.
 *
 * Input:  a byte that selects which fields are corrected, so that the input passes the first
 *         checks; then the image. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/twin/resume.h"
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

/* Offsets in the image: its size, and plain fields of the resume point. */
enum { SIZE = 8, PLAIN = 16, HEAD = (PLAIN + TL_RESUME_PLAIN + 15) / 16 * 16 };
enum { LAST = PLAIN + offsetof(tl_resume, last), STEP = PLAIN + offsetof(tl_resume, step) };
enum { START = PLAIN + offsetof(tl_resume, start), SIGNALS = PLAIN + offsetof(tl_resume, signals) };

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
        tl_resume_identify(tl_fuzz_config(configuration), (char *)image + SIGNALS);
    }
}

static void check_tick(const tl_resume *resume, int64_t number) {
    tl_resume_tick tick;
    tl_fuzz_hold(tl_resume_tick_at(resume, number, &tick) && tick.sample.tick == number);
    tl_fuzz_hold(tick.has_u || !tick.resets);
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        tl_fuzz_hold(isfinite(tick.sample.values[i]) && tick.sample.quality[i] <= TL_LAST_QUALITY);
    }
    for (size_t i = 0; i < TL_MAX_ADJUST; i++) {
        tl_fuzz_hold(isfinite(tick.u[i]));
    }
}

static void check(const tl_resume *resume) {
    tl_resume_tick tick;
    unsigned sum = 0;
    for (size_t i = 0; i < resume->checkpoint_size; i++) {
        sum += resume->checkpoint[i];
    }
    tl_fuzz_hold(sum <= 255 * resume->checkpoint_size);
    tl_fuzz_hold((resume->from == TL_RESUMED_CHECKPOINT) == (resume->checkpoint != NULL) && resume->gap >= 0 &&
                 resume->age >= 0);
    for (int64_t number = resume->first; number <= resume->last; number++) {
        check_tick(resume, number);
    }
    tl_fuzz_hold(resume->tuning_count <= TL_RESUME_TUNINGS);
    for (size_t i = 0; i < resume->tuning_count; i++) {
        tl_run_tuning tuning;
        tl_error error;
        memcpy(&tuning, resume->tunings + i * sizeof tuning, sizeof tuning);
        tl_fuzz_hold(tuning.tick >= 0 && tl_tuning_check(&tuning.values, &error) == TL_OK);
    }
    tl_fuzz_hold(!tl_resume_tick_at(resume, resume->first - 1, &tick) &&
                 !tl_resume_tick_at(resume, resume->last + 1, &tick));
}

static void *allocate(size_t size) {
    void *bytes = malloc(size == 0 ? 1 : size);
    if (bytes == NULL) {
        exit(1);
    }
    return bytes;
}

/* Expects that writing the resume point again gives the same image: so each byte was read. */
static void write_again(const tl_resume *resume, const unsigned char *image, size_t size) {
    unsigned char *again = allocate(size);
    tl_resume_write(resume, again);
    tl_fuzz_hold(memcmp(again, image, size) == 0);
    free(again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_resume resume;
    tl_error error = {TL_OK, ""};
    if (size == 0) {
        return 0;
    }
    size--;
    unsigned char *image = allocate(size); /* without spare bytes: an access outside of it is detected */
    memcpy(image, data + 1, size);
    put_right(data[0], image, size);
    tl_status status = tl_resume_read(image, size, tl_fuzz_config(configuration), NOW, &resume, &error);
    tl_fuzz_hold(status == TL_OK || (status == TL_BAD_DATA && error.text[0] != '\0'));
    int64_t start = 0;
    memcpy(&start, image + (size >= HEAD ? START : 0), size >= HEAD ? sizeof start : 0);
    if (status != TL_OK) {
        status = tl_resume_read_samples(image, size, tl_fuzz_config(configuration), start, &resume, &error);
        tl_fuzz_hold(status == TL_BAD_DATA || resume.from == TL_RESUMED_NOT);
    }
    if (status == TL_OK) {
        check(&resume);
        write_again(&resume, image, size);
    }
    free(image);
    return 0;
}
