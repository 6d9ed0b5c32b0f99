/* What the reader says about a configuration that is wrong: one change to a valid one, one problem, its exact words. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <unity.h>

#include "firmware/base/json.h"
#include "firmware/config/json_document.h"
#include "master/solve/optimiser.h"
#include "tests/support/config_text.h"

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
        {"\"twinlock\": 1", "\"twinlock\": 2", "twinlock",
         "found 2 (number), expected 1, the version of the format that this program reads, for example \"twinlock\": 1",
         NULL},
        {"\"twinlock\": 1", "\"twinlock\": \"1\"", "twinlock",
         "found \"1\" (text), expected 1, the version of the format that this program reads, for example \"twinlock\": 1",
         NULL},
        {"\"twinlock\": 1", "\"twinlock\": true", "twinlock",
         "found true, expected 1, the version of the format that this program reads, for example \"twinlock\": 1",
         NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"\"", "name",
         "found \"\" (text), expected a text that is not empty, for example \"motor bench\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": 5", "name",
         "found 5 (number), expected a text, for example \"motor bench\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"a\\u001b[31m\"", "name",
         "found \"a\\x1B[31m\" (text), expected a text without control characters, for example \"motor bench\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"a\\u202eb\"", "name",
         "found \"a\\u{202E}b\" (text), expected a text without control characters, for example \"motor bench\"", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 9e-6", "step_s",
         "found 9e-06 (number), expected a number from 1e-05 to 3600, for example 0.01", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 3600.5", "step_s",
         "found 3600.5 (number), expected a number from 1e-05 to 3600, for example 0.01", NULL},
        {"\"step_s\": 0.01", "\"step_s\": \"0.01\"", "step_s",
         "found \"0.01\" (text), expected a number from 1e-05 to 3600, for example 0.01", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 0.0100000001", "step_s",
         "found 0.0100000001 (number), expected a whole number of nanoseconds, for example 0.01", NULL},
        {"\"step_s\": 0.01", "\"step_s\": 3599.0000000005", "step_s",
         "found 3599.0000000005 (number), expected a whole number of nanoseconds, for example 0.01", NULL},
        {"\"duration_s\": 14", "\"duration_s\": 0", "duration_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 14", NULL},
        {"\"duration_s\": 14", "\"duration_s\": 1.1e9", "duration_s",
         "found 1100000000 (number), expected a number > 0 (at most 1e9), for example 14", NULL},
        {"\"duration_s\": 14", "\"duration_s\": null", "duration_s",
         "found null, expected a number > 0 (at most 1e9), for example 14", NULL},
        {"\"record\": {", "\"Record\": {", "Record", "found the unknown key \"Record\", expected \"record\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"motor bench\", \"nmae\": 1", "nmae",
         "found the unknown key \"nmae\", expected \"name\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"motor bench\", \"nam\": 1", "nam",
         "found the unknown key \"nam\", expected \"name\"", NULL},
        {"\"name\": \"motor bench\"", "\"name\": \"motor bench\", \"title\": 1", "title",
         "found the unknown key \"title\", expected one of twinlock, name, step_s, duration_s, components, sources, plant, recording, connect, compare, synchronise, delays, record, realtime, emulate, $schema",
         NULL},
        {"\"$schema\": \"../../config/schema/twinlock-1.json\"", "\"$schema\": 1", "$schema",
         "found 1 (number), expected a text, for example \"twinlock-1.json\"", NULL},
        {"\"$schema\": \"../../config/schema/twinlock-1.json\"", "\"schema\": \"twinlock-1.json\"", "schema",
         "found the unknown key \"schema\", expected \"$schema\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_components(void) {
    static const tl_test_change changes[] = {
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": {}", "components.drive.fmu",
         "found nothing, expected a text, for example \"motor.fmu\"", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": \"drive.fmu\"", "components.drive",
         "found \"drive.fmu\" (text), expected an object, for example {\"fmu\": \"motor.fmu\"}", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": { \"fmu\": \"drive.fmu\", \"sets\": {} }",
         "components.drive.sets", "found the unknown key \"sets\", expected \"set\"", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": { \"fmu\": \"drive.fmu\" }, \"2nd\": { \"fmu\": \"x\" }",
         "components.2nd",
         "found the name \"2nd\", expected at most 63 letters, digits and _, no digit first, for example \"motor\"",
         NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }",
         "\"drive\": { \"fmu\": \"drive.fmu\" }, \"dr ive\": { \"fmu\": \"x\" }", "components.dr ive",
         "found the name \"dr ive\", expected at most 63 letters, digits and _, no digit first, for example \"motor\"",
         NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }", "\"drive\": { \"fmu\": \"drive.fmu\" }, \"\": { \"fmu\": \"x\" }",
         "components.",
         "found the name \"\", expected at most 63 letters, digits and _, no digit first, for example \"motor\"", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }",
         "\"drive\": { \"fmu\": \"drive.fmu\" }, \"plant\": { \"fmu\": \"x\" }", "components.plant",
         "found the name \"plant\", expected another: that name means the plant itself, for example \"motor\"", NULL},
        {"\"drive\": { \"fmu\": \"drive.fmu\" }",
         "\"drive\": { \"fmu\": \"drive.fmu\" }, \"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\": { \"fmu\": \"x\" }",
         "components.aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
         "found the name \"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa…\", expected at most 63 letters, digits and _, no digit first, for example \"motor\"",
         NULL},
        {"\"keep\": \"outputs\"", "\"keep\": \"nothing\"", "components.motor.keep",
         "found \"nothing\" (text), expected \"states\" or \"outputs\", for example \"states\"", NULL},
        {"\"keep\": \"outputs\"", "\"keep\": true", "components.motor.keep",
         "found true, expected \"states\" or \"outputs\", for example \"states\"", NULL},
        {"\"keep\": \"outputs\"", "\"keeps\": \"outputs\"", "components.motor.keeps",
         "found the unknown key \"keeps\", expected \"keep\"", NULL},
        {"\"rollback\": \"memory\"", "\"rollback\": \"copy\"", "components.motor.rollback",
         "found \"copy\" (text), expected \"auto\", \"state\", \"memory\" or \"replay\", for example \"auto\"", NULL},
        {"[\"libpython3.11.so.1.0\", \"lib/solver.so\"]", "\"libpython3.11.so.1.0\"", "components.motor.libraries",
         "found \"libpython3.11.so.1.0\" (text), expected an array of names of shared libraries, for example "
         "[\"libpython3.11.so.1.0\"]",
         NULL},
        {"\"lib/solver.so\"", "5", "components.motor.libraries[1]",
         "found 5 (number), expected the name of a shared library, for example \"libpython3.11.so.1.0\"", NULL},
        {"\"lib/solver.so\"", "\"\"", "components.motor.libraries[1]",
         "found \"\" (text), expected the name of a shared library, for example \"libpython3.11.so.1.0\"", NULL},
        {"\"lib/solver.so\"", "\"lib\\tsolver.so\"", "components.motor.libraries[1]",
         "found \"lib\\tsolver.so\" (text), expected the name of a shared library, for example \"libpython3.11.so.1.0\"",
         NULL},
        {"\"logging\": true", "\"logging\": 1", "components.motor.logging",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"sha256\": \"9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08\"", "\"sha256\": \"9F86\"",
         "components.motor.sha256",
         "found \"9F86\" (text), expected 64 digits of 0 to 9 and a to f, as sha256sum prints them, for example "
         "\"9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08\"",
         NULL},
        {"\"J\": 0.0515", "\"J\": [1]", "components.motor.set.J",
         "found an array of 1, expected a number, true, false or a text, for example 0.0515", NULL},
        {"\"J\": 0.0515", "\"J\": null", "components.motor.set.J",
         "found null, expected a number, true, false or a text, for example 0.0515", NULL},
        {"\"J\": 0.0515", "\"\": 1", "components.motor.set.",
         "found an unusable name, expected the name of a variable of the FMU, for example \"J\"", NULL},
        {"\"set\": { \"J\": 0.0515, \"poles\": 4, \"warm\": true, \"label\": \"\" }", "\"set\": 1",
         "components.motor.set", "found 1 (number), expected an object, for example {\"J\": 0.0515}", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_sources(void) {
    static const tl_test_change changes[] = {
        {"\"gateway\": { \"modbus_tcp\": { \"host\": \"plc.example\" } }",
         "\"gateway\": { \"modbus_tcp\": { \"host\": \"plc.example\" } }, \"odd\": {}", "sources.odd",
         "found none of csv, modbus_tcp, modbus_rtu, can, gpio, expected exactly one of csv, modbus_tcp, modbus_rtu, can, gpio, for example {\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}",
         NULL},
        {"\"stream\": { \"csv\": {", "\"stream\": { \"modbus_tcp\": { \"host\": \"x\" }, \"csv\": {", "sources.stream",
         "found csv and modbus_tcp, expected exactly one of csv, modbus_tcp, modbus_rtu, can, gpio, for example {\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}",
         NULL},
        {"{ \"host\": \"plc.example\" }", "{}", "sources.gateway.modbus_tcp.host",
         "found nothing, expected a text, for example \"192.0.2.10\"", NULL},
        {"{ \"host\": \"plc.example\" }", "{ \"host\": \"plc.example\", \"hosts\": 1 }",
         "sources.gateway.modbus_tcp.hosts", "found the unknown key \"hosts\", expected \"host\"", NULL},
        {"\"port\": 1502", "\"port\": 0", "sources.plc.modbus_tcp.port",
         "found 0 (number), expected a whole number from 1 to 65535, for example 502", NULL},
        {"\"port\": 1502", "\"port\": 65536", "sources.plc.modbus_tcp.port",
         "found 65536 (number), expected a whole number from 1 to 65535, for example 502", NULL},
        {"\"port\": 1502", "\"port\": 1.5", "sources.plc.modbus_tcp.port",
         "found 1.5 (number), expected a whole number from 1 to 65535, for example 502", NULL},
        {"\"any_unit_id\": true", "\"any_unit_id\": 1", "sources.plc.modbus_tcp.any_unit_id",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"any_unit_id\": true", "\"any_unit\": true", "sources.plc.modbus_tcp.any_unit",
         "found the unknown key \"any_unit\", expected one of host, port, any_unit_id, timeout_s, period_s", NULL},
        {"\"period_s\": 0.02", "\"period_s\": 0", "sources.plc.modbus_tcp.period_s",
         "found 0 (number), expected a number from 1e-05 to 3600, for example 0.1", NULL},
        {"\"timeout_s\": 0.25", "\"timeout_s\": 61", "sources.plc.modbus_tcp.timeout_s",
         "found 61 (number), expected a number from 0.001 to 60, for example 0.5", NULL},
        {"\"file\": \"plant.fifo\", ", "", "sources.stream.csv.file",
         "found nothing, expected a text, for example \"plant.fifo\"", NULL},
        {"\"time_column\": \"t\"", "\"time_column\": \"\"", "sources.stream.csv.time_column",
         "found \"\" (text), expected a text that is not empty, for example \"time\"", NULL},
        {"\"period_s\": 0.005", "\"period_s\": 3601", "sources.stream.csv.period_s",
         "found 3601 (number), expected a number from 1e-05 to 3600, for example 0.1", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_signals(void) {
    static const tl_test_change changes[] = {
        {"\"current\": {}", "\"current\": 1", "plant.current",
         "found 1 (number), expected an object, for example {\"unit\": \"rad/s\"}", NULL},
        {"\"current\": {}", "\"current\": { \"type\": \"float\" }", "plant.current.type",
         "found \"float\" (text), expected \"real\", \"integer\" or \"boolean\", for example \"real\"", NULL},
        {"\"current\": {}", "\"current\": { \"type\": \"bool\", \"initial\": true }", "plant.current.type",
         "found \"bool\" (text), expected \"real\", \"integer\" or \"boolean\", for example \"real\"", NULL},
        {"\"current\": {}", "\"current\": {}, \"1st\": {}", "plant.1st",
         "found the name \"1st\", expected at most 63 letters, digits and _, no digit first, for example \"omega\"",
         NULL},
        {"\"unit\": \"N.m\"", "\"unit\": 1", "plant.torque.unit",
         "found 1 (number), expected a text, for example \"rad/s\"", NULL},
        {"\"min\": -5", "\"min\": \"-5\"", "plant.torque.min", "found \"-5\" (text), expected a number, for example 0",
         NULL},
        {"\"min\": -5, \"max\": 5", "\"min\": 5, \"max\": -5", "plant.torque.max",
         "found -5 (number), expected at least min, which is 5", NULL},
        {"\"stale_s\": 0.1", "\"stale_s\": 0", "plant.torque.stale_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.1", NULL},
        {"\"stale_s\": 0.1", "\"stale\": 0.1", "plant.torque.stale",
         "found the unknown key \"stale\", expected \"stale_s\"", NULL},
        {"\"stale_s\": 0.1", "\"stale_s\": \"0.1\"", "plant.torque.stale_s",
         "found \"0.1\" (text), expected a number > 0 (at most 1e9), for example 0.1", NULL},
        {"\"initial\": 0.5", "\"initial\": true", "plant.torque.initial",
         "found true, expected a number, for example 0.5", NULL},
        {"\"initial\": true", "\"initial\": 1", "plant.running.initial",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"initial\": 3", "\"initial\": 3.5", "plant.stage.initial",
         "found 3.5 (number), expected a whole number from -2147483647 to 2147483647, for example 3", NULL},
        {"\"initial\": 3", "\"initial\": -2147483648", "plant.stage.initial",
         "found -2147483648 (number), expected a whole number from -2147483647 to 2147483647, for example 3", NULL},
        {"\"csv\": { \"column\": \"M_w\" }", "\"csv\": \"M_w\"", "plant.torque.csv",
         "found \"M_w\" (text), expected an object, for example {\"column\": \"omega\"}", NULL},
        {"\"csv\": { \"column\": \"M_w\" }", "\"csv\": { \"columns\": \"M_w\" }", "plant.torque.csv.columns",
         "found the unknown key \"columns\", expected \"column\"", NULL},
        {"\"column\": \"M_w\"", "\"column\": 1", "plant.torque.csv.column",
         "found 1 (number), expected a text, for example \"omega\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_live_sources(void) {
    static const tl_test_change changes[] = {
        {"\"source\": \"stream\"", "\"source\": \"steam\"", "plant.omega.csv.source",
         "found \"steam\" (text), expected the name of a csv source: one of stream", NULL},
        {"\"source\": \"stream\"", "\"source\": \"plc\"", "plant.omega.csv.source",
         "found \"plc\" (text), expected the name of a csv source: one of stream", NULL},
        {"\"source\": \"gateway\"", "\"source\": \"stream\"", "plant.running.modbus.source",
         "found \"stream\" (text), expected the name of a modbus_tcp or modbus_rtu source: one of plc, gateway, bus",
         NULL},
        {"\"source\": \"gateway\"", "\"source\": \"nobody\"", "plant.running.modbus.source",
         "found \"nobody\" (text), expected the name of a modbus_tcp or modbus_rtu source: one of plc, gateway, bus",
         NULL},
        {"\"source\": \"gateway\"", "\"source\": 1", "plant.running.modbus.source",
         "found 1 (number), expected a text, for example \"plc\"", NULL},
        {"\"source\": \"gateway\", ", "", "plant.running.modbus.source",
         "found nothing, expected a text, for example \"plc\"", NULL},
        {"\"csv\": { \"column\": \"M_w\" },", "\"csv\": { \"source\": \"stream\" },", "plant.torque.modbus",
         "found modbus beside another live source, expected at most one live source", "\"modbus\": {\n"},
    };
    EXPECT_EACH(full, changes);
}

static void test_live_sources_where_there_are_none(void) {
    static const tl_test_change changes[] = {
        {"\"torque\": {}", "\"torque\": { \"csv\": { \"source\": \"x\" } }", "plant.torque.csv.source",
         "found \"x\" (text), expected the name of a csv source", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

static void test_a_serial_line(void) {
    static const char bauds[] =
        "one of 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 500000, 921600, "
        "1000000, for example 19200";
    static char odd[256];
    static char low[256];
    (void)snprintf(odd, sizeof odd, "found 9601 (number), expected %s", bauds);
    (void)snprintf(low, sizeof low, "found 300 (number), expected %s", bauds);
    const tl_test_change changes[] = {
        {"\"device\": \"ttyPLC\", ", "", "sources.bus.modbus_rtu.device",
         "found nothing, expected a text, for example "
         "\"/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0\"",
         "\"modbus_rtu\": {\n"},
        {"\"any\": {", "\"other\": { \"modbus_rtu\": { \"device\": \"ttyPLC\" } }, \"any\": {",
         "sources.other.modbus_rtu.device",
         "found the device of sources.bus, expected a line of its own: one source reads all units of a line", NULL},
        {"\"baud\": 38400", "\"baud\": 9601", "sources.bus.modbus_rtu.baud", odd, NULL},
        {"\"baud\": 38400", "\"baud\": 300", "sources.bus.modbus_rtu.baud", low, NULL},
        {"\"parity\": \"none\"", "\"parity\": \"N\"", "sources.bus.modbus_rtu.parity",
         "found \"N\" (text), expected \"even\", \"odd\" or \"none\", for example \"even\"", NULL},
        {"\"stop_bits\": 1", "\"stop_bits\": 1.5", "sources.bus.modbus_rtu.stop_bits",
         "found 1.5 (number), expected a whole number from 1 to 2, for example 1", NULL},
        {"\"rs485\": true", "\"rs485\": 1", "sources.bus.modbus_rtu.rs485",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"timeout_s\": 0.1", "\"timeout_s\": 0", "sources.bus.modbus_rtu.timeout_s",
         "found 0 (number), expected a number from 0.001 to 60, for example 0.5", NULL},
        {"\"rs485\": true", "\"data_bits\": 7", "sources.bus.modbus_rtu.data_bits",
         "found the unknown key \"data_bits\", expected one of device, baud, parity, stop_bits, rs485, timeout_s, period_s",
         NULL},
        {"\"unit_id\": 247", "\"unit_id\": 0", "plant.level.modbus.unit_id",
         "found 0 (number), expected a unit of a line, a whole number from 1 to 247, for example 1", NULL},
        {"\"unit_id\": 247", "\"unit_id\": 255", "plant.level.modbus.unit_id",
         "found 255 (number), expected a unit of a line, a whole number from 1 to 247, for example 1", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_gpio(void) {
    static const tl_test_change changes[] = {
        {"\"chip\": \"bench\"", "\"chip\": 0", "sources.box.gpio.chip",
         "found 0 (number), expected a text, for example \"gpiochip0\"", NULL},
        {"\"period_s\": 0.002", "\"timeout_s\": 1", "sources.box.gpio.timeout_s",
         "found the unknown key \"timeout_s\", expected one of chip, period_s", NULL},
        {"\"any\": { \"gpio\": {} }", "\"any\": { \"gpio\": 1 }", "sources.any.gpio",
         "found 1 (number), expected an object, for example {\"chip\": \"gpiochip0\"}", NULL},
        {"\"source\": \"any\"", "\"source\": \"plc\"", "plant.start.gpio.source",
         "found \"plc\" (text), expected the name of a gpio source: one of box, any", NULL},
        {"\"line\": \"START\"", "\"line\": 4", "plant.start.gpio.line",
         "found 4 (number), expected a text, for example \"START\"", NULL},
        {"\"line\": \"START\"", "\"line\": \"START\", \"offset\": 1", "plant.start.gpio",
         "found both line and offset, expected exactly one of them, for example {\"source\": \"box\", \"line\": \"START\"}",
         NULL},
        {"\"line\": \"START\", ", "", "plant.start.gpio",
         "found neither line nor offset, expected exactly one of them, for example {\"source\": \"box\", \"line\": "
         "\"START\"}",
         "\"gpio\": { \"source\": \"any\""},
        {"\"line\": \"START\"", "\"offset\": 1", "plant.start.gpio.offset",
         "found 1 (number), expected line, or a source with a chip", NULL},
        {"\"offset\": 5", "\"offset\": -1", "plant.stop.gpio.offset",
         "found -1 (number), expected a whole number from 0 to 65535, for example 3", NULL},
        {"\"active_low\": true", "\"active_low\": 1", "plant.start.gpio.active_low",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"bias\": \"none\"", "\"bias\": \"up\"", "plant.stop.gpio.bias",
         "found \"up\" (text), expected \"pull-up\", \"pull-down\" or \"none\", for example \"pull-up\"", NULL},
        {"\"debounce_s\": 0.004", "\"debounce_s\": -1", "plant.start.gpio.debounce_s",
         "found -1 (number), expected a number from 0 to 60, for example 0.01", NULL},
        {"\"source\": \"box\", \"offset\": 5", "\"source\": \"any\", \"line\": \"START\"", "plant.stop.gpio.line",
         "found the line of plant.start, expected a line that no other signal has: it can be requested once", NULL},
        {"\"current\": {},", "\"current\": { \"gpio\": { \"source\": \"box\", \"offset\": 5 } },",
         "plant.stop.gpio.offset",
         "found the line of plant.current, expected a line that no other signal has: it can be requested once",
         "\"offset\": 5, \"bias\""},
        {"\"csv\": { \"column\": \"omega\", \"source\": \"stream\" }",
         "\"csv\": { \"source\": \"stream\" }, \"gpio\": { \"source\": \"any\", \"line\": \"A\" }", "plant.omega.gpio",
         "found gpio beside another live source, expected at most one live source", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_modbus(void) {
    static const tl_test_change changes[] = {
        {"\"unit_id\": 255", "\"unit_id\": 248", "plant.torque.modbus.unit_id",
         "found 248 (number), expected a whole number from 0 to 247, or 255, for example 1", NULL},
        {"\"unit_id\": 255", "\"unit_id\": 256", "plant.torque.modbus.unit_id",
         "found 256 (number), expected a whole number from 0 to 247, or 255, for example 1", NULL},
        {"\"table\": \"holding\"", "\"table\": \"registers\"", "plant.torque.modbus.table",
         "found \"registers\" (text), expected \"coil\", \"discrete\", \"holding\" or \"input\", for example \"coil\"",
         NULL},
        {"\"table\": \"holding\", ", "", "plant.torque.modbus.table",
         "found nothing, expected \"coil\", \"discrete\", \"holding\" or \"input\", for example \"coil\"",
         "\"modbus\": {\n"},
        {"\"address\": 100", "\"address\": 65536", "plant.torque.modbus.address",
         "found 65536 (number), expected a whole number from 0 to 65535, for example 100", NULL},
        {"\"address\": 100", "\"address\": -1", "plant.torque.modbus.address",
         "found -1 (number), expected a whole number from 0 to 65535, for example 100", NULL},
        {"\"address\": 100, ", "", "plant.torque.modbus.address",
         "found nothing, expected a whole number from 0 to 65535, for example 100", "\"modbus\": {\n"},
        {"\"address\": 65532", "\"address\": 65533", "plant.stage.modbus.address",
         "found 65533 (number), expected at most 65532, because the value takes 4 registers", NULL},
        {"\"type\": \"int16\"", "\"type\": \"bit\"", "plant.torque.modbus.type",
         "found \"bit\" (text), expected \"int16\", \"uint16\", \"int32\", \"uint32\", \"float32\" or \"float64\", for example \"int16\"",
         NULL},
        {"\"type\": \"int16\"", "\"type\": \"int64\"", "plant.torque.modbus.type",
         "found \"int64\" (text), expected \"int16\", \"uint16\", \"int32\", \"uint32\", \"float32\" or \"float64\", for example \"int16\"",
         NULL},
        {", \"type\": \"float64\"", "", "plant.stage.modbus.type",
         "found nothing, expected \"int16\", \"uint16\", \"int32\", \"uint32\", \"float32\" or \"float64\", for example \"int16\"",
         NULL},
        {"\"table\": \"coil\"", "\"table\": \"coil\", \"type\": \"int16\"", "plant.running.modbus.type",
         "found \"int16\" (text), expected \"bit\"", NULL},
        {"\"words\": \"little\"", "\"words\": \"middle\"", "plant.torque.modbus.words",
         "found \"middle\" (text), expected \"big\" or \"little\", for example \"big\"", NULL},
        {"\"bytes\": \"little\"", "\"bytes\": 1", "plant.torque.modbus.bytes",
         "found 1 (number), expected \"big\" or \"little\", for example \"big\"", NULL},
        {"\"scale\": 0.001", "\"scale\": 0", "plant.torque.modbus.scale",
         "found 0 (number), expected a number other than 0, for example 0.1", NULL},
        {"\"offset\": -1.5", "\"offset\": \"-1.5\"", "plant.torque.modbus.offset",
         "found \"-1.5\" (text), expected a number, for example 0.1", NULL},
        {"\"scale\": 0.001", "\"scal\": 0.001", "plant.torque.modbus.scal",
         "found the unknown key \"scal\", expected \"scale\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_connections(void) {
    static const tl_test_change changes[] = {
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\"]", "connect[0]",
         "found an array of 1, expected an array of two texts, from and to, for example [\"plant.torque\", \"motor.M_w\"]",
         NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "\"plant.torque\"", "connect[0]",
         "found \"plant.torque\" (text), expected an array of two texts, from and to, for example [\"plant.torque\", \"motor.M_w\"]",
         NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\", 1]", "connect[0][1]",
         "found 1 (number), expected a text, for example \"motor.omega\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torqe\", \"motor.M_w\"]", "connect[0][0]",
         "found \"plant.torqe\", expected a signal that \"plant\" has, for example \"plant.torque\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.x\", \"motor.M_w\"]", "connect[0][0]",
         "found \"plant.x\", expected a signal that \"plant\" has: one of torque, running, stage, omega, current, level, start, stop",
         NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"drve.u_R\", \"motor.M_w\"]", "connect[0][0]",
         "found \"drve.u_R\", expected a variable of one of \"components\", for example \"drive.u_R\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"torque\", \"motor.M_w\"]", "connect[0][0]",
         "found \"torque\", expected component.variable or plant.signal, for example \"motor.omega\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.\", \"motor.M_w\"]", "connect[0][0]",
         "found \"plant.\", expected component.variable or plant.signal, for example \"motor.omega\"", NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\", \"plant.torque\"]", "connect[0][1]",
         "found \"plant.torque\", expected component.variable (the plant is only listened to), for example \"motor.omega\"",
         NULL},
        {"[\"plant.torque\", \"motor.M_w\"]", "[\"plant.torque\", \".x\"]", "connect[0][1]",
         "found \".x\", expected component.variable, for example \"motor.omega\"", NULL},
        {"[\"motor.omega\", \"drive.y\"]", "[\"motor.omega\", \"motor.M_w\"]", "connect[2][1]",
         "found \"motor.M_w\", which connect[0] leads to already, expected each input to be connected at most once",
         NULL},
        {"\"record\": {", "\"connects\": [], \"record\": {", "connects",
         "found the unknown key \"connects\", expected \"connect\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_connections_that_are_no_array(void) {
    static const tl_test_change changes[] = {
        {"[[\"plant.torque\", \"motor.M_w\"]]", "{}", "connect",
         "found an object with 0 keys, expected an array of connections [from, to], for example [[\"plant.torque\", \"motor.M_w\"]]",
         NULL},
    };
    EXPECT_EACH(free_running, changes);
}

static void test_compare(void) {
    static const tl_test_change changes[] = {
        {"{ \"motor.omega\": { \"to\": \"plant.omega\" } }", "{}", "compare",
         "found an object with 0 keys, expected an object with 1 to 16 entries, for example {\"motor.omega\": {\"to\": \"plant.omega\"}}",
         NULL},
        {"{ \"motor.omega\": { \"to\": \"plant.omega\" } }", "[]", "compare",
         "found an array of 0, expected an object with 1 to 16 entries, for example {\"motor.omega\": {\"to\": \"plant.omega\"}}",
         NULL},
        {"{ \"to\": \"plant.omega\" }", "{}", "compare.motor.omega.to",
         "found nothing, expected a text, for example \"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "\"plant.omega\"", "compare.motor.omega",
         "found \"plant.omega\" (text), expected an object, for example {\"to\": \"plant.omega\"}", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": \"plant.omga\" }", "compare.motor.omega.to",
         "found \"plant.omga\", expected a signal that \"plant\" has, for example \"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": \"motor.omega\" }", "compare.motor.omega.to",
         "found \"motor.omega\", expected a signal of the plant, for example \"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": 1 }", "compare.motor.omega.to",
         "found 1 (number), expected a text, for example \"plant.omega\"", NULL},
        {"{ \"to\": \"plant.omega\" }", "{ \"to\": \"plant.omega\", \"tolerance\": 1 }",
         "compare.motor.omega.tolerance", "found the unknown key \"tolerance\", expected one of to, between", NULL},
        {"\"motor.omega\": {", "\"moter.omega\": {", "compare.moter.omega",
         "found \"moter.omega\", expected a variable of one of \"components\", for example \"motor.omega\"", NULL},
        {"\"motor.omega\": {", "\"plant.omega\": {", "compare.plant.omega",
         "found \"plant.omega\", expected component.variable (the plant is only listened to), for example \"motor.omega\"",
         NULL},
        {"\"motor.omega\": {", "\"omega\": {", "compare.omega",
         "found \"omega\", expected component.variable, for example \"motor.omega\"", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

static void test_compare_beside_synchronise(void) {
    static const tl_test_change changes[] = {
        {"\"synchronise\": {", "\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }, \"synchronise\": {",
         "compare",
         "found compare beside synchronise, expected one of them: in synchronise.match, weight 0 means compared only",
         NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_adjust(void) {
    static const tl_test_change changes[] = {
        {"\"step\": 0.05", "\"step\": \"0.05\"", "synchronise.adjust.motor.d.step",
         "found \"0.05\" (text), expected a number > 0, for example 0.05", NULL},
        {"\"nominal\": true", "\"nominal\": null", "synchronise.adjust.motor.brake.nominal",
         "found null, expected a number, true or false, for example 0", NULL},
        {"\"penalty\": { \"deviation\": 0.25, \"rate\": 0.125 }", "\"penalty\": 0.25",
         "synchronise.adjust.motor.d.penalty", "found 0.25 (number), expected an object, for example {\"rate\": 0.01}",
         NULL},
        {"\"deviation\": 0.25", "\"deviation\": -0.25", "synchronise.adjust.motor.d.penalty.deviation",
         "found -0.25 (number), expected a number from 0 up, for example 0.01", NULL},
        {"\"deviation\": 0.25", "\"deviation\": \"0.25\"", "synchronise.adjust.motor.d.penalty.deviation",
         "found \"0.25\" (text), expected a number from 0 up, for example 0.01", NULL},
        {"\"rate\": 0.125", "\"rate\": -1e-9", "synchronise.adjust.motor.d.penalty.rate",
         "found -1e-09 (number), expected a number from 0 up, for example 0.01", NULL},
        {"\"rate\": 0.125", "\"rate\": true", "synchronise.adjust.motor.d.penalty.rate",
         "found true, expected a number from 0 up, for example 0.01", NULL},
        {"\"rate\": 0.125", "\"rates\": 0.125", "synchronise.adjust.motor.d.penalty.rates",
         "found the unknown key \"rates\", expected \"rate\"", NULL},
        {"\"dwell_s\": 0.2", "\"dwell_s\": 0", "synchronise.adjust.motor.brake.dwell_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.5", NULL},
        {"\"dwell_s\": 0.2", "\"dwell_s\": 1.1e9", "synchronise.adjust.motor.brake.dwell_s",
         "found 1100000000 (number), expected a number > 0 (at most 1e9), for example 0.5", NULL},
        {"\"dwell_s\": 0.2", "\"dwell_s\": \"0.2\"", "synchronise.adjust.motor.brake.dwell_s",
         "found \"0.2\" (text), expected a number > 0 (at most 1e9), for example 0.5", NULL},
        {"\"dwell_s\": 0.2", "\"dwell\": 0.2", "synchronise.adjust.motor.brake.dwell",
         "found the unknown key \"dwell\", expected \"dwell_s\"", NULL},
        {"\"step\": 0.05", "\"step\": 0", "synchronise.adjust.motor.d.step",
         "found 0 (number), expected a number > 0, for example 0.05", NULL},
        {"\"nominal\": 0.0031", "\"nominal\": \"0.0031\"", "synchronise.adjust.motor.d.nominal",
         "found \"0.0031\" (text), expected a number, true or false, for example 0", NULL},
        {"\"min\": 0, \"max\": 1", "\"min\": 1, \"max\": 1", "synchronise.adjust.motor.d.max",
         "found 1 (number), expected more than min, which is 1", NULL},
        {"\"min\": 0, \"max\": 1", "\"min\": 0, \"max\": true", "synchronise.adjust.motor.d.max",
         "found true, expected a number, for example 0", NULL},
        {"\"min\": 0, \"max\": 1", "\"min\": 0, \"maximum\": 1", "synchronise.adjust.motor.d.maximum",
         "found the unknown key \"maximum\", expected one of step, nominal, min, max, penalty, dwell_s", NULL},
        {"\"motor.d\": {", "\"engine.d\": {", "synchronise.adjust.engine.d",
         "found \"engine.d\", expected a variable of one of \"components\": one of drive, motor", NULL},
        {"\"motor.x[1].bias\": { \"step\": 2 }", "\"motor.x[1].bias\": 2", "synchronise.adjust.motor.x[1].bias",
         "found 2 (number), expected an object, for example {\"step\": 0.05}", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_match(void) {
    static const tl_test_change changes[] = {
        {"\"to\": \"plant.omega\", \"tolerance\": 0.5", "\"tolerance\": 0.5", "synchronise.match.motor.omega.to",
         "found nothing, expected a text, for example \"plant.omega\"", NULL},
        {"\"tolerance\": 0.5, ", "", "synchronise.match.motor.omega.tolerance",
         "found nothing, expected a number > 0, for example 0.5", NULL},
        {"\"tolerance\": 0.5", "\"tolerance\": 0", "synchronise.match.motor.omega.tolerance",
         "found 0 (number), expected a number > 0, for example 0.5", NULL},
        {"\"tolerance\": 0.5", "\"tolerance\": \"0.5\"", "synchronise.match.motor.omega.tolerance",
         "found \"0.5\" (text), expected a number > 0, for example 0.5", NULL},
        {"\"weight\": 2", "\"weight\": \"2\"", "synchronise.match.motor.omega.weight",
         "found \"2\" (text), expected a number from 0 up, for example 1", NULL},
        {"\"huber\": 3", "\"huber\": 0", "synchronise.match.motor.omega.huber",
         "found 0 (number), expected a number > 0, for example 3", NULL},
        {"\"huber\": 3", "\"huber\": true", "synchronise.match.motor.omega.huber",
         "found true, expected a number > 0, for example 3", NULL},
        {"\"huber\": 3", "\"hubert\": 3", "synchronise.match.motor.omega.hubert",
         "found the unknown key \"hubert\", expected \"huber\"", NULL},
        {"\"condition\": { \"median\": 5, \"low_pass_s\": 0.03, \"gate\": 45 }", "\"condition\": \"median\"",
         "synchronise.match.motor.omega.condition",
         "found \"median\" (text), expected an object, for example {\"median\": 5}", NULL},
        {"\"weight\": 2", "\"weight\": -1", "synchronise.match.motor.omega.weight",
         "found -1 (number), expected a number from 0 up, for example 1", NULL},
        {"\"weight\": 2", "\"weight\": 0", "synchronise.match",
         "found weight 0 everywhere, expected at least one weight above 0 (it is 1 where none is given)",
         "\"match\": {"},
        {"\"weight\": 2", "\"weights\": 2", "synchronise.match.motor.omega.weights",
         "found the unknown key \"weights\", expected \"weight\"", NULL},
        {"\"plant.current\"", "\"plant.curent\"", "synchronise.match.motor.I.to",
         "found \"plant.curent\", expected a signal that \"plant\" has, for example \"plant.current\"", NULL},
        {"\"motor.I\": {", "\"plant.I\": {", "synchronise.match.plant.I",
         "found \"plant.I\", expected component.variable (the plant is only listened to), for example \"motor.omega\"",
         NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_the_rest_of_synchronise(void) {
    static const tl_test_change changes[] = {
        {"\"horizon\": {", "\"horizons\": {", "synchronise.horizons",
         "found the unknown key \"horizons\", expected \"horizon\"", NULL},
        {"\"prediction\": 2", "\"prediction\": 0", "synchronise.horizon.prediction",
         "found 0 (number), expected a whole number from 1 to 1000, for example 2", NULL},
        {"\"prediction\": 2", "\"prediction\": 1001", "synchronise.horizon.prediction",
         "found 1001 (number), expected a whole number from 1 to 1000, for example 2", NULL},
        {"\"prediction\": 2", "\"prediction\": 1.5", "synchronise.horizon.prediction",
         "found 1.5 (number), expected a whole number from 1 to 1000, for example 2", NULL},
        {"\"shape\": \"dynamic\"", "\"event\": {\"start\": \"plant.omega\", \"window_s\": 0.1, \"longest_s\": 2}",
         "synchronise.horizon.event.end", "found nothing, expected a text, for example \"plant.extended\"", NULL},
        {"\"shape\": \"dynamic\"",
         "\"event\": {\"start\": \"not omega\", \"end\": \"plant.omega\", \"window_s\": 0.1, \"longest_s\": 2}",
         "synchronise.horizon.event.start",
         "found \"omega\", expected a signal of the plant, for example \"plant.omega\"", NULL},
        {"\"shape\": \"dynamic\"",
         "\"event\": {\"start\": \"plant.omega\", \"end\": \"plant.omega\", \"window_s\": 0, \"longest_s\": 2}",
         "synchronise.horizon.event.window_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.08", NULL},
        {"\"shape\": \"dynamic\"", "\"shape\": \"moving\"", "synchronise.horizon.shape",
         "found \"moving\" (text), expected \"static\" or \"dynamic\", for example \"static\"", NULL},
        {"\"shape\": \"dynamic\"", "\"shape\": 1", "synchronise.horizon.shape",
         "found 1 (number), expected \"static\" or \"dynamic\", for example \"static\"", NULL},
        {"\"shape\": \"dynamic\"", "\"shapes\": \"dynamic\"", "synchronise.horizon.shapes",
         "found the unknown key \"shapes\", expected \"shape\"", NULL},
        {"\"measurements\": \"ahead\"", "\"measurements\": \"late\"", "synchronise.horizon.measurements",
         "found \"late\" (text), expected \"lag\", \"ahead\" or \"hold\", for example \"lag\"", NULL},
        {"\"measurements\": \"ahead\"", "\"measurements\": true", "synchronise.horizon.measurements",
         "found true, expected \"lag\", \"ahead\" or \"hold\", for example \"lag\"", NULL},
        {"\"margin\": 0.02", "\"margin\": 1", "synchronise.margin",
         "found 1 (number), expected a number from 0 to below 1, for example 0.01", NULL},
        {"\"margin\": 0.02", "\"margin\": -0.1", "synchronise.margin",
         "found -0.1 (number), expected a number from 0 to below 1, for example 0.01", NULL},
        {"\"evaluations\": 40", "\"evaluations\": 1", "synchronise.budget.evaluations",
         "found 1 (number), expected a whole number from 2 to 100000, for example 60", NULL},
        {"\"evaluations\": 40", "\"evaluations\": 100001", "synchronise.budget.evaluations",
         "found 100001 (number), expected a whole number from 2 to 100000, for example 60", NULL},
        {"\"time_s\": 0.004", "\"time_s\": 0", "synchronise.budget.time_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.006", NULL},
        {"\"budget\": { \"evaluations\": 40, \"time_s\": 0.004 }", "\"budget\": 40", "synchronise.budget",
         "found 40 (number), expected an object, for example {\"evaluations\": 60}", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_condition(void) {
    static const tl_test_change changes[] = {
        {"\"median\": 5", "\"median\": 0", "synchronise.match.motor.omega.condition.median",
         "found 0 (number), expected an odd whole number from 1 to 99, for example 5", NULL},
        {"\"median\": 5", "\"median\": 4", "synchronise.match.motor.omega.condition.median",
         "found 4 (number), expected an odd whole number from 1 to 99, for example 5", NULL},
        {"\"median\": 5", "\"median\": 98", "synchronise.match.motor.omega.condition.median",
         "found 98 (number), expected an odd whole number from 1 to 99, for example 5", NULL},
        {"\"median\": 5", "\"median\": 101", "synchronise.match.motor.omega.condition.median",
         "found 101 (number), expected an odd whole number from 1 to 99, for example 5", NULL},
        {"\"median\": 5", "\"median\": 2.5", "synchronise.match.motor.omega.condition.median",
         "found 2.5 (number), expected an odd whole number from 1 to 99, for example 5", NULL},
        {"\"median\": 5", "\"median\": -1", "synchronise.match.motor.omega.condition.median",
         "found -1 (number), expected an odd whole number from 1 to 99, for example 5", NULL},
        {"\"median\": 5", "\"median\": \"5\"", "synchronise.match.motor.omega.condition.median",
         "found \"5\" (text), expected an odd whole number from 1 to 99, for example 5", NULL},
        {"\"low_pass_s\": 0.03", "\"low_pass_s\": 0", "synchronise.match.motor.omega.condition.low_pass_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.05", NULL},
        {"\"low_pass_s\": 0.03", "\"low_pass_s\": 1.1e9", "synchronise.match.motor.omega.condition.low_pass_s",
         "found 1100000000 (number), expected a number > 0 (at most 1e9), for example 0.05", NULL},
        {"\"low_pass_s\": 0.03", "\"low_pass_s\": [0.03]", "synchronise.match.motor.omega.condition.low_pass_s",
         "found an array of 1, expected a number > 0 (at most 1e9), for example 0.05", NULL},
        {"\"gate\": 45", "\"gate\": 0", "synchronise.match.motor.omega.condition.gate",
         "found 0 (number), expected a number > 0, for example 10", NULL},
        {"\"gate\": 45", "\"gate\": false", "synchronise.match.motor.omega.condition.gate",
         "found false, expected a number > 0, for example 10", NULL},
        {"\"gate\": 45", "\"gates\": 45", "synchronise.match.motor.omega.condition.gates",
         "found the unknown key \"gates\", expected \"gate\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_epsilon(void) {
    static const tl_test_change changes[] = {
        {"\"epsilon\": 0.25", "\"epsilon\": 0", "synchronise.epsilon",
         "found 0 (number), expected a number > 0, for example 0.01", NULL},
        {"\"epsilon\": 0.25", "\"epsilon\": -1", "synchronise.epsilon",
         "found -1 (number), expected a number > 0, for example 0.01", NULL},
        {"\"epsilon\": 0.25", "\"epsilon\": \"0.25\"", "synchronise.epsilon",
         "found \"0.25\" (text), expected a number > 0, for example 0.01", NULL},
        {"\"huber\": 2", "\"tolerance\": 1", "synchronise.match.motor.omega.tolerance",
         "found a tolerance beside synchronise.epsilon, expected one of them: epsilon is the square of every match's tolerance",
         NULL},
        {"\"weight\": 0", "\"weight\": 0, \"tolerance\": 1", "synchronise.match.motor.I.tolerance",
         "found a tolerance beside synchronise.epsilon, expected one of them: epsilon is the square of every match's tolerance",
         NULL},
        {"\"epsilon\": 0.25,", "", "synchronise.match.motor.omega.tolerance",
         "found nothing, expected a number > 0, for example 0.5", "\"motor.omega\": {"},
    };
    EXPECT_EACH(with_epsilon, changes);
}

static void test_limits_and_saving(void) {
    static const tl_test_change changes[] = {
        {"\"stagnation\": 30", "\"stagnation\": 0", "synchronise.stagnation",
         "found 0 (number), expected a whole number from 1 to 100000, for example 30", NULL},
        {"\"stagnation\": 30", "\"stagnation\": 100001", "synchronise.stagnation",
         "found 100001 (number), expected a whole number from 1 to 100000, for example 30", NULL},
        {"\"stagnation\": 30", "\"stagnation\": 1.5", "synchronise.stagnation",
         "found 1.5 (number), expected a whole number from 1 to 100000, for example 30", NULL},
        {"\"stagnation\": 30", "\"stagnation\": \"30\"", "synchronise.stagnation",
         "found \"30\" (text), expected a whole number from 1 to 100000, for example 30", NULL},
        {"\"free_twin\": false", "\"free_twin\": 1", "synchronise.free_twin",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"free_twin\": false", "\"free_twin\": true", "synchronise.free_twin",
         "found true, expected false: not with a component whose states are not kept (keep \"outputs\")", NULL},
        {"\"noise_floor\": 0.002", "\"noise_floor\": -0.002", "synchronise.noise_floor",
         "found -0.002 (number), expected a number from 0 up, for example 0.001", NULL},
        {"\"noise_floor\": 0.002", "\"noise_floor\": false", "synchronise.noise_floor",
         "found false, expected a number from 0 up, for example 0.001", NULL},
        {"\"saving\": { \"structure\": false, \"sequences\": false, \"nodes\": 500, \"memory_mb\": 300 }",
         "\"saving\": false", "synchronise.saving", "found false, expected an object, for example {\"nodes\": 4096}",
         NULL},
        {"\"structure\": false", "\"structure\": 0", "synchronise.saving.structure",
         "found 0 (number), expected true or false, for example true", NULL},
        {"\"sequences\": false", "\"sequences\": \"no\"", "synchronise.saving.sequences",
         "found \"no\" (text), expected true or false, for example true", NULL},
        {"\"sequences\": false", "\"sequence\": false", "synchronise.saving.sequence",
         "found the unknown key \"sequence\", expected \"sequences\"", NULL},
        {"\"nodes\": 500", "\"nodes\": 1", "synchronise.saving.nodes",
         "found 1 (number), expected a whole number from 2 to 1000000, for example 4096", NULL},
        {"\"nodes\": 500", "\"nodes\": 1000001", "synchronise.saving.nodes",
         "found 1000001 (number), expected a whole number from 2 to 1000000, for example 4096", NULL},
        {"\"nodes\": 500", "\"nodes\": 2.5", "synchronise.saving.nodes",
         "found 2.5 (number), expected a whole number from 2 to 1000000, for example 4096", NULL},
        {"\"nodes\": 500", "\"nodes\": true", "synchronise.saving.nodes",
         "found true, expected a whole number from 2 to 1000000, for example 4096", NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": 0", "synchronise.saving.memory_mb",
         "found 0 (number), expected a whole number from 1 to 1000000, for example 128", NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": 1000001", "synchronise.saving.memory_mb",
         "found 1000001 (number), expected a whole number from 1 to 1000000, for example 128", NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": 0.5", "synchronise.saving.memory_mb",
         "found 0.5 (number), expected a whole number from 1 to 1000000, for example 128", NULL},
        {"\"memory_mb\": 300", "\"memory_mb\": \"300\"", "synchronise.saving.memory_mb",
         "found \"300\" (text), expected a whole number from 1 to 1000000, for example 128", NULL},
        {"\"fallback\": 1000", "\"fallback\": \"nelder-mead\"", "synchronise.fallback",
         "found \"nelder-mead\" (text), expected another than algorithm, which is \"nelder-mead\"", NULL},
        {"\"fallback\": 1000", "\"fallback\": 1", "synchronise.fallback",
         "found 1 (number), expected another than algorithm, which is \"nelder-mead\"", NULL},
        {"\"fallback\": 1000", "\"fall_back\": 1000", "synchronise.fall_back",
         "found the unknown key \"fall_back\", expected \"fallback\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

/* `key` in the full configuration, whose value there is `old`; the names are the registry's. */
static void expect_no_solver(const char *key, const char *old, const char *new, const char *found) {
    char before[64];
    char after[64];
    char where[64];
    char text[TL_ERROR_TEXT];
    (void)snprintf(before, sizeof before, "\"%s\": %s", key, old);
    (void)snprintf(after, sizeof after, "\"%s\": %s", key, new);
    (void)snprintf(where, sizeof where, "synchronise.%s", key);
    (void)snprintf(text, sizeof text,
                   "found %s, expected one of %s, or the thesis's number 1, 100 or 1000, for example \"secant\"", found,
                   tl_optimiser_names());
    const tl_test_change c = {before, after, where, text, NULL};
    tl_test_expect_problems(full, &c, 1);
}

static void test_solvers_that_there_are_not(void) {
    static const struct {
        const char *new, *found;
    } cases[] = {
        {"\"nelder_mead\"", "\"nelder_mead\" (text)"},
        {"\"Secant\"", "\"Secant\" (text)"},
        {"\"\"", "\"\" (text)"},
        {"\"1\"", "\"1\" (text)"},
        {"0", "0 (number)"},
        {"-1", "-1 (number)"},
        {"2", "2 (number)"},
        {"1.5", "1.5 (number)"},
        {"1e300", "1e+300 (number)"},
        {"true", "true"},
        {"null", "null"},
        {"[]", "an array of 0"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        expect_no_solver("algorithm", "\"nelder-mead\"", cases[i].new, cases[i].found);
        expect_no_solver("fallback", "1000", cases[i].new, cases[i].found);
    }
}

static void test_synchronise_without_its_parts(void) {
    static const tl_test_change changes[] = {
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }", "\"synchronise\": []", "synchronise",
         "found an array of 0, expected an object, for example {\"adjust\": {\"motor.d\": {\"step\": 0.05}}, \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", …}}}",
         NULL},
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }",
         "\"synchronise\": { \"match\": { \"motor.omega\": { \"to\": \"plant.omega\", \"tolerance\": 1 } } }",
         "synchronise.adjust",
         "found nothing, expected an object with 1 to 8 entries, for example {\"motor.d\": {\"step\": 0.05}}", NULL},
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }",
         "\"synchronise\": { \"adjust\": { \"motor.d\": { \"step\": 1 } } }", "synchronise.match",
         "found nothing, expected an object with 1 to 16 entries, for example {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0}}",
         NULL},
        {"\"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } }",
         "\"synchronise\": { \"adjust\": { \"motor.d\": { \"step\": 1 } }, \"match\": {} }", "synchronise.match",
         "found an object with 0 keys, expected an object with 1 to 16 entries, for example {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0}}",
         NULL},
    };
    EXPECT_EACH(free_running, changes);
}

static void test_running(void) {
    static const tl_test_change changes[] = {
        {"\"file\": \"bench.csv\"", "\"file\": 1", "recording.file",
         "found 1 (number), expected a text, for example \"bench.csv\"", NULL},
        {"\"time_column\": \"seconds\"", "\"time\": \"seconds\"", "recording.time",
         "found the unknown key \"time\", expected one of file, time_column", NULL},
        {"\"file\": \"bench.db\", ", "", "record.file", "found nothing, expected a text, for example \"bench.db\"",
         NULL},
        {"\"max_mb\": 250.5", "\"max_mb\": 0.5", "record.max_mb",
         "found 0.5 (number), expected a number from 1 to 1000000000, for example 1000", NULL},
        {"\"max_mb\": 250.5", "\"max_mb\": 1.5e9", "record.max_mb",
         "found 1500000000 (number), expected a number from 1 to 1000000000, for example 1000", NULL},
        {"\"commit_s\": 0.25", "\"commit_s\": 0.01", "record.commit_s",
         "found 0.01 (number), expected a number from 0.05 to 10, for example 0.5", NULL},
        {"\"commit_s\": 0.25", "\"commit_s\": 11", "record.commit_s",
         "found 11 (number), expected a number from 0.05 to 10, for example 0.5", NULL},
        {"\"resume_s\": 30", "\"resume_s\": -1", "record.resume_s",
         "found -1 (number), expected a number from 0 to 3600, for example 60", NULL},
        {"\"resume_s\": 30", "\"resume_s\": 3601", "record.resume_s",
         "found 3601 (number), expected a number from 0 to 3600, for example 60", NULL},
        {"\"priority\": 0", "\"priority\": 99", "realtime.priority",
         "found 99 (number), expected a whole number from 0 to 98, for example 50", NULL},
        {"\"priority\": 0", "\"priority\": -1", "realtime.priority",
         "found -1 (number), expected a whole number from 0 to 98, for example 50", NULL},
        {"\"lock_memory\": false", "\"lock_memory\": 1", "realtime.lock_memory",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"hang_s\": 1.5", "\"hang_s\": 0", "realtime.hang_s",
         "found 0 (number), expected a number from 0.1 to 3600, for example 2", NULL},
        {"\"lock_memory\": false", "\"lockmemory\": true", "realtime.lockmemory",
         "found the unknown key \"lockmemory\", expected \"lock_memory\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_emulate(void) {
    static const tl_test_change changes[] = {
        {"\"from\": \"motor.omega\", ", "", "emulate.columns.omega.from",
         "found nothing, expected a text, for example \"motor.omega\"", NULL},
        {"\"from\": \"motor.omega\"", "\"from\": \"moto.omega\"", "emulate.columns.omega.from",
         "found \"moto.omega\", expected a variable of one of \"components\", for example \"motor.omega\"", NULL},
        {"\"from\": \"plant.torque\"", "\"from\": \"plant.Torqe\"", "emulate.columns.M_w.from",
         "found \"plant.Torqe\", expected a signal that \"plant\" has, for example \"plant.torque\"", NULL},
        {"\"noise\": 0.01", "\"noise\": -0.01", "emulate.columns.omega.noise",
         "found -0.01 (number), expected a number from 0 up, for example 0.01", NULL},
        {"\"M_w\": { \"from\": \"plant.torque\" }", "\"M_w\": \"plant.torque\"", "emulate.columns.M_w",
         "found \"plant.torque\" (text), expected an object, for example {\"from\": \"motor.omega\"}", NULL},
        {"\"M_w\": { \"from\": \"plant.torque\" }", "\"\": { \"from\": \"plant.torque\" }", "emulate.columns.",
         "found an unusable name, expected the name of a column, for example \"omega\"", NULL},
        {"[0.005, 0.02]", "[0.02, 0.005]", "emulate.message_s",
         "found an array of 2, expected an array of two numbers > 0 (at most 1e9), the first not above the second, for example [0.005, 0.02]",
         NULL},
        {"[0.005, 0.02]", "[0, 0.005]", "emulate.message_s",
         "found an array of 2, expected an array of two numbers > 0 (at most 1e9), the first not above the second, for example [0.005, 0.02]",
         NULL},
        {"[0.005, 0.02]", "[0.005]", "emulate.message_s",
         "found an array of 1, expected an array of two numbers > 0 (at most 1e9), the first not above the second, for example [0.005, 0.02]",
         NULL},
        {"[0.005, 0.02]", "0.005", "emulate.message_s",
         "found 0.005 (number), expected an array of two numbers > 0 (at most 1e9), the first not above the second, for example [0.005, 0.02]",
         NULL},
        {"[0.005, 0.02]", "[0.005, \"0.02\"]", "emulate.message_s",
         "found an array of 2, expected an array of two numbers > 0 (at most 1e9), the first not above the second, for example [0.005, 0.02]",
         NULL},
        {"\"message_s\": [", "\"message\": [", "emulate.message",
         "found the unknown key \"message\", expected \"message_s\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_delays(void) {
    static const tl_test_change changes[] = {
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 0 }", "delays.participants.bus.cycle_s",
         "found 0 (number), expected a number > 0, at most 3600, for example 0.008", NULL},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": {}", "delays.participants.bus.cycle_s",
         "found nothing, expected a number > 0, at most 3600, for example 0.008", NULL},
        {"\"dead_s\": 0.01,", "\"dead_s\": -1,", "delays.participants.device.dead_s",
         "found -1 (number), expected a number from 0 to 3600, for example 0.004", NULL},
        {"\"dead_s\": 0.01,", "\"dead\": 0.01,", "delays.participants.device.dead",
         "found the unknown key \"dead\", expected \"dead_s\"", NULL},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 0.008 }, \"a b\": { \"cycle_s\": 1 }",
         "delays.participants.a b",
         "found the name \"a b\", expected at most 63 letters, digits and _, no digit first, for example \"bus\"",
         NULL},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 0.008 }, \"io\": 1", "delays.participants.io",
         "found 1 (number), expected an object, for example {\"dead_s\": 0.004, \"cycle_s\": 0.008}", NULL},
        {"[[\"acquisition\", \"twin\"]]", "[[\"acquisition\"]]", "delays.synchronous[0]",
         "found an array of 1, expected an array of two or more participants, for example [\"acquisition\", \"simulation\"]",
         NULL},
        {"[[\"acquisition\", \"twin\"]]", "\"twin\"", "delays.synchronous",
         "found \"twin\" (text), expected an array of groups, each an array of two or more participants, for example [[\"acquisition\", \"simulation\"]]",
         NULL},
        {"[[\"acquisition\", \"twin\"]]", "[[\"acquisition\", \"twins\"]]", "delays.synchronous[0][1]",
         "found \"twins\" (text), expected the name of a participant: one of bus, device, acquisition, twin", NULL},
        {"[[\"acquisition\", \"twin\"]]", "[[\"acquisition\", \"twin\"], [\"bus\", \"twin\"]]",
         "delays.synchronous[1][1]",
         "found \"twin\" (text), expected each participant at most once: what is synchronous to one of a group is so to all of it",
         NULL},
        {"{ \"plant\": [\"bus\", \"device\"], ", "{ ", "delays.input.plant",
         "found nothing, expected an array of 1 to 16 participants, for example [\"bus\", \"plant\", \"bus\"]", NULL},
        {"[\"bus\", \"device\"]", "[]", "delays.input.plant",
         "found an array of 0, expected an array of 1 to 16 participants, for example [\"bus\", \"plant\", \"bus\"]",
         NULL},
        {"[\"bus\", \"device\"]", "[\"bus\", 5]", "delays.input.plant[1]",
         "found 5 (number), expected the name of a participant: one of bus, device, acquisition, twin", NULL},
        {"[\"bus\", \"device\", \"bus\"]",
         "[\"bus\", \"device\", \"bus\", \"device\", \"bus\", \"device\", \"bus\", \"device\", \"bus\"]",
         "delays.output.plant",
         "found a chain with more, expected at most 7 links between participants that are not synchronous", NULL},
        {"\"dead_s\": 0.01,", "\"dead_s\": 0.01, \"delay_s\": 1,", "delays.participants.device.delay_s",
         "found the unknown key \"delay_s\", expected \"dead_s\"", NULL},
        {"\"acquisition\": { \"dead_s\": 0.004", "\"acquisition\": { \"dead_s\": 12", "delays.input",
         "found a shift by 12.0079 s, expected at most 1000 times step_s, which is 10 s", "\"input\": { \"plant\""},
        {"\"bus\": { \"cycle_s\": 0.008 }", "\"bus\": { \"cycle_s\": 10 }", "delays.output",
         "found a shift by 19.9959 s, with the cycle of the plant's last participant, expected at most 1000 times step_s, which is 10 s",
         "\"output\": { \"plant\""},
        {"\"synchronous\": [[", "\"synchronus\": [[", "delays.synchronus",
         "found the unknown key \"synchronus\", expected \"synchronous\"", NULL},
    };
    EXPECT_EACH(full, changes);
}

static void test_delays_of_other_kinds(void) {
    static const tl_test_change changes[] = {
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"participants\": {\"bus\": {\"cycle_s\": 1}}}", "delays",
         "found nothing to make up for, expected \"input\", \"output\" or \"measure\", for example {\"measure\": true}",
         NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"output\": true}", "delays.output",
         "found true, expected an object with two chains, or a number of seconds, for example {\"plant\": [\"bus\", "
         "\"plant\"], \"simulation\": […]}",
         NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"input\": 1e10}", "delays.input",
         "found 10000000000 (number), expected a number from -1000000000 to 1000000000, for example 0.008", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"input\": 101}", "delays.input",
         "found a shift by 101 s, expected at most 1000 times step_s, which is 100 s", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": 5", "delays",
         "found 5 (number), expected an object or \"measure\", for example {\"participants\": {…}, \"output\": {…}}",
         NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": \"estimate\"", "delays",
         "found \"estimate\" (text), expected an object or \"measure\", for example {\"participants\": {…}, \"output\": {…}}",
         NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": false}", "delays.measure",
         "found false, expected true or an object, for example {\"range_s\": 0.1}", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": {\"range_s\": 0}}", "delays.measure.range_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.1", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": {\"range_s\": 3.2}}", "delays.measure.range_s",
         "found 3.2 (number), expected at most 31 times step_s, which is 3.1 s", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": true, \"take\": \"nearest\"}", "delays.take",
         "found \"nearest\" (text), expected \"next\" or \"newest\", for example \"next\"", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0.1, \"delays\": {\"measure\": true, \"mesure\": 1}", "delays.mesure",
         "found the unknown key \"mesure\", expected \"measure\"", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

/* Delays count in steps: without one, only the step is wrong. */
static void test_delays_without_a_step(void) {
    static const tl_test_change changes[] = {
        {"\"step_s\": 0.1", "\"delays\": \"measure\"", "step_s",
         "found nothing, expected a number from 1e-05 to 3600, for example 0.01", "{"},
        {"\"step_s\": 0.1", "\"step_s\": 0, \"delays\": \"measure\"", "step_s",
         "found 0 (number), expected a number from 1e-05 to 3600, for example 0.01", NULL},
        {"\"step_s\": 0.1", "\"step_s\": \"0.1\", \"delays\": \"measure\"", "step_s",
         "found \"0.1\" (text), expected a number from 1e-05 to 3600, for example 0.01", NULL},
        {"\"step_s\": 0.1", "\"step_s\": 0, \"delays\": {\"measure\": true, \"input\": 0.5}", "step_s",
         "found 0 (number), expected a number from 1e-05 to 3600, for example 0.01", NULL},
    };
    EXPECT_EACH(free_running, changes);
}

/* What waits for a next reading is Real, feeds an input or is matched, and says how long that takes. */
static void test_between_readings(void) {
    static const tl_test_change changes[] = {
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"linear\"", "plant.torque.between",
         "found \"linear\" (text), expected \"last\", \"line\" or \"mean\", for example \"last\"", NULL},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"every_s\": 0", "plant.torque.every_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.04", NULL},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"line\", \"every_s\": 0", "plant.torque.every_s",
         "found 0 (number), expected a number > 0 (at most 1e9), for example 0.04", NULL},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"line\"", "plant.torque.every_s",
         "found none, expected the longest time from one reading to the next, for which a step waits, for example 0.04",
         "\"torque\": {"},
        {"\"between\": \"last\", \"every_s\": 0.04", "\"between\": \"mean\", \"every_s\": 10.5", "plant.torque.every_s",
         "found 10.5 (number), expected at most 1000 times step_s", NULL},
        {"\"current\": {}", "\"current\": { \"between\": \"mean\", \"every_s\": 0.04 }", "plant.current.between",
         "found a signal that feeds no input, expected no such key: of a signal that is matched it stands beside its "
         "\"to\"",
         NULL},
        {"\"huber\": 3, \"between\": \"last\"", "\"huber\": 3, \"between\": \"mean\"",
         "synchronise.match.motor.omega.between",
         "found \"mean\" (text), expected \"last\" or \"line\", for example \"last\"", NULL},
        {"\"huber\": 3, \"between\": \"last\"", "\"huber\": 3, \"between\": \"line\"", "plant.omega.every_s",
         "found none, expected the longest time from one reading to the next, for which a step waits, for example 0.04",
         "\"omega\": { \"unit\""},
        {"{ \"to\": \"plant.current\", \"weight\": 0 }",
         "{ \"to\": \"plant.stage\", \"weight\": 0, \"between\": \"line\" }", "synchronise.match.motor.I.between",
         "found \"line\" (text), expected \"last\": between two readings of an Integer or Boolean signal there is "
         "nothing",
         NULL},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        char *lagging = tl_test_replaced(full, "\"measurements\": \"ahead\"", "\"measurements\": \"lag\"");
        tl_test_expect_problems(lagging, &changes[i], 1);
        free(lagging);
    }
}

/* A reading is conditioned once, and no step waits for it for ever. */
static void test_conditions_that_do_not_fit(void) {
    static const tl_test_change changes[] = {
        {"{ \"to\": \"plant.current\", \"weight\": 0 }",
         "{ \"to\": \"plant.omega\", \"weight\": 0, \"condition\": { \"gate\": 3 } }",
         "synchronise.match.motor.I.condition",
         "found another condition than that of an earlier match with the same signal, expected one for all of them: a "
         "reading is conditioned once",
         NULL},
        {"{ \"to\": \"plant.current\", \"weight\": 0 }",
         "{ \"to\": \"plant.stage\", \"weight\": 0, \"condition\": { \"low_pass_s\": 1 } }",
         "synchronise.match.motor.I.condition",
         "found a low-pass of a signal that is no Real, expected \"median\" or \"gate\"", NULL},
        {"\"omega\": { \"unit\": \"rad/s\", ", "\"omega\": { \"unit\": \"rad/s\", \"every_s\": 5, ",
         "synchronise.match.motor.omega.condition",
         "found a condition for which a step waits longer than 1000 times step_s, expected a shorter median or low-pass, or "
         "a smaller every_s of the signal",
         "\"condition\": {"},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        char *lagging = tl_test_replaced(full, "\"measurements\": \"ahead\"", "\"measurements\": \"lag\"");
        tl_test_expect_problems(lagging, &changes[i], 1);
        free(lagging);
    }
}

/* It is said once, and first what is hardest to change: this one has a component with keep "outputs" as well. */
static void test_no_free_twin(void) {
    static const tl_test_change changes[] = {
        {"\"measurements\": \"ahead\"",
         "\"measurements\": \"lag\", \"event\": {\"start\": \"plant.running\", \"end\": \"plant.running\", "
         "\"window_s\": 0.1, \"longest_s\": 2}",
         "synchronise.free_twin", "found true, expected false: not with horizon.event", "\"free_twin\""},
    };
    char *led = tl_test_replaced(full, "\"free_twin\": false", "\"free_twin\": true");
    char *short_of = tl_test_replaced(led, "\"prediction\": 2, \"shape\": \"dynamic\", ", "");
    char *raw = tl_test_replaced(short_of, "{ \"median\": 5, \"low_pass_s\": 0.03, \"gate\": 45 }", "{}");
    tl_test_expect_problems(raw, &changes[0], 1);
    free(raw);
    free(short_of);
    free(led);
}

/* 62 signals, three of which would be there twice. */
static void test_too_many_look_ups(void) {
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
    TEST_ASSERT_EQUAL_STRING(
        "line 5: found 62 signals, and 3 of them feed an input and are matched, expected at most 64 "
        "together: with delays, a \"between\" or a \"condition\" such a signal is looked up twice, and counts twice",
        verdict.problems[0].text);
}

static void test_doubled_keys(void) {
    static const tl_test_change changes[] = {
        {"\"step_s\": 0.01", "\"step_s\": 0.01, \"step\\u005fs\": 0.02", "",
         "found the key \"step_s\" again, expected it once; the first is on line 4", NULL},
        {"\"unit\": \"N.m\"", "\"unit\": \"N.m\", \"unit\": \"N.m\"", "",
         "found the key \"unit\" again, expected it once; the first is on line 25", NULL},
    };
    EXPECT_EACH(full, changes);
}

/* ---- several at once ---- */

static void expect_problem(const char *where, const char *part) {
    for (size_t i = 0; i < verdict.count && i < TL_TEST_PROBLEMS; i++) {
        if (strcmp(verdict.problems[i].where, where) == 0) {
            TEST_ASSERT_NOT_NULL_MESSAGE(strstr(verdict.problems[i].text, part), verdict.problems[i].text);
            return;
        }
    }
    TEST_FAIL_MESSAGE(where);
}

static void test_everything_at_once(void) {
    static const char *const text = "{\n\"twinlock\": 2,\n\"step_s\": \"0.01\",\n\"step_s\": 0.01,\n"
                                    "\"components\": {\"plant\": 1, \"motor\": {}},\n\"plant\": {\"1\": {\"min\": "
                                    "2,\n\"max\": 1}},\n\"Name\": \"x\"}";
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, verdict.status);
    expect_problem("", "line 4: found the key \"step_s\" again");
    expect_problem("twinlock", "line 2: found 2 (number), expected 1");
    expect_problem("name", "line 1: found nothing, expected a text");
    expect_problem("components.motor.fmu", "line 5: found nothing");
    expect_problem("components.plant", "line 5: found the name \"plant\"");
    expect_problem("plant.1", "line 6: found the name \"1\"");
    expect_problem("plant.1.max", "line 7: found 1 (number), expected at least min, which is 2");
    expect_problem("Name", "line 8: found the unknown key \"Name\", expected \"name\"");
    TEST_ASSERT_EQUAL_size_t(10, verdict.count);
}

/* The number of problems where the object that begins with `opening` gets `count` more entries: NAME0, NAME1, … */
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
        {"\"match\": {", "motor.m", "{\"to\": \"plant.omega\", \"weight\": 0}", "synchronise.match", 2, 16},
        {"\"columns\": {", "c", "{\"from\": \"motor.x\"}", "emulate.columns", 2, 64},
        {"\"compare\": {", "motor.m", "{\"to\": \"plant.omega\"}", "compare", 1, 16},
    };
    for (size_t i = 0; i < sizeof maps / sizeof maps[0]; i++) {
        char expected[64];
        const char *base = strcmp(maps[i].where, "compare") == 0 ? free_running : full;
        size_t room = maps[i].most - maps[i].there;
        (void)snprintf(expected, sizeof expected, "to %zu entries", maps[i].most);
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
    TEST_ASSERT_EQUAL_STRING("line 2, column 12: found 01, expected a number as JSON writes it (no leading zeros or "
                             "+), for example 0.1 or -2e-3",
                             verdict.problems[0].text);
}

/* A section that is no object is one problem; what refers into it is not blamed. */
static void test_broken_sections_are_blamed_once(void) {
    static const tl_test_change sections[] = {
        {"\"sources\": {", "\"sources\": [], \"x\": {", "sources", "", NULL},
        {"\"plant\": {", "\"plant\": [1, 2], \"x\": {", "plant", "", NULL},
        {"\"components\": {", "\"components\": \"\", \"x\": {", "components", "", NULL},
    };
    for (size_t i = 0; i < sizeof sections / sizeof sections[0]; i++) {
        char *text = tl_test_replaced(full, sections[i].old, sections[i].new);
        TEST_ASSERT_NOT_NULL(text);
        tl_test_judge_text(text, strlen(text), &verdict);
        free(text);
        TEST_ASSERT_EQUAL_size_t(2, verdict.count);
        expect_problem(sections[i].where, "expected an object with");
        expect_problem("x", "found the unknown key \"x\"");
    }
}

static void expect_root_problem(const char *text, const char *found) {
    char expected[TL_ERROR_TEXT];
    (void)snprintf(expected, sizeof expected,
                   "line 1: found %s, expected an object, for example {\"twinlock\": 1, \"name\": \"motor bench\", …}",
                   found);
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].where);
    TEST_ASSERT_EQUAL_STRING(expected, verdict.problems[0].text);
}

static void test_roots_that_are_no_object(void) {
    expect_root_problem("[]", "an array of 0");
    expect_root_problem("\"x\"", "\"x\" (text)");
    expect_root_problem("null", "null");
    expect_root_problem("1.5", "1.5 (number)");
}

static void test_missing_sections(void) {
    tl_test_judge_text("{}", 2, &verdict);
    TEST_ASSERT_EQUAL_size_t(5, verdict.count);
    expect_problem("twinlock", "line 1: found nothing, expected 1, the version");
    expect_problem("name", "line 1: found nothing, expected a text, for example \"motor bench\"");
    expect_problem("step_s", "line 1: found nothing, expected a number from 1e-05 to 3600, for example 0.01");
    expect_problem("components", "line 1: found nothing, expected an object with 1 to 62 entries, for example {");
    expect_problem("plant", "line 1: found nothing, expected an object with 1 to 64 entries, for example {");
}

/* Nothing a file holds can reach a terminal as a control character, however long or strange. */
static void test_hostile_texts_are_shown_tame(void) {
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
    TEST_ASSERT_NOT_NULL(strstr(verdict.problems[0].text,
                                "nnnn…\", expected one of twinlock, name, step_s, duration_s, "
                                "components, sources, plant, recording, connect, compare, "
                                "synchronise, delays, record, realtime, emulate"));
}

/* The longest names, wrong as often as a file can hold them: what is near is looked for each time. */
static void test_a_hostile_file_is_refused_soon(void) {
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
    expect_problem("connect[1][0]", "expected a signal that \"plant\" has: one of aaaaaaaa");
    TEST_ASSERT_TRUE(seconds < 30); /* about 1 s with sanitizers; without the bounds it is minutes */
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
    RUN_TEST(test_solvers_that_there_are_not);
    RUN_TEST(test_synchronise_without_its_parts);
    RUN_TEST(test_running);
    RUN_TEST(test_emulate);
    RUN_TEST(test_delays);
    RUN_TEST(test_delays_of_other_kinds);
    RUN_TEST(test_delays_without_a_step);
    RUN_TEST(test_between_readings);
    RUN_TEST(test_conditions_that_do_not_fit);
    RUN_TEST(test_no_free_twin);
    RUN_TEST(test_too_many_look_ups);
    RUN_TEST(test_doubled_keys);
    RUN_TEST(test_everything_at_once);
    RUN_TEST(test_syntax_comes_alone);
    RUN_TEST(test_broken_sections_are_blamed_once);
    RUN_TEST(test_roots_that_are_no_object);
    RUN_TEST(test_missing_sections);
    RUN_TEST(test_hostile_texts_are_shown_tame);
    RUN_TEST(test_a_long_text_is_cut);
    RUN_TEST(test_a_hostile_file_is_refused_soon);
    RUN_TEST(test_the_most_entries);
    return UNITY_END();
}
