/* Ticks and results, packed and unpacked: nothing is lost, every byte is written, and none beside. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/twin_step.h"
#include "tests/support/random_numbers.h"

enum { ROUNDS = 200, CANARY = 0x5A, BEFORE = 3 /* so that nothing is aligned */ };

/* The smallest there is, usual ones, and the largest. */
static const tl_config configs[] = {
    {.component_count = 1},
    {.signal_count = 1, .component_count = 1, .match_count = 1, .emulated_count = 1},
    {.signal_count = 2, .component_count = 2, .match_count = 1, .adjust_count = 1, .emulated_count = 2},
    {.signal_count = 7, .component_count = 5, .match_count = 3, .adjust_count = 2, .emulated_count = 3},
    {.signal_count = TL_MAX_SIGNALS,
     .component_count = TL_RECORDER_COMPONENTS - 2,
     .match_count = TL_MAX_MATCH,
     .adjust_count = TL_MAX_ADJUST,
     .emulated_count = TL_MAX_SIGNALS},
};
enum { CONFIGS = sizeof configs / sizeof configs[0] };
static const tl_twin_tells tells[] = {TL_TELLS_RECORDS, TL_TELLS_COUNTS, TL_TELLS_OUTPUTS};
enum { TELLS = sizeof tells / sizeof tells[0] };

static tl_test_random numbers;
static tl_recording_tick tick, tick_back;
static tl_twin_result result, result_back;

void setUp(void) {
    numbers.state = 14;
}

void tearDown(void) {}

static void fill(void *bytes, size_t size) {
    for (size_t i = 0; i < size; i++) {
        ((unsigned char *)bytes)[i] = (unsigned char)tl_test_random_bits(&numbers);
    }
}

/* Any bits, but in what is a bool. */
static void make_tick(tl_recording_tick *made) {
    fill(made, sizeof *made);
    made->made_up = tl_test_random_chance(&numbers, 50);
    made->cut_short = tl_test_random_chance(&numbers, 50);
    made->without_nominal = tl_test_random_chance(&numbers, 50);
    made->followed = tl_test_random_chance(&numbers, 50);
    made->resets = tl_test_random_chance(&numbers, 50);
}

/* ---- ticks ---- */

static void expect_same_tick(const tl_config *config) {
    const tl_sample *sample = &tick.sample;
    const tl_sample *back = &tick_back.sample;
    TEST_ASSERT_EQUAL_INT64(sample->tick, back->tick);
    TEST_ASSERT_EQUAL_INT64(sample->instant, back->instant);
    TEST_ASSERT_EQUAL_INT(0, memcmp(sample->values, back->values, config->signal_count * sizeof back->values[0]));
    TEST_ASSERT_EQUAL_INT(0, memcmp(sample->stamps, back->stamps, config->signal_count * sizeof back->stamps[0]));
    TEST_ASSERT_EQUAL_INT(0, memcmp(sample->quality, back->quality, config->signal_count));
    TEST_ASSERT_EQUAL_INT(0, memcmp(tick.u, tick_back.u, config->adjust_count * sizeof tick.u[0]));
    TEST_ASSERT_EQUAL_UINT64(tick.executions, tick_back.executions);
    TEST_ASSERT_EQUAL_UINT32(tick.evaluations, tick_back.evaluations);
    TEST_ASSERT_EQUAL_INT(tick.made_up, tick_back.made_up);
    TEST_ASSERT_EQUAL_INT(tick.cut_short, tick_back.cut_short);
    TEST_ASSERT_EQUAL_INT(tick.without_nominal, tick_back.without_nominal);
    TEST_ASSERT_EQUAL_INT(tick.followed, tick_back.followed);
    TEST_ASSERT_EQUAL_INT(tick.resets, tick_back.resets);
}

static void expect_canaries(const unsigned char *bytes, size_t from, size_t to) {
    for (size_t i = from; i < to; i++) {
        TEST_ASSERT_EQUAL_HEX8(CANARY, bytes[i]);
    }
}

/* What is behind the last signal and the last variable is not touched. */
static void expect_tick_untouched(const tl_config *config) {
    const tl_sample *sample = &tick_back.sample;
    expect_canaries((const unsigned char *)sample->values, config->signal_count * sizeof sample->values[0],
                    sizeof sample->values);
    expect_canaries((const unsigned char *)sample->stamps, config->signal_count * sizeof sample->stamps[0],
                    sizeof sample->stamps);
    expect_canaries(sample->quality, config->signal_count, sizeof sample->quality);
    expect_canaries((const unsigned char *)tick_back.u, config->adjust_count * sizeof tick_back.u[0],
                    sizeof tick_back.u);
}

static void check_tick(const tl_config *config) {
    unsigned char bytes[BEFORE + TL_TWIN_PACKED + 1];
    size_t size = tl_twin_packed_tick_size(config);
    make_tick(&tick);
    memset(bytes, CANARY, sizeof bytes);
    tl_twin_pack_tick(config, &tick, bytes + BEFORE);
    expect_canaries(bytes, 0, BEFORE);
    expect_canaries(bytes, BEFORE + size, sizeof bytes);
    memset(&tick_back, CANARY, sizeof tick_back);
    tl_twin_unpack_tick(config, bytes + BEFORE, &tick_back);
    expect_same_tick(config);
    expect_tick_untouched(config);
}

static void test_ticks_come_back(void) {
    for (size_t i = 0; i < CONFIGS; i++) {
        for (int round = 0; round < ROUNDS; round++) {
            check_tick(&configs[i]);
        }
    }
}

/* ---- results ---- */

static size_t besides_size(const tl_config *config, tl_twin_tells told) {
    return told == TL_TELLS_COUNTS    ? (config->component_count + 1) * sizeof result.besides.counts[0]
           : told == TL_TELLS_OUTPUTS ? config->emulated_count * sizeof result.besides.outputs[0]
                                      : 0;
}

static void expect_same_arrays(const tl_config *config, tl_twin_tells told) {
    const tl_record *record = &result.record;
    const tl_record *back = &result_back.record;
    const size_t matches = config->match_count * sizeof record->y[0];
    const size_t adjusts = config->adjust_count * sizeof record->u[0];
    const size_t readings = config->match_count * sizeof record->readings[0];
    TEST_ASSERT_EQUAL_INT(0, memcmp(record->y, back->y, matches));
    TEST_ASSERT_EQUAL_INT(0, memcmp(record->y_hat, back->y_hat, matches));
    TEST_ASSERT_EQUAL_INT(0, memcmp(record->y_hat_quality, back->y_hat_quality, config->match_count));
    TEST_ASSERT_EQUAL_INT(0, memcmp(record->u, back->u, adjusts));
    TEST_ASSERT_EQUAL_INT(0, memcmp(record->u_hat, back->u_hat, adjusts));
    TEST_ASSERT_EQUAL_INT(0, memcmp(record->readings, back->readings, readings));
    TEST_ASSERT_EQUAL_INT(0, memcmp(&result.besides, &result_back.besides, besides_size(config, told)));
    expect_canaries((const unsigned char *)back->y, matches, sizeof back->y);
    expect_canaries((const unsigned char *)back->y_hat, matches, sizeof back->y_hat);
    expect_canaries(back->y_hat_quality, config->match_count, sizeof back->y_hat_quality);
    expect_canaries((const unsigned char *)back->readings, readings, sizeof back->readings);
    expect_canaries((const unsigned char *)back->u, adjusts, sizeof back->u);
    expect_canaries((const unsigned char *)back->u_hat, adjusts, sizeof back->u_hat);
    expect_canaries((const unsigned char *)&result_back.besides, besides_size(config, told),
                    sizeof result_back.besides);
}

static void expect_same_heads(void) {
    const tl_record *record = &result.record;
    const tl_record *back = &result_back.record;
    TEST_ASSERT_EQUAL_INT64(result.tick, result_back.tick);
    TEST_ASSERT_EQUAL_INT32(result.status, result_back.status);
    TEST_ASSERT_EQUAL_UINT32(result.ready, result_back.ready);
    TEST_ASSERT_EQUAL_INT64(record->step, back->step);
    TEST_ASSERT_EQUAL_INT64(record->used, back->used);
    TEST_ASSERT_EQUAL_INT64(record->delay, back->delay);
    TEST_ASSERT_EQUAL_INT(0, memcmp(&record->objective, &back->objective, sizeof back->objective));
    TEST_ASSERT_EQUAL_INT(0,
                          memcmp(&record->objective_nominal, &back->objective_nominal, sizeof back->objective_nominal));
    TEST_ASSERT_EQUAL_UINT32(record->outcome, back->outcome);
    TEST_ASSERT_EQUAL_UINT32(record->stop, back->stop);
    TEST_ASSERT_EQUAL_UINT32(record->evaluations, back->evaluations);
    TEST_ASSERT_EQUAL_UINT32(record->executions, back->executions);
    TEST_ASSERT_EQUAL_UINT32(record->predicted, back->predicted);
    TEST_ASSERT_EQUAL_UINT32(record->flags, back->flags);
    TEST_ASSERT_EQUAL_UINT32(record->held, back->held);
    TEST_ASSERT_EQUAL_UINT32(record->delay_state, back->delay_state);
}

/* Enumerations of any bits but the highest: no compiler's enumeration has less. */
static void make_result(void) {
    fill(&result, sizeof result);
    result.record.outcome = (tl_outcome)tl_test_random_below(&numbers, TL_OUTCOMES);
    result.record.stop = (tl_stop)tl_test_random_below(&numbers, TL_STOP_TIME + 1);
    result.record.delay_state = (tl_delay_state)tl_test_random_below(&numbers, TL_DELAY_LOST + 1);
}

static void check_result(const tl_config *config, tl_twin_tells told) {
    unsigned char bytes[BEFORE + TL_TWIN_PACKED + 1];
    size_t size = tl_twin_packed_result_size(config, told);
    make_result();
    memset(bytes, CANARY, sizeof bytes);
    tl_twin_pack_result(config, told, &result, bytes + BEFORE);
    expect_canaries(bytes, 0, BEFORE);
    expect_canaries(bytes, BEFORE + size, sizeof bytes);
    memset(&result_back, CANARY, sizeof result_back);
    tl_twin_unpack_result(config, told, bytes + BEFORE, &result_back);
    expect_same_heads();
    expect_same_arrays(config, told);
}

static void test_results_come_back(void) {
    for (size_t i = 0; i < CONFIGS * TELLS; i++) {
        for (int round = 0; round < ROUNDS; round++) {
            check_result(&configs[i / TELLS], tells[i % TELLS]);
        }
    }
}

/* ---- sizes ---- */

static void test_sizes(void) {
    const tl_config *largest = &configs[CONFIGS - 1];
    const tl_config *small = &configs[2];
    tl_config more = *small;
    more.signal_count++;
    TEST_ASSERT_EQUAL_size_t(tl_twin_packed_tick_size(small) + 17, tl_twin_packed_tick_size(&more));
    more.match_count++;
    TEST_ASSERT_EQUAL_size_t(tl_twin_packed_result_size(small, TL_TELLS_RECORDS) + 33,
                             tl_twin_packed_result_size(&more, TL_TELLS_RECORDS));
    TEST_ASSERT_EQUAL_size_t(tl_twin_packed_result_size(small, TL_TELLS_RECORDS) + 3 * sizeof(tl_recorder_component),
                             tl_twin_packed_result_size(small, TL_TELLS_COUNTS));
    TEST_ASSERT_LESS_THAN_size_t(sizeof(tl_recording_tick) / 8, tl_twin_packed_tick_size(small));
    TEST_ASSERT_LESS_OR_EQUAL_size_t(TL_TWIN_PACKED, tl_twin_packed_tick_size(largest));
    for (size_t i = 0; i < TELLS; i++) {
        TEST_ASSERT_LESS_OR_EQUAL_size_t(TL_TWIN_PACKED, tl_twin_packed_result_size(largest, tells[i]));
    }
}

/* So nothing crosses that was in memory before: what is packed twice, over different bytes, is the same. */
static void test_every_byte_is_written(void) {
    unsigned char one[TL_TWIN_PACKED];
    unsigned char other[TL_TWIN_PACKED];
    for (size_t i = 0; i < CONFIGS * TELLS; i++) {
        const tl_config *config = &configs[i / TELLS];
        make_tick(&tick);
        make_result();
        memset(one, 0, sizeof one);
        memset(other, 0xFF, sizeof other);
        tl_twin_pack_tick(config, &tick, one);
        tl_twin_pack_tick(config, &tick, other);
        TEST_ASSERT_EQUAL_INT(0, memcmp(one, other, tl_twin_packed_tick_size(config)));
        tl_twin_pack_result(config, tells[i % TELLS], &result, one);
        tl_twin_pack_result(config, tells[i % TELLS], &result, other);
        TEST_ASSERT_EQUAL_INT(0, memcmp(one, other, tl_twin_packed_result_size(config, tells[i % TELLS])));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_ticks_come_back);
    RUN_TEST(test_results_come_back);
    RUN_TEST(test_sizes);
    RUN_TEST(test_every_byte_is_written);
    return UNITY_END();
}
