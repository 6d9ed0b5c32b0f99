/* The live host of the config manager, with simulated supervisor and twins.
 * Tests its orders and what it reports about the two twin slots. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/identity.h"
#include "firmware/live/live_host.h"
#include "master/base/simtime.h"
#include "tests/support/scratch.h"

#define FIRST "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"
#define OTHER "bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb"
#define TUNED "cccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccc"

static tl_live_config_manager_status live_status;
static tl_live_twin_status twins[TL_TWIN_SLOTS];
static tl_live_tuning tunings[TL_TWIN_SLOTS];
static tl_live_recorder_status recorder;
static tl_handover handover_block;
static tl_live_candidate candidate;
static tl_live_host host;
static tl_activation_host functions;
static tl_activation_shadow shadow;
static tl_activation_view view;
static char why[TL_ACTIVATION_WHY];
static char hash[TL_SHA256_TEXT];
static tl_tuning values;

static tl_scratch scratch;
static void begin_host(void) {
    host = (tl_live_host){.live_status = &live_status,
                          .twins = {&twins[0], &twins[1]},
                          .tunings = {&tunings[0], &tunings[1]},
                          .recorder = &recorder,
                          .handover_block = &handover_block,
                          .candidate = &candidate,
                          .text = "began",
                          .text_hash = "0b",
                          .step = TL_SECOND / 100};
    memcpy(host.hash[0], FIRST, sizeof host.hash[0]);
    functions = tl_live_host_functions(&host);
}

void setUp(void) {
    memset(&live_status, 0, sizeof live_status);
    memset(twins, 0, sizeof twins);
    memset(tunings, 0, sizeof tunings);
    memset(&recorder, 0, sizeof recorder);
    memset(&handover_block, 0, sizeof handover_block);
    memset(&candidate, 0, sizeof candidate);
    begin_host();
}

void tearDown(void) {}

/* ---- supervisor and twins ---- */

static void obey(tl_live_shadow state, const char *text) {
    (void)snprintf(handover_block.why, sizeof handover_block.why, "%s", text);
    handover_block.shadow = (uint32_t)state;
    handover_block.order = live_status.order.number;
}

static void announce(void) {
    handover_block.to = 1 - handover_block.slot_index;
    handover_block.handovers++;
    handover_block.order = live_status.order.number;
}

static tl_lock_tolerances tolerances_in(size_t slot_index) {
    tl_lock_tolerances found;
    TEST_ASSERT_TRUE(tl_latest_read(&tunings[slot_index].tolerances, &found, sizeof found));
    return found;
}

static bool begin(const char *text, const char *of) {
    const tl_lock_tolerances tolerances = {.match[1] = {0.5, 2.0}};
    const tl_activation_candidate given = {
        .text = text,
        .size = strlen(text),
        .hash = of,
        .tolerances = &tolerances,
        .needs = {.match = 3, .adjust = 2, .components = 4, .unpacked_bytes = 99, .signals = 7}};
    return functions.begin_shadow(functions.context, &given);
}

static tl_activation_phase phase(void) {
    functions.read_shadow(functions.context, &shadow);
    return shadow.phase;
}

static tl_activation_answer handed_over(void) {
    return functions.handover_result(functions.context, why);
}

static const char *active_hash(void) {
    functions.active_hash(functions.context, hash);
    return hash;
}

static bool tune(const char *of) {
    tl_version version = {.size = 2, .origin = TL_ORIGIN_RELOAD, .who = "ann"};
    (void)snprintf(version.hash, sizeof version.hash, "%s", of);
    return functions.tune(functions.context, &version, "", "{}", &values);
}

static void publish(uint32_t slot_index, tl_run_status *figures) {
    tl_latest_publish(&twins[slot_index].figures, figures, sizeof *figures);
}

/* ---- orders ---- */

static void test_a_candidate_is_handed_over(void) {
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_NO_SHADOW, phase());
    TEST_ASSERT_TRUE(begin("{ \"a\": 1 }", OTHER));
    TEST_ASSERT_EQUAL_DOUBLE(0.5, tolerances_in(1).match[1].tolerance);
    functions.use_tolerances(functions.context, &(tl_lock_tolerances){.match[0] = {3.0, 1.0}});
    TEST_ASSERT_EQUAL_DOUBLE(3.0, tolerances_in(0).match[0].tolerance);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tolerances_in(1).match[0].tolerance);
    TEST_ASSERT_EQUAL_UINT32(1, live_status.order.number);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW, live_status.order.verb);
    TEST_ASSERT_EQUAL_UINT32(3, live_status.order.needs.match);
    TEST_ASSERT_EQUAL_UINT64(99, live_status.order.needs.unpacked_bytes);
    TEST_ASSERT_EQUAL_UINT32(7, live_status.order.needs.signals);
    TEST_ASSERT_EQUAL_UINT32(10, candidate.size);
    TEST_ASSERT_EQUAL_STRING("{ \"a\": 1 }", candidate.text);
    TEST_ASSERT_EQUAL_STRING(OTHER, candidate.hash);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_SHADOW_BEGINS, phase());
    TEST_ASSERT_EQUAL_STRING(FIRST, active_hash());
}

static void test_one_order_at_a_time(void) {
    TEST_ASSERT_TRUE(begin("{}", OTHER));
    TEST_ASSERT_FALSE(begin("[]", TUNED));
    TEST_ASSERT_FALSE(functions.handover(functions.context));
    TEST_ASSERT_EQUAL_STRING("{}", candidate.text);
    TEST_ASSERT_EQUAL_UINT32(1, live_status.order.number);
}

static void test_an_end_waits_until_it_can_be_ordered(void) {
    TEST_ASSERT_TRUE(begin("{}", OTHER));
    functions.end_shadow(functions.context);
    tl_live_host_poll(&host);
    TEST_ASSERT_EQUAL_UINT32(1, live_status.order.number);
    obey(TL_LIVE_SHADOW_RUNS, "");
    tl_live_host_poll(&host);
    TEST_ASSERT_EQUAL_UINT32(2, live_status.order.number);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_NO_SHADOW, live_status.order.verb);
    obey(TL_LIVE_SHADOW_NONE, "");
    tl_live_host_poll(&host);
    TEST_ASSERT_EQUAL_UINT32(2, live_status.order.number);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_NO_SHADOW, phase());
}

static void test_a_shadow_is_looked_at(void) {
    static tl_run_status figures;
    TEST_ASSERT_TRUE(begin("{}", OTHER));
    obey(TL_LIVE_SHADOW_RUNS, "");
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_SHADOW_BEGINS, phase());
    figures = (tl_run_status){.phase = TL_RUN_RECORDED, .tick = 40, .last = 60, .steps = 7, .outputs = 1};
    figures.used = TL_SECOND / 2;
    figures.output[0].pairs = 5;
    figures.output[0].sum_of_squares = 2.5;
    figures.output[0].tolerance = 0.5;
    memset(figures.output[0].name, 'x', sizeof figures.output[0].name); /* not terminated */
    memcpy(figures.output[0].unit, "m\x1b", 3);                         /* a control character */
    publish(1, &figures);
    figures = (tl_run_status){.phase = TL_RUN_LIVE, .steps = 9};
    publish(0, &figures);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_SHADOW_RECORDED, phase());
    TEST_ASSERT_EQUAL_INT64(40, shadow.work.tick);
    TEST_ASSERT_EQUAL_INT64(60, shadow.work.last);
    TEST_ASSERT_EQUAL_UINT64(7, shadow.work.steps);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 2, shadow.work.used);
    TEST_ASSERT_EQUAL_UINT64(9, shadow.beside.steps);
    TEST_ASSERT_EQUAL_size_t(1, shadow.work.outputs);
    TEST_ASSERT_EQUAL_UINT64(5, shadow.work.output[0].pairs);
    TEST_ASSERT_EQUAL_DOUBLE(2.5, shadow.work.output[0].sum_of_squares);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, shadow.work.output[0].tolerance);
    TEST_ASSERT_EQUAL_size_t(TL_RUN_OUTPUT_NAME - 1, strlen(shadow.work.output[0].name));
    TEST_ASSERT_EQUAL_STRING("m\\x1B", shadow.work.output[0].unit);
    figures = (tl_run_status){.phase = 77, .outputs = UINT32_MAX};
    publish(1, &figures);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_SHADOW_BEGINS, phase());
    TEST_ASSERT_EQUAL_size_t(TL_MAX_MATCH, shadow.work.outputs);
    figures = (tl_run_status){.phase = TL_RUN_LIVE};
    publish(1, &figures);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_SHADOW_LIVE, phase());
    obey(TL_LIVE_SHADOW_ENDED, "signal 9");
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_SHADOW_FAILED, phase());
    TEST_ASSERT_EQUAL_STRING("signal 9", shadow.why);
}

/* ---- the FMUs' files ---- */

static const char TEXT[] =
    "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": 0.01, \"components\": {\"motor\": {\"fmu\": \"nobodys.fmu\"}},"
    " \"plant\": {\"omega\": {\"unit\": \"rad/s\"}}, \"recording\": {\"file\": \"r.csv\"},"
    " \"compare\": {\"motor.omega\": {\"to\": \"plant.omega\"}}}";

static void write_fmu(const char *bytes) {
    char path[PATH_MAX + 16];
    (void)snprintf(path, sizeof path, "%s/nobodys.fmu", scratch.folder);
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs(bytes, file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    const char *const paths[] = {path};
    tl_identity_files(paths, 1, hash);
}

static bool has_other_fmus(const char *text) {
    return functions.has_other_fmus(functions.context, text, strlen(text));
}

static void test_files_of_fmus(void) {
    char path[PATH_MAX + 16];
    (void)snprintf(path, sizeof path, "%s/motor.json", scratch.folder);
    host.path = path;
    write_fmu("one");
    TEST_ASSERT_FALSE(has_other_fmus(TEXT)); /* the loaded FMUs are unknown */
    memcpy(twins[0].digest, hash, sizeof hash);
    TEST_ASSERT_FALSE(has_other_fmus(TEXT));
    write_fmu("another");
    TEST_ASSERT_TRUE(has_other_fmus(TEXT));
    TEST_ASSERT_FALSE(has_other_fmus("{}")); /* not a configuration */
    memset(twins[0].digest, 'x', sizeof twins[0].digest);
    TEST_ASSERT_FALSE(has_other_fmus(TEXT)); /* an invalid digest */
    tl_scratch_empty(&scratch);
    memcpy(twins[0].digest, hash, sizeof hash);
    TEST_ASSERT_FALSE(has_other_fmus(TEXT)); /* no file: the check of the candidate reports it */
}

/* ---- a handover ---- */

static void begin_and_handover(void) {
    TEST_ASSERT_TRUE(begin("{}", OTHER));
    obey(TL_LIVE_SHADOW_RUNS, "");
    TEST_ASSERT_TRUE(functions.handover(functions.context));
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_HAND_OVER, live_status.order.verb);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_WAITS, handed_over());
}

static void test_a_handover(void) {
    begin_and_handover();
    announce();
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_WAITS, handed_over());
    TEST_ASSERT_EQUAL_STRING(FIRST, active_hash());
    handover_block.slot_index = 1;
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_STARTED, handed_over());
    TEST_ASSERT_EQUAL_STRING(OTHER, active_hash());
    TEST_ASSERT_TRUE(functions.handover(functions.context));
    announce();
    handover_block.slot_index = 0;
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_STARTED, handed_over());
    TEST_ASSERT_EQUAL_STRING(FIRST, active_hash());
}

static void test_a_handover_that_is_refused(void) {
    begin_and_handover();
    obey(TL_LIVE_SHADOW_ENDED, "no shadow");
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_REFUSED, handed_over());
    TEST_ASSERT_EQUAL_STRING("no shadow", why);
}

/* Its predecessor has ordered the handover, and died. */
static void test_a_successor_sees_what_came_of_a_handover(void) {
    begin_and_handover();
    begin_host();
    memcpy(host.hash[1], OTHER, sizeof host.hash[1]);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_WAITS, handed_over());
    announce();
    handover_block.slot_index = 1;
    begin_host();
    memcpy(host.hash[1], OTHER, sizeof host.hash[1]);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_STARTED, handed_over());
    TEST_ASSERT_EQUAL_STRING(OTHER, active_hash());
    TEST_ASSERT_TRUE(functions.handover(functions.context));
    obey(TL_LIVE_SHADOW_ENDED, "died");
    begin_host();
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_REFUSED, handed_over());
}

/* ---- tunings and run status ---- */

static void test_tunings_go_to_the_live_slot(void) {
    TEST_ASSERT_TRUE(tune(TUNED));
    TEST_ASSERT_EQUAL_UINT32(2, tl_live_tuning_number(&tunings[0]));
    TEST_ASSERT_EQUAL_STRING(TUNED, active_hash());
    recorder.state.tuning = 2;
    begin_and_handover();
    announce();
    handover_block.slot_index = 1;
    TEST_ASSERT_EQUAL_STRING(OTHER, active_hash());
    TEST_ASSERT_TRUE(tune(TUNED));
    TEST_ASSERT_EQUAL_UINT32(4, tl_live_tuning_number(&tunings[1])); /* above those of the recorder */
    TEST_ASSERT_FALSE(tune(OTHER));
    recorder.state.tuning = 4;
    TEST_ASSERT_TRUE(tune(OTHER));
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_WAITS, functions.tuning_result(functions.context, why));
    tl_live_tuning_answer_with(&twins[1].tuned, 6, 1, NULL);
    TEST_ASSERT_EQUAL_INT(TL_ACTIVATION_STARTED, functions.tuning_result(functions.context, why));
    TEST_ASSERT_EQUAL_UINT32(2, tl_live_tuning_number(&tunings[0]));
}

/* The tuning was for another twin. */
static void test_a_new_shadow_gets_no_old_tuning(void) {
    tl_live_tuning_head head;
    begin_and_handover();
    announce();
    handover_block.slot_index = 1;
    TEST_ASSERT_TRUE(tune(TUNED));
    recorder.state.tuning = 2;
    TEST_ASSERT_TRUE(functions.handover(functions.context));
    announce();
    handover_block.slot_index = 0;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_live_tuning_read(&tunings[1], &head, NULL));
    TEST_ASSERT_TRUE(begin("{}", OTHER));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_live_tuning_read(&tunings[1], &head, NULL));
    handover_block.slot_index = 1;
    TEST_ASSERT_EQUAL_STRING(OTHER, active_hash());
    TEST_ASSERT_TRUE(tune(TUNED));
    TEST_ASSERT_EQUAL_UINT32(4, tl_live_tuning_number(&tunings[1]));
}

static void test_failures_are_those_of_the_configuration(void) {
    twins[0].number = 9;
    twins[0].first = 7;
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_UINT64(2, view.figures.twin_failures);
    TEST_ASSERT_FALSE(view.figures.twin_alive);
    handover_block.slot_index = 1;
    twins[1].number = 3;
    twins[1].first = 3;
    tl_heartbeats_set_ready(&twins[1].beats);
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_UINT64(0, view.figures.twin_failures);
    TEST_ASSERT_TRUE(view.figures.twin_alive);
}

/* The reason may contain the name of an FMU, so control characters are escaped. */
static void test_why_the_twin_has_failed(void) {
    char failure[TL_HANDOVER_WHY] = "it hung, in fmi2DoStep of mo\x1btor";
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_STRING("", view.figures.failure);
    tl_latest_publish(&handover_block.failure, failure, sizeof failure);
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_STRING("it hung, in fmi2DoStep of mo\\x1Btor", view.figures.failure);
    memset(failure, 'x', sizeof failure); /* not terminated */
    tl_latest_publish(&handover_block.failure, failure, sizeof failure);
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_size_t(TL_RUN_FAILURE - 1, strlen(view.figures.failure));
}

/* Paired measurements, or all steps if the twin matches nothing. */
static void test_measurements(void) {
    static tl_run_status figures;
    figures = (tl_run_status){.steps = 50, .plant_is_shut = true, .outputs = 2, .output = {{.pairs = 7}, {.pairs = 4}}};
    publish(0, &figures);
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_UINT64(11, view.figures.pairs);
    TEST_ASSERT_TRUE(view.figures.plant_is_shut);
    figures.outputs = 0; /* it matches no output */
    figures.plant_is_shut = false;
    publish(0, &figures);
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_UINT64(50, view.figures.pairs);
    TEST_ASSERT_FALSE(view.figures.plant_is_shut);
    figures.outputs = UINT32_MAX; /* an impossible number */
    publish(0, &figures);
    functions.read_view(functions.context, &view);
    TEST_ASSERT_EQUAL_UINT64(11, view.figures.pairs);
}

/* The host has the texts in memory, in case that the files are damaged. */
static void test_texts_of_the_run(void) {
    static char text[TL_CONFIG_MAX_BYTES + 1];
    size_t size = 0;
    TEST_ASSERT_TRUE(functions.text(functions.context, "0b", text, &size));
    TEST_ASSERT_EQUAL_STRING("began", text);
    TEST_ASSERT_EQUAL_size_t(5, size);
    TEST_ASSERT_FALSE(functions.text(functions.context, OTHER, text, &size));
    TEST_ASSERT_TRUE(begin("other", OTHER));
    TEST_ASSERT_TRUE(functions.text(functions.context, OTHER, text, &size));
    TEST_ASSERT_EQUAL_STRING("other", text);
    candidate.size = sizeof text;
    TEST_ASSERT_FALSE(functions.text(functions.context, OTHER, text, &size));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "live_host");
    static tl_config config;
    tl_report report = {0};
    if (tl_config_read(TL_SOURCE_DIR "/tests/support/motor_lock.json", &config, &report) != TL_OK) {
        return 1;
    }
    tl_config_tuning(&config, &values);
    tl_config_free(&config);
    UNITY_BEGIN();
    RUN_TEST(test_a_candidate_is_handed_over);
    RUN_TEST(test_one_order_at_a_time);
    RUN_TEST(test_an_end_waits_until_it_can_be_ordered);
    RUN_TEST(test_a_shadow_is_looked_at);
    RUN_TEST(test_files_of_fmus);
    RUN_TEST(test_a_handover);
    RUN_TEST(test_a_handover_that_is_refused);
    RUN_TEST(test_a_successor_sees_what_came_of_a_handover);
    RUN_TEST(test_tunings_go_to_the_live_slot);
    RUN_TEST(test_a_new_shadow_gets_no_old_tuning);
    RUN_TEST(test_failures_are_those_of_the_configuration);
    RUN_TEST(test_why_the_twin_has_failed);
    RUN_TEST(test_measurements);
    RUN_TEST(test_texts_of_the_run);
    return tl_scratch_finish(&scratch, UNITY_END());
}
