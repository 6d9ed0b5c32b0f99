/* The change detector with made-up records: what is one finding, and what is none. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/change_detector.h"
#include "tests/support/message.h"

enum { DAY = 86400, RELEASE = 600, TOLD = 16, LEAD = 3 };

static tl_config_signal signals[2];
static tl_plan_adjust adjust[2];
static tl_plan_match match[2];
static const char *matched_as[2] = {"plant.level", "plant.flow"};
static tl_config config;
static tl_account account;
static tl_change_detector *detector;
static tl_record record;
static uint64_t random_state;
static tl_finding told[TOLD];
static tl_finding_turn turns[TOLD];
static size_t count; /* of what was reported */

static int64_t ticks[TOLD];

static void keep(void *context, int64_t tick, const tl_finding *finding, tl_finding_turn turn) {
    (void)context;
    if (count < TOLD) {
        told[count] = *finding;
        turns[count] = turn;
        ticks[count] = tick;
    }
    count++;
}

static double draw(void) {
    double sum = 0.0;
    for (int i = 0; i < 12; i++) {
        random_state ^= random_state << 13;
        random_state ^= random_state >> 7;
        random_state ^= random_state << 17;
        sum += (double)(random_state >> 11) / 9007199254740992.0 - 0.5;
    }
    return sum;
}

void setUp(void) {
    memset(&record, 0, sizeof record);
    memset(&config, 0, sizeof config);
    random_state = 88172645463325252U;
    count = 0;
    signals[0].plan.name = "level";
    signals[1].plan.name = "flow";
    adjust[0] = (tl_plan_adjust){.variable = "tank.pump"};
    adjust[1] = (tl_plan_adjust){.variable = "tank.valve"};
    match[0] = (tl_plan_match){.variable = "tank.level", .to = "plant.level", .tolerance = 0.1, .weight = 1};
    match[1] = (tl_plan_match){.variable = "tank.flow", .to = "plant.flow", .tolerance = 0.5};
    config.name = "tank";
    config.signals = signals;
    config.signal_count = 2;
    config.adjust = adjust;
    config.adjust_count = 2;
    config.match = match;
    config.match_count = 2;
    config.matched_as = matched_as;
    config.step = TL_SECOND;
    config.released_steps = RELEASE;
    config.false_alarms_per_year = 1.0;
    config.detect_learn = DAY * TL_SECOND;
    account.match[0] = (tl_account_match){.unit = "m"};
    account.match[1] = (tl_account_match){.unit = "l/s"};
    account.adjust[0] = (tl_account_adjust){.unit = "%", .type = TL_REAL, .step = 1.0};
    account.adjust[1] = (tl_account_adjust){.type = TL_BOOLEAN};
    detector = tl_change_detector_create(&config, &account, keep, NULL);
    TEST_ASSERT_NOT_NULL(detector);
}

void tearDown(void) {
    tl_change_detector_destroy(detector);
}

/* Steps of a plant whose pump needs this correction, and whose outputs are off by these errors. */
static void run(int64_t steps, double correction, double level, double flow) {
    for (int64_t i = 0; i < steps; i++) {
        record.outcome = TL_OPTIMISED;
        record.nominal[0] = 40.0;
        record.u[0] = 40.0 + correction + 0.1 * draw();
        record.release_age = RELEASE / 2 + (uint32_t)(record.step % (RELEASE / 2));
        record.released[0] = 2.0;
        record.measured[0] = 2.0 + level + 0.01 * draw();
        record.released[1] = 5.0;
        record.measured[1] = 5.0 + flow + 0.05 * draw();
        tl_change_detector_step(detector, record.step + LEAD, &record);
        record.step++;
    }
}

static tl_changes get(void) {
    return tl_change_detector_get(detector);
}

static void learn(void) {
    run(DAY + DAY / 4, 0.0, 0.0, 0.0);
    TEST_ASSERT_TRUE(get().detection.is_ready);
    TEST_ASSERT_EQUAL_size_t(0, count);
}

static void expect_told(size_t index, tl_finding_turn turn, const char *variable) {
    TEST_ASSERT_GREATER_THAN_size_t(index, count);
    TEST_ASSERT_EQUAL_INT(turn, turns[index]);
    TEST_ASSERT_EQUAL_STRING(variable, told[index].variable);
}

static void test_learning(void) {
    run(DAY / 2, 0.0, 0.0, 0.0);
    run(DAY / 4, 8.0, 0.0, 0.0);
    tl_changes changes = get();
    TEST_ASSERT_FALSE(changes.detection.is_ready);
    TEST_ASSERT_DOUBLE_WITHIN(1000.0, 0.75 * DAY - 10 * RELEASE, changes.detection.learnt);
    TEST_ASSERT_DOUBLE_WITHIN(0.5, DAY, changes.detection.needed);
    TEST_ASSERT_EQUAL_size_t(0, changes.count);
}

/* A change of the pump moves both outputs as well: one finding, named by the correction. */
static void test_one_cause_is_one_finding(void) {
    learn();
    const double at = (double)record.step;
    run(DAY / 4, -2.0, 0.05, -0.5);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    const tl_finding *finding = get().finding;
    TEST_ASSERT_EQUAL_STRING("tank.pump", finding->variable);
    TEST_ASSERT_EQUAL_STRING("%", finding->unit);
    TEST_ASSERT_DOUBLE_WITHIN(30.0, at, finding->onset);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -2.0, finding->size);
    TEST_ASSERT_DOUBLE_WITHIN(0.25, -5.0, finding->percent);
    TEST_ASSERT_EQUAL_UINT64(1, finding->corrections);
    TEST_ASSERT_EQUAL_UINT64(3, finding->outputs);
    expect_told(0, TL_FINDING_FOUND, told[0].variable);
    TEST_ASSERT_LESS_OR_EQUAL_size_t(3, count); /* if an output was found first, and with the cause */
    expect_told(count - 1, turns[count - 1], "tank.pump");
    TEST_ASSERT_EQUAL_INT(TL_FINDING_PLANT, told[count - 1].cause);
}

static void test_a_finding_ends_and_comes_back(void) {
    learn();
    run(DAY / 8, -2.0, 0.0, 0.0);
    const double at = (double)record.step;
    run(DAY / 8, 0.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_TRUE(get().finding->is_gone);
    TEST_ASSERT_DOUBLE_WITHIN(60.0, at, get().finding->gone);
    expect_told(1, TL_FINDING_ENDED, "tank.pump");
    TEST_ASSERT_DOUBLE_WITHIN(1.0, told[0].found, (double)(ticks[0] - LEAD));
    TEST_ASSERT_GREATER_THAN_INT64((int64_t)at, ticks[1]); /* events are in order */
    run(DAY / 8, -2.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_FALSE(get().finding->is_gone);
    expect_told(2, TL_FINDING_FURTHER, "tank.pump");
}

/* Long after its end it is news, with a new onset, but the same finding. Another level is another. */
static void test_a_finding_comes_back_late(void) {
    learn();
    run(DAY / 8, -2.0, 0.0, 0.0);
    run(DAY + DAY / 2, 0.0, 0.0, 0.0);
    const double at = (double)record.step;
    run(DAY / 8, -2.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_DOUBLE_WITHIN(60.0, at, get().finding->onset);
    expect_told(2, TL_FINDING_FOUND, "tank.pump");
    run(DAY / 8, 6.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
    TEST_ASSERT_TRUE(get().finding[0].is_gone);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 6.0, get().finding[1].size);
}

/* The released twin has no correction, so an output shows the open change again. */
static void test_an_output_belongs_to_an_open_correction(void) {
    learn();
    run(DAY / 4, -2.0, 0.0, 0.0);
    run(DAY / 4, -2.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_EQUAL_UINT64(2, get().finding->outputs);
}

/* After an outage of the readings, the twin is wrong for some time. */
static void test_an_outage(void) {
    learn();
    record.measured_quality[0] = record.measured_quality[1] = TL_STALE;
    for (int i = 0; i < 3600; i++) {
        record.outcome = TL_FREE;
        tl_change_detector_step(detector, record.step + LEAD, &record);
        record.step++;
    }
    record.measured_quality[0] = record.measured_quality[1] = TL_GOOD;
    run(RELEASE, 20.0, 3.0, 3.0);
    run(DAY / 8, 0.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(0, get().count);
    TEST_ASSERT_EQUAL_size_t(0, count);
}

static void test_a_sensor_is_named_by_its_output(void) {
    learn();
    run(DAY / 8, 0.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_OUTPUT, get().finding->subject);
    TEST_ASSERT_EQUAL_STRING("flow", get().finding->variable);
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 1.0, get().finding->size);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_SENSOR, get().finding->cause);
    TEST_ASSERT_EQUAL_STRING("flow", get().finding->sensor);
}

/* A biased sensor that is matched moves a correction. One output is off while the release from
 * before the onset is recorded; later ones are off all together, and do not count. */
static void test_a_matched_sensor(void) {
    learn();
    run(RELEASE / 2 - record.step % (RELEASE / 2), 1.5, 0.3, 0.0);
    run(DAY / 8, 1.5, 0.1, 1.0);
    TEST_ASSERT_EQUAL_STRING("tank.pump", get().finding->variable);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_SENSOR, get().finding->cause);
    TEST_ASSERT_EQUAL_STRING("level", get().finding->sensor);
}

/* A slow change is found when the releases of its onset are forgotten: then no cause is told. */
static void test_a_cause_that_is_too_old(void) {
    config.released_steps = 20; /* 64 of them last 640 steps */
    tl_change_detector_destroy(detector);
    detector = tl_change_detector_create(&config, &account, keep, NULL);
    learn();
    double level = 0.0;
    for (int i = 1; i <= 400 && get().count == 0; i++) {
        level = 0.005 * i;
        run(100, level, 0.0, 0.0);
    }
    run(2000, level, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_TRUE(get().finding->is_decided);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_NO_CAUSE, get().finding->cause);
}

/* With one output, a sensor cannot be distinguished. */
static void test_one_output_shows_no_cause(void) {
    config.match_count = 1;
    tl_change_detector_destroy(detector);
    detector = tl_change_detector_create(&config, &account, keep, NULL);
    learn();
    run(DAY / 8, -2.0, 0.3, 0.0);
    TEST_ASSERT_TRUE(get().finding->is_decided);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_NO_CAUSE, get().finding->cause);
}

static void test_a_drift(void) {
    learn();
    for (int i = 1; i <= 60; i++) {
        run(600, -0.1 * i, 0.0, 0.0);
    }
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_DRIFT, get().finding->kind);
}

/* Less than a hundredth of û, and less than a tenth of a tolerance. */
static void test_a_small_change_is_no_finding(void) {
    learn();
    run(DAY / 2, 0.2, 0.005, 0.02);
    TEST_ASSERT_EQUAL_size_t(0, get().count);
}

static void test_two_changes_are_two_findings(void) {
    learn();
    run(DAY / 8, 0.0, 0.0, 1.0);
    run(DAY / 8, -2.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
    TEST_ASSERT_EQUAL_STRING("flow", get().finding[0].variable);
    TEST_ASSERT_EQUAL_STRING("tank.pump", get().finding[1].variable);
}

/* After a reset the FMUs start again, and their first steps are no change. */
static void test_a_reset_is_left_out(void) {
    learn();
    record.flags = TL_FLAG_RESET;
    run(1, 30.0, 3.0, 3.0);
    record.flags = 0;
    run(9 * RELEASE, 30.0, 3.0, 3.0);
    run(DAY / 8, 0.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(0, get().count);
}

/* Steps that repeat an earlier run, and values that are not good. */
static void test_what_is_not_known_is_left_out(void) {
    learn();
    record.outcome = TL_RESUMED;
    record.u[0] = 90.0;
    for (int i = 0; i < 1000; i++) {
        tl_change_detector_step(detector, record.step + LEAD, &record);
    }
    record.measured_quality[1] = TL_STALE;
    run(DAY / 8, 0.0, 0.0, 9.0);
    TEST_ASSERT_EQUAL_size_t(0, get().count);
}

static void test_the_words_of_the_user(void) {
    static tl_config_words says[] = {{"plant.flow", "flow meter"}, {"tank.valve", "valve"}};
    char text[TL_FINDING_TEXT];
    config.says = says;
    config.says_count = 2;
    learn();
    run(DAY / 8, 0.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_STRING("flow meter", get().finding->says);
    tl_finding_write(get().finding, 0.0, 0, text);
    TL_EXPECT_PARTS("flow meter: plant.flow: |since", text);
}

static void test_a_frozen_signal(void) {
    tl_sample sample = {.tick = 0};
    for (; sample.tick < 100; sample.tick++) {
        sample.values[1] = sample.tick < 40 ? (double)sample.tick : 40.0;
        sample.quality[1] = sample.tick < 80 ? TL_GOOD : TL_FROZEN;
        tl_change_detector_sample(detector, &sample);
    }
    expect_told(0, TL_FINDING_FOUND, "flow");
    TEST_ASSERT_EQUAL_INT(TL_FINDING_FREEZE, told[0].kind);
    TEST_ASSERT_DOUBLE_WITHIN(1.0, 40.0, told[0].onset);
    sample.quality[1] = TL_GOOD; /* until the value moves, it is still frozen: a run may have begun */
    tl_change_detector_sample(detector, &sample);
    TEST_ASSERT_EQUAL_size_t(1, count);
    sample.values[1] = 41.0;
    tl_change_detector_sample(detector, &sample);
    expect_told(1, TL_FINDING_ENDED, "flow");
    TEST_ASSERT_TRUE(told[1].is_gone);
}

/* Findings that are not stored yet get numbers behind those that are. */
static void test_numbers(void) {
    learn();
    run(DAY / 8, 0.0, 0.0, 1.0);
    tl_change_detector_number_from(detector, 7, true);
    TEST_ASSERT_EQUAL_UINT32(8, get().finding->number);
    run(DAY / 8, -2.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
    TEST_ASSERT_EQUAL_UINT32(9, get().finding[1].number);
    run(DAY / 4, -2.0, 0.0, 0.0);
    TEST_ASSERT_TRUE(get().finding[0].is_gone);
    TEST_ASSERT_FALSE(get().finding[1].is_gone);
}

/* An open finding is not dropped for a new one while another one is gone. */
static void test_an_open_finding_stays(void) {
    learn();
    run(DAY / 8, 0.0, 0.0, 1.0);
    tl_sample sample = {.tick = 0};
    for (; sample.tick < 2 * (TL_FINDINGS + 6); sample.tick++) {
        sample.quality[0] = sample.tick % 2 == 0 ? TL_FROZEN : TL_GOOD;
        sample.values[0] = (double)(sample.tick % 2);
        tl_change_detector_sample(detector, &sample);
    }
    TEST_ASSERT_EQUAL_STRING("flow", get().finding[0].variable);
    TEST_ASSERT_FALSE(get().finding[0].is_gone);
}

/* Steps that are missing interrupt the sums, and nothing is found. */
static void test_a_gap(void) {
    learn();
    record.step += 5000;
    run(DAY / 8, 0.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(0, get().count);
    run(DAY / 8, -2.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
}

/* The oldest findings are dropped, and the numbers go on. */
static void test_many_findings(void) {
    tl_sample sample = {.tick = 0};
    for (; sample.tick < 2 * (TL_FINDINGS + 6); sample.tick++) {
        sample.quality[0] = sample.tick % 2 == 0 ? TL_FROZEN : TL_GOOD;
        sample.values[0] = (double)(sample.tick % 2);
        tl_change_detector_sample(detector, &sample);
    }
    TEST_ASSERT_EQUAL_size_t(TL_FINDINGS, get().count);
    TEST_ASSERT_EQUAL_UINT32(7, get().finding[0].number);
    TEST_ASSERT_EQUAL_UINT32(TL_FINDINGS + 6, get().finding[TL_FINDINGS - 1].number);
}

/* Saves the detector, and restores it in another one. Returns false if that is refused. */
static bool restart(int64_t started) {
    size_t size = tl_change_detector_size(detector);
    unsigned char *bytes = malloc(size);
    TEST_ASSERT_NOT_NULL(bytes);
    tl_change_detector_save(detector, bytes);
    tl_change_detector_destroy(detector);
    detector = tl_change_detector_create(&config, &account, keep, NULL);
    bool is_loaded = tl_change_detector_load(detector, bytes, size);
    free(bytes);
    tl_change_detector_begin(detector, &account, started);
    record.step = 0;
    return is_loaded;
}

/* What was learnt outlives a restart. The open finding remains one, with the time of its onset. */
static void test_a_restart(void) {
    const int64_t first = 1764388800000;
    tl_change_detector_begin(detector, &account, first);
    learn();
    run(DAY / 8, -2.0, 0.0, 0.0);
    const double at = (double)DAY * 1.25;
    const int64_t later = 2 * DAY;
    TEST_ASSERT_TRUE(restart(first + 1000 * later));
    TEST_ASSERT_TRUE(get().detection.is_ready);
    run(DAY / 2, -2.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_FALSE(get().finding->is_gone);
    TEST_ASSERT_DOUBLE_WITHIN(30.0, at - (double)later, get().finding->onset);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -2.0, get().finding->size);
    run(DAY / 4, 0.0, 0.0, 0.0);
    TEST_ASSERT_TRUE(get().finding->is_gone);
    TEST_ASSERT_DOUBLE_WITHIN(60.0, 0.5 * DAY, get().finding->gone);
    TEST_ASSERT_TRUE(restart(first + 1000 * (later + DAY)));
    tl_change_detector_number_from(detector, 7, false);
    run(DAY / 4, 0.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
    TEST_ASSERT_EQUAL_UINT32(8, get().finding[1].number);
}

/* The levels of a finding that a user accepts give none, also after a restart. */
static void test_a_normal_finding(void) {
    tl_change_detector_begin(detector, &account, 1);
    learn();
    run(DAY / 8, -2.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_INT(TL_ACCEPTANCE_NONE, tl_change_detector_accept(detector, 2));
    TEST_ASSERT_EQUAL_INT(TL_ACCEPTANCE_DONE, tl_change_detector_accept(detector, 1));
    TEST_ASSERT_EQUAL_INT(TL_ACCEPTANCE_NONE, tl_change_detector_accept(detector, 1));
    TEST_ASSERT_FALSE(tl_finding_is_open(get().finding));
    TEST_ASSERT_EQUAL_STRING("normal", tl_finding_state_name(get().finding));
    const size_t before = count;
    run(DAY / 8, 0.0, 0.0, 0.0);
    run(DAY / 8, -2.0, 0.0, 1.0);
    TEST_ASSERT_TRUE(restart(1 + 1000 * DAY));
    run(DAY / 2, 0.0, 0.0, 0.0);
    run(DAY / 8, -2.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_EQUAL_size_t(before, count);
    run(DAY / 8, -6.0, 0.0, 1.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
    TEST_ASSERT_TRUE(tl_finding_is_open(&get().finding[1]));
}

/* After many other levels that of a finding is forgotten: it is normal all the same, once. */
static void test_a_forgotten_level(void) {
    tl_change_detector_begin(detector, &account, 1);
    learn();
    double size = 2.0;
    for (int i = 0; i < 10; i++) {
        run(DAY / 4, size, 0.0, 0.0);
        run(DAY / 4, 0.0, 0.0, 0.0);
        size *= i % 2 == 0 ? -1.0 : -3.0;
    }
    TEST_ASSERT_GREATER_THAN_size_t(8, get().count);
    TEST_ASSERT_EQUAL_INT(TL_ACCEPTANCE_LATE, tl_change_detector_accept(detector, get().finding->number));
    TEST_ASSERT_EQUAL_STRING("normal", tl_finding_state_name(get().finding));
    TEST_ASSERT_EQUAL_INT(TL_ACCEPTANCE_NONE, tl_change_detector_accept(detector, get().finding->number));
}

/* ---- limits that the user names ---- */

static tl_config_alarm alarms[] = {{.adjust = 0, .above = 3.0, .below = -3.0, .averaging_time = 160 * TL_SECOND}};

static void use_limits(void) {
    alarms[0].above = 3.0;
    config.alarms = alarms;
    config.alarm_count = 1;
}

/* No learning is needed. One finding while it lasts. */
static void test_a_limit(void) {
    use_limits();
    run(1000, 2.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(0, count);
    run(1000, -4.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, count);
    expect_told(0, TL_FINDING_FOUND, "tank.pump");
    const tl_finding *finding = get().finding;
    TEST_ASSERT_EQUAL_STRING("limit", tl_finding_kind_name(finding->kind));
    TEST_ASSERT_EQUAL_STRING("%", finding->unit);
    TEST_ASSERT_TRUE(tl_finding_is_open(finding));
    TEST_ASSERT_DOUBLE_WITHIN(10.0, 1000.0, finding->onset);
    TEST_ASSERT_DOUBLE_WITHIN(1.0, 6.0, finding->onset_spread);
    TEST_ASSERT_DOUBLE_WITHIN(10.0, 1140.0, finding->found);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -4.0, finding->size);
    TEST_ASSERT_TRUE(isnan(finding->percent));
    TEST_ASSERT_FALSE(get().detection.is_ready);
    run(1000, -9.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(2, count); /* it has grown */
    expect_told(1, TL_FINDING_FURTHER, "tank.pump");
    TEST_ASSERT_DOUBLE_WITHIN(1.0, -8.5, get().finding->size);
    run(500, 0.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(3, count);
    expect_told(2, TL_FINDING_ENDED, "tank.pump");
    TEST_ASSERT_DOUBLE_WITHIN(60.0, 3100.0, get().finding->gone);
    run(500, 4.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count); /* it returns soon, on the other side */
    expect_told(3, TL_FINDING_FURTHER, "tank.pump");
    TEST_ASSERT_TRUE(get().finding->size > 1.0);
    run(3000, 0.0, 0.0, 0.0);
    run(500, 4.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count); /* it returns late */
    expect_told(5, TL_FINDING_FOUND, "tank.pump");
}

/* A change of the same variable is another finding, and neither disturbs the other. */
static void test_a_limit_and_a_change(void) {
    use_limits();
    learn();
    run(DAY / 8, -6.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_LIMIT, get().finding[0].kind);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_STEP, get().finding[1].kind);
    TEST_ASSERT_EQUAL_INT(TL_FINDING_NO_CAUSE, get().finding[0].cause);
    run(DAY / 8, 0.0, 0.0, 0.0);
    TEST_ASSERT_TRUE(get().finding[0].is_gone && get().finding[1].is_gone);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
}

static void test_a_limit_without_values(void) {
    use_limits();
    run(1000, -4.0, 0.0, 0.0);
    for (int i = 0; i < 1000; i++) { /* the correction is not known: nothing ends */
        record.outcome = TL_FREE_RUN;
        record.u[0] = record.nominal[0];
        tl_change_detector_step(detector, record.step + LEAD, &record);
        record.step++;
    }
    TEST_ASSERT_TRUE(tl_finding_is_open(get().finding));
    TEST_ASSERT_EQUAL_size_t(1, count);
}

/* Other limits keep what was learnt, and the finding. Without limits it is gone. */
static void test_other_limits(void) {
    use_limits();
    tl_change_detector_begin(detector, &account, 1);
    learn();
    run(1000, -4.0, 0.0, 0.0);
    alarms[0].above = 5.0;
    TEST_ASSERT_TRUE(restart(1 + 1000 * 2 * (int64_t)DAY));
    TEST_ASSERT_TRUE(get().detection.is_ready);
    run(1000, -4.0, 0.0, 0.0);
    TEST_ASSERT_TRUE(tl_finding_is_open(get().finding));
    TEST_ASSERT_EQUAL_INT(TL_FINDING_LIMIT, get().finding->kind);
    const size_t before = count;
    config.alarm_count = 0;
    TEST_ASSERT_TRUE(restart(1 + 1000 * 3 * (int64_t)DAY));
    TEST_ASSERT_TRUE(get().detection.is_ready);
    TEST_ASSERT_EQUAL_size_t(before + 1, count);
    expect_told(before, TL_FINDING_ENDED, "tank.pump");
    TEST_ASSERT_TRUE(get().finding->is_gone);
}

/* A user has accepted it: it is not reported while it lasts. */
static void test_a_normal_limit(void) {
    use_limits();
    run(1000, -4.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_INT(TL_ACCEPTANCE_DONE, tl_change_detector_accept(detector, 1));
    run(1000, -9.0, 0.0, 0.0);
    run(1000, 0.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_STRING("normal", tl_finding_state_name(get().finding));
    TEST_ASSERT_EQUAL_size_t(1, count);
    run(3000, 0.0, 0.0, 0.0);
    run(1000, -4.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(2, get().count);
    expect_told(1, TL_FINDING_FOUND, "tank.pump");
}

/* A restart before a change has settled keeps it as one finding. */
static void test_a_restart_within_a_change(void) {
    tl_change_detector_begin(detector, &account, 1);
    learn();
    while (get().count == 0) {
        run(1, -2.0, 0.0, 0.0);
    }
    TEST_ASSERT_TRUE(restart(1 + 1000 * DAY));
    run(DAY / 2, -2.0, 0.0, 0.0);
    TEST_ASSERT_EQUAL_size_t(1, get().count);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -2.0, get().finding->size);
}

/* A restart while learning continues to learn. */
static void test_a_restart_while_learning(void) {
    tl_change_detector_begin(detector, &account, 1);
    run(DAY / 2, 0.0, 0.0, 0.0);
    double before = get().detection.learnt;
    TEST_ASSERT_TRUE(restart(1 + 1000 * DAY));
    TEST_ASSERT_DOUBLE_WITHIN(1.0, before, get().detection.learnt);
    run(DAY / 2 + 20 * RELEASE + DAY / 8, 0.0, 0.0, 0.0);
    TEST_ASSERT_TRUE(get().detection.is_ready);
    TEST_ASSERT_EQUAL_size_t(0, get().count);
}

static void test_what_cannot_be_restored(void) {
    learn();
    size_t size = tl_change_detector_size(detector);
    unsigned char *bytes = malloc(size);
    TEST_ASSERT_NOT_NULL(bytes);
    tl_change_detector_save(detector, bytes);
    TEST_ASSERT_FALSE(tl_change_detector_load(detector, bytes, size - 1));
    matched_as[1] = "plant.level";
    TEST_ASSERT_FALSE(tl_change_detector_load(detector, bytes, size));
    matched_as[1] = "plant.flow";
    TEST_ASSERT_TRUE(tl_change_detector_load(detector, bytes, size));
    for (size_t i = 0; i < 20000; i++) { /* any byte may be damaged: nothing fails, or is endless */
        size_t at =
            (size_t)(((random_state = random_state * 6364136223846793005U + 1442695040888963407U) >> 20) % size);
        unsigned char right = bytes[at];
        bytes[at] ^= (unsigned char)(1U << (i % 8));
        if (tl_change_detector_load(detector, bytes, size) && i % 100 == 0) {
            tl_change_detector_begin(detector, &account, 0);
            run(1000, 0.0, 0.0, 0.0);
        }
        bytes[at] = right;
    }
    free(bytes);
}

static void test_sentences(void) {
    char text[TL_FINDING_TEXT];
    tl_finding finding = {.subject = TL_FINDING_CORRECTION,
                          .variable = "tank.pump",
                          .unit = "%",
                          .size = -2.0,
                          .percent = -5.0,
                          .onset = 22680,
                          .onset_spread = 10};
    tl_finding_write(&finding, 0.0, 0, text);
    TL_EXPECT_PARTS("tank.pump|-2 %|(-5 %)|since t = 22680 s|10 s", text);
    finding = (tl_finding){.subject = TL_FINDING_OUTPUT,
                           .variable = "level",
                           .unit = "m",
                           .size = 0.3,
                           .percent = (double)NAN,
                           .onset = 10,
                           .is_gone = true,
                           .gone = 70,
                           .kind = TL_FINDING_DRIFT};
    tl_finding_write(&finding, 0.0, 0, text);
    TL_EXPECT_PARTS("plant.level|drifts|+0.3 m|from t = 10 s|to t = 70 s", text);
    TEST_ASSERT_NULL(strchr(text, '('));
    finding.cause = TL_FINDING_SENSOR;
    tl_finding_write_cause(&finding, text);
    TL_EXPECT_PARTS("sensor|plant", text);
    finding.cause = TL_FINDING_PLANT;
    tl_finding_write_cause(&finding, text);
    TL_EXPECT_PARTS("the plant", text);
    finding = (tl_finding){
        .kind = TL_FINDING_LIMIT, .variable = "tank.pump", .unit = "%", .size = -4.0, .percent = (double)NAN};
    tl_finding_write(&finding, 0.0, 0, text);
    TL_EXPECT_PARTS("tank.pump|-4 %|limits|since t = 0 s", text);
    finding = (tl_finding){.subject = TL_FINDING_SIGNAL, .kind = TL_FINDING_FREEZE, .variable = "level", .onset = 10};
    tl_finding_write(&finding, 20.0, 1764388800000, text);
    TL_EXPECT_PARTS("plant.level|frozen|since|UTC", text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_learning);
    RUN_TEST(test_one_cause_is_one_finding);
    RUN_TEST(test_a_finding_ends_and_comes_back);
    RUN_TEST(test_a_finding_comes_back_late);
    RUN_TEST(test_an_output_belongs_to_an_open_correction);
    RUN_TEST(test_an_outage);
    RUN_TEST(test_a_sensor_is_named_by_its_output);
    RUN_TEST(test_a_matched_sensor);
    RUN_TEST(test_a_cause_that_is_too_old);
    RUN_TEST(test_one_output_shows_no_cause);
    RUN_TEST(test_a_drift);
    RUN_TEST(test_a_small_change_is_no_finding);
    RUN_TEST(test_two_changes_are_two_findings);
    RUN_TEST(test_a_reset_is_left_out);
    RUN_TEST(test_what_is_not_known_is_left_out);
    RUN_TEST(test_the_words_of_the_user);
    RUN_TEST(test_a_frozen_signal);
    RUN_TEST(test_numbers);
    RUN_TEST(test_an_open_finding_stays);
    RUN_TEST(test_a_gap);
    RUN_TEST(test_many_findings);
    RUN_TEST(test_a_restart);
    RUN_TEST(test_a_normal_finding);
    RUN_TEST(test_a_forgotten_level);
    RUN_TEST(test_a_limit);
    RUN_TEST(test_a_limit_and_a_change);
    RUN_TEST(test_a_limit_without_values);
    RUN_TEST(test_other_limits);
    RUN_TEST(test_a_normal_limit);
    RUN_TEST(test_a_restart_within_a_change);
    RUN_TEST(test_a_restart_while_learning);
    RUN_TEST(test_what_cannot_be_restored);
    RUN_TEST(test_sentences);
    return UNITY_END();
}
