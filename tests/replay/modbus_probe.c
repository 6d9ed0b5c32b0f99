/* The Modbus driver and the emulated device as a program, for test_modbus_oracle.py.
 *
 *   modbus_probe read HOST PORT   reads every channel once it can; prints "quality value" for each
 *   modbus_probe read HOST PORT rtu   with frames of a line
 *   modbus_probe read DEVICE      the same on a serial line
 *   modbus_probe serve            prints its port, serves until its input ends, prints "requests refused_writes"
 * Channels are lines of the standard input, "unit table address type words_little bytes_little bit scale offset code
 * value", up to a line "go"; tables and types are the numbers of board/modbus/modbus_map.h. The code means "not
 * available"; nan: none.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "board/modbus/modbus.h"
#include "firmware/cli/plant_server.h"
#include "tests/replay/probe.h"

enum { CHANNELS = 4096, FIELDS = 11, POLLS = 200 };

static tl_modbus_channel channels[CHANNELS];
static double values[CHANNELS];
static size_t count;

static bool read_channels(void) {
    char line[512];
    while (fgets(line, sizeof line, stdin) != NULL && strcmp(line, "go\n") != 0) {
        double field[FIELDS];
        char *at = line;
        for (size_t i = 0; i < FIELDS; i++) {
            field[i] = strtod(at, &at);
        }
        if (strcmp(at, "\n") != 0 || count == CHANNELS) {
            return false;
        }
        channels[count] = (tl_modbus_channel){.unit_id = (uint8_t)field[0],
                                              .table = (tl_modbus_table)field[1],
                                              .address = (uint16_t)field[2],
                                              .type = (tl_modbus_type)field[3],
                                              .words_little = field[4] != 0,
                                              .bytes_little = field[5] != 0,
                                              .bit = (uint8_t)field[6],
                                              .scale = field[7],
                                              .offset = field[8],
                                              .codes = {field[9]},
                                              .code_count = isnan(field[9]) ? 0U : 1U};
        values[count] = field[10];
        count++;
    }
    return true;
}

static tl_reading readings[CHANNELS];
static bool linked;

static void on_post(void *context, size_t channel, const tl_reading *reading) {
    (void)context;
    readings[channel] = *reading;
}

static void on_link(void *context, bool up, const char *text) {
    (void)context;
    (void)fprintf(stderr, "modbus_probe: %s: %s\n", up ? "up" : "down", text);
    linked = up;
}

static int run_read(const char *host, const char *port, bool rtu_framing) {
    const tl_modbus_settings settings = {
        .host = host,
        .port = (uint16_t)(port != NULL ? strtoul(port, NULL, 10) : 0),
        .rtu_framing = rtu_framing,
        .line = {.device = port != NULL ? NULL : host, .baud = 115200, .parity = 'E', .stop_bits = 1},
        .timeout_s = 10,
        .channels = channels,
        .channel_count = count};
    const tl_plant_io_sink sink = {.post = on_post, .link = on_link};
    const struct timespec pause = {.tv_sec = 0, .tv_nsec = 50000000};
    tl_plant_io *io = NULL;
    tl_error error = {.status = TL_OK};
    if (tl_modbus_open(&settings, &io, &error) != TL_OK) {
        return tl_probe_fail(error.text);
    }
    for (int i = 0; i < POLLS && !linked; i++) {
        tl_modbus_driver.poll(io, &sink);
        if (!linked) {
            (void)nanosleep(&pause, NULL);
        }
    }
    tl_modbus_driver.close(io);
    for (size_t i = 0; i < count; i++) {
        (void)printf("%d %.17g\n", (int)readings[i].quality, readings[i].value);
    }
    return EXIT_SUCCESS;
}

static int run_serve(void) {
    const tl_plant_server_settings settings = {
        .host = "127.0.0.1", .port = 0, .channels = channels, .channel_count = count};
    tl_plant_server *server = NULL;
    tl_error error = {.status = TL_OK};
    if (tl_plant_server_start(&settings, &server, &error) != TL_OK) {
        return tl_probe_fail(error.text);
    }
    tl_plant_server_set_all(server, values, NULL);
    (void)printf("%u\n", (unsigned)tl_plant_server_port(server));
    (void)fflush(stdout);
    while (getchar() != EOF) {
    }
    tl_plant_server_counts counts = tl_plant_server_count(server);
    tl_plant_server_stop(server);
    (void)printf("%llu %llu\n", (unsigned long long)counts.requests, (unsigned long long)counts.refused_writes);
    return EXIT_SUCCESS;
}

int main(int argc, char **argv) {
    if (!read_channels()) {
        return tl_probe_fail("a line is no channel, or there are too many");
    }
    if (argc >= 3 && argc <= 5 && strcmp(argv[1], "read") == 0) {
        return run_read(argv[2], argc >= 4 ? argv[3] : NULL, argc == 5);
    }
    if (argc == 2 && strcmp(argv[1], "serve") == 0) {
        return run_serve();
    }
    return tl_probe_fail("say read HOST PORT [rtu], read DEVICE, or serve");
}
