/* The CAN codec and the emulated bus as a program, for test_can_oracle.py: signals as a configuration has them.
 *
 *   can_probe CONFIG decode   reads lines "id extended bytes" ("123 0 00ff…", hexadecimal) and prints for each
 *                             "name=value …" of the signals in that frame, those that are not finite as "name=nan"
 *   can_probe CONFIG encode   reads lines with one value per signal and prints for each the frames that the emulated
 *                             plant sends, "id extended fd bytes …"
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board/can/can_codec.h"
#include "firmware/cli/plant_bus.h"
#include "firmware/config/config.h"
#include "tests/replay/probe.h"

static tl_config config;
static tl_can_channel channels[TL_MAX_SIGNALS];
static tl_can_map map;

static void report(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    (void)fprintf(stderr, "%s: %s\n", where, text);
}

/* Two hexadecimal digits; −1 where there are none. */
static int byte_at(const char *text) {
    char pair[3] = {text[0], text[0] != '\0' ? text[1] : '\0', '\0'};
    char *end = NULL;
    long byte = strtol(pair, &end, 16);
    return end == pair + 2 ? (int)byte : -1;
}

static void print_signal(const tl_can_entry *entry, const uint8_t *data, size_t length) {
    double value = 0;
    if (length < entry->bytes || !tl_can_is_present(&entry->channel, data)) {
        return;
    }
    if (tl_can_decode(&entry->channel, data, &value)) {
        (void)printf("%s=%.17g ", config.signals[entry->index].plan.name, value);
    } else {
        (void)printf("%s=nan ", config.signals[entry->index].plan.name);
    }
}

static int decode_line(const char *line) {
    char *at = NULL;
    uint8_t data[TL_CAN_BYTES] = {0};
    uint32_t id = (uint32_t)strtoul(line, &at, 16);
    long extended = strtol(at, &at, 10);
    size_t length = 0;
    if (*at != ' ') {
        return tl_probe_fail("a line is no frame");
    }
    for (at++; length < TL_CAN_BYTES && byte_at(at) >= 0; at += 2) {
        data[length++] = (uint8_t)byte_at(at);
    }
    const tl_can_id *found = NULL;
    while ((found = tl_can_map_find(&map, found, id, extended != 0)) != NULL) {
        for (size_t i = found->first; i < found->first + found->entries; i++) {
            print_signal(&map.entries[i], data, length);
        }
    }
    (void)printf("\n");
    return EXIT_SUCCESS;
}

static int encode_line(const char *line) {
    static tl_plant_bus_frame frames[TL_MAX_SIGNALS];
    char *at = NULL;
    size_t count = tl_plant_bus_plan(channels, config.signal_count, frames);
    for (size_t i = 0; i < config.signal_count; i++) {
        double value = strtod(line, &at);
        if (at == line) {
            return tl_probe_fail("a line has too few values");
        }
        line = at;
        for (size_t k = 0; k < count; k++) {
            if (frames[k].members[i]) {
                tl_can_encode(&channels[i], value, frames[k].data);
            }
        }
    }
    for (size_t k = 0; k < count; k++) {
        (void)printf("%" PRIx32 " %d %d ", frames[k].id, frames[k].extended ? 1 : 0, frames[k].fd ? 1 : 0);
        for (size_t i = 0; i < frames[k].bytes; i++) {
            (void)printf("%02x", frames[k].data[i]);
        }
        (void)printf(k + 1 < count ? " " : "\n");
    }
    return EXIT_SUCCESS;
}

int main(int argc, char **argv) {
    static char line[64 * 1024];
    tl_report to = {.add = report};
    if (argc != 3 || (strcmp(argv[2], "decode") != 0 && strcmp(argv[2], "encode") != 0)) {
        return tl_probe_fail("say CONFIG decode, or CONFIG encode");
    }
    if (tl_config_read(argv[1], &config, &to) != TL_OK) {
        return EXIT_FAILURE;
    }
    for (size_t i = 0; i < config.signal_count; i++) {
        channels[i] = *(const tl_can_channel *)config.signals[i].channel;
    }
    if (!tl_can_map_make(&map, channels, config.signal_count)) {
        return tl_probe_fail("out of memory");
    }
    int result = EXIT_SUCCESS;
    while (result == EXIT_SUCCESS && fgets(line, sizeof line, stdin) != NULL) {
        result = argv[2][0] == 'd' ? decode_line(line) : encode_line(line);
    }
    tl_can_map_release(&map);
    tl_config_free(&config);
    return result;
}
