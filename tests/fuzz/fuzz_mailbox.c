/* Fuzzes sample buffers of a hostile process: it can write any value into the memory between two of
 * our look-ups.
 *
 * Input:  depth of the buffers and kind of the look-ups, then actions. The hostile process posts,
 *         changes a count, writes a slot that looks complete, or writes a word anywhere; a
 *         successor repairs the buffer; we look up. The memory has no spare bytes, so that an
 *         access outside of it is detected. */
#include <math.h>
#include <stdlib.h>

#include "firmware/plant/plant_input.h"
#include "firmware/plant/sample_buffer.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { SIGNALS = 3, DEEPEST = 9 };

static tl_sample_buffers_shape shape;
static tl_plant_input input;
static unsigned char *memory;

/* Returns a small, large or arbitrary number. */
static uint64_t take_number(void) {
    unsigned how = tl_fuzz_take();
    uint64_t low = tl_fuzz_take_word();
    uint64_t high = how % 4 == 0 ? tl_fuzz_take_word() : 0;
    uint64_t number = high << 32 | low >> (how / 4 % 4 * 8);
    return how >= 128 ? ~number : number;
}

/* Returns a time as our code passes it: of a clock that has run for some months, or of a
 * recording. */
static tl_time take_instant(void) {
    return (tl_time)(int32_t)tl_fuzz_take_word() * ((tl_time)1 << tl_fuzz_take() % 24);
}

/* ---- the enemy ---- */

static void put_slot(const tl_sample_buffer *buffer, uint64_t post) {
    tl_sample_buffer_slot *slot = &buffer->slots[post % buffer->depth];
    *slot = (tl_sample_buffer_slot){
        .sequence = 2 * post + 2, .value = take_number(), .stamp = (int64_t)take_number(), .quality = take_number()};
}

static void post(size_t signal) {
    const tl_reading reading = {
        .value = tl_fuzz_take(), .stamp = take_instant(), .quality = (tl_quality)(tl_fuzz_take() % (TL_NO_LINK + 1))};
    tl_sample_buffer_post(&input.buffers[signal], &reading);
}

static void attack(unsigned what) {
    const size_t signal = what / 8 % shape.signals;
    const tl_sample_buffer *buffer = &input.buffers[signal];
    switch (what % 6) {
    case 0:
        post(signal);
        break;
    case 1:
        *buffer->count += tl_fuzz_take();
        break;
    case 2:
        *buffer->count = take_number();
        break;
    case 3:
        put_slot(buffer, *buffer->count - 1 - tl_fuzz_take());
        break;
    case 4: {
        size_t words = tl_sample_buffers_bytes(&shape) / sizeof(uint64_t);
        ((uint64_t *)(void *)memory)[tl_fuzz_take_word() % words] = take_number();
        break;
    }
    default:
        tl_sample_buffer_repair(buffer);
    }
}

/* ---- we ---- */

static void hold_reading(const tl_reading *reading) {
    tl_fuzz_hold(reading->quality >= TL_GOOD && reading->quality <= TL_OUTLIER);
}

static void look_up(void) {
    tl_reading reading = {.quality = TL_NO_LINK};
    const tl_sample_buffer *buffer = &input.buffers[tl_fuzz_take() % shape.signals];
    tl_time one = (tl_time)take_number();
    tl_time other = (tl_time)take_number();
    (void)tl_sample_buffer_at(buffer, one, &reading);
    hold_reading(&reading);
    tl_reading after = {.quality = TL_NO_LINK};
    if (tl_sample_buffer_around(buffer, one < other ? one : other, one < other ? other : one, &reading, &after)) {
        hold_reading(&reading);
        hold_reading(&after);
    }
    (void)tl_sample_buffer_from(buffer, one < other ? one : other, one < other ? other : one, &reading);
    hold_reading(&reading);
}

static void take_sample(void) {
    static tl_sample sample;
    tl_time instant = take_instant();
    tl_plant_input_take(&input, 0, instant, &sample);
    for (size_t i = 0; i < shape.signals; i++) {
        tl_time stamp = sample.stamps[i];
        tl_time at = instant - input.looks[i].back;
        tl_fuzz_hold(isfinite(sample.values[i]) && sample.quality[i] <= TL_OUTLIER);
        tl_fuzz_hold(stamp == TL_TIME_NEVER ? sample.quality[i] == TL_NO_LINK
                                            : stamp - at <= TL_PLANT_FARTHEST && at - stamp <= TL_PLANT_FARTHEST);
    }
    (void)tl_plant_input_is_complete(&input);
}

/* ---- one input ---- */

static void begin(void) {
    shape = (tl_sample_buffers_shape){.signals = 1 + tl_fuzz_take() % SIGNALS};
    input = (tl_plant_input){.count = shape.signals};
    for (size_t i = 0; i < shape.signals; i++) {
        unsigned how = tl_fuzz_take();
        shape.depth[i] = (uint32_t)1 << how % (DEEPEST + 1);
        shape.of[i] = i;
        input.limits[i] = (tl_plant_limits){.minimum = -1000,
                                            .maximum = 1000,
                                            .stale = how % 3 * TL_SECOND,
                                            .type = (tl_type)(how % (TL_ENUMERATION + 1))};
        input.looks[i] = (tl_plant_lookup){.back = (tl_time)tl_fuzz_take() << 20,
                                           .next = how >= 128,
                                           .between = (tl_between)(how / 4 % 3),
                                           .span = TL_SECOND / 100};
    }
    memory = calloc(1, tl_sample_buffers_bytes(&shape));
    tl_fuzz_hold(memory != NULL);
    tl_sample_buffers_open(&shape, memory, input.buffers);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_fuzz_begin(data, size);
    begin();
    while (!tl_fuzz_is_over()) {
        unsigned what = tl_fuzz_take();
        if (what < 160) {
            attack(what);
        } else if (what < 208) {
            look_up();
        } else {
            take_sample();
        }
    }
    free(memory);
    return 0;
}
