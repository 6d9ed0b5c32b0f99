/* Wrong configurations. Each case makes one change to a valid configuration and expects one problem
 * with its path, line and values. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <unity.h>

#include "firmware/base/json.h"
#include "firmware/config/json_document.h"
#include "master/solve/optimiser.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"

#define FULL TL_SOURCE_DIR "/tests/support/configuration_full.json"
#define FREE TL_SOURCE_DIR "/tests/support/configuration_free.json"
#define EPSILON TL_SOURCE_DIR "/tests/support/configuration_epsilon.json"

static char *full;
static char *free_running;
static char *with_epsilon;
static tl_test_verdict verdict;

void setUp(void) {
    full = tl_test_read_text(FULL);
    free_running = tl_test_read_text(FREE);
    with_epsilon = tl_test_read_text(EPSILON);
    TEST_ASSERT_NOT_NULL(full);
    TEST_ASSERT_NOT_NULL(free_running);
    TEST_ASSERT_NOT_NULL(with_epsilon);
}

void tearDown(void) {
    tl_config_free(&verdict.config);
    free(full);
    free(free_running);
    free(with_epsilon);
}

#define EXPECT_EACH(base, changes) tl_test_expect_problems(base, changes, sizeof(changes) / sizeof(changes)[0])

static void test_the_root(void) {
    static const tl_test_change changes[] = {
        {"\"twinlock\": 1", "\"twinlock\": 2", "twinlock", "2|1|version", NULL},
        {"\"twinlock\": 1", "\"twinlock\": \"1\"", "twinlock", "\"1\"|1|version", NULL},
        {"\"twinlock\": 1", "\"twinlock\": true", "twinlock", "true|1|version", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"\"", "name", "\"\"|empty", NULL},
        {"\"name\": \"motor bench\"", "\"name\": 5", "name", "5|\"motor bench\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"a\\u001b[31m\"", "name", "\"a\\x1B[31m\"|control", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"a\\u202eb\"", "name", "\"a\\u{202E}b\"|control", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 9e-6", "step_s", "9e-06|1e-05|3600", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 3600.5", "step_s", "3600.5|1e-05|3600", NULL},
        {"\"step_s\": 0.01", "\"step_s\": \"0.01\"", "step_s", "\"0.01\"|1e-05|3600", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 0.0100000001", "step_s", "0.0100000001|nanoseconds", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 3599.0000000005", "step_s", "3599.0000000005|nanoseconds", NULL},
        {"\"duration_s\": 14", "\"duration_s\": 0", "duration_s", "0|> 0|1e9", NULL},
        {"\"duration_s\": 14", "\"duration_s\": 1.1e9", "duration_s", "1100000000|> 0|1e9", NULL},
        {"\"duration_s\": 14", "\"duration_s\": null", "duration_s", "null|> 0|1e9", NULL},
        {"\"start_s\": 5", "\"start_s\": 2e12", "start_s", "2000000000000|1000000000000", NULL},
        {"\"stop_s\": 1e6", "\"stop_s\": 5", "stop_s", "5|start_s", NULL},
        {"\"stop_s\": 1e6", "\"stop_s\": true", "stop_s", "true|1000000000000", NULL},
        {"\"record\": {", "\"Record\": {", "Record", "unknown|\"Record\"|\"record\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"motor bench\", \"nmae\": 1", "nmae", "unknown|\"nmae\"|\"name\"",
         NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"motor bench\", \"nam\": 1", "nam", "unknown|\"nam\"|\"name\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"motor bench\", \"title\": 1", "title",
         "unknown|\"title\"|twinlock|name|step_s|duration_s|start_s|stop_s|components|sources|plant|recording|connect|compare|synchronise|delays|record|realtime|emulate|$schema",
         NULL},
        {"\"$schema\": \"../../config/schema/twinlock-1.json\"", "\"$schema\": 1", "$schema", "1|\"twinlock-1.json\"",
         NULL},
        {"\"$schema\": \"../../config/schema/twinlock-1.json\"", "\"schema\": \"twinlock-1.json\"", "schema",
         "unknown|\"schema\"|\"$schema\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_components(void) {
    static const tl_test_change changes[] = {
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": {}", "components.drive.fmu", "\"motor.fmu\"", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": \"drive.fmu\"", "components.drive",
         "\"drive.fmu\"|object", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": { \"fmu\": \"drive.fmu\", \"sets\": {} }",
         "components.drive.sets", "unknown|\"sets\"|\"set\"", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": { \"fmu\": \"drive.fmu\" }, \"2nd\": { \"fmu\": \"x\" }",
         "components.2nd", "\"2nd\"|63|letters", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }",
         "\"drive\": { \"fmu\": \"drive.fmu\" }, \"dr ive\": { \"fmu\": \"x\" }", "components.dr ive",
         "\"dr ive\"|63|letters", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": { \"fmu\": \"drive.fmu\" }, \"\": { \"fmu\": \"x\" }",
         "components.", "\"\"|63|letters", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }",
         "\"drive\": { \"fmu\": \"drive.fmu\" }, \"plant\": { \"fmu\": \"x\" }", "components.plant",
         "name|\"plant\"|\"motor\"", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }",
         "\"drive\": { \"fmu\": \"drive.fmu\" }, \"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\": { \"fmu\": \"x\" }",
         "components.aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
         "\"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa…\"|63|letters", NULL},
        {"\"keep\": \"outputs\"", "\"keep\": \"nothing\"", "components.motor.keep",
         "\"nothing\"|\"states\"|\"outputs\"", NULL},
        {"\"keep\": \"outputs\"", "\"keep\": true", "components.motor.keep", "true|\"states\"|\"outputs\"", NULL},
        {"\"keep\": \"outputs\"", "\"keeps\": \"outputs\"", "components.motor.keeps", "unknown|\"keeps\"|\"keep\"",
         NULL},
        {"\"rollback\": \"memory\"", "\"rollback\": \"copy\"", "components.motor.rollback",
         "\"copy\"|\"auto\"|\"state\"|\"memory\"|\"replay\"", NULL},
        {"[\"libpython3.11.so.1.0\", \"lib/solver.so\"]", "\"libpython3.11.so.1.0\"", "components.motor.libraries",
         "\"libpython3.11.so.1.0\"|array|shared libraries", NULL},
        {"\"lib/solver.so\"", "5", "components.motor.libraries[1]", "5|shared library", NULL},
        {"\"lib/solver.so\"", "\"\"", "components.motor.libraries[1]", "\"\"|shared library", NULL},
        {"\"lib/solver.so\"", "\"lib\\tsolver.so\"", "components.motor.libraries[1]",
         "\"lib\\tsolver.so\"|shared library", NULL},
        {"\"logging\": true", "\"logging\": 1", "components.motor.logging", "1|true|false", NULL},
        {"\"sha256\": \"9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08\"", "\"sha256\": \"9F86\"",
         "components.motor.sha256", "\"9F86\"|64|sha256sum", NULL},
        {"\"J\": 0.0515", "\"J\": [1]", "components.motor.set.J", "array|1|number|true|false", NULL},
        {"\"J\": 0.0515", "\"J\": null", "components.motor.set.J", "null|number|true|false", NULL},
        {"\"J\": 0.0515", "\"\": 1", "components.motor.set.", "variable|FMU|\"J\"", NULL},
        {"\"set\": { \"J\": 0.0515, \"poles\": 4, \"warm\": true, \"label\": \"\" }", "\"set\": 1",
         "components.motor.set", "1|object", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_sources(void) {
    static const tl_test_change changes[] = {
        {"\"gateway\": { \"modbus_tcp\": { \"host\": \"plc.example\" } }",
         "\"gateway\": { \"modbus_tcp\": { \"host\": \"plc.example\" } }, \"odd\": {}", "sources.odd",
         "csv|modbus_tcp|modbus_rtu|can|gpio|one", NULL},
        {"\"stream\": { \"csv\": {", "\"stream\": { \"modbus_tcp\": { \"host\": \"x\" }, \"csv\": {", "sources.stream",
         "csv and modbus_tcp|csv|modbus_tcp|modbus_rtu|can|gpio", NULL},
        {"{ \"host\": \"plc.example\" }", "{}", "sources.gateway.modbus_tcp.host", "\"192.0.2.10\"", NULL},
        {"{ \"host\": \"plc.example\" }", "{ \"host\": \"plc.example\", \"hosts\": 1 }",
         "sources.gateway.modbus_tcp.hosts", "unknown|\"hosts\"|\"host\"", NULL},
        {"\"port\": 1502", "\"port\": 0", "sources.plc.modbus_tcp.port", "0|1|65535", NULL},
        {"\"port\": 1502", "\"port\": 65536", "sources.plc.modbus_tcp.port", "65536|1|65535", NULL},
        {"\"port\": 1502", "\"port\": 1.5", "sources.plc.modbus_tcp.port", "1.5|whole number|1|65535", NULL},
        {"\"any_unit_id\": true", "\"any_unit_id\": 1", "sources.plc.modbus_tcp.any_unit_id", "1|true|false", NULL},
        {"\"any_unit_id\": true", "\"any_unit\": true", "sources.plc.modbus_tcp.any_unit",
         "unknown|\"any_unit\"|host|port|any_unit_id|timeout_s|period_s", NULL},
        {"\"most_registers\": 40", "\"most_registers\": 0", "sources.plc.modbus_tcp.most_registers", "0|1|125", NULL},
        {"\"most_registers\": 1,", "\"most_registers\": 126,", "sources.bus.modbus_rtu.most_registers", "126|1|125",
         NULL},
        {"\"any_transaction_id\": true", "\"any_transaction_id\": 0", "sources.plc.modbus_tcp.any_transaction_id",
         "0|true|false", NULL},
        {"\"framing\": \"rtu\"", "\"framing\": \"ascii\"", "sources.plc.modbus_tcp.framing",
         "\"ascii\"|\"tcp\"|\"rtu\"", NULL},
        {"\"pause_s\": 0.002", "\"pause_s\": -0.1", "sources.plc.modbus_tcp.pause_s", "-0.1|0|60", NULL},
        {"\"pause_s\": 60", "\"pause_s\": 61", "sources.bus.modbus_rtu.pause_s", "61|0|60", NULL},
        {"\"pause_s\": 0.002, \"split_failed\": true", "\"split_failed\": 1", "sources.plc.modbus_tcp.split_failed",
         "1|true|false", NULL},
        {"\"period_s\": 0.02", "\"period_s\": 0", "sources.plc.modbus_tcp.period_s", "0|1e-05|3600", NULL},
        {"\"timeout_s\": 0.25", "\"timeout_s\": 61", "sources.plc.modbus_tcp.timeout_s", "61|0.001|60", NULL},
        {"\"file\": \"plant.fifo\", ", "", "sources.stream.csv.file", "\"plant.fifo\"", NULL},
        {"\"time_column\": \"t\"", "\"time_column\": \"\"", "sources.stream.csv.time_column", "\"\"|empty", NULL},
        {"\"period_s\": 0.005", "\"period_s\": 3601", "sources.stream.csv.period_s", "3601|1e-05|3600", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_signals(void) {
    static const tl_test_change changes[] = {
        {"\"current\": {}", "\"current\": 1", "plant.current", "1|object", NULL},
        {"\"current\": {}", "\"current\": { \"type\": \"float\" }", "plant.current.type",
         "\"float\"|\"real\"|\"integer\"|\"boolean\"", NULL},
        {"\"current\": {}", "\"current\": { \"type\": \"bool\", \"initial\": true }", "plant.current.type",
         "\"bool\"|\"real\"|\"integer\"|\"boolean\"", NULL},
        {"\"current\": {}", "\"current\": {}, \"1st\": {}", "plant.1st", "\"1st\"|63|letters", NULL},
        {"\"unit\": \"N.m\"", "\"unit\": 1", "plant.torque.unit", "1|\"rad/s\"", NULL},
        {"\"min\": -5", "\"min\": \"-5\"", "plant.torque.min", "\"-5\"|number", NULL},
        {"\"min\": -5, \"max\": 5", "\"min\": 5, \"max\": -5", "plant.torque.max", "-5|min|5", NULL},
        {"\"stale_s\": 0.1", "\"stale_s\": 0", "plant.torque.stale_s", "0|> 0|1e9", NULL},
        {"\"stale_s\": 0.1", "\"stale\": 0.1", "plant.torque.stale", "unknown|\"stale\"|\"stale_s\"", NULL},
        {"\"stale_s\": 0.1", "\"stale_s\": \"0.1\"", "plant.torque.stale_s", "\"0.1\"|> 0|1e9", NULL},
        {"\"initial\": 0.5", "\"initial\": true", "plant.torque.initial", "true|number", NULL},
        {"\"initial\": true", "\"initial\": 1", "plant.running.initial", "1|true|false", NULL},
        {"\"initial\": 3", "\"initial\": 3.5", "plant.stage.initial", "3.5|whole number|-2147483647|2147483647", NULL},
        {"\"initial\": 3", "\"initial\": -2147483648", "plant.stage.initial", "-2147483648|-2147483647|2147483647",
         NULL},
        {"\"csv\": { \"column\": \"M_w\" }", "\"csv\": \"M_w\"", "plant.torque.csv", "\"M_w\"|object", NULL},
        {"\"csv\": { \"column\": \"M_w\" }", "\"csv\": { \"columns\": \"M_w\" }", "plant.torque.csv.columns",
         "unknown|\"columns\"|\"column\"", NULL},
        {"\"column\": \"M_w\"", "\"column\": 1", "plant.torque.csv.column", "1|\"omega\"", NULL},
        {"\"scale\": 0.5", "\"scale\": 0", "plant.level.csv.scale", "0|other than 0", NULL},
        {"\"offset\": 2", "\"offset\": \"2\"", "plant.level.csv.offset", "\"2\"|number", NULL},
        {"\"type\": \"boolean\", \"initial\": true", "\"type\": \"boolean\", \"csv\": { \"scale\": 2 }",
         "plant.running.csv.scale", "2|none|boolean", NULL},
        {"\"type\": \"boolean\", \"initial\": true", "\"type\": \"boolean\", \"csv\": { \"offset\": 1 }",
         "plant.running.csv.offset", "1|none|boolean", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_live_sources(void) {
    static const tl_test_change changes[] = {
        {"\"source\": \"stream\"", "\"source\": \"steam\"", "plant.omega.csv.source", "\"steam\"|csv|stream", NULL},
        {"\"source\": \"stream\"", "\"source\": \"plc\"", "plant.omega.csv.source", "\"plc\"|csv|stream", NULL},
        {"\"source\": \"gateway\"", "\"source\": \"stream\"", "plant.running.modbus.source",
         "\"stream\"|modbus_tcp|modbus_rtu|plc|gateway|bus", NULL},
        {"\"source\": \"gateway\"", "\"source\": \"nobody\"", "plant.running.modbus.source",
         "\"nobody\"|modbus_tcp|modbus_rtu|plc|gateway|bus", NULL},
        {"\"source\": \"gateway\"", "\"source\": 1", "plant.running.modbus.source", "1|\"plc\"", NULL},
        {"\"source\": \"gateway\", ", "", "plant.running.modbus.source", "\"plc\"", NULL},
        {"\"csv\": { \"column\": \"M_w\" },", "\"csv\": { \"source\": \"stream\" },", "plant.torque.modbus",
         "modbus|live source", "\"modbus\": {\n"},
    };
    EXPECT_EACH(full, changes);
}

static void test_live_sources_where_there_are_none(void) {
    static const tl_test_change changes[] = {
        {"\"torque\": {}", "\"torque\": { \"csv\": { \"source\": \"x\" } }", "plant.torque.csv.source", "\"x\"|csv",
         NULL},
    };
    EXPECT_EACH(free_running, changes);
}

#define BAUDS "1200|2400|4800|9600|19200|38400|57600|115200|230400|460800|500000|921600|1000000"

static void test_a_serial_line(void) {
    static const tl_test_change changes[] = {
        {"\"device\": \"ttyPLC\", ", "", "sources.bus.modbus_rtu.device",
         "\"/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0\"", "\"modbus_rtu\": {\n"},
        {"\"any\": {", "\"other\": { \"modbus_rtu\": { \"device\": \"ttyPLC\" } }, \"any\": {",
         "sources.other.modbus_rtu.device", "device|sources.bus", NULL},
        {"\"baud\": 38400", "\"baud\": 9601", "sources.bus.modbus_rtu.baud", "9601|" BAUDS, NULL},
        {"\"baud\": 38400", "\"baud\": 300", "sources.bus.modbus_rtu.baud", "300|" BAUDS, NULL},
        {"\"parity\": \"none\"", "\"parity\": \"N\"", "sources.bus.modbus_rtu.parity",
         "\"N\"|\"even\"|\"odd\"|\"none\"", NULL},
        {"\"stop_bits\": 1", "\"stop_bits\": 1.5", "sources.bus.modbus_rtu.stop_bits", "1.5|whole number|1|2", NULL},
        {"\"rs485\": true", "\"rs485\": 1", "sources.bus.modbus_rtu.rs485", "1|true|false", NULL},
        {"\"timeout_s\": 0.1", "\"timeout_s\": 0", "sources.bus.modbus_rtu.timeout_s", "0|0.001|60", NULL},
        {"\"rs485\": true", "\"data_bits\": 7", "sources.bus.modbus_rtu.data_bits",
         "unknown|\"data_bits\"|device|baud|parity|stop_bits|rs485|timeout_s|period_s", NULL},
        {"\"unit_id\": 247", "\"unit_id\": 0", "plant.level.modbus.unit_id", "0|modbus_rtu|1|247", NULL},
        {"\"unit_id\": 247", "\"unit_id\": 255", "plant.level.modbus.unit_id", "255|modbus_rtu|1|247", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_gpio(void) {
    static const tl_test_change changes[] = {
        {"\"chip\": \"bench\"", "\"chip\": 0", "sources.box.gpio.chip", "0|\"gpiochip0\"", NULL},
        {"\"period_s\": 0.002", "\"timeout_s\": 1", "sources.box.gpio.timeout_s", "unknown|\"timeout_s\"|chip|period_s",
         NULL},
        {"\"any\": { \"gpio\": {} }", "\"any\": { \"gpio\": 1 }", "sources.any.gpio", "1|object", NULL},
        {"\"source\": \"any\"", "\"source\": \"plc\"", "plant.start.gpio.source", "\"plc\"|gpio|box|any", NULL},
        {"\"line\": \"START\"", "\"line\": 4", "plant.start.gpio.line", "4|\"START\"", NULL},
        {"\"line\": \"START\"", "\"line\": \"START\", \"offset\": 1", "plant.start.gpio", "both|line|offset", NULL},
        {"\"line\": \"START\", ", "", "plant.start.gpio", "neither|line|offset", "\"gpio\": { \"source\": \"any\""},
        {"\"line\": \"START\"", "\"offset\": 1", "plant.start.gpio.offset", "1|line|chip", NULL},
        {"\"offset\": 5", "\"offset\": -1", "plant.stop.gpio.offset", "-1|0|65535", NULL},
        {"\"active_low\": true", "\"active_low\": 1", "plant.start.gpio.active_low", "1|true|false", NULL},
        {"\"bias\": \"none\"", "\"bias\": \"up\"", "plant.stop.gpio.bias", "\"up\"|\"pull-up\"|\"pull-down\"|\"none\"",
         NULL},
        {"\"debounce_s\": 0.004", "\"debounce_s\": -1", "plant.start.gpio.debounce_s", "-1|0|60", NULL},
        {"\"source\": \"box\", \"offset\": 5", "\"source\": \"any\", \"line\": \"START\"", "plant.stop.gpio.line",
         "line|plant.start", NULL},
        {"\"current\": {},", "\"current\": { \"gpio\": { \"source\": \"box\", \"offset\": 5 } },",
         "plant.stop.gpio.offset", "line|plant.current", "\"offset\": 5, \"bias\""},
        {"\"csv\": { \"column\": \"omega\", \"source\": \"stream\" }",
         "\"csv\": { \"source\": \"stream\" }, \"gpio\": { \"source\": \"any\", \"line\": \"A\" }", "plant.omega.gpio",
         "gpio|live source", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_modbus(void) {
    static const tl_test_change changes[] = {
        {"\"unit_id\": 255", "\"unit_id\": 248", "plant.torque.modbus.unit_id", "248|0|247|255", NULL},
        {"\"unit_id\": 255", "\"unit_id\": 256", "plant.torque.modbus.unit_id", "256|0|247|255", NULL},
        {"\"table\": \"holding\"", "\"table\": \"registers\"", "plant.torque.modbus.table",
         "\"registers\"|\"coil\"|\"discrete\"|\"holding\"|\"input\"", NULL},
        {"\"table\": \"holding\", ", "", "plant.torque.modbus.table", "\"coil\"|\"discrete\"|\"holding\"|\"input\"",
         "\"modbus\": {\n"},
        {"\"address\": 100", "\"address\": 65536", "plant.torque.modbus.address", "65536|0|65535", NULL},
        {"\"address\": 100", "\"address\": -1", "plant.torque.modbus.address", "-1|0|65535", NULL},
        {"\"address\": 100, ", "", "plant.torque.modbus.address", "0|65535", "\"modbus\": {\n"},
        {"\"address\": 65532", "\"address\": 65533", "plant.stage.modbus.address", "65533|65532|4 registers", NULL},
        {"\"type\": \"int16\"", "\"type\": \"bit\"", "plant.torque.modbus.bit", "0|15", "\"modbus\": {\n"},
        {"\"type\": \"int16\"", "\"type\": \"int63\"", "plant.torque.modbus.type",
         "\"int63\"|\"int16\"|\"uint16\"|\"int32\"|\"uint32\"|\"float32\"|\"float64\"", NULL},
        {", \"type\": \"float64\"", "", "plant.stage.modbus.type",
         "\"int16\"|\"uint16\"|\"int32\"|\"uint32\"|\"float32\"|\"float64\"", NULL},
        {"\"table\": \"coil\"", "\"table\": \"coil\", \"type\": \"int16\"", "plant.running.modbus.type",
         "\"int16\"|\"bit\"", NULL},
        {"\"words\": \"little\"", "\"words\": \"middle\"", "plant.torque.modbus.words", "\"middle\"|\"big\"|\"little\"",
         NULL},
        {"\"bytes\": \"little\"", "\"bytes\": 1", "plant.torque.modbus.bytes", "1|\"big\"|\"little\"", NULL},
        {"\"scale\": 0.001", "\"scale\": 0", "plant.torque.modbus.scale", "0|other than 0", NULL},
        {"\"offset\": -1.5", "\"offset\": \"-1.5\"", "plant.torque.modbus.offset", "\"-1.5\"|number", NULL},
        {"\"scale\": 0.001", "\"scal\": 0.001", "plant.torque.modbus.scal", "unknown|\"scal\"|\"scale\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_connections(void) {
    static const tl_test_change changes[] = {
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\"]", "connect[0]",
         "array|1|[\"plant.torque\", \"motor.M_w\"]", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "\"plant.torque\"", "connect[0]",
         "\"plant.torque\"|array|[\"plant.torque\", \"motor.M_w\"]", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\", 1]", "connect[0][1]", "1|\"motor.omega\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torqe\", \"motor.M_w\"]", "connect[0][0]",
         "\"plant.torqe\"|\"plant.torque\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.x\", \"motor.M_w\"]", "connect[0][0]",
         "\"plant.x\"|torque|running|stage|omega|current|level|start|stop", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"drve.u_R\", \"motor.M_w\"]", "connect[0][0]",
         "\"drve.u_R\"|\"drive.u_R\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"torque\", \"motor.M_w\"]", "connect[0][0]",
         "\"torque\"|component.variable|plant.signal", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.\", \"motor.M_w\"]", "connect[0][0]",
         "\"plant.\"|component.variable|plant.signal", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\", \"plant.torque\"]", "connect[0][1]",
         "\"plant.torque\"|component.variable", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\", \".x\"]", "connect[0][1]",
         "\".x\"|component.variable", NULL},
        {"[\"motor.omega\", \"drive.y\"]", "[\"motor.omega\", \"motor.M_w\"]", "connect[2][1]",
         "\"motor.M_w\"|connect[0]|input", NULL},
        {"\"record\": {", "\"connects\": [], \"record\": {", "connects", "unknown|\"connects\"|\"connect\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_connections_that_are_no_array(void) {
    static const tl_test_change changes[] = {
        {"[[\"plant.torque\", \"motor.M_w\"]]", "{}", "connect", "object|0|array|[from, to]", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

static void test_compare(void) {
    static const tl_test_change changes[] = {
        {"{ \"motor.omega\": { \"to\": \"plant.omega\" } }", "{}", "compare", "object|0|1|64", NULL},
        {"{ \"motor.omega\": { \"to\": \"plant.omega\" } }", "[]", "compare", "array|0|object|1|64", NULL},
        {"{ \"to\": \"plant.omega\" }", "{}", "compare.motor.omega.to", "\"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "\"plant.omega\"", "compare.motor.omega", "\"plant.omega\"|object", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": \"plant.omga\" }", "compare.motor.omega.to",
         "\"plant.omga\"|\"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": \"motor.omega\" }", "compare.motor.omega.to",
         "\"motor.omega\"|\"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": 1 }", "compare.motor.omega.to", "1|\"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": \"plant.omega\", \"tolerance\": 1 }",
         "compare.motor.omega.tolerance", "unknown|\"tolerance\"|to|between", NULL},
        {"\"motor.omega\": {", "\"moter.omega\": {", "compare.moter.omega", "\"moter.omega\"|\"motor.omega\"", NULL},
        {"\"motor.omega\": {", "\"plant.omega\": {", "compare.plant.omega", "\"plant.omega\"|component.variable", NULL},
        {"\"motor.omega\": {", "\"omega\": {", "compare.omega", "\"omega\"|component.variable", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

static void test_compare_beside_synchronise(void) {
    static const tl_test_change changes[] = {
        {"\"synchronise\": {", "\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }, \"synchronise\": {",
         "compare", "compare|synchronise|weight 0", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_adjust(void) {
    static const tl_test_change changes[] = {
        {"\"step\": 0.05", "\"step\": \"0.05\"", "synchronise.adjust.motor.d.step", "\"0.05\"|> 0", NULL},
        {"\"nominal\": true", "\"nominal\": null", "synchronise.adjust.motor.brake.nominal", "null|number|true|false",
         NULL},
        {"\"approved\": 0.5", "\"approved\": \"0.5\"", "synchronise.adjust.motor.d.approved", "\"0.5\"|number", NULL},
        {"\"approved\": 0.5", "\"approved\": 1", "synchronise.adjust.motor.d.approved", "1|1.0031|min|max", NULL},
        {"\"approved\": 0.5", "\"approved\": -0.01", "synchronise.adjust.motor.d.approved", "-0.01|-0.0069|min|max",
         NULL},
        {"\"penalty\": { \"deviation\": 0.25, \"rate\": 0.125 }", "\"penalty\": 0.25",
         "synchronise.adjust.motor.d.penalty", "0.25|object", NULL},
        {"\"deviation\": 0.25", "\"deviation\": -0.25", "synchronise.adjust.motor.d.penalty.deviation", "-0.25|0",
         NULL},
        {"\"deviation\": 0.25", "\"deviation\": \"0.25\"", "synchronise.adjust.motor.d.penalty.deviation", "\"0.25\"|0",
         NULL},
        {"\"rate\": 0.125", "\"rate\": -1e-9", "synchronise.adjust.motor.d.penalty.rate", "-1e-09|0", NULL},
        {"\"rate\": 0.125", "\"rate\": true", "synchronise.adjust.motor.d.penalty.rate", "true|0", NULL},
        {"\"rate\": 0.125", "\"rates\": 0.125", "synchronise.adjust.motor.d.penalty.rates",
         "unknown|\"rates\"|\"rate\"", NULL},
        {"\"dwell_s\": 0.2", "\"dwell_s\": 0", "synchronise.adjust.motor.brake.dwell_s", "0|> 0|1e9", NULL},
        {"\"dwell_s\": 0.2", "\"dwell_s\": 1.1e9", "synchronise.adjust.motor.brake.dwell_s", "1100000000|> 0|1e9",
         NULL},
        {"\"dwell_s\": 0.2", "\"dwell_s\": \"0.2\"", "synchronise.adjust.motor.brake.dwell_s", "\"0.2\"|> 0|1e9", NULL},
        {"\"dwell_s\": 0.2", "\"dwell\": 0.2", "synchronise.adjust.motor.brake.dwell", "unknown|\"dwell\"|\"dwell_s\"",
         NULL},
        {"\"step\": 0.05", "\"step\": 0", "synchronise.adjust.motor.d.step", "0|> 0", NULL},
        {"\"nominal\": 0.0031", "\"nominal\": \"0.0031\"", "synchronise.adjust.motor.d.nominal",
         "\"0.0031\"|number|true|false", NULL},
        {"\"min\": 0, \"max\": 1", "\"min\": 1, \"max\": 1", "synchronise.adjust.motor.d.max", "1|min", NULL},
        {"\"min\": 0, \"max\": 1", "\"min\": 0, \"max\": true", "synchronise.adjust.motor.d.max", "true|number", NULL},
        {"\"min\": 0, \"max\": 1", "\"min\": 0, \"maximum\": 1", "synchronise.adjust.motor.d.maximum",
         "unknown|\"maximum\"|step|nominal|min|max|penalty|dwell_s", NULL},
        {"\"motor.d\": {", "\"engine.d\": {", "synchronise.adjust.engine.d", "\"engine.d\"|drive|motor", NULL},
        {"\"motor.x[1].bias\": { \"step\": 2 }", "\"motor.x[1].bias\": 2", "synchronise.adjust.motor.x[1].bias",
         "2|object", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_match(void) {
    static const tl_test_change changes[] = {
        {"\"to\": \"plant.omega\", \"tolerance\": 0.5", "\"tolerance\": 0.5", "synchronise.match.motor.omega.to",
         "\"plant.omega\"", NULL},
        {"\"tolerance\": 0.5, ", "", "synchronise.match.motor.omega.tolerance", "> 0|0.5", NULL},
        {"\"tolerance\": 0.5", "\"tolerance\": 0", "synchronise.match.motor.omega.tolerance", "0|> 0", NULL},
        {"\"tolerance\": 0.5", "\"tolerance\": \"0.5\"", "synchronise.match.motor.omega.tolerance", "\"0.5\"|> 0",
         NULL},
        {"\"weight\": 2", "\"weight\": \"2\"", "synchronise.match.motor.omega.weight", "\"2\"|0", NULL},
        {"\"huber\": 3", "\"huber\": 0", "synchronise.match.motor.omega.huber", "0|> 0", NULL},
        {"\"huber\": 3", "\"huber\": true", "synchronise.match.motor.omega.huber", "true|> 0", NULL},
        {"\"huber\": 3", "\"hubert\": 3", "synchronise.match.motor.omega.hubert", "unknown|\"hubert\"|\"huber\"", NULL},
        {"\"condition\": { \"median\": 5, \"low_pass_s\": 0.03, \"gate\": 45 }", "\"condition\": \"median\"",
         "synchronise.match.motor.omega.condition", "\"median\"|object", NULL},
        {"\"weight\": 2", "\"weight\": -1", "synchronise.match.motor.omega.weight", "-1|0", NULL},
        {"\"weight\": 2", "\"weight\": 0", "synchronise.match", "weight 0|1", "\"match\": {"},
        {"\"weight\": 2", "\"weights\": 2", "synchronise.match.motor.omega.weights", "unknown|\"weights\"|\"weight\"",
         NULL},
        {"\"plant.current\"", "\"plant.curent\"", "synchronise.match.motor.I.to", "\"plant.curent\"|\"plant.current\"",
         NULL},
        {"\"motor.I\": {", "\"plant.I\": {", "synchronise.match.plant.I", "\"plant.I\"|component.variable", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_the_rest_of_synchronise(void) {
    static const tl_test_change changes[] = {
        {"\"horizon\": {", "\"horizons\": {", "synchronise.horizons", "unknown|\"horizons\"|\"horizon\"", NULL},
        {"\"prediction\": 2", "\"prediction\": 0", "synchronise.horizon.prediction", "0|1|1000", NULL},
        {"\"prediction\": 2", "\"prediction\": 1001", "synchronise.horizon.prediction", "1001|1|1000", NULL},
        {"\"prediction\": 2", "\"prediction\": 1.5", "synchronise.horizon.prediction", "1.5|whole number|1|1000", NULL},
        {"\"shape\": \"dynamic\"", "\"event\": {\"start\": \"plant.omega\", \"window_s\": 0.1, \"longest_s\": 2}",
         "synchronise.horizon.event.end", "\"plant.extended\"", NULL},
        {"\"shape\": \"dynamic\"",
         "\"event\": {\"start\": \"not omega\", \"end\": \"plant.omega\", \"window_s\": 0.1, \"longest_s\": 2}",
         "synchronise.horizon.event.start", "\"omega\"|\"plant.omega\"", NULL},
        {"\"shape\": \"dynamic\"",
         "\"event\": {\"start\": \"plant.omega\", \"end\": \"plant.omega\", \"window_s\": 0, \"longest_s\": 2}",
         "synchronise.horizon.event.window_s", "0|> 0|1e9", NULL},
        {"\"shape\": \"dynamic\"", "\"shape\": \"moving\"", "synchronise.horizon.shape",
         "\"moving\"|\"static\"|\"dynamic\"", NULL},
        {"\"shape\": \"dynamic\"", "\"shape\": 1", "synchronise.horizon.shape", "1|\"static\"|\"dynamic\"", NULL},
        {"\"shape\": \"dynamic\"", "\"shapes\": \"dynamic\"", "synchronise.horizon.shapes",
         "unknown|\"shapes\"|\"shape\"", NULL},
        {"\"measurements\": \"ahead\"", "\"measurements\": \"late\"", "synchronise.horizon.measurements",
         "\"late\"|\"lag\"|\"ahead\"|\"hold\"", NULL},
        {"\"measurements\": \"ahead\"", "\"measurements\": true", "synchronise.horizon.measurements",
         "true|\"lag\"|\"ahead\"|\"hold\"", NULL},
        {"\"margin\": 0.02", "\"margin\": 1", "synchronise.margin", "1|0", NULL},
        {"\"margin\": 0.02", "\"margin\": -0.1", "synchronise.margin", "-0.1|0|1", NULL},
        {"\"evaluations\": 40", "\"evaluations\": 1", "synchronise.budget.evaluations", "1|2|100000", NULL},
        {"\"evaluations\": 40", "\"evaluations\": 100001", "synchronise.budget.evaluations", "100001|2|100000", NULL},
        {"\"time_s\": 0.004", "\"time_s\": 0", "synchronise.budget.time_s", "0|> 0|1e9", NULL},
        {"\"budget\": { \"evaluations\": 40, \"time_s\": 0.004 }", "\"budget\": 40", "synchronise.budget", "40|object",
         NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_condition(void) {
    static const tl_test_change changes[] = {
        {"\"median\": 5", "\"median\": 0", "synchronise.match.motor.omega.condition.median", "0|odd|1|99", NULL},
        {"\"median\": 5", "\"median\": 4", "synchronise.match.motor.omega.condition.median", "4|odd|1|99", NULL},
        {"\"median\": 5", "\"median\": 98", "synchronise.match.motor.omega.condition.median", "98|odd|1|99", NULL},
        {"\"median\": 5", "\"median\": 101", "synchronise.match.motor.omega.condition.median", "101|odd|1|99", NULL},
        {"\"median\": 5", "\"median\": 2.5", "synchronise.match.motor.omega.condition.median", "2.5|odd|1|99", NULL},
        {"\"median\": 5", "\"median\": -1", "synchronise.match.motor.omega.condition.median", "-1|odd|1|99", NULL},
        {"\"median\": 5", "\"median\": \"5\"", "synchronise.match.motor.omega.condition.median", "\"5\"|odd|1|99",
         NULL},
        {"\"low_pass_s\": 0.03", "\"low_pass_s\": 0", "synchronise.match.motor.omega.condition.low_pass_s", "0|> 0|1e9",
         NULL},
        {"\"low_pass_s\": 0.03", "\"low_pass_s\": 1.1e9", "synchronise.match.motor.omega.condition.low_pass_s",
         "1100000000|> 0|1e9", NULL},
        {"\"low_pass_s\": 0.03", "\"low_pass_s\": [0.03]", "synchronise.match.motor.omega.condition.low_pass_s",
         "array|1|> 0|1e9", NULL},
        {"\"gate\": 45", "\"gate\": 0", "synchronise.match.motor.omega.condition.gate", "0|> 0", NULL},
        {"\"gate\": 45", "\"outliers\": true", "synchronise.match.motor.omega.condition.outliers", "true|reject|keep",
         NULL},
        {"\"gate\": 45", "\"gate\": false", "synchronise.match.motor.omega.condition.gate", "false|> 0", NULL},
        {"\"gate\": 45", "\"gates\": 45", "synchronise.match.motor.omega.condition.gates", "unknown|\"gates\"|\"gate\"",
         NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_epsilon(void) {
    static const tl_test_change changes[] = {
        {"\"epsilon\": 0.25", "\"epsilon\": 0", "synchronise.epsilon", "0|> 0", NULL},
        {"\"epsilon\": 0.25", "\"epsilon\": -1", "synchronise.epsilon", "-1|> 0", NULL},
        {"\"epsilon\": 0.25", "\"epsilon\": \"0.25\"", "synchronise.epsilon", "\"0.25\"|> 0", NULL},
        {"\"huber\": 2", "\"tolerance\": 1", "synchronise.match.motor.omega.tolerance",
         "tolerance|synchronise.epsilon|square", NULL},
        {"\"weight\": 0", "\"weight\": 0, \"tolerance\": 1", "synchronise.match.motor.I.tolerance",
         "tolerance|synchronise.epsilon|square", NULL},
        {"\"epsilon\": 0.25,", "", "synchronise.match.motor.omega.tolerance", "> 0|0.5", "\"motor.omega\": {"},
    };
    EXPECT_EACH(with_epsilon, changes);
}

static void test_limits_and_saving(void) {
    static const tl_test_change changes[] = {
        {"\"stagnation\": 30", "\"stagnation\": 0", "synchronise.stagnation", "0|1|100000", NULL},
        {"\"stagnation\": 30", "\"stagnation\": 100001", "synchronise.stagnation", "100001|1|100000", NULL},
        {"\"stagnation\": 30", "\"stagnation\": 1.5", "synchronise.stagnation", "1.5|whole number|1|100000", NULL},
        {"\"stagnation\": 30", "\"stagnation\": \"30\"", "synchronise.stagnation", "\"30\"|1|100000", NULL},
        {"\"rest\": false", "\"rest\": 1", "synchronise.rest", "1|true|false", NULL},
        {"\"free_twin\": false", "\"free_twin\": 1", "synchronise.free_twin", "1|true|false", NULL},
        {"\"free_twin\": false", "\"free_twin\": true", "synchronise.free_twin", "true|false|\"outputs\"", NULL},
        {"\"release_s\": 7200", "\"release_s\": 0.01", "synchronise.release_s", "0.01|0|step_s|600", NULL},
        {"\"release_s\": 7200", "\"release_s\": -1", "synchronise.release_s", "-1|0", NULL},
        {"\"release_s\": 7200", "\"release_s\": true", "synchronise.release_s", "true|0", NULL},
        {"\"over_s\": 10, ", "", "synchronise.start.over_s", "10", NULL},
        {"\"over_s\": 10", "\"over_s\": 21", "synchronise.start.over_s", "21|2000|step_s|20", NULL},
        {"\"min\": -10, \"max\": 10 }", "\"min\": -10 }", "synchronise.start.find.motor.omega_start.max", "number",
         NULL},
        {"\"min\": -10, \"max\": 10 }", "\"min\": 10, \"max\": 10 }", "synchronise.start.find.motor.omega_start.max",
         "more than min|10", NULL},
        {"\"motor.omega_start\": { \"min\"", "\"omega_start\": { \"min\"", "synchronise.start.find.omega_start",
         "component.variable", NULL},
        {"{ \"motor.omega_start\": { \"min\": -10, \"max\": 10 } }", "{}", "synchronise.start.find", "1", NULL},
        {"\"noise_floor\": 0.002", "\"noise_floor\": -0.002", "synchronise.noise_floor", "-0.002|0", NULL},
        {"\"noise_floor\": 0.002", "\"noise_floor\": false", "synchronise.noise_floor", "false|0", NULL},
        {"\"saving\": { \"structure\": false, \"sequences\": false, \"nodes\": 500, \"memory_mb\": 300 }",
         "\"saving\": false", "synchronise.saving", "false|object", NULL},
        {"\"structure\": false", "\"structure\": 0", "synchronise.saving.structure", "0|true|false", NULL},
        {"\"sequences\": false", "\"sequences\": \"no\"", "synchronise.saving.sequences", "\"no\"|true|false", NULL},
        {"\"sequences\": false", "\"sequence\": false", "synchronise.saving.sequence",
         "unknown|\"sequence\"|\"sequences\"", NULL},
        {"\"nodes\": 500", "\"nodes\": 1", "synchronise.saving.nodes", "1|2|1000000", NULL},
        {"\"nodes\": 500", "\"nodes\": 1000001", "synchronise.saving.nodes", "1000001|2|1000000", NULL},
        {"\"nodes\": 500", "\"nodes\": 2.5", "synchronise.saving.nodes", "2.5|whole number|2|1000000", NULL},
        {"\"nodes\": 500", "\"nodes\": true", "synchronise.saving.nodes", "true|2|1000000", NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": 0", "synchronise.saving.memory_mb", "0|1|1000000", NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": 1000001", "synchronise.saving.memory_mb", "1000001|1|1000000", NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": 0.5", "synchronise.saving.memory_mb", "0.5|whole number|1|1000000",
         NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": \"300\"", "synchronise.saving.memory_mb", "\"300\"|1|1000000", NULL},
        {"\"fallback\": 1000", "\"fallback\": \"nelder-mead\"", "synchronise.fallback", "algorithm|\"nelder-mead\"",
         NULL},
        {"\"fallback\": 1000", "\"fallback\": 1", "synchronise.fallback", "1|algorithm|\"nelder-mead\"", NULL},
        {"\"fallback\": 1000", "\"fall_back\": 1000", "synchronise.fall_back", "unknown|\"fall_back\"|\"fallback\"",
         NULL},
    };
    EXPECT_EACH(full, changes);
}

/* Replaces the value `old` of `key` in the full configuration. The message must list all registered
 * solvers. */
static void expect_unknown_solver(const char *key, const char *old, const char *new, const char *found) {
    char before[64];
    char after[64];
    char where[64];
    char parts[TL_ERROR_TEXT];
    (void)snprintf(before, sizeof before, "\"%s\": %s", key, old);
    (void)snprintf(after, sizeof after, "\"%s\": %s", key, new);
    (void)snprintf(where, sizeof where, "synchronise.%s", key);
    (void)snprintf(parts, sizeof parts, "%s|%s|1|100|1000", found, tl_optimiser_names());
    const tl_test_change c = {before, after, where, parts, NULL};
    tl_test_expect_problems(full, &c, 1);
}

static void test_unknown_solvers(void) {
    static const struct {
        const char *new, *found;
    } cases[] = {
        {"\"nelder_mead\"", "\"nelder_mead\""},
        {"\"Secant\"", "\"Secant\""},
        {"\"\"", "\"\""},
        {"\"1\"", "\"1\""},
        {"0", "0"},
        {"-1", "-1"},
        {"2", "2"},
        {"1.5", "1.5"},
        {"1e300", "1e+300"},
        {"true", "true"},
        {"null", "null"},
        {"[]", "array|0"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        expect_unknown_solver("algorithm", "\"nelder-mead\"", cases[i].new, cases[i].found);
        expect_unknown_solver("fallback", "1000", cases[i].new, cases[i].found);
    }
}

static void test_synchronise_without_its_parts(void) {
    static const tl_test_change changes[] = {
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }", "\"synchronise\": []", "synchronise",
         "array|0|object", NULL},
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }",
         "\"synchronise\": { \"match\": { \"motor.omega\": { \"to\": \"plant.omega\", \"tolerance\": 1 } } }",
         "synchronise.adjust", "object|1|8", NULL},
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }",
         "\"synchronise\": { \"adjust\": { \"motor.d\": { \"step\": 1 } } }", "synchronise.match", "object|1|64", NULL},
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }",
         "\"synchronise\": { \"adjust\": { \"motor.d\": { \"step\": 1 } }, \"match\": {} }", "synchronise.match",
         "object|0|1|64", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

static void test_running(void) {
    static const tl_test_change changes[] = {
        {"\"file\": \"bench.csv\"", "\"file\": 1", "recording.file", "1|\"bench.csv\"", NULL},
        {"\"time_column\": \"seconds\"", "\"time\": \"seconds\"", "recording.time", "unknown|\"time\"|file|time_column",
         NULL},
        {"\"file\": \"bench.db\", ", "", "record.file", "\"bench.db\"", NULL},
        {"\"max_mb\": 250.5", "\"max_mb\": 0.5", "record.max_mb", "0.5|1|1000000000", NULL},
        {"\"max_mb\": 250.5", "\"max_mb\": 1.5e9", "record.max_mb", "1500000000|1|1000000000", NULL},
        {"\"commit_s\": 0.25", "\"commit_s\": 0.01", "record.commit_s", "0.01|0.05|10", NULL},
        {"\"commit_s\": 0.25", "\"commit_s\": 11", "record.commit_s", "11|0.05|10", NULL},
        {"\"resume_s\": 30", "\"resume_s\": -1", "record.resume_s", "-1|0|3600", NULL},
        {"\"resume_s\": 30", "\"resume_s\": 3601", "record.resume_s", "3601|0|3600", NULL},
        {"\"learn_s\": 3600", "\"learn_s\": 59", "detect.learn_s", "59|60|1000000000", NULL},
        {"\"false_alarms_per_year\": 2.5", "\"false_alarms_per_year\": 0", "detect.false_alarms_per_year",
         "0|0.001|1000000", NULL},
        {"\"cycle_s\": 40", "\"cycle_s\": -1", "detect.cycle_s", "-1|0|1000000000", NULL},
        {"\"motor.x[1].bias\": { \"above\"", "\"motor.e\": { \"above\"", "detect.alarm.motor.e",
         "not adjusted|\"tank.pump\"", NULL},
        {"\"motor.brake\": { \"below\": -0.75 }", "\"motor.brake\": -0.75", "detect.alarm.motor.brake", "-0.75|above",
         NULL},
        {"\"motor.brake\": { \"below\": -0.75 }", "\"motor.brake\": { \"for_s\": 9 }", "detect.alarm.motor.brake",
         "object|above|below", NULL},
        {"\"above\": 0.25", "\"above\": \"0.25\"", "detect.alarm.motor.x[1].bias.above", "\"0.25\"|number", NULL},
        {"\"below\": -0.5", "\"below\": 0.25", "detect.alarm.motor.x[1].bias.above", "0.25|more than below", NULL},
        {"\"for_s\": 90", "\"for_s\": 0", "detect.alarm.motor.x[1].bias.for_s", "0|> 0|1000000000", NULL},
        {"\"for_s\": 90", "\"fors\": 90", "detect.alarm.motor.x[1].bias.fors", "unknown|\"fors\"|\"for_s\"", NULL},
        {"\"priority\": 0", "\"priority\": 99", "realtime.priority", "99|0|98", NULL},
        {"\"priority\": 0", "\"priority\": -1", "realtime.priority", "-1|0|98", NULL},
        {"\"lock_memory\": false", "\"lock_memory\": 1", "realtime.lock_memory", "1|true|false", NULL},
        {"\"hang_s\": 1.5", "\"hang_s\": 0", "realtime.hang_s", "0|0.1|3600", NULL},
        {"\"lock_memory\": false", "\"lockmemory\": true", "realtime.lockmemory",
         "unknown|\"lockmemory\"|\"lock_memory\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_emulate(void) {
    static const tl_test_change changes[] = {
        {"\"from\": \"motor.omega\", ", "", "emulate.columns.omega.from", "\"motor.omega\"", NULL},
        {"\"from\": \"motor.omega\"", "\"from\": \"moto.omega\"", "emulate.columns.omega.from",
         "\"moto.omega\"|\"motor.omega\"", NULL},
        {"\"from\": \"plant.torque\"", "\"from\": \"plant.Torqe\"", "emulate.columns.M_w.from",
         "\"plant.Torqe\"|\"plant.torque\"", NULL},
        {"\"noise\": 0.01", "\"noise\": -0.01", "emulate.columns.omega.noise", "-0.01|0", NULL},
        {"\"M_w\": { \"from\": \"plant.torque\" }", "\"M_w\": \"plant.torque\"", "emulate.columns.M_w",
         "\"plant.torque\"|object", NULL},
        {"\"M_w\": { \"from\": \"plant.torque\" }", "\"\": { \"from\": \"plant.torque\" }", "emulate.columns.",
         "column|\"omega\"", NULL},
        {"[0.005, 0.02]", "[0.02, 0.005]", "emulate.message_s", "array|2|> 0|1e9|[0.005, 0.02]", NULL},
        {"[0.005, 0.02]", "[0, 0.005]", "emulate.message_s", "array|2|> 0|1e9|[0.005, 0.02]", NULL},
        {"[0.005, 0.02]", "[0.005]", "emulate.message_s", "array|1|> 0|1e9|[0.005, 0.02]", NULL},
        {"[0.005, 0.02]", "0.005", "emulate.message_s", "0.005|array|> 0|1e9|[0.005, 0.02]", NULL},
        {"[0.005, 0.02]", "[0.005, \"0.02\"]", "emulate.message_s", "array|2|> 0|1e9|[0.005, 0.02]", NULL},
        {"\"message_s\": [", "\"message\": [", "emulate.message", "unknown|\"message\"|\"message_s\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_delays(void) {
    static const tl_test_change changes[] = {
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 0 }", "delays.participants.bus.cycle_s",
         "0|> 0|3600", NULL},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": {}", "delays.participants.bus.cycle_s", "> 0|3600", NULL},
        {"\"dead_s\": 0.01,", "\"dead_s\": -1,", "delays.participants.device.dead_s", "-1|0|3600", NULL},
        {"\"dead_s\": 0.01,", "\"dead\": 0.01,", "delays.participants.device.dead", "unknown|\"dead\"|\"dead_s\"",
         NULL},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 0.008 }, \"a b\": { \"cycle_s\": 1 }",
         "delays.participants.a b", "\"a b\"|63|letters", NULL},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 0.008 }, \"io\": 1", "delays.participants.io",
         "1|object", NULL},
        {"[[\"acquisition\", \"twin\"]]", "[[\"acquisition\"]]", "delays.synchronous[0]",
         "array|1|participants|[\"acquisition\", \"simulation\"]", NULL},
        {"[[\"acquisition\", \"twin\"]]", "\"twin\"", "delays.synchronous",
         "\"twin\"|array|[[\"acquisition\", \"simulation\"]]", NULL},
        {"[[\"acquisition\", \"twin\"]]", "[[\"acquisition\", \"twins\"]]", "delays.synchronous[0][1]",
         "\"twins\"|participant|bus|device|acquisition|twin", NULL},
        {"[[\"acquisition\", \"twin\"]]", "[[\"acquisition\", \"twin\"], [\"bus\", \"twin\"]]",
         "delays.synchronous[1][1]", "\"twin\"|participant|group", NULL},
        {"{ \"plant\": [\"bus\", \"device\"], ", "{ ", "delays.input.plant", "array|1|16|participants", NULL},
        {"[\"bus\", \"device\"]", "[]", "delays.input.plant", "array|0|1|16|participants", NULL},
        {"[\"bus\", \"device\"]", "[\"bus\", 5]", "delays.input.plant[1]", "5|participant|bus|device|acquisition|twin",
         NULL},
        {"[\"bus\", \"device\", \"bus\"]",
         "[\"bus\", \"device\", \"bus\", \"device\", \"bus\", \"device\", \"bus\", \"device\", \"bus\"]",
         "delays.output.plant", "7|chain|participants", NULL},
        {"\"dead_s\": 0.01,", "\"dead_s\": 0.01, \"delay_s\": 1,", "delays.participants.device.delay_s",
         "unknown|\"delay_s\"|\"dead_s\"", NULL},
        {"\"acquisition\": { \"dead_s\": 0.004", "\"acquisition\": { \"dead_s\": 12", "delays.input",
         "12.0079 s|1000|step_s|10 s", "\"input\": { \"plant\""},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 10 }", "delays.output",
         "19.9959 s|cycle|1000|step_s|10 s", "\"output\": { \"plant\""},
        {"\"synchronous\": [[", "\"synchronus\": [[", "delays.synchronus", "unknown|\"synchronus\"|\"synchronous\"",
         NULL},
    };
    EXPECT_EACH(full, changes);
}

/* The message lists the names of participants: an array has none. */
static void test_participants_without_names(void) {
    char *changed = tl_test_replaced(full, "\"participants\": {", "\"participants\": [5], \"odd\": {");
    TEST_ASSERT_NOT_NULL(changed);
    tl_test_judge_text(changed, strlen(changed), &verdict);
    free(changed);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, verdict.status);
    TEST_ASSERT_EQUAL_STRING("delays.participants", verdict.problems[0].where);
}

static void test_delays_of_other_kinds(void) {
    static const tl_test_change changes[] = {
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"participants\": {\"bus\": {\"cycle_s\": 1}}}", "delays",
         "\"input\"|\"output\"|\"measure\"", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"output\": true}", "delays.output",
         "true|object|seconds|chains", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"input\": 1e10}", "delays.input",
         "10000000000|-1000000000|1000000000", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"input\": 101}", "delays.input", "101 s|1000|step_s|100 s",
         NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": 5", "delays", "5|object|\"measure\"", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": \"estimate\"", "delays", "\"estimate\"|object|\"measure\"",
         NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": false}", "delays.measure", "false|true|object",
         NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": {\"range_s\": 0}}", "delays.measure.range_s",
         "0|> 0|1e9", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": {\"range_s\": 3.2}}", "delays.measure.range_s",
         "3.2|31|step_s|3.1 s", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": true, \"take\": \"nearest\"}", "delays.take",
         "\"nearest\"|\"next\"|\"newest\"", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": true, \"mesure\": 1}", "delays.mesure",
         "unknown|\"mesure\"|\"measure\"", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

/* Delays are checked against the step. If the step is wrong, only the step is reported. */
static void test_delays_without_a_step(void) {
    static const tl_test_change changes[] = {
        {"\"step_s\": 0.1", "\"delays\": \"measure\"", "step_s", "1e-05|3600", "{"},
        {"\"step_s\": 0.1", "\"step_s\": 0, \"delays\": \"measure\"", "step_s", "0|1e-05|3600", NULL},
        {"\"step_s\": 0.1", "\"step_s\": \"0.1\", \"delays\": \"measure\"", "step_s", "\"0.1\"|1e-05|3600", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0, \"delays\": {\"measure\": true, \"input\": 0.5}", "step_s", "0|1e-05|3600",
         NULL},
    };
    EXPECT_EACH(free_running, changes);
}

/* Interpolation needs a Real signal that feeds an input or is matched, and the longest interval
 * between two readings. */
static void test_between_readings(void) {
    static const tl_test_change changes[] = {
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"linear\"", "plant.torque.between",
         "\"linear\"|\"last\"|\"line\"|\"mean\"", NULL},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"every_s\": 0", "plant.torque.every_s", "0|> 0|1e9", NULL},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"line\", \"every_s\": 0", "plant.torque.every_s",
         "0|> 0|1e9", NULL},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"line\"", "plant.torque.every_s",
         "longest|reading|0.04", "\"torque\": {"},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"mean\", \"every_s\": 10.5", "plant.torque.every_s",
         "10.5|1000|step_s", NULL},
        {"\"current\": {}", "\"current\": { \"between\": \"mean\", \"every_s\": 0.04 }", "plant.current.between",
         "signal|input|\"to\"", NULL},
        {"\"huber\": 3, \"between\": \"last\"", "\"huber\": 3, \"between\": \"mean\"",
         "synchronise.match.motor.omega.between", "\"mean\"|\"last\"|\"line\"", NULL},
        {"\"huber\": 3, \"between\": \"last\"", "\"huber\": 3, \"between\": \"line\"", "plant.omega.every_s",
         "longest|reading|0.04", "\"omega\": { \"unit\""},
        {"{ \"to\": \"plant.current\", \"weight\": 0 }",
         "{ \"to\": \"plant.stage\", \"weight\": 0, \"between\": \"line\" }", "synchronise.match.motor.I.between",
         "\"line\"|\"last\"|Integer|Boolean", NULL},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        char *lagging = tl_test_replaced(full, "\"measurements\": \"ahead\"", "\"measurements\": \"lag\"");
        tl_test_expect_problems(lagging, &changes[i], 1);
        free(lagging);
    }
}

/* All matches of a signal share one condition, and its delay is limited. */
static void test_conditions_that_do_not_fit(void) {
    static const tl_test_change changes[] = {
        {"{ \"to\": \"plant.current\", \"weight\": 0 }",
         "{ \"to\": \"plant.omega\", \"weight\": 0, \"condition\": { \"gate\": 3 } }",
         "synchronise.match.motor.I.condition", "condition|same signal", NULL},
        {"{ \"to\": \"plant.current\", \"weight\": 0 }",
         "{ \"to\": \"plant.stage\", \"weight\": 0, \"condition\": { \"low_pass_s\": 1 } }",
         "synchronise.match.motor.I.condition", "low-pass|Real|\"median\"|\"gate\"", NULL},
        {"\"omega\": { \"unit\": \"rad/s\", ", "\"omega\": { \"unit\": \"rad/s\", \"every_s\": 5, ",
         "synchronise.match.motor.omega.condition", "1000|step_s|median|low-pass|every_s", "\"condition\": {"},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        char *lagging = tl_test_replaced(full, "\"measurements\": \"ahead\"", "\"measurements\": \"lag\"");
        tl_test_expect_problems(lagging, &changes[i], 1);
        free(lagging);
    }
}

/* The component with keep "outputs" excludes a free twin as well. Only the first reason is
 * reported. */
static void test_no_free_twin(void) {
    static const tl_test_change changes[] = {
        {"\"measurements\": \"ahead\"",
         "\"measurements\": \"lag\", \"event\": {\"start\": \"plant.running\", \"end\": \"plant.running\", "
         "\"window_s\": 0.1, \"longest_s\": 2}",
         "synchronise.free_twin", "true|false|horizon.event", "\"free_twin\""},
    };
    char *led = tl_test_replaced(full, "\"free_twin\": false", "\"free_twin\": true");
    char *short_of = tl_test_replaced(led, "\"prediction\": 2, \"shape\": \"dynamic\", ", "");
    char *raw = tl_test_replaced(short_of, "{ \"median\": 5, \"low_pass_s\": 0.03, \"gate\": 45 }", "{}");
    tl_test_expect_problems(raw, &changes[0], 1);
    free(raw);
    free(short_of);
    free(led);
}

/* 62 signals, of which three need a second lookup: 65 of at most 64. */
static void test_too_many_lookups(void) {
    enum { SIGNALS = 62, ROOM = 16384 };
    char text[ROOM];
    size_t used = (size_t)snprintf(text, ROOM,
                                   "{\"twinlock\": 1, \"name\": \"x\", \"step_s\": 0.01,\n\"components\": "
                                   "{\"a\": {\"fmu\": \"lag.fmu\"}}, \"plant\": {\"s0\": {}");
    for (int i = 1; i < SIGNALS; i++) {
        used += (size_t)snprintf(text + used, ROOM - used, ", \"s%d\": {}", i);
    }
    (void)snprintf(
        text + used, ROOM - used,
        "},\n\"connect\": [[\"plant.s0\", \"a.u\"], [\"plant.s1\", \"a.v\"], [\"plant.s2\", \"a.w\"]],\n\"compare\": {\"a.y\": "
        "{\"to\": \"plant.s0\"}, \"a.z\": {\"to\": \"plant.s1\"}, \"a.q\": {\"to\": \"plant.s2\"}},\n\"delays\": {\"participants\": "
        "{\"bus\": {\"cycle_s\": 0.01}}, \"output\": {\"plant\": [\"bus\"], \"simulation\": [\"bus\"]}}}");
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_STRING("delays", verdict.problems[0].where);
    TL_EXPECT_PARTS("line 5|62 signals|3|64|\"between\"|\"condition\"", verdict.problems[0].text);
}

static void test_doubled_keys(void) {
    static const tl_test_change changes[] = {
        {"\"step_s\": 0.01", "\"step_s\": 0.01, \"step\\u005fs\": 0.02", "", "\"step_s\"|line 4", NULL},
        {"\"unit\": \"N.m\"", "\"unit\": \"N.m\", \"unit\": \"N.m\"", "", "\"unit\"|line 27", NULL},
    };
    EXPECT_EACH(full, changes);
}

/* ---- several at once ---- */

static const char *message_at(const char *where) {
    for (size_t i = 0; i < verdict.count && i < TL_TEST_PROBLEMS; i++) {
        if (strcmp(verdict.problems[i].where, where) == 0) {
            return verdict.problems[i].text;
        }
    }
    TEST_FAIL_MESSAGE(where);
    return NULL;
}

static void expect_problem(const char *where, const char *parts) {
    const char *message = message_at(where);
    TL_EXPECT_PARTS(parts, message);
}

static void test_everything_at_once(void) {
    static const char *const text = "{\n\"twinlock\": 2,\n\"step_s\": \"0.01\",\n\"step_s\": 0.01,\n"
                                    "\"components\": {\"plant\": 1, \"motor\": {}},\n\"plant\": {\"1\": {\"min\": "
                                    "2,\n\"max\": 1}},\n\"Name\": \"x\"}";
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, verdict.status);
    expect_problem("", "line 4|\"step_s\"");
    expect_problem("twinlock", "line 2|2|1");
    expect_problem("name", "line 1|\"motor bench\"");
    expect_problem("components.motor.fmu", "line 5|\"motor.fmu\"");
    expect_problem("components.plant", "line 5|\"plant\"");
    expect_problem("plant.1", "line 6|\"1\"");
    expect_problem("plant.1.max", "line 7|1|min|2");
    expect_problem("Name", "line 8|unknown|\"Name\"|\"name\"");
    TEST_ASSERT_EQUAL_size_t(10, verdict.count);
}

/* Inserts `count` entries NAME0, NAME1, … after `opening` and returns the number of problems. */
static size_t problems_with_entries(const char *base, const char *opening, const char *name, const char *value,
                                    size_t count) {
    char added[8192];
    size_t used = (size_t)snprintf(added, sizeof added, "%s", opening);
    for (size_t i = 0; i < count; i++) {
        used += (size_t)snprintf(added + used, sizeof added - used, "\"%s%zu\": %s, ", name, i, value);
    }
    char *text = tl_test_replaced(base, opening, added);
    TEST_ASSERT_NOT_NULL_MESSAGE(text, opening);
    tl_test_judge_text(text, strlen(text), &verdict);
    tl_config_free(&verdict.config);
    free(text);
    return verdict.count;
}

static void test_the_most_entries(void) {
    static const struct {
        const char *opening, *name, *value, *where;
        size_t there, most;
    } maps[] = {
        {"\"components\": {", "c", "{\"fmu\": \"x\"}", "components", 2, 62},
        {"\"sources\": {", "s", "{\"csv\": {\"file\": \"x\"}}", "sources", 6, 64},
        {"\"plant\": {", "p", "{}", "plant", 8, 64},
        {"\"adjust\": {", "motor.a", "{\"step\": 1}", "synchronise.adjust", 3, 8},
        {"\"match\": {", "motor.m", "{\"to\": \"plant.omega\", \"weight\": 0}", "synchronise.match", 2, 64},
        {"\"columns\": {", "c", "{\"from\": \"motor.x\"}", "emulate.columns", 2, 64},
        {"\"compare\": {", "motor.m", "{\"to\": \"plant.omega\"}", "compare", 1, 64},
    };
    for (size_t i = 0; i < sizeof maps / sizeof maps[0]; i++) {
        char expected[32];
        const char *base = strcmp(maps[i].where, "compare") == 0 ? free_running : full;
        size_t room = maps[i].most - maps[i].there;
        (void)snprintf(expected, sizeof expected, "%zu|%zu", maps[i].most + 1, maps[i].most);
        TEST_ASSERT_EQUAL_size_t(0, problems_with_entries(base, maps[i].opening, maps[i].name, maps[i].value, room));
        TEST_ASSERT_EQUAL_size_t(1,
                                 problems_with_entries(base, maps[i].opening, maps[i].name, maps[i].value, room + 1));
        expect_problem(maps[i].where, expected);
    }
}

static void test_syntax_comes_alone(void) {
    static const char *const text = "{\"twinlock\": 2,\n \"step_s\": 01}";
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].where);
    TL_EXPECT_PARTS("line 2|column 12|01|number|JSON", verdict.problems[0].text);
}

/* A section that is not an object is reported once. References into it are not reported. */
static void test_broken_sections_are_reported_once(void) {
    static const struct {
        const char *old, *new, *where, *parts;
    } sections[] = {
        {"\"sources\": {", "\"sources\": [], \"x\": {", "sources", "array|0|object"},
        {"\"plant\": {", "\"plant\": [1, 2], \"x\": {", "plant", "array|2|object"},
        {"\"components\": {", "\"components\": \"\", \"x\": {", "components", "\"\"|object"},
    };
    for (size_t i = 0; i < sizeof sections / sizeof sections[0]; i++) {
        char *text = tl_test_replaced(full, sections[i].old, sections[i].new);
        TEST_ASSERT_NOT_NULL(text);
        tl_test_judge_text(text, strlen(text), &verdict);
        free(text);
        TEST_ASSERT_EQUAL_size_t(2, verdict.count);
        expect_problem(sections[i].where, sections[i].parts);
        expect_problem("x", "unknown|\"x\"");
    }
}

static void expect_root_problem(const char *text, const char *parts) {
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].where);
    TL_EXPECT_PARTS(parts, verdict.problems[0].text);
}

static void test_roots_that_are_not_objects(void) {
    expect_root_problem("[]", "line 1|array|0|object");
    expect_root_problem("\"x\"", "line 1|\"x\"|object");
    expect_root_problem("null", "line 1|null|object");
    expect_root_problem("1.5", "line 1|1.5|object");
}

static void test_missing_sections(void) {
    tl_test_judge_text("{}", 2, &verdict);
    TEST_ASSERT_EQUAL_size_t(5, verdict.count);
    expect_problem("twinlock", "line 1|1|version");
    expect_problem("name", "line 1|\"motor bench\"");
    expect_problem("step_s", "line 1|1e-05|3600");
    expect_problem("components", "line 1|object|1|62");
    expect_problem("plant", "line 1|object|1|64");
}

/* Messages and paths contain no control characters, whatever the file holds. */
static void test_hostile_texts_are_escaped(void) {
    static const char *const text =
        "{\"\\u001b[31m\": 1, \"\\u202e\": 1, \"\\u2028\": 2, \"components\": {\"\\u009b\": {\"\\r\": 1}}, \"connect\": [[\"\\u001b.x\", \"\\n\"]],"
        "\"name\": \"\\u0007\", \"plant\": {\"\\u007f\": {\"csv\": {\"source\": \"\\b\"}}},"
        "\"synchronise\": {\"adjust\": {\"\\t.x\": {}}, \"match\": {\"\\f\": {\"to\": \"plant.\\u0001\"}}},"
        "\"emulate\": {\"columns\": {\"\\u0002\": {\"from\": \"\\u0003\"}}}}";
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, verdict.status);
    TEST_ASSERT_GREATER_THAN_size_t(15, verdict.count);
    for (size_t i = 0; i < verdict.count && i < TL_TEST_PROBLEMS; i++) {
        TEST_ASSERT_TRUE_MESSAGE(tl_text_is_plain(verdict.problems[i].text), verdict.problems[i].text);
        TEST_ASSERT_TRUE_MESSAGE(tl_text_is_plain(verdict.problems[i].where), verdict.problems[i].text);
    }
}

static void test_a_long_text_is_cut(void) {
    char new[600];
    char name[300];
    memset(name, 'n', sizeof name);
    name[sizeof name - 1] = '\0';
    (void)snprintf(new, sizeof new, "\"%s\": 1, \"name\": \"x\"", name);
    char *text = tl_test_replaced(full, "\"name\": \"motor bench\"", new);
    TEST_ASSERT_NOT_NULL(text);
    tl_test_judge_text(text, strlen(text), &verdict);
    free(text);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_size_t(TL_JSON_PATH - 1, strlen(verdict.problems[0].where));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(verdict.problems[0].text, "nnnn…\""), verdict.problems[0].text);
    TL_EXPECT_PARTS("twinlock|name|step_s|duration_s|components|sources|plant|recording|connect|compare|synchronise|"
                    "delays|record|realtime|emulate",
                    verdict.problems[0].text);
}

/* As many wrong references with the longest names as a file can hold. Each one starts a search for
 * the nearest name. */
static void test_a_hostile_file_is_rejected_soon(void) {
    enum { COMMON = 59, SIGNALS = 64 };
    char *text = malloc(TL_CONFIG_MAX_BYTES);
    char common[COMMON + 1];
    TEST_ASSERT_NOT_NULL(text);
    memset(common, 'a', COMMON);
    common[COMMON] = '\0';
    size_t used = (size_t)snprintf(text, TL_CONFIG_MAX_BYTES, "{\"plant\":{");
    for (size_t i = 0; i < SIGNALS; i++) {
        used +=
            (size_t)snprintf(text + used, TL_CONFIG_MAX_BYTES - used, "%s\"%s%04zx\":{}", i == 0 ? "" : ",", common, i);
    }
    used += (size_t)snprintf(text + used, TL_CONFIG_MAX_BYTES - used, "},\"connect\":[[\"\",\"\"]");
    while (used + 2 * COMMON < TL_CONFIG_MAX_BYTES) {
        used += (size_t)snprintf(text + used, TL_CONFIG_MAX_BYTES - used, ",[\"plant.%szzzz\",\"\"]", common);
    }
    used += (size_t)snprintf(text + used, TL_CONFIG_MAX_BYTES - used, "]}");
    clock_t start = clock();
    tl_test_judge_text(text, used, &verdict);
    double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    free(text);
    TEST_ASSERT_GREATER_THAN_size_t(6000, verdict.count);
    TEST_ASSERT_NOT_NULL(strstr(message_at("connect[1][0]"), " aaaaaaaa")); /* listed signals */
    TEST_ASSERT_TRUE(seconds < 30); /* 1 s with sanitizers, minutes without limits of the search */
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_root);
    RUN_TEST(test_components);
    RUN_TEST(test_sources);
    RUN_TEST(test_signals);
    RUN_TEST(test_live_sources);
    RUN_TEST(test_live_sources_where_there_are_none);
    RUN_TEST(test_a_serial_line);
    RUN_TEST(test_gpio);
    RUN_TEST(test_modbus);
    RUN_TEST(test_connections);
    RUN_TEST(test_connections_that_are_no_array);
    RUN_TEST(test_compare);
    RUN_TEST(test_compare_beside_synchronise);
    RUN_TEST(test_adjust);
    RUN_TEST(test_match);
    RUN_TEST(test_the_rest_of_synchronise);
    RUN_TEST(test_condition);
    RUN_TEST(test_epsilon);
    RUN_TEST(test_limits_and_saving);
    RUN_TEST(test_unknown_solvers);
    RUN_TEST(test_synchronise_without_its_parts);
    RUN_TEST(test_running);
    RUN_TEST(test_emulate);
    RUN_TEST(test_delays);
    RUN_TEST(test_participants_without_names);
    RUN_TEST(test_delays_of_other_kinds);
    RUN_TEST(test_delays_without_a_step);
    RUN_TEST(test_between_readings);
    RUN_TEST(test_conditions_that_do_not_fit);
    RUN_TEST(test_no_free_twin);
    RUN_TEST(test_too_many_lookups);
    RUN_TEST(test_doubled_keys);
    RUN_TEST(test_everything_at_once);
    RUN_TEST(test_syntax_comes_alone);
    RUN_TEST(test_broken_sections_are_reported_once);
    RUN_TEST(test_roots_that_are_not_objects);
    RUN_TEST(test_missing_sections);
    RUN_TEST(test_hostile_texts_are_escaped);
    RUN_TEST(test_a_long_text_is_cut);
    RUN_TEST(test_a_hostile_file_is_rejected_soon);
    RUN_TEST(test_the_most_entries);
    return UNITY_END();
}
