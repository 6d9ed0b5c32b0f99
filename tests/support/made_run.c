/* Values are a hash of their tick and signal. Every 16th one is an extreme number. */
#include "tests/support/made_run.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const tl_recorder_signal plant[TL_MADE_PLANT] = {
    {.name = "plant.torque", .unit = "N.m", .type = TL_REAL},
    {.name = "plant.omega", .unit = "rad/s", .type = TL_REAL},
    {.name = "plant.door", .unit = "", .type = TL_BOOLEAN},
};
static const tl_recorder_signal match[TL_MADE_MATCH] = {
    {.name = "motor.omega", .to = "plant.omega"},
    {.name = "motor.i", .to = "plant.torque"},
};
static const tl_recorder_signal adjust[TL_MADE_ADJUST] = {
    {.name = "motor.d"},
    {.name = "drive.u"},
};

static tl_account made_account;

tl_account *tl_made_account(void) {
    return &made_account;
}

tl_recorder_settings tl_made_settings(const char *path) {
    made_account = (tl_account){.components = TL_MADE_COMPONENTS,
                                .matches = TL_MADE_MATCH,
                                .adjusts = TL_MADE_ADJUST,
                                .prediction = TL_MADE_PREDICTION,
                                .lead = TL_MADE_PREDICTION,
                                .component = {{.name = "drive"}, {.name = "motor"}, {.name = "plant"}},
                                .match = {{.unit = "rad/s"}, {.unit = "A"}},
                                .adjust = {{.unit = "N.m.s/rad"}, {.unit = "V"}}};
    tl_recorder_settings settings = {
        .path = path,
        .commit = TL_SECOND / 50,
        .verb = "replay",
        .name = "motor bench",
        .configuration = "{ \"twinlock\": 1, \"name\": \"motor bench\" }\n",
        .step = TL_SECOND / 100,
        .measurements = TL_LAG,
        .plant = plant,
        .match = match,
        .adjust = adjust,
        .plant_count = TL_MADE_PLANT,
        .match_count = TL_MADE_MATCH,
        .adjust_count = TL_MADE_ADJUST,
        .component_count = TL_MADE_COMPONENTS,
        .account = &made_account,
    };
    return settings;
}

/* SplitMix64's finaliser (Steele, Lea, Flood 2014). */
static uint64_t mix(uint64_t x) {
    x += UINT64_C(0x9E3779B97F4A7C15);
    x = (x ^ (x >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94D049BB133111EB);
    return x ^ (x >> 31);
}

static double number(int64_t at, uint64_t salt) {
    static const double awkward[] = {-0.0, 0.0,      5e-324, -5e-324, DBL_MAX, -DBL_MIN, 9007199254740993.0,
                                     0.1,  -1.0 / 3, 5.0,    -3.0,    1e18,    1e-300,   1e-310};
    uint64_t hash = mix((uint64_t)at * 64 + salt);
    if (hash % 16 == 0) {
        return awkward[(hash >> 8) % (sizeof awkward / sizeof awkward[0])];
    }
    return ((double)(hash >> 11) / 9007199254740992.0 - 0.5) * 1000.0;
}

void tl_made_sample(int64_t tick, tl_sample *sample) {
    memset(sample, 0xA5, sizeof *sample);
    sample->tick = tick;
    for (uint64_t i = 0; i < TL_MADE_PLANT; i++) {
        uint64_t hash = mix((uint64_t)tick * 8 + i);
        sample->values[i] = number(tick, i);
        sample->quality[i] = (uint8_t)(hash % 8 < TL_NO_LINK ? TL_GOOD : hash % 8 - 3);
        sample->stamps[i] = tick * (TL_SECOND / 100) - (int64_t)(hash % 20000000);
        if (tick == 0 && i == 2) {
            sample->stamps[i] = TL_TIME_NEVER;
            sample->quality[i] = TL_NO_LINK;
        }
    }
}

void tl_made_record(int64_t step, tl_record *record) {
    uint64_t hash = mix((uint64_t)step + 7);
    memset(record, 0xA5, sizeof *record);
    record->step = step;
    record->outcome = (tl_outcome)(hash % TL_OUTCOMES);
    record->stop = (tl_stop)((hash >> 8) % (TL_STOP_TIME + 1));
    record->objective = record->outcome == TL_CAUGHT_UP ? (double)NAN : number(step, 10);
    record->objective_nominal = record->outcome == TL_OPTIMISED ? (double)INFINITY : number(step, 11);
    record->evaluations = (uint32_t)(hash >> 16) % 60;
    record->executions = (uint32_t)(hash >> 24) % 600;
    record->used = (tl_time)(hash >> 40);
    record->predicted = (uint32_t)(hash >> 20) % 600;
    record->flags = (uint32_t)(hash >> 28) % 8;
    record->held = (uint32_t)(hash >> 32) % (1U << TL_MADE_ADJUST);
    record->release_age = (uint32_t)(hash >> 12) % 4;
    record->delay_state = (tl_delay_state)((hash >> 36) % (TL_DELAY_LOST + 1));
    for (uint64_t i = 0; i < TL_MADE_MATCH; i++) {
        record->y[i] = number(step, 20 + i);
        record->measured[i] = number(step, 30 + i);
        record->released[i] = number(step, 70 + i);
        record->measured_quality[i] = (uint8_t)((hash >> i) % 8 == 0 ? TL_STALE : TL_GOOD);
        record->readings[i] = (tl_record_readings){.count = (uint32_t)(hash >> i) % 3,
                                                   .rejected = (uint32_t)(hash >> i) % 2,
                                                   .squares = fabs(number(step, 60 + i))};
    }
    for (uint64_t i = 0; i < TL_MADE_ADJUST; i++) {
        record->u[i] = number(step, 40 + i);
        record->nominal[i] = number(step, 50 + i);
    }
}

void tl_made_ledger(int64_t step, tl_execution_counts *ledger) {
    uint64_t steps = (uint64_t)step + 1;
    for (uint64_t i = 0; i < TL_MADE_COMPONENTS; i++) {
        ledger[i] = (tl_execution_counts){40 * steps, (20 + i) * steps, (21 + i) * steps, i * steps, steps / (i + 1)};
    }
}

void tl_made_put(tl_recorder *recorder, int64_t first, int64_t ticks) {
    tl_sample sample;
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    for (int64_t tick = first; tick < first + ticks; tick++) {
        tl_made_sample(tick, &sample);
        tl_recorder_put_sample(recorder, &sample);
        if (tick >= TL_MADE_PREDICTION) {
            tl_made_record(tick - TL_MADE_PREDICTION, &record);
            tl_made_ledger(record.step, ledger);
            tl_recorder_put_step(recorder, &record, ledger);
        }
    }
}

void tl_made_beginning(tl_time start, tl_record_queue_start *beginning) {
    tl_account *account = &beginning->account;
    *beginning = (tl_record_queue_start){.resumption = {.start = start, .started = INT64_C(1795219200000)},
                                         .account = {.components = TL_MADE_COMPONENTS,
                                                     .matches = TL_MADE_MATCH,
                                                     .adjusts = TL_MADE_ADJUST,
                                                     .prediction = TL_MADE_PREDICTION,
                                                     .lead = 0}};
    for (int i = 0; i < TL_MADE_COMPONENTS; i++) {
        (void)snprintf(account->component[i].name, TL_ACCOUNT_TEXT, "component %d", i);
    }
    for (int i = 0; i < TL_MADE_MATCH; i++) {
        (void)snprintf(account->match[i].unit, TL_ACCOUNT_TEXT, "unit %d", i);
    }
}

bool tl_made_put_out(tl_record_queue *queue, int64_t first, int64_t ticks) {
    tl_sample sample;
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    bool has_room = true;
    for (int64_t tick = first; tick < first + ticks; tick++) {
        tl_made_sample(tick, &sample);
        tl_made_record(tick, &record);
        tl_made_ledger(tick, ledger);
        has_room = tl_record_queue_put_sample(queue, &sample) && has_room;
        has_room = tl_record_queue_put_step(queue, &record, ledger) && has_room;
    }
    return has_room;
}
