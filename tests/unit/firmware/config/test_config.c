/* Valid configurations: each key, each default, lines and file paths. Then files that cannot be
 * read. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "board/csv/csv.h"
#include "board/gpio/gpio.h"
#include "board/modbus/modbus.h"
#include "firmware/config/drivers.h"
#include "master/solve/optimiser.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"

#define FULL TL_SOURCE_DIR "/tests/support/configuration_full.json"
#define FREE TL_SOURCE_DIR "/tests/support/configuration_free.json"
#define EPSILON TL_SOURCE_DIR "/tests/support/configuration_epsilon.json"

static tl_test_verdict verdict;
static char folder[64]; /* temporary */

void setUp(void) {
    (void)snprintf(folder, sizeof folder, "/tmp/twinlock-test-XXXXXX");
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
    memset(&verdict, 0, sizeof verdict);
}

void tearDown(void) {
    static const char *const left[] = {"/fmus/a.fmu", "/fmus", "/plant/a.fmu", "/plant", "/config.json", ""};
    char path[128];
    tl_config_free(&verdict.config);
    for (size_t i = 0; i < sizeof left / sizeof left[0]; i++) {
        (void)snprintf(path, sizeof path, "%s%s", folder, left[i]);
        (void)remove(path);
    }
}

static const tl_config *read_good(const char *path) {
    tl_test_judge_file(path, &verdict);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].text);
    TEST_ASSERT_EQUAL_size_t(0, verdict.count);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    return &verdict.config;
}

/* ---- every key ---- */

static void test_root(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_EQUAL_STRING(FULL, config->path);
    TEST_ASSERT_EQUAL_STRING(TL_SOURCE_DIR "/tests/support", config->directory);
    TEST_ASSERT_EQUAL_STRING("motor bench", config->name);
    TEST_ASSERT_EQUAL_INT64(10000000, config->step);
    TEST_ASSERT_EQUAL_INT64(14 * TL_SECOND, config->duration);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, config->start_s);
    TEST_ASSERT_EQUAL_DOUBLE(1e6, config->stop_s);
    TEST_ASSERT_EQUAL_size_t(1, config->fill_in_count);
    TEST_ASSERT_EQUAL_STRING("plant.omega.modbus", config->fill_in[0].where);
    TEST_ASSERT_EQUAL_STRING("the register of the speed", config->fill_in[0].name);
    TEST_ASSERT_EQUAL_STRING("bench.csv", config->recording_file);
    TEST_ASSERT_EQUAL_STRING("seconds", config->recording_time_column);
    TEST_ASSERT_EQUAL_STRING("bench.db", config->record_file);
    TEST_ASSERT_EQUAL_INT64(250500000, config->record_max_bytes);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 4, config->record_commit);
    TEST_ASSERT_EQUAL_INT64(30 * TL_SECOND, config->record_resume);
    TEST_ASSERT_FALSE(config->rests);
    TEST_ASSERT_EQUAL_INT64(3600 * TL_SECOND, config->detect_learn);
    TEST_ASSERT_EQUAL_INT64(40 * TL_SECOND, config->detect_cycle);
    TEST_ASSERT_EQUAL_size_t(2, config->alarm_count);
    TEST_ASSERT_EQUAL_size_t(1, config->alarms[0].adjust);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, config->alarms[0].above);
    TEST_ASSERT_EQUAL_DOUBLE(-0.5, config->alarms[0].below);
    TEST_ASSERT_EQUAL_INT64(90 * TL_SECOND, config->alarms[0].averaging_time);
    TEST_ASSERT_EQUAL_size_t(2, config->alarms[1].adjust);
    TEST_ASSERT_EQUAL_DOUBLE(HUGE_VAL, config->alarms[1].above);
    TEST_ASSERT_EQUAL_DOUBLE(-0.75, config->alarms[1].below);
    TEST_ASSERT_EQUAL_INT64(60 * TL_SECOND, config->alarms[1].averaging_time);
    TEST_ASSERT_EQUAL_DOUBLE(2.5, config->false_alarms_per_year);
    TEST_ASSERT_EQUAL_INT(0, config->realtime_priority);
    TEST_ASSERT_FALSE(config->realtime_lock_memory);
    TEST_ASSERT_EQUAL_INT64(3 * TL_SECOND / 2, config->realtime_hang);
}

static void test_text_and_fingerprint(void) {
    const tl_config *config = read_good(FULL);
    char *text = tl_test_read_text(FULL);
    char command[256];
    char sum[65] = "";
    TEST_ASSERT_EQUAL_size_t(strlen(text), config->size);
    TEST_ASSERT_EQUAL_STRING(text, config->text);
    free(text);
    (void)snprintf(command, sizeof command, "sha256sum '%s'", FULL);
    FILE *pipe = popen(command, "r");
    TEST_ASSERT_NOT_NULL(pipe);
    TEST_ASSERT_EQUAL_size_t(64, fread(sum, 1, 64, pipe));
    (void)pclose(pipe);
    TEST_ASSERT_EQUAL_STRING(sum, config->hash);
}

static void test_components(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_EQUAL_size_t(2, config->component_count);
    TEST_ASSERT_EQUAL_STRING("components.drive", config->components[0].where);
    TEST_ASSERT_EQUAL_STRING("drive", config->components[0].name);
    TEST_ASSERT_EQUAL_STRING("drive.fmu", config->components[0].fmu);
    TEST_ASSERT_EQUAL_size_t(0, config->components[0].set_count);
    TEST_ASSERT_EQUAL_INT(TL_KEEP_STATES, config->components[0].keep);
    TEST_ASSERT_EQUAL_INT(TL_KEEP_OUTPUTS, config->components[1].keep);
    TEST_ASSERT_EQUAL_STRING("models/motor.fmu", config->components[1].fmu);
    TEST_ASSERT_EQUAL_size_t(0, config->components[0].library_count);
    TEST_ASSERT_FALSE(config->components[0].logging);
    TEST_ASSERT_TRUE(config->components[1].logging);
    TEST_ASSERT_EQUAL_size_t(2, config->components[1].library_count);
    const tl_config_name *libraries = config->components[1].libraries;
    TEST_ASSERT_EQUAL_STRING("components.motor.libraries[0]", libraries[0].where);
    TEST_ASSERT_EQUAL_STRING("libpython3.11.so.1.0", libraries[0].name);
    TEST_ASSERT_EQUAL_STRING("components.motor.libraries[1]", libraries[1].where);
    TEST_ASSERT_EQUAL_STRING("lib/solver.so", libraries[1].name);
    TEST_ASSERT_EQUAL_UINT32(750, config->components[1].replay_steps);
    TEST_ASSERT_EQUAL_STRING_LEN("9f86d081", config->components[1].sha256, 8);
    TEST_ASSERT_NULL(config->components[0].sha256);
    TEST_ASSERT_TRUE(config->components[1].unconfined);
    TEST_ASSERT_EQUAL_size_t(1, config->components[1].read_count);
    TEST_ASSERT_EQUAL_size_t(4, config->components[1].set_count);
    const tl_plan_set *set = config->components[1].set;
    TEST_ASSERT_EQUAL_STRING("components.motor.set.J", set[0].where);
    TEST_ASSERT_EQUAL_STRING("J", set[0].variable);
    TEST_ASSERT_EQUAL_INT(TL_REAL, set[0].value.type);
    TEST_ASSERT_EQUAL_DOUBLE(0.0515, set[0].value.real);
    TEST_ASSERT_EQUAL_INT(TL_REAL, set[1].value.type);
    TEST_ASSERT_EQUAL_DOUBLE(4, set[1].value.real);
    TEST_ASSERT_EQUAL_INT(TL_BOOLEAN, set[2].value.type);
    TEST_ASSERT_EQUAL_INT(1, set[2].value.integer);
    TEST_ASSERT_EQUAL_INT(TL_STRING, set[3].value.type);
    TEST_ASSERT_EQUAL_STRING("", set[3].value.text);
}

static const tl_modbus_settings *modbus_by(const tl_config_source *source) {
    return source->settings;
}

static const tl_csv_settings *csv_by(const tl_config_source *source) {
    return source->settings;
}

static const tl_gpio_settings *gpio_by(const tl_config_source *source) {
    return source->settings;
}

static const tl_modbus_channel *modbus_of(const tl_config_signal *signal) {
    return signal->channel;
}

static const tl_gpio_channel *gpio_of(const tl_config_signal *signal) {
    return signal->channel;
}

static void test_sources(void) {
    const tl_config *config = read_good(FULL);
    const tl_config_source *source = config->sources;
    TEST_ASSERT_EQUAL_size_t(6, config->source_count);
    TEST_ASSERT_EQUAL_STRING("sources.plc", source[0].where);
    TEST_ASSERT_EQUAL_STRING("plc", source[0].name);
    TEST_ASSERT_EQUAL_STRING("modbus_tcp", source[0].driver->name);
    TEST_ASSERT_EQUAL_STRING("192.0.2.10", modbus_by(&source[0])->host);
    TEST_ASSERT_EQUAL_UINT16(1502, modbus_by(&source[0])->port);
    TEST_ASSERT_EQUAL_DOUBLE(0.02, source[0].period_s);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, modbus_by(&source[0])->timeout_s);
    TEST_ASSERT_TRUE(modbus_by(&source[0])->any_unit_id);
    TEST_ASSERT_TRUE(modbus_by(&source[0])->any_transaction_id);
    TEST_ASSERT_TRUE(modbus_by(&source[0])->rtu_framing);
    TEST_ASSERT_EQUAL_UINT8(40, modbus_by(&source[0])->most_registers);
    TEST_ASSERT_EQUAL_DOUBLE(0.002, modbus_by(&source[0])->pause_s);
    TEST_ASSERT_TRUE(modbus_by(&source[0])->split_failed);
    TEST_ASSERT_EQUAL_STRING("plc.example", modbus_by(&source[1])->host);
    TEST_ASSERT_FALSE(modbus_by(&source[1])->any_unit_id);
    TEST_ASSERT_FALSE(modbus_by(&source[1])->any_transaction_id);
    TEST_ASSERT_FALSE(modbus_by(&source[1])->rtu_framing);
    TEST_ASSERT_EQUAL_UINT8(125, modbus_by(&source[1])->most_registers);
    TEST_ASSERT_EQUAL_DOUBLE(0, modbus_by(&source[1])->pause_s);
    TEST_ASSERT_FALSE(modbus_by(&source[1])->split_failed);
    TEST_ASSERT_EQUAL_UINT16(502, modbus_by(&source[1])->port);
    TEST_ASSERT_EQUAL_DOUBLE(0.01, source[1].period_s);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, modbus_by(&source[1])->timeout_s);
    TEST_ASSERT_EQUAL_STRING("csv", source[2].driver->name);
    TEST_ASSERT_EQUAL_STRING("plant.fifo", csv_by(&source[2])->path);
    TEST_ASSERT_EQUAL_STRING("t", csv_by(&source[2])->time_column);
    TEST_ASSERT_EQUAL_DOUBLE(0.005, source[2].period_s);
}

static void test_a_serial_line(void) {
    const tl_config *config = read_good(FULL);
    const tl_config_source *bus = &config->sources[3];
    const tl_config_signal *level = &config->signals[5];
    TEST_ASSERT_EQUAL_STRING("modbus_rtu", bus->driver->name);
    TEST_ASSERT_EQUAL_STRING("ttyPLC", modbus_by(bus)->line.device);
    TEST_ASSERT_EQUAL_UINT32(38400, modbus_by(bus)->line.baud);
    TEST_ASSERT_EQUAL_INT('N', modbus_by(bus)->line.parity);
    TEST_ASSERT_EQUAL_UINT8(1, modbus_by(bus)->line.stop_bits);
    TEST_ASSERT_TRUE(modbus_by(bus)->line.rs485);
    TEST_ASSERT_TRUE(modbus_by(bus)->line.echo);
    TEST_ASSERT_EQUAL_UINT8(1, modbus_by(bus)->most_registers);
    TEST_ASSERT_EQUAL_DOUBLE(60, modbus_by(bus)->pause_s);
    TEST_ASSERT_TRUE(modbus_by(bus)->split_failed);
    TEST_ASSERT_EQUAL_DOUBLE(0.05, bus->period_s);
    TEST_ASSERT_EQUAL_DOUBLE(0.1, modbus_by(bus)->timeout_s);
    TEST_ASSERT_EQUAL_size_t(3, level->source);
    TEST_ASSERT_EQUAL_UINT8(247, modbus_of(level)->unit_id);
    TEST_ASSERT_EQUAL_INT(TL_MODBUS_DISCRETE, modbus_of(level)->table);
}

static void expect_line(const char *keys, uint32_t baud, char parity, uint8_t stop_bits) {
    char text[512];
    const tl_config *config = &verdict.config;
    (void)snprintf(
        text, sizeof text,
        "{ \"twinlock\": 1, \"name\": \"line\", \"step_s\": 0.01, \"components\": { \"a\": { \"fmu\": \"a\" } },"
        "  \"sources\": { \"bus\": { \"modbus_rtu\": { \"device\": \"/dev/ttyS1\"%s } } },"
        "  \"plant\": { \"y\": {} } }",
        keys);
    tl_config_free(&verdict.config);
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].text);
    TEST_ASSERT_EQUAL_UINT32(baud, modbus_by(config->sources)->line.baud);
    TEST_ASSERT_EQUAL_INT(parity, modbus_by(config->sources)->line.parity);
    TEST_ASSERT_EQUAL_UINT8(stop_bits, modbus_by(config->sources)->line.stop_bits);
    TEST_ASSERT_FALSE(modbus_by(config->sources)->line.rs485);
    TEST_ASSERT_FALSE(modbus_by(config->sources)->line.echo);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, modbus_by(config->sources)->timeout_s);
    TEST_ASSERT_EQUAL_DOUBLE(0.01, config->sources[0].period_s);
}

/* The defaults of the MODBUS over Serial Line specification: 19200 baud, even parity, 2 stop bits
 * without parity. */
static void test_defaults_of_a_serial_line(void) {
    expect_line("", 19200, 'E', 1);
    expect_line(", \"parity\": \"odd\"", 19200, 'O', 1);
    expect_line(", \"parity\": \"none\", \"baud\": 1000000", 1000000, 'N', 2);
    expect_line(", \"parity\": \"even\", \"stop_bits\": 2", 19200, 'E', 2);
}

static void test_gpio(void) {
    const tl_config *config = read_good(FULL);
    const tl_config_signal *start = &config->signals[6];
    const tl_config_signal *stop = &config->signals[7];
    TEST_ASSERT_EQUAL_STRING("gpio", config->sources[4].driver->name);
    TEST_ASSERT_EQUAL_STRING("bench", gpio_by(&config->sources[4])->chip);
    TEST_ASSERT_EQUAL_DOUBLE(0.002, config->sources[4].period_s);
    TEST_ASSERT_NULL(gpio_by(&config->sources[5])->chip);
    TEST_ASSERT_EQUAL_DOUBLE(0.01, config->sources[5].period_s);
    TEST_ASSERT_EQUAL_size_t(5, start->source);
    TEST_ASSERT_EQUAL_STRING("START", gpio_of(start)->line);
    TEST_ASSERT_TRUE(gpio_of(start)->active_low);
    TEST_ASSERT_EQUAL_INT(TL_GPIO_PULL_UP, gpio_of(start)->bias);
    TEST_ASSERT_EQUAL_DOUBLE(0.004, gpio_of(start)->debounce_s);
    TEST_ASSERT_EQUAL_size_t(4, stop->source);
    TEST_ASSERT_NULL(gpio_of(stop)->line);
    TEST_ASSERT_EQUAL_UINT(5, gpio_of(stop)->offset);
    TEST_ASSERT_FALSE(gpio_of(stop)->active_low);
    TEST_ASSERT_EQUAL_INT(TL_GPIO_NO_PULL, gpio_of(stop)->bias);
    TEST_ASSERT_EQUAL_DOUBLE(0, gpio_of(stop)->debounce_s);
}

static void test_a_modbus_signal(void) {
    const tl_config *config = read_good(FULL);
    const tl_config_signal *torque = &config->signals[0];
    TEST_ASSERT_EQUAL_size_t(8, config->signal_count);
    TEST_ASSERT_EQUAL_STRING("plant.torque", torque->plan.where);
    TEST_ASSERT_EQUAL_STRING("torque", torque->plan.name);
    TEST_ASSERT_EQUAL_INT(TL_REAL, torque->plan.type);
    TEST_ASSERT_EQUAL_STRING("N.m", torque->plan.unit);
    TEST_ASSERT_TRUE(torque->plan.has_initial);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, torque->plan.initial);
    TEST_ASSERT_EQUAL_DOUBLE(-5, torque->minimum);
    TEST_ASSERT_EQUAL_DOUBLE(5, torque->maximum);
    TEST_ASSERT_EQUAL_DOUBLE(0.1, torque->stale_s);
    TEST_ASSERT_EQUAL_STRING("M_w", torque->column);
    TEST_ASSERT_EQUAL_size_t(0, torque->source);
    TEST_ASSERT_EQUAL_UINT8(255, modbus_of(torque)->unit_id);
    TEST_ASSERT_EQUAL_INT(TL_MODBUS_HOLDING, modbus_of(torque)->table);
    TEST_ASSERT_EQUAL_UINT16(100, modbus_of(torque)->address);
    TEST_ASSERT_EQUAL_INT(TL_MODBUS_INT16, modbus_of(torque)->type);
    TEST_ASSERT_TRUE(modbus_of(torque)->words_little);
    TEST_ASSERT_TRUE(modbus_of(torque)->bytes_little);
    TEST_ASSERT_EQUAL_DOUBLE(0.001, modbus_of(torque)->scale);
    TEST_ASSERT_EQUAL_DOUBLE(-1.5, modbus_of(torque)->offset);
}

static void test_other_signals(void) {
    const tl_config *config = read_good(FULL);
    const tl_config_signal *running = &config->signals[1];
    const tl_config_signal *handover_block = &config->signals[2];
    TEST_ASSERT_EQUAL_INT(TL_BOOLEAN, running->plan.type);
    TEST_ASSERT_TRUE(running->plan.has_initial);
    TEST_ASSERT_EQUAL_DOUBLE(1, running->plan.initial);
    TEST_ASSERT_EQUAL_size_t(1, running->source);
    TEST_ASSERT_EQUAL_UINT8(1, modbus_of(running)->unit_id);
    TEST_ASSERT_EQUAL_INT(TL_MODBUS_COIL, modbus_of(running)->table);
    TEST_ASSERT_EQUAL_INT(TL_MODBUS_BIT, modbus_of(running)->type);
    TEST_ASSERT_EQUAL_UINT16(65535, modbus_of(running)->address);
    TEST_ASSERT_FALSE(modbus_of(running)->words_little);
    TEST_ASSERT_FALSE(modbus_of(running)->bytes_little);
    TEST_ASSERT_EQUAL_DOUBLE(1, modbus_of(running)->scale);
    TEST_ASSERT_EQUAL_DOUBLE(0, modbus_of(running)->offset);
    TEST_ASSERT_EQUAL_INT(TL_INTEGER, handover_block->plan.type);
    TEST_ASSERT_EQUAL_DOUBLE(3, handover_block->plan.initial);
    TEST_ASSERT_EQUAL_INT(TL_MODBUS_INPUT, modbus_of(handover_block)->table);
    TEST_ASSERT_EQUAL_INT(TL_MODBUS_FLOAT64, modbus_of(handover_block)->type);
    TEST_ASSERT_EQUAL_STRING("omega", config->signals[3].column);
    TEST_ASSERT_EQUAL_size_t(2, config->signals[3].source);
}

static void test_a_signal_without_keys(void) {
    const tl_config *config = read_good(FULL);
    const tl_config_signal *current = &config->signals[4];
    TEST_ASSERT_EQUAL_INT(TL_REAL, current->plan.type);
    TEST_ASSERT_EQUAL_STRING("", current->plan.unit);
    TEST_ASSERT_FALSE(current->plan.has_initial);
    TEST_ASSERT_TRUE(isinf(current->minimum) && current->minimum < 0);
    TEST_ASSERT_TRUE(isinf(current->maximum) && current->maximum > 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, current->stale_s);
    TEST_ASSERT_EQUAL_STRING("current", current->column);
    TEST_ASSERT_EQUAL_DOUBLE(1, current->scale);
    TEST_ASSERT_EQUAL_DOUBLE(0, current->offset);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, config->signals[5].scale);
    TEST_ASSERT_EQUAL_DOUBLE(2, config->signals[5].offset);
    TEST_ASSERT_EQUAL_size_t(SIZE_MAX, current->source);
}

static void test_connections(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_EQUAL_size_t(3, config->connection_count);
    TEST_ASSERT_EQUAL_STRING("connect[2]", config->connections[2].where);
    TEST_ASSERT_EQUAL_STRING("plant.torque", config->connections[0].from);
    TEST_ASSERT_EQUAL_STRING("motor.M_w", config->connections[0].to);
    TEST_ASSERT_EQUAL_STRING("drive.y", config->connections[2].to);
}

static void test_adjust(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_TRUE(config->synchronise);
    TEST_ASSERT_EQUAL_size_t(3, config->adjust_count);
    TEST_ASSERT_EQUAL_STRING("synchronise.adjust.motor.d", config->adjust[0].where);
    TEST_ASSERT_EQUAL_STRING("motor.d", config->adjust[0].variable);
    TEST_ASSERT_TRUE(config->adjust[0].has_nominal);
    TEST_ASSERT_EQUAL_DOUBLE(0.0031, config->adjust[0].nominal);
    TEST_ASSERT_EQUAL_DOUBLE(0.05, config->adjust[0].step);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->adjust[0].lower);
    TEST_ASSERT_EQUAL_DOUBLE(1, config->adjust[0].upper);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, config->adjust[0].approved);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, config->adjust[0].deviation_penalty);
    TEST_ASSERT_EQUAL_DOUBLE(0.125, config->adjust[0].rate_penalty);
    TEST_ASSERT_EQUAL_INT64(0, config->adjust[0].dwell);
    TEST_ASSERT_EQUAL_STRING("motor.x[1].bias", config->adjust[1].variable);
    TEST_ASSERT_FALSE(config->adjust[1].has_nominal);
    TEST_ASSERT_TRUE(isinf(config->adjust[1].lower) && config->adjust[1].lower < 0);
    TEST_ASSERT_TRUE(isinf(config->adjust[1].upper) && config->adjust[1].upper > 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->adjust[1].approved);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->adjust[1].deviation_penalty);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->adjust[1].rate_penalty);
}

static void test_a_boolean_that_is_adjusted(void) {
    const tl_plan_adjust *brake = &read_good(FULL)->adjust[2];
    TEST_ASSERT_EQUAL_STRING("motor.brake", brake->variable);
    TEST_ASSERT_EQUAL_DOUBLE(0, brake->step); /* not given */
    TEST_ASSERT_TRUE(brake->has_nominal);
    TEST_ASSERT_EQUAL_DOUBLE(1, brake->nominal);
    TEST_ASSERT_EQUAL_INT64(200000000, brake->dwell);
}

static void test_match(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_EQUAL_size_t(2, config->match_count);
    TEST_ASSERT_EQUAL_STRING("synchronise.match.motor.omega", config->match[0].where);
    TEST_ASSERT_EQUAL_STRING("motor.omega", config->match[0].variable);
    TEST_ASSERT_EQUAL_STRING("plant.omega", config->match[0].to);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, config->match[0].tolerance);
    TEST_ASSERT_EQUAL_DOUBLE(2, config->match[0].weight);
    TEST_ASSERT_EQUAL_DOUBLE(1, config->match[1].tolerance);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->match[1].weight);
    TEST_ASSERT_EQUAL_DOUBLE(3, config->match[0].huber);
    TEST_ASSERT_EQUAL_UINT32(5, config->conditions[0].median);
    TEST_ASSERT_EQUAL_INT64(30000000, config->conditions[0].low_pass);
    TEST_ASSERT_EQUAL_DOUBLE(45, config->conditions[0].gate);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->match[1].huber);
    TEST_ASSERT_EQUAL_UINT32(0, config->conditions[1].median);
    TEST_ASSERT_EQUAL_INT64(0, config->conditions[1].low_pass);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->conditions[1].gate);
}

static void test_the_rest_of_synchronise(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_EQUAL_UINT32(2, config->prediction);
    TEST_ASSERT_EQUAL_INT(TL_DYNAMIC, config->shape);
    TEST_ASSERT_EQUAL_INT(TL_AHEAD, config->measurements);
    TEST_ASSERT_EQUAL_STRING("nelder-mead", config->algorithm);
    TEST_ASSERT_EQUAL_STRING("bobyqa", config->fallback);
    TEST_ASSERT_EQUAL_UINT32(30, config->stagnation);
    TEST_ASSERT_EQUAL_DOUBLE(0.02, config->margin);
    TEST_ASSERT_EQUAL_DOUBLE(0.002, config->noise_floor);
    TEST_ASSERT_FALSE(config->saving.structure);
    TEST_ASSERT_FALSE(config->saving.sequences);
    TEST_ASSERT_EQUAL_UINT32(500, config->saving.nodes);
    TEST_ASSERT_EQUAL_UINT32(300, config->saving_memory);
    TEST_ASSERT_EQUAL_UINT32(40, config->budget_evaluations);
    TEST_ASSERT_EQUAL_INT64(4000000, config->budget_time);
}

/* epsilon is the square of all tolerances. The other values are the defaults of a configuration
 * that synchronises. */
static void test_epsilon(void) {
    const tl_config *config = read_good(EPSILON);
    TEST_ASSERT_TRUE(config->synchronise);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, config->match[0].tolerance);
    TEST_ASSERT_EQUAL_DOUBLE(1, config->match[0].weight);
    TEST_ASSERT_EQUAL_DOUBLE(2, config->match[0].huber);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, config->match[1].tolerance);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->match[1].weight);
    TEST_ASSERT_EQUAL_STRING("l-bfgs", config->algorithm);
    TEST_ASSERT_NULL(config->fallback);
    TEST_ASSERT_EQUAL_UINT32(0, config->stagnation);
    TEST_ASSERT_EQUAL_DOUBLE(0.001, config->noise_floor);
    TEST_ASSERT_EQUAL_DOUBLE(0.01, config->margin);
}

static void test_emulate(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_EQUAL_size_t(2, config->emulated_count);
    TEST_ASSERT_EQUAL_STRING("emulate.columns.omega", config->emulated[0].where);
    TEST_ASSERT_EQUAL_STRING("omega", config->emulated[0].column);
    TEST_ASSERT_EQUAL_STRING("motor.omega", config->emulated[0].from);
    TEST_ASSERT_EQUAL_DOUBLE(0.01, config->emulated[0].noise);
    TEST_ASSERT_EQUAL_STRING("plant.torque", config->emulated[1].from);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->emulated[1].noise);
    TEST_ASSERT_EQUAL_DOUBLE(0.005, config->message_min_s);
    TEST_ASSERT_EQUAL_DOUBLE(0.02, config->message_max_s);
}

/* Table 5.16 with a step of 10 ms. */
static void test_delays(void) {
    const tl_config_delays *delays = read_good(FULL)->delays;
    TEST_ASSERT_EQUAL_size_t(4, delays->participant_count);
    TEST_ASSERT_EQUAL_STRING("device", delays->names[1]);
    TEST_ASSERT_EQUAL_INT64(10000000, delays->participants[1].dead);
    TEST_ASSERT_EQUAL_INT64(100000, delays->participants[1].cycle);
    TEST_ASSERT_EQUAL_size_t(2, delays->participants[3].base);
    TEST_ASSERT_TRUE(delays->has_input && delays->has_output);
    TEST_ASSERT_EQUAL_size_t(4, delays->output.simulation.length);
    TEST_ASSERT_EQUAL_size_t(3, delays->output.simulation.parts[3]);
    TEST_ASSERT_EQUAL_INT64(11900000, delays->input.delay);
    TEST_ASSERT_EQUAL_INT64(8000000, delays->output.delay);
    TEST_ASSERT_EQUAL_INT64(3900000, delays->shift);
    TEST_ASSERT_EQUAL_INT64(8000000, delays->wait);
    TEST_ASSERT_EQUAL_INT32(2, verdict.config.input_lookup.ticks);
    TEST_ASSERT_EQUAL_INT64(8100000, verdict.config.input_lookup.look_back);
    TEST_ASSERT_EQUAL_INT32(2, verdict.config.output_lookup.ticks);
    TEST_ASSERT_EQUAL_INT64(16100000, verdict.config.output_lookup.look_back);
}

/* A signal that feeds an input and is matched needs two lookups. */
static void test_second_lookups(void) {
    char *text = tl_test_read_text(FULL);
    char *fed = tl_test_replaced(text, "[\"drive.u_R\", \"motor.I_in\"]",
                                 "[\"drive.u_R\", \"motor.I_in\"], [\"plant.omega\", \"drive.ref\"]");
    TEST_ASSERT_NOT_NULL(fed);
    tl_test_judge_text(fed, strlen(fed), &verdict);
    free(fed);
    free(text);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    tl_config *config = &verdict.config;
    TEST_ASSERT_EQUAL_size_t(8, config->signal_count);
    TEST_ASSERT_EQUAL_size_t(2, config->further_count);
    TEST_ASSERT_EQUAL_STRING("plant.omega@match", config->matched_as[0]);
    TEST_ASSERT_EQUAL_STRING("plant.omega@reading", config->reading_as[0]);
    TEST_ASSERT_EQUAL_STRING("plant.omega", config->match[0].to);
    TEST_ASSERT_EQUAL_STRING("plant.current", config->matched_as[1]);
    tl_config_use_lookups(config);
    tl_config_use_lookups(config);
    TEST_ASSERT_EQUAL_size_t(10, config->signal_count);
    const tl_config_signal *first = &config->signals[3];
    const tl_config_signal *second = &config->signals[8];
    TEST_ASSERT_EQUAL_STRING("omega@match", second->plan.name);
    TEST_ASSERT_EQUAL_size_t(3, second->of);
    TEST_ASSERT_EQUAL_size_t(3, first->of);
    TEST_ASSERT_EQUAL_STRING("omega", second->column);
    TEST_ASSERT_EQUAL_size_t(2, second->source);
    TEST_ASSERT_EQUAL_INT64(8100000, first->look_back);
    TEST_ASSERT_FALSE(first->next);
    TEST_ASSERT_EQUAL_UINT32(0, first->condition.median);
    TEST_ASSERT_EQUAL_UINT32(5, second->condition.median); /* only the match is conditioned */
    TEST_ASSERT_EQUAL_size_t(8, config->signals[9].shows);
    TEST_ASSERT_EQUAL_INT64(16100000, second->look_back);
    TEST_ASSERT_TRUE(second->next);
    TEST_ASSERT_EQUAL_INT64(16100000, config->signals[4].look_back); /* current: matched only */
    TEST_ASSERT_EQUAL_INT64(8100000, config->signals[0].look_back);  /* torque: feeds only */
    TEST_ASSERT_EQUAL_INT64(0, config->signals[1].look_back);        /* running: neither */
}

static void expect_guard(const char *text, uint32_t steps) {
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    TEST_ASSERT_EQUAL_UINT32(steps, tl_config_free_twin_guard(&verdict.config));
    tl_config_free(&verdict.config);
}

static void expect_release(const char *instead, uint32_t steps) {
    char *text = tl_test_read_text(FULL);
    char *changed = tl_test_replaced(text, "\"release_s\": 7200,", instead);
    tl_test_judge_text(changed, strlen(changed), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    TEST_ASSERT_EQUAL_UINT32(steps, verdict.config.released_steps);
    tl_config_free(&verdict.config);
    free(changed);
    free(text);
}

static void test_start_values(void) {
    char *text = tl_test_read_text(FULL);
    tl_test_judge_text(text, strlen(text), &verdict);
    const tl_config *config = &verdict.config;
    TEST_ASSERT_EQUAL_size_t(1, config->find_count);
    TEST_ASSERT_EQUAL_UINT32(1000, config->find_steps);
    TEST_ASSERT_EQUAL_STRING("motor.omega_start", config->find[0].variable);
    TEST_ASSERT_EQUAL_STRING("synchronise.start.find.motor.omega_start", config->find[0].where);
    TEST_ASSERT_EQUAL_DOUBLE(-10.0, config->find[0].lower);
    TEST_ASSERT_EQUAL_DOUBLE(10.0, config->find[0].upper);
    tl_config_free(&verdict.config);
    free(text);
}

/* The default is 600 steps, or 20 horizons if these are longer. */
static void test_released_twins(void) {
    expect_release("\"release_s\": 7200,", 720000);
    expect_release("\"release_s\": 0.02,", 2);
    expect_release("\"release_s\": 0,", 0);
    expect_release("", 600);
    char *text = tl_test_read_text(FULL);
    char *plain = tl_test_replaced(text, "\"release_s\": 7200,", "");
    char *longer = tl_test_replaced(plain, "\"prediction\": 2,", "\"prediction\": 31,");
    tl_test_judge_text(longer, strlen(longer), &verdict);
    TEST_ASSERT_EQUAL_UINT32(620, verdict.config.released_steps);
    tl_config_free(&verdict.config);
    free(longer);
    free(plain);
    free(text);
}

/* The guard covers two messages of a matched signal, four messages in the median and three times
 * the 30 ms of the low-pass. Without every_s a message counts as five steps. A message counts as
 * 1000 steps at most. The every_s of an input does not count. */
static void test_a_free_twin(void) {
    static const char omega[] = "\"omega\": { \"unit\": \"rad/s\",";
    TEST_ASSERT_EQUAL_UINT32(0, tl_config_free_twin_guard(read_good(FULL)));
    tl_config_free(&verdict.config);
    char *text = tl_test_read_text(FULL);
    char *lagging = tl_test_replaced(text, "\"ahead\"", "\"lag\"");
    char *kept = tl_test_replaced(lagging, "\"keep\": \"outputs\"", "\"keep\": \"states\"");
    char *led = tl_test_replaced(kept, "\"free_twin\": false", "\"free_twin\": true");
    char *known = tl_test_replaced(led, omega, "\"omega\": { \"unit\": \"rad/s\", \"every_s\": 0.04,");
    char *plain = tl_test_replaced(led, "\"median\": 5, ", "");
    char *rare = tl_test_replaced(plain, omega, "\"omega\": { \"unit\": \"rad/s\", \"every_s\": 1e9,");
    expect_guard(led, 39);
    expect_guard(known, 33);
    expect_guard(rare, 2 * 1000 + 9);
    free(rare);
    free(plain);
    free(known);
    free(led);
    free(kept);
    free(lagging);
    free(text);
}

/* Interpolation waits for the next reading, so it looks back as well. */
static void test_between_readings(void) {
    char *text = tl_test_read_text(FULL);
    char *lagging = tl_test_replaced(text, "\"ahead\"", "\"lag\"");
    char *without = tl_test_replaced(lagging, "\"measure\": { \"range_s\": 0.1 },", "");
    char *line = tl_test_replaced(without, "\"between\": \"last\", \"every_s\": 0.04",
                                  "\"between\": \"mean\", \"every_s\": 0.04");
    tl_test_judge_text(line, strlen(line), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    /* 40 ms, one step and 11.9 ms: the tick at 70 ms looks back by 58.1 ms. */
    TEST_ASSERT_EQUAL_INT32(7, verdict.config.input_lookup.ticks);
    TEST_ASSERT_EQUAL_INT64(58100000, verdict.config.input_lookup.look_back);
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_MEAN, verdict.config.signals[0].between);
    TEST_ASSERT_EQUAL_INT64(58100000, verdict.config.signals[0].look_back);
    tl_config_forget_delays(&verdict.config);
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, verdict.config.signals[0].between);
    TEST_ASSERT_EQUAL_INT32(0, verdict.config.input_lookup.ticks);
    free(line);
    free(without);
    free(lagging);
    free(text);
}

/* The delay of a condition is half the median's readings plus the low-pass time. The raw reading is
 * a second signal. */
static void test_the_delay_of_a_condition(void) {
    char *text = tl_test_read_text(FULL);
    char *lagging = tl_test_replaced(text, "\"ahead\"", "\"lag\"");
    char *without = tl_test_replaced(lagging, "\"measure\": { \"range_s\": 0.1 },", "");
    char *every = tl_test_replaced(without, "\"omega\": { \"unit\"", "\"omega\": { \"every_s\": 0.02, \"unit\"");
    tl_config *config = &verdict.config;
    tl_test_judge_text(every, strlen(every), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    TEST_ASSERT_EQUAL_INT64(70000000, tl_config_condition_lag(config, 0)); /* 2·20 + 30 ms */
    TEST_ASSERT_EQUAL_INT64(0, tl_config_condition_lag(config, 1));
    /* 20 ms more and 3.9 ms: the tick at 100 ms looks back by 96.1 ms. */
    TEST_ASSERT_EQUAL_INT32(10, config->output_lookup.ticks);
    TEST_ASSERT_EQUAL_INT64(96100000, config->output_lookup.look_back);
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LINE, config->signals[3].between);
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, config->signals[4].between);
    TEST_ASSERT_EQUAL_size_t(1, config->further_count);
    const tl_config_signal *reading = &config->signals[8];
    TEST_ASSERT_EQUAL_STRING("omega@reading", reading->plan.name);
    TEST_ASSERT_TRUE(reading->is_reading && !config->signals[3].is_reading);
    TEST_ASSERT_EQUAL_size_t(3, reading->shows);
    TEST_ASSERT_EQUAL_size_t(3, reading->of);
    TEST_ASSERT_EQUAL_INT64(0, reading->look_back);
    TEST_ASSERT_FALSE(tl_condition_is_needed(&reading->condition));
    free(every);
    free(without);
    free(lagging);
    free(text);
}

static void test_a_plant_has_no_delays(void) {
    tl_config *config = &verdict.config;
    (void)read_good(FULL);
    tl_config_forget_delays(config);
    tl_config_use_lookups(config);
    TEST_ASSERT_NULL(config->delays);
    TEST_ASSERT_EQUAL_size_t(8, config->signal_count);
    TEST_ASSERT_EQUAL_INT64(0, config->signals[0].look_back);
    TEST_ASSERT_EQUAL_INT64(0, config->signals[4].look_back);
    TEST_ASSERT_FALSE(config->signals[4].next);
    TEST_ASSERT_EQUAL_STRING("plant.omega", config->matched_as[0]);
}

/* ---- defaults ---- */

static void test_defaults(void) {
    const tl_config *config = read_good(FREE);
    TEST_ASSERT_EQUAL_INT64(0, config->duration);
    TEST_ASSERT_TRUE(isnan(config->start_s) && isnan(config->stop_s));
    TEST_ASSERT_EQUAL_size_t(0, config->source_count);
    TEST_ASSERT_NULL(config->delays);
    TEST_ASSERT_NULL(config->recording_file);
    TEST_ASSERT_EQUAL_STRING("time", config->recording_time_column);
    TEST_ASSERT_NULL(config->record_file);
    TEST_ASSERT_EQUAL_INT64(1000000000, config->record_max_bytes);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 2, config->record_commit);
    TEST_ASSERT_EQUAL_INT64(60 * TL_SECOND, config->record_resume);
    TEST_ASSERT_EQUAL_INT64(86400 * TL_SECOND, config->detect_learn);
    TEST_ASSERT_EQUAL_INT64(0, config->detect_cycle);
    TEST_ASSERT_EQUAL_size_t(0, config->alarm_count);
    TEST_ASSERT_EQUAL_DOUBLE(1, config->false_alarms_per_year);
    TEST_ASSERT_EQUAL_INT(50, config->realtime_priority);
    TEST_ASSERT_TRUE(config->realtime_lock_memory);
    TEST_ASSERT_EQUAL_INT64(2 * TL_SECOND, config->realtime_hang);
    TEST_ASSERT_EQUAL_size_t(0, config->emulated_count);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->message_min_s);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->message_max_s);
}

static void test_compare_only(void) {
    const tl_config *config = read_good(FREE);
    TEST_ASSERT_FALSE(config->synchronise);
    TEST_ASSERT_EQUAL_size_t(0, config->adjust_count);
    TEST_ASSERT_EQUAL_size_t(1, config->match_count);
    TEST_ASSERT_EQUAL_STRING("compare.motor.omega", config->match[0].where);
    TEST_ASSERT_EQUAL_STRING("motor.omega", config->match[0].variable);
    TEST_ASSERT_EQUAL_STRING("plant.omega", config->match[0].to);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->match[0].weight);
    TEST_ASSERT_EQUAL_DOUBLE(1, config->match[0].tolerance);
    TEST_ASSERT_EQUAL_DOUBLE(0, config->match[0].huber);
    TEST_ASSERT_EQUAL_UINT32(0, config->conditions[0].median);
    TEST_ASSERT_EQUAL_INT(TL_KEEP_STATES, config->components[0].keep);
    TEST_ASSERT_EQUAL_UINT32(0, config->prediction);
    TEST_ASSERT_EQUAL_INT(TL_STATIC, config->shape);
    TEST_ASSERT_EQUAL_INT(TL_LAG, config->measurements);
    TEST_ASSERT_NULL(config->algorithm);
    TEST_ASSERT_NULL(config->fallback);
    TEST_ASSERT_EQUAL_UINT32(0, config->stagnation);
    TEST_ASSERT_EQUAL_DOUBLE(0.01, config->margin);
    TEST_ASSERT_EQUAL_DOUBLE(0.001, config->noise_floor);
    TEST_ASSERT_TRUE(config->saving.structure);
    TEST_ASSERT_TRUE(config->saving.sequences);
    TEST_ASSERT_EQUAL_UINT32(0, config->saving.nodes);
    TEST_ASSERT_EQUAL_UINT32(128, config->saving_memory);
    TEST_ASSERT_EQUAL_UINT32(60, config->budget_evaluations);
    TEST_ASSERT_EQUAL_INT64(60000000, config->budget_time);
}

static void judge_edited(const char *path, const char *old, const char *new) {
    char *text = tl_test_read_text(path);
    TEST_ASSERT_NOT_NULL(text);
    char *edited = tl_test_replaced(text, old, new);
    TEST_ASSERT_NOT_NULL_MESSAGE(edited, old);
    tl_config_free(&verdict.config);
    tl_test_judge_text(edited, strlen(edited), &verdict);
    free(edited);
    free(text);
}

static void takes(const char *path, const char *old, const char *new) {
    judge_edited(path, old, new);
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", verdict.problems[0].text, new);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
}

static void test_delays_of_outputs_alone(void) {
    takes(FULL,
          "\"input\": { \"plant\": [\"bus\", \"device\"], \"simulation\": [\"bus\", \"acquisition\", \"twin\"] },", "");
    const tl_config_delays *delays = verdict.config.delays;
    TEST_ASSERT_FALSE(delays->has_input);
    TEST_ASSERT_EQUAL_INT64(-8000000, delays->shift);
    TEST_ASSERT_EQUAL_INT32(0, verdict.config.input_lookup.ticks);
    TEST_ASSERT_EQUAL_INT64(0, verdict.config.input_lookup.look_back);
    TEST_ASSERT_EQUAL_INT32(0, verdict.config.output_lookup.ticks);
    TEST_ASSERT_EQUAL_INT64(8000000, verdict.config.output_lookup.look_back);
}

static void test_nothing_to_compare(void) {
    takes(FREE, ",\n  \"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }", "");
    TEST_ASSERT_FALSE(verdict.config.synchronise);
    TEST_ASSERT_EQUAL_size_t(0, verdict.config.match_count);
    takes(FREE, "[[\"plant.torque\", \"motor.M_w\"]]", "[]");
    TEST_ASSERT_EQUAL_size_t(0, verdict.config.connection_count);
}

static void test_weights_and_tolerances(void) {
    takes(FULL, "\"tolerance\": 0.5, \"weight\": 2", "\"tolerance\": 0.5");
    TEST_ASSERT_EQUAL_DOUBLE(1, verdict.config.match[0].weight);
    takes(FULL, "\"plant.current\", \"weight\": 0", "\"plant.current\", \"weight\": 0, \"tolerance\": 3");
    TEST_ASSERT_EQUAL_DOUBLE(3, verdict.config.match[1].tolerance);
}

/* Each name, and the numbers of the dissertation (table 5.1). */
static void test_solvers(void) {
    static const struct {
        const char *text, *name;
    } cases[] = {
        {"\"secant\"", "secant"}, {"\"nelder-mead\"", "nelder-mead"},
        {"\"bobyqa\"", "bobyqa"}, {"\"l-bfgs\"", "l-bfgs"},
        {"\"sbplx\"", "sbplx"},   {"\"boolean\"", "boolean"},
        {"1", "nelder-mead"},     {"100", "l-bfgs"},
        {"1000", "bobyqa"},       {"1e2", "l-bfgs"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char new[64];
        (void)snprintf(new, sizeof new, "\"algorithm\": %s", cases[i].text);
        takes(EPSILON, "\"algorithm\": 100", new);
        TEST_ASSERT_EQUAL_STRING(cases[i].name, verdict.config.algorithm);
        TEST_ASSERT_EQUAL_STRING(cases[i].name, tl_optimiser_find(cases[i].name)->name);
        (void)snprintf(new, sizeof new, "\"fallback\": %s", cases[i].text);
        takes(EPSILON, "\"algorithm\": 100", new);
        TEST_ASSERT_NULL(verdict.config.algorithm);
        TEST_ASSERT_EQUAL_STRING(cases[i].name, verdict.config.fallback);
    }
}

static void test_modes_and_shapes(void) {
    takes(FULL, "\"measurements\": \"ahead\"", "\"measurements\": \"hold\"");
    TEST_ASSERT_EQUAL_INT(TL_HOLD, verdict.config.measurements);
    takes(FULL, "\"measurements\": \"ahead\"", "\"measurements\": \"lag\"");
    TEST_ASSERT_EQUAL_INT(TL_LAG, verdict.config.measurements);
    takes(FULL, "\"shape\": \"dynamic\"", "\"shape\": \"static\"");
    TEST_ASSERT_EQUAL_INT(TL_STATIC, verdict.config.shape);
    takes(FULL, "\"sequences\": false", "\"sequences\": true");
    TEST_ASSERT_EQUAL_INT(TL_KEEP_AUTO, verdict.config.components[0].keep);
    takes(FULL, "\"keep\": \"outputs\"", "\"keep\": \"states\"");
    TEST_ASSERT_EQUAL_INT(TL_KEEP_STATES, verdict.config.components[1].keep);
    takes(FULL, "\"nominal\": true", "\"nominal\": false");
    TEST_ASSERT_TRUE(verdict.config.adjust[2].has_nominal);
    TEST_ASSERT_EQUAL_DOUBLE(0, verdict.config.adjust[2].nominal);
}

/* Returns the limit for outliers of the matched speed. */
static double leap_with(const char *old, const char *new) {
    takes(FULL, old, new);
    return verdict.config.signals[3].condition.leap;
}

/* Outliers are rejected unless a gate or a median does it, or the file keeps them. */
static void test_outliers_are_rejected_by_default(void) {
    static const char *const all = "\"median\": 5, \"low_pass_s\": 0.03, \"gate\": 45";
    TEST_ASSERT_EQUAL_DOUBLE(3, leap_with(all, "")); /* six times the tolerance */
    TEST_ASSERT_EQUAL_STRING("plant.omega@reading", verdict.config.reading_as[0]);
    TEST_ASSERT_EQUAL_DOUBLE(3, leap_with(all, "\"low_pass_s\": 0.03, \"outliers\": \"reject\""));
    TEST_ASSERT_EQUAL_DOUBLE(0, leap_with(all, "\"low_pass_s\": 0.03, \"outliers\": \"keep\""));
    TEST_ASSERT_EQUAL_DOUBLE(0, leap_with(all, "\"median\": 3"));
    TEST_ASSERT_EQUAL_DOUBLE(0, leap_with(all, "\"gate\": 45"));
    TEST_ASSERT_EQUAL_DOUBLE(0, verdict.config.signals[4].condition.leap); /* current: weight 0 */
}

/* Empty objects, and objects with some of their keys. */
static void test_objects_in_part(void) {
    takes(FULL, "\"deviation\": 0.25, \"rate\": 0.125", "\"rate\": 0.125");
    TEST_ASSERT_EQUAL_DOUBLE(0, verdict.config.adjust[0].deviation_penalty);
    TEST_ASSERT_EQUAL_DOUBLE(0.125, verdict.config.adjust[0].rate_penalty);
    takes(FULL, "\"median\": 5, \"low_pass_s\": 0.03, \"gate\": 45", "");
    TEST_ASSERT_EQUAL_UINT32(0, verdict.config.conditions[0].median);
    TEST_ASSERT_EQUAL_INT64(0, verdict.config.conditions[0].low_pass);
    TEST_ASSERT_EQUAL_DOUBLE(0, verdict.config.conditions[0].gate);
    takes(FULL, "\"structure\": false, \"sequences\": false, \"nodes\": 500", "\"sequences\": false");
    TEST_ASSERT_TRUE(verdict.config.saving.structure);
    TEST_ASSERT_FALSE(verdict.config.saving.sequences);
    TEST_ASSERT_EQUAL_UINT32(0, verdict.config.saving.nodes);
    takes(FULL, "{ \"nominal\": true, \"dwell_s\": 0.2 }", "{}");
    TEST_ASSERT_FALSE(verdict.config.adjust[2].has_nominal);
    TEST_ASSERT_EQUAL_INT64(0, verdict.config.adjust[2].dwell);
}

/* Decimal fractions that a double cannot represent exactly, and the limits. */
static void test_steps_in_nanoseconds(void) {
    static const struct {
        const char *text;
        tl_time step;
    } cases[] = {
        {"1e-5", 10000},
        {"0.000123457", 123457},
        {"0.3", 300000000},
        {"0.30000000000000004", 300000000},
        {"1.1", 1100000000},
        {"3599.1", INT64_C(3599100000000)},
        {"3599.999999999", INT64_C(3599999999999)},
        {"3600", INT64_C(3600000000000)},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char new[64];
        (void)snprintf(new, sizeof new, "\"step_s\": %s", cases[i].text);
        takes(FREE, "\"step_s\": 0.1", new);
        TEST_ASSERT_EQUAL_INT64(cases[i].step, verdict.config.step);
    }
}

static void test_durations_at_their_limits(void) {
    takes(FULL, "\"duration_s\": 14", "\"duration_s\": 1e9");
    TEST_ASSERT_EQUAL_INT64(INT64_C(1000000000) * TL_SECOND, verdict.config.duration);
    takes(FULL, "\"duration_s\": 14", "\"duration_s\": 1e-300");
    TEST_ASSERT_EQUAL_INT64(1, verdict.config.duration);
    takes(FULL, "\"stale_s\": 0.1", "\"stale_s\": 1e-300");
    TEST_ASSERT_EQUAL_DOUBLE(1e-9, verdict.config.signals[0].stale_s);
    takes(FULL, "[0.005, 0.02]", "[1e-300, 1e-300]");
    TEST_ASSERT_EQUAL_DOUBLE(1e-9, verdict.config.message_min_s);
    TEST_ASSERT_EQUAL_DOUBLE(1e-9, verdict.config.message_max_s);
    takes(FULL, "\"dwell_s\": 0.2", "\"dwell_s\": 1e-300");
    TEST_ASSERT_EQUAL_INT64(1, verdict.config.adjust[2].dwell);
    takes(FULL, "\"low_pass_s\": 0.03", "\"low_pass_s\": 10");
    TEST_ASSERT_EQUAL_INT64(10 * TL_SECOND, verdict.config.conditions[0].low_pass);
    takes(FULL, "\"time_s\": 0.004", "\"time_s\": 1e-300");
    TEST_ASSERT_EQUAL_INT64(1, verdict.config.budget_time);
}

static void test_the_default_budget_is_six_tenths_of_a_step(void) {
    takes(FULL, "\"evaluations\": 40, \"time_s\": 0.004", "");
    TEST_ASSERT_EQUAL_UINT32(60, verdict.config.budget_evaluations);
    TEST_ASSERT_EQUAL_INT64(6000000, verdict.config.budget_time);
    takes(FREE, "\"step_s\": 0.1", "\"step_s\": 0.000010001");
    TEST_ASSERT_EQUAL_INT64(6000, verdict.config.budget_time);
}

static void test_other_ways_to_write_the_same(void) {
    takes(FULL, "\"port\": 1502", "\"port\": 1.502e3");
    TEST_ASSERT_EQUAL_UINT16(1502, modbus_by(verdict.config.sources)->port);
    takes(FULL, "\"name\": \"motor bench\"", "\"n\\u0061me\": \"m\\u00f6tor \\ud83d\\ude00\"");
    TEST_ASSERT_EQUAL_STRING("mötor \U0001F600", verdict.config.name);
    takes(FULL, "\"unit\": \"N.m\"", "\"unit\": \"\"");
    TEST_ASSERT_EQUAL_STRING("", verdict.config.signals[0].plan.unit);
    takes(FULL, "\"label\": \"\"", "\"label\": \"two\\nlines\"");
    TEST_ASSERT_EQUAL_STRING("two\nlines", verdict.config.components[1].set[3].value.text);
}

static void test_values_at_their_limits(void) {
    takes(FULL, "\"min\": -5, \"max\": 5", "\"min\": 5, \"max\": 5");
    takes(FULL, "\"unit_id\": 255", "\"unit_id\": 247");
    takes(FULL, "\"unit_id\": 255", "\"unit_id\": 0");
    takes(FULL, "\"address\": 100", "\"address\": 65535");
    takes(FULL, "\"prediction\": 2", "\"prediction\": 1000");
    takes(FULL, "\"margin\": 0.02", "\"margin\": 0");
    takes(FULL, "\"evaluations\": 40", "\"evaluations\": 2");
    takes(FULL, "\"median\": 5", "\"median\": 1");
    takes(FULL, "\"median\": 5", "\"median\": 99");
    takes(FULL, "\"deviation\": 0.25", "\"deviation\": 0");
    takes(FULL, "\"rate\": 0.125", "\"rate\": 0");
    takes(FULL, "\"stagnation\": 30", "\"stagnation\": 1");
    takes(FULL, "\"stagnation\": 30", "\"stagnation\": 100000");
    takes(FULL, "\"noise_floor\": 0.002", "\"noise_floor\": 0");
    takes(FULL, "\"nodes\": 500", "\"nodes\": 2");
    takes(FULL, "\"nodes\": 500", "\"nodes\": 1000000");
    takes(EPSILON, "\"epsilon\": 0.25", "\"epsilon\": 1e-300");
    TEST_ASSERT_EQUAL_DOUBLE(1e-150, verdict.config.match[0].tolerance);
    takes(FULL, "\"priority\": 0", "\"priority\": 98");
    takes(FULL, "\"initial\": 3", "\"initial\": -2147483647");
}

static void test_a_boolean_without_initial(void) {
    takes(FULL, "\"type\": \"boolean\", \"initial\": true", "\"type\": \"boolean\"");
    TEST_ASSERT_FALSE(verdict.config.signals[1].plan.has_initial);
    takes(FULL, "\"initial\": true", "\"initial\": false");
    TEST_ASSERT_TRUE(verdict.config.signals[1].plan.has_initial);
    TEST_ASSERT_EQUAL_DOUBLE(0, verdict.config.signals[1].plan.initial);
}

/* ---- lines ---- */

static void test_lines(void) {
    const tl_config *config = read_good(FULL);
    TEST_ASSERT_EQUAL_size_t(0, tl_config_line(config, ""));
    TEST_ASSERT_EQUAL_size_t(0, tl_config_line(config, "nothing"));
    TEST_ASSERT_EQUAL_size_t(4, tl_config_line(config, "step_s"));
    TEST_ASSERT_EQUAL_size_t(tl_test_line_of(config->text, "\"J\""), tl_config_line(config, "components.motor.set.J"));
    TEST_ASSERT_EQUAL_size_t(tl_test_line_of(config->text, "\"drive.y\""), tl_config_line(config, "connect[2][1]"));
    TEST_ASSERT_EQUAL_size_t(tl_test_line_of(config->text, "\"motor.x[1].bias\""),
                             tl_config_line(config, "synchronise.adjust.motor.x[1].bias.nominal"));
    tl_config empty = {.tree = NULL};
    TEST_ASSERT_EQUAL_size_t(0, tl_config_line(&empty, "step_s"));
}

/* ---- files that cannot be read ---- */

static void expect_file_problem(const char *path, tl_status status, const char *parts) {
    tl_test_judge_file(path, &verdict);
    TEST_ASSERT_EQUAL_INT(status, verdict.status);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_INT(status, verdict.problems[0].status);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].where);
    TL_EXPECT_PARTS(parts, verdict.problems[0].text);
    TEST_ASSERT_NULL(verdict.config.tree);
    TEST_ASSERT_NULL(verdict.config.text);
}

/* A file `name` in the temporary folder. */
static const char *make_file(const char *name, const char *text, size_t size) {
    static char path[128];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_size_t(size, fwrite(text, 1, size, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    return path;
}

static void test_a_missing_file(void) {
    expect_file_problem("/nowhere/plant.json", TL_BAD_DATA, "configuration|No such file");
}

static void test_a_directory(void) {
    expect_file_problem("/tmp", TL_BAD_DATA, "configuration|Is a directory");
}

/* The error is temporary, so the status is TL_TRY_AGAIN and not TL_BAD_DATA. */
static void test_no_free_file_descriptor(void) {
    struct rlimit limit;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &limit));
    struct rlimit none = {.rlim_cur = 0, .rlim_max = limit.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &none));
    tl_test_judge_file(FREE, &verdict);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &limit));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, verdict.status);
    TL_EXPECT_PARTS("configuration|Too many open", verdict.problems[0].text);
}

static void test_an_empty_file(void) {
    expect_file_problem(make_file("config.json", "", 0), TL_BAD_DATA,
                        "line 1|column 1|end|object|array|number|true|false|null");
}

static void test_a_nul_byte(void) {
    expect_file_problem(make_file("config.json", "{}\0", 3), TL_BAD_DATA, "line 1|column 3|U+0000");
}

static void test_a_file_that_never_ends(void) {
    expect_file_problem("/dev/zero", TL_BAD_DATA, "more than 256 KiB");
}

static void test_the_largest_file(void) {
    size_t size = TL_CONFIG_MAX_BYTES + 1;
    char *text = malloc(size);
    char *good = tl_test_read_text(FREE);
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_NOT_NULL(good);
    memset(text, ' ', size);
    memcpy(text + size - strlen(good), good, strlen(good));
    const char *path = make_file("config.json", text + 1, size - 1);
    TEST_ASSERT_EQUAL_size_t(TL_CONFIG_MAX_BYTES, read_good(path)->size);
    tl_config_free(&verdict.config);
    expect_file_problem(make_file("config.json", text, size), TL_BAD_DATA, "more than 256 KiB");
    free(good);
    free(text);
}

static void test_freeing_an_empty_configuration(void) {
    tl_config config = {.tree = NULL};
    tl_config_free(&config);
    TEST_ASSERT_NULL(config.tree);
}

/* ---- paths of files that a configuration names ---- */

static void expect_path(const char *config_path, const char *file, const char *expected) {
    char path[128];
    tl_config config;
    tl_report report = {.add = NULL};
    char *text = tl_test_read_text(FREE);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read_text(config_path, text, strlen(text), &config, &report));
    free(text);
    TEST_ASSERT_TRUE(tl_config_file_path(&config, file, path, sizeof path));
    TEST_ASSERT_EQUAL_STRING(expected, path);
    TEST_ASSERT_FALSE(tl_config_file_path(&config, file, path, strlen(expected)));
    TEST_ASSERT_EQUAL_STRING("", path);
    tl_config_free(&config);
}

static void test_file_paths(void) {
    expect_path("bench/motor.json", "a.csv", "bench/a.csv");
    expect_path("bench/motor.json", "../a.csv", "bench/../a.csv");
    expect_path("bench/motor.json", "/data/a.csv", "/data/a.csv");
    expect_path("motor.json", "a.csv", "a.csv");
    expect_path("/motor.json", "a.csv", "/a.csv");
}

static void expect_fmu(const char *fmu, bool found, const char *expected) {
    char path[256];
    TEST_ASSERT_EQUAL(found, tl_config_fmu_path(&verdict.config, fmu, path, sizeof path));
    TEST_ASSERT_EQUAL_STRING(expected, path);
}

static void make_folder(const char *name, char path[128]) {
    (void)snprintf(path, 128, "%s/%s", folder, name);
    TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0700));
}

static void test_where_an_fmu_is(void) {
    char plant[128];
    char fmus[128];
    char list[400];
    char first[256];
    char second[256];
    make_folder("plant", plant);
    make_folder("fmus", fmus);
    (void)snprintf(first, sizeof first, "%s/plant/a.fmu", folder);
    (void)snprintf(second, sizeof second, "%s/a.fmu", fmus);
    (void)snprintf(list, sizeof list, "/nowhere::%s:/elsewhere", fmus);
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TWINLOCK_FMU_PATH"));

    char *text = tl_test_read_text(FREE);
    tl_report report = {.add = NULL};
    char config_path[160];
    (void)snprintf(config_path, sizeof config_path, "%s/motor.json", plant);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read_text(config_path, text, strlen(text), &verdict.config, &report));
    free(text);

    expect_fmu("a.fmu", false, first);
    (void)make_file("fmus/a.fmu", "x", 1);
    expect_fmu("a.fmu", false, first);
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", list, 1));
    expect_fmu("a.fmu", true, second);
    expect_fmu(second, true, second);
    expect_fmu("/nowhere/a.fmu", false, "/nowhere/a.fmu");
    (void)make_file("plant/a.fmu", "x", 1);
    expect_fmu("a.fmu", true, first);
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TWINLOCK_FMU_PATH"));
}

/* This program is in BUILD/tests, so the folder ../x beside the program is BUILD/x. */
static void expect_an_fmu_found_in(const char *below_build) {
    char expected[256];
    char path[256];
    char name[64];
    (void)snprintf(name, sizeof name, "test_config_%ld.fmu", (long)getpid());
    (void)snprintf(expected, sizeof expected, TL_BINARY_DIR "/tests/../%s/%s", below_build, name);
    FILE *file = fopen(expected, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    bool found = tl_config_fmu_path(&verdict.config, name, path, sizeof path);
    TEST_ASSERT_EQUAL_INT(0, remove(expected));
    TEST_ASSERT_TRUE(found);
    TEST_ASSERT_EQUAL_STRING(expected, path);
}

static void test_an_fmu_beside_the_program(void) {
    (void)mkdir(TL_BINARY_DIR "/fmus", 0755);
    (void)mkdir(TL_BINARY_DIR "/lib", 0755);
    (void)mkdir(TL_BINARY_DIR "/lib/twinlock", 0755);
    (void)mkdir(TL_BINARY_DIR "/lib/twinlock/fmus", 0755);
    (void)read_good(FREE);
    expect_an_fmu_found_in("fmus");
    expect_an_fmu_found_in("lib/twinlock/fmus");
}

/* The tuning values of a configuration, read and then replaced. */
static void test_tuning(void) {
    tl_tuning tuning;
    tl_tuning again;
    tl_error error;
    const tl_config *config = read_good(FULL);
    tl_config_tuning(config, &tuning);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_tuning_check(&tuning, &error), error.text);
    TEST_ASSERT_EQUAL_UINT32(config->match_count, tuning.matches);
    TEST_ASSERT_EQUAL_UINT32(config->adjust_count, tuning.adjusts);
    TEST_ASSERT_EQUAL_DOUBLE(config->match[0].tolerance, tuning.match[0].tolerance);
    TEST_ASSERT_EQUAL_DOUBLE(config->match[0].weight, tuning.match[0].weight);
    TEST_ASSERT_EQUAL_DOUBLE(config->match[0].huber, tuning.match[0].huber);
    TEST_ASSERT_EQUAL_INT(config->adjust[0].has_nominal, tuning.adjust[0].has_nominal);
    TEST_ASSERT_EQUAL_DOUBLE(config->adjust[0].lower, tuning.adjust[0].lower);
    TEST_ASSERT_EQUAL_DOUBLE(config->adjust[0].upper, tuning.adjust[0].upper);
    TEST_ASSERT_EQUAL_DOUBLE(config->adjust[0].approved, tuning.adjust[0].approved);
    TEST_ASSERT_EQUAL_DOUBLE(config->adjust[0].deviation_penalty, tuning.adjust[0].deviation_penalty);
    TEST_ASSERT_EQUAL_DOUBLE(config->adjust[0].rate_penalty, tuning.adjust[0].rate_penalty);
    TEST_ASSERT_EQUAL_DOUBLE(config->margin, tuning.margin);
    TEST_ASSERT_EQUAL_DOUBLE(config->noise_floor, tuning.noise_floor);
    TEST_ASSERT_EQUAL_UINT64(config->budget_evaluations, tuning.evaluations);
    TEST_ASSERT_EQUAL_INT64(config->budget_time, tuning.time);
    for (uint32_t i = 0; i < tuning.matches; i++) {
        tuning.match[i] = (tl_tuning_match){.tolerance = 0.5 + i, .weight = 1.0 + i, .huber = 2.0 + i};
    }
    for (uint32_t v = 0; v < tuning.adjusts; v++) {
        tl_tuning_adjust *adjust = &tuning.adjust[v];
        adjust->nominal = adjust->has_nominal != 0 ? 1.5 + v : 0.0;
        adjust->lower = -3.0 - v;
        adjust->upper = 9.0 + v;
        adjust->approved = -0.75 - v;
        adjust->deviation_penalty = 0.25 + v;
        adjust->rate_penalty = 0.125 + v;
    }
    tuning.margin = 0.5;
    tuning.noise_floor = 0.75;
    tuning.evaluations = 7;
    tuning.time = 1234;
    tl_config_retune(&verdict.config, &tuning);
    tl_config_tuning(config, &again);
    TEST_ASSERT_EQUAL_MEMORY(&tuning, &again, sizeof tuning);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_tuning);
    RUN_TEST(test_root);
    RUN_TEST(test_text_and_fingerprint);
    RUN_TEST(test_components);
    RUN_TEST(test_sources);
    RUN_TEST(test_a_serial_line);
    RUN_TEST(test_defaults_of_a_serial_line);
    RUN_TEST(test_gpio);
    RUN_TEST(test_a_modbus_signal);
    RUN_TEST(test_other_signals);
    RUN_TEST(test_a_signal_without_keys);
    RUN_TEST(test_connections);
    RUN_TEST(test_adjust);
    RUN_TEST(test_a_boolean_that_is_adjusted);
    RUN_TEST(test_match);
    RUN_TEST(test_the_rest_of_synchronise);
    RUN_TEST(test_epsilon);
    RUN_TEST(test_emulate);
    RUN_TEST(test_delays);
    RUN_TEST(test_delays_of_outputs_alone);
    RUN_TEST(test_second_lookups);
    RUN_TEST(test_a_free_twin);
    RUN_TEST(test_released_twins);
    RUN_TEST(test_start_values);
    RUN_TEST(test_between_readings);
    RUN_TEST(test_the_delay_of_a_condition);
    RUN_TEST(test_a_plant_has_no_delays);
    RUN_TEST(test_defaults);
    RUN_TEST(test_compare_only);
    RUN_TEST(test_nothing_to_compare);
    RUN_TEST(test_weights_and_tolerances);
    RUN_TEST(test_solvers);
    RUN_TEST(test_modes_and_shapes);
    RUN_TEST(test_outliers_are_rejected_by_default);
    RUN_TEST(test_objects_in_part);
    RUN_TEST(test_steps_in_nanoseconds);
    RUN_TEST(test_durations_at_their_limits);
    RUN_TEST(test_the_default_budget_is_six_tenths_of_a_step);
    RUN_TEST(test_other_ways_to_write_the_same);
    RUN_TEST(test_values_at_their_limits);
    RUN_TEST(test_a_boolean_without_initial);
    RUN_TEST(test_lines);
    RUN_TEST(test_a_missing_file);
    RUN_TEST(test_a_directory);
    RUN_TEST(test_no_free_file_descriptor);
    RUN_TEST(test_an_empty_file);
    RUN_TEST(test_a_nul_byte);
    RUN_TEST(test_a_file_that_never_ends);
    RUN_TEST(test_the_largest_file);
    RUN_TEST(test_freeing_an_empty_configuration);
    RUN_TEST(test_file_paths);
    RUN_TEST(test_where_an_fmu_is);
    RUN_TEST(test_an_fmu_beside_the_program);
    return UNITY_END();
}
