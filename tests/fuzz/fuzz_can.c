/* Fuzzes the input of a CAN bus: frames, error frames and the state of the interface, through the
 * driver, its map, its codec, the meaning of error frames, and the conversion of stamps.
 *
 * The harness replaces can_link.c and the clock: frames are bytes of the input, and the input moves
 * the clocks. So nothing waits, and the same bytes have the same effect. An input is channels, then
 * events: see read_channels() and tl_can_link_receive().
 */
#include <math.h>
#include <string.h>

#include "board/can/can.h"
#include "board/can/can_link.h"
#include "board/io/monotonic.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { CHANNELS = 12, POLLS = 200 };

/* ---- the input ---- */

static tl_can_channel channels[CHANNELS];
static size_t channel_count;

static tl_can_field read_field(void) {
    unsigned order = tl_fuzz_take();
    tl_can_field field = {.order = (order & 1) != 0 ? TL_CAN_MOTOROLA : TL_CAN_INTEL,
                          .length = (uint16_t)(order / 2 % 70)};
    field.start = (uint16_t)(tl_fuzz_take() << 1);
    field.start = (uint16_t)(field.start | order >> 7);
    return field;
}

static void read_conditions(tl_can_channel *channel, unsigned count) {
    channel->condition_count = count;
    for (size_t i = 0; i < count && i < TL_CAN_CONDITIONS; i++) {
        tl_can_condition *condition = &channel->conditions[i];
        condition->field = read_field();
        condition->value_count = tl_fuzz_take() % (TL_CAN_CONDITION_VALUES + 2);
        for (size_t k = 0; k < condition->value_count && k < TL_CAN_CONDITION_VALUES; k++) {
            condition->values[k] = tl_fuzz_take();
        }
    }
}

/* Each has an id, which a few share, the bytes of its frame, a type, a scale, a field and
 * multiplexors. */
static void read_channels(void) {
    static const double SCALES[] = {1, 0.1, -3, 1e300};
    static const uint8_t BYTES[] = {8, 64, 4, 12, 1, 48, 0, 9};
    channel_count = 1 + tl_fuzz_take() % CHANNELS;
    for (size_t i = 0; i < channel_count; i++) {
        unsigned head = tl_fuzz_take();
        unsigned what = tl_fuzz_take();
        tl_can_channel channel = {.id = head % 16 == 15 ? tl_fuzz_take_word() : head % 16,
                                  .extended = (head & 0x10) != 0,
                                  .bytes = BYTES[head / 32],
                                  .type = (tl_can_type)(what % 4),
                                  .scale = SCALES[what / 4 % 4],
                                  .offset = what >> 4 & 1};
        channel.field = read_field();
        if (channel.type == TL_CAN_FLOAT32 || channel.type == TL_CAN_FLOAT64) {
            channel.field.length = channel.type == TL_CAN_FLOAT32 ? 32 : 64;
        }
        channels[i] = channel;
        read_conditions(&channels[i], what / 32 % 6);
    }
}

/* ---- the link ---- */

static tl_time clock_now;
static tl_time wall_ahead; /* of the wall clock */
static tl_time last_stamp;
static bool woken;
static tl_can_state state;
static const tl_can_frame *received; /* the newest of data */

bool tl_can_link_make(tl_can_link *link, const char *interface) {
    tl_fuzz_hold(interface[0] != '\0');
    *link = (tl_can_link){.interface = "fuzz0", .socket = -1, .wake = {.descriptor = -1}};
    return true;
}

bool tl_can_link_open(tl_can_link *link, const tl_can_map *map, char *cause, size_t cause_size) {
    tl_fuzz_hold(link->socket < 0 && map->id_count <= map->entry_count);
    for (size_t i = 0; i < map->id_count; i++) {
        tl_fuzz_hold(tl_can_map_find(map, NULL, map->ids[i].id, map->ids[i].extended) == &map->ids[i]);
    }
    link->socket = tl_fuzz_take() % 8 == 7 ? -1 : 100;
    (void)strncpy(cause, "there is no such interface", cause_size);
    return link->socket >= 0;
}

bool tl_can_link_state(const tl_can_link *link, tl_can_state *now) {
    tl_fuzz_hold(link->socket >= 0);
    *now = state;
    return tl_fuzz_take() < 250;
}

/* Advances the clock, and may change the wall clock and the state of the interface. */
bool tl_can_link_await(tl_can_link *link, int timeout_ms) {
    unsigned what = tl_fuzz_take();
    (void)link;
    clock_now += (tl_time)timeout_ms * (TL_SECOND / 1000) * (what % 32);
    if (what % 64 == 63) {
        wall_ahead = (tl_time)(int32_t)tl_fuzz_take_word() * (TL_SECOND / 1000);
    }
    if (what >= 192) {
        unsigned now = tl_fuzz_take();
        state = (tl_can_state){.up = now % 4 != 3, .running = now / 4 % 4 != 3, .fd = now / 16 % 2 != 0};
    }
    bool was = woken;
    woken = false;
    return !was;
}

/* Data, or the classes and data of an error frame. */
static void fill(tl_can_frame *frame, unsigned what) {
    unsigned head = tl_fuzz_take();
    frame->id = head % 16 == 15 ? tl_fuzz_take_word() : head % 16;
    frame->extended = (head & 0x10) != 0;
    frame->length = (uint8_t)(head / 32 < 7 ? head / 32 + 2 : tl_fuzz_take() % (TL_CAN_BYTES + 1));
    frame->lost = what / 64 == 3 ? tl_fuzz_take() : 0;
    for (size_t i = 0; i < frame->length; i++) {
        frame->data[i] = (uint8_t)tl_fuzz_take();
    }
}

/* Stamps the frame as can_link.h specifies. */
static void stamp(tl_can_link *link, tl_can_frame *frame, unsigned what) {
    tl_time sent = what % 64 < 32 ? clock_now + wall_ahead : (tl_time)tl_fuzz_take_word() * (TL_SECOND / 1000);
    frame->stamp = tl_can_clock_stamp(&link->clock, sent, clock_now, clock_now + wall_ahead);
    tl_fuzz_hold(frame->stamp <= clock_now && frame->stamp >= last_stamp);
    last_stamp = frame->stamp;
}

tl_can_arrival tl_can_link_receive(tl_can_link *link, tl_can_frame *frame) {
    unsigned what = tl_fuzz_take();
    tl_fuzz_hold(link->socket >= 0);
    memset(frame, 0, sizeof *frame);
    if (tl_fuzz_is_over() || what % 16 == 0) {
        tl_can_clock_empty(&link->clock, clock_now, clock_now + wall_ahead);
        return TL_CAN_NOTHING;
    }
    if (what % 16 == 1) {
        return what / 16 < 14 ? TL_CAN_DOWN : TL_CAN_LOST;
    }
    if (what % 16 == 2) {
        return TL_CAN_OTHER;
    }
    fill(frame, what);
    stamp(link, frame, what);
    if (what % 16 < 6) {
        frame->fault = tl_can_fault_of(frame->id, frame->data);
        tl_fuzz_hold(frame->fault.health >= TL_CAN_SAME && frame->fault.health <= TL_CAN_BUS_OFF);
        return TL_CAN_ERROR;
    }
    received = frame;
    return TL_CAN_DATA;
}

void tl_can_link_close(tl_can_link *link) {
    link->socket = -1;
}

void tl_can_link_interrupt(tl_can_link *link) {
    (void)link;
    woken = true;
}

void tl_can_link_release(tl_can_link *link) {
    tl_can_link_close(link);
}

tl_time tl_monotonic_now(void) {
    return clock_now;
}

/* ---- what the driver says ---- */

/* Returns the bits of a field, read one by one, the most significant first. */
static uint64_t bits_of(const tl_can_field *field, const uint8_t *data) {
    uint64_t bits = 0;
    unsigned at = field->start;
    for (unsigned i = 0; i < field->length; i++) {
        unsigned bit = field->order == TL_CAN_INTEL ? field->start + field->length - 1U - i : at;
        tl_fuzz_hold(bit / 8 < TL_CAN_BYTES);
        bits = bits << 1 | ((unsigned)data[bit / 8] >> bit % 8 & 1U);
        at = at % 8 == 0 ? at + 15 : at - 1; /* from bit 0 of a byte to bit 7 of the next */
    }
    return bits;
}

static void check_value(const tl_can_channel *channel, double value) {
    uint64_t bits = bits_of(&channel->field, received->data);
    uint8_t data[TL_CAN_BYTES] = {0};
    double again = 0;
    tl_fuzz_hold(tl_can_read_bits(&channel->field, received->data) == bits);
    if (channel->type == TL_CAN_UNSIGNED) {
        tl_fuzz_hold(value == (double)bits * channel->scale + channel->offset);
    }
    if (channel->scale == 1 && channel->offset == 0 && channel->condition_count == 0) {
        tl_can_encode(channel, value, data);
        tl_fuzz_hold(tl_can_decode(channel, data, &again) && again == value);
    }
}

static void post(void *context, size_t channel, const tl_reading *reading) {
    (void)context;
    tl_fuzz_hold(channel < channel_count && isfinite(reading->value) && reading->stamp <= clock_now);
    if (reading->quality == TL_GOOD) {
        tl_fuzz_hold(received->length >= tl_can_channel_bytes(&channels[channel]));
        tl_fuzz_hold(received->id == channels[channel].id && received->extended == channels[channel].extended);
        check_value(&channels[channel], reading->value);
    }
}

static void say(void *context, bool up, const char *text) {
    (void)context;
    (void)up;
    tl_fuzz_hold(strncmp(text, "CAN interface fuzz0: ", 21) == 0 && strlen(text) > 24 &&
                 strstr(text, "(null)") == NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const tl_plant_io_sink sink = {.post = post, .link = say};
    tl_plant_io *io = NULL;
    tl_error error;
    tl_fuzz_begin(data, size);
    clock_now = TL_SECOND;
    wall_ahead = 1000 * TL_SECOND;
    last_stamp = 0;
    woken = false;
    state = (tl_can_state){.up = true, .running = true};
    read_channels();
    const tl_can_settings settings = {.interface = "fuzz0", .channels = channels, .channel_count = channel_count};
    if (tl_can_open(&settings, &io, &error) != TL_OK) {
        tl_fuzz_hold(error.text[0] != '\0');
        return 0;
    }
    for (int i = 0; i < POLLS && !tl_fuzz_is_over(); i++) {
        if (tl_fuzz_take() == 255) {
            tl_can_driver.interrupt(io);
        }
        tl_can_driver.poll(io, &sink);
    }
    tl_can_driver.finish(io, &sink);
    tl_can_driver.close(io);
    return 0;
}
