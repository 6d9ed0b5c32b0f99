/* Fuzzes a channel whose other side is hostile: it can write any value into its block between two
 * of our calls.
 *
 * Input:  which side we are, then actions. The hostile side sends a message, changes a counter, or
 *         writes a word anywhere in its block. We offer, push, take, or wait for no time. Blocks
 *         have no spare bytes, so that an access outside of them is detected. */
#include <stdlib.h>
#include <string.h>

#include "firmware/process/channel.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { PAGE = 4096, LINE = 64, COUNTERS = 4, CANARY = 0x5A };

static const tl_channel_settings settings = {.sizes = {.bytes = {[TL_MESSAGE_TICK] = 100,
                                                                 [TL_MESSAGE_FINISH] = 100,
                                                                 [TL_MESSAGE_READY] = 8,
                                                                 [TL_MESSAGE_RESULT] = 40,
                                                                 [TL_MESSAGE_ENDED] = 4}},
                                             .extra = {10, 20}};
static uint8_t *blocks[TL_SIDES];
static tl_channel channel;
static tl_side enemy;
static bool was_broken;

static uint32_t *word_at(size_t offset) {
    return (uint32_t *)(void *)(blocks[enemy] + offset);
}

/* ---- the enemy ---- */

/* Writes the next message into the ring, of any type and length; few of them are valid. */
static void send(unsigned what) {
    size_t stride = (8 + tl_protocol_longest(&settings.sizes, enemy) + LINE - 1) / LINE * LINE;
    size_t slot = PAGE + *word_at(0) % TL_CHANNEL_DEPTH * stride;
    uint32_t type = what % (TL_MESSAGES + 1);
    *word_at(slot) = type;
    *word_at(slot + 4) = what < 240 && type < TL_MESSAGES ? settings.sizes.bytes[type] : tl_fuzz_take_word();
    *word_at(slot + 8) = what;
    (*word_at(0))++;
}

static void attack(unsigned what) {
    unsigned how = what / 4 % 4;
    if (how == 0) {
        send(tl_fuzz_take());
    } else if (how == 1) { /* a counter, a little */
        uint32_t *counter = word_at(tl_fuzz_take() % COUNTERS * LINE + what / 16 % 2 * 4);
        *counter += (uint32_t)(int)(tl_fuzz_take() - 128);
    } else if (how == 2) { /* takes all messages */
        memcpy(word_at(LINE), blocks[channel.side], 4);
    } else {
        size_t words = tl_channel_bytes(&settings, enemy) / 4;
        *word_at(tl_fuzz_take_word() % words * 4) = tl_fuzz_take_word();
    }
}

/* ---- we ---- */

/* Offers a message if its type is valid now. */
static void offer(unsigned what) {
    uint8_t payload[100] = {(uint8_t)what};
    tl_message type = (tl_message)(what / 4 % TL_MESSAGES);
    if (tl_protocol_check(&settings.sizes, &channel.phases, channel.side, (uint32_t)type, settings.sizes.bytes[type],
                          NULL) == TL_OK) {
        tl_fuzz_hold(!tl_channel_offer(&channel, type, payload) || !was_broken);
    }
}

static void take(void) {
    uint8_t payload[128];
    tl_message type = TL_MESSAGES;
    size_t longest = tl_protocol_longest(&settings.sizes, enemy);
    tl_protocol_phases before = channel.phases;
    uint32_t taken = channel.taken;
    memset(payload, CANARY, sizeof payload);
    tl_channel_event outcome = tl_channel_take(&channel, &type, payload);
    for (size_t i = outcome == TL_CHANNEL_SOMETHING ? settings.sizes.bytes[type] : 0; i < sizeof payload; i++) {
        tl_fuzz_hold(payload[i] == CANARY);
    }
    tl_fuzz_hold(outcome != TL_CHANNEL_NUDGED && (outcome == TL_CHANNEL_BROKEN || !was_broken) &&
                 longest < sizeof payload);
    tl_fuzz_hold(channel.taken == taken + (outcome == TL_CHANNEL_SOMETHING ? 1 : 0));
    if (outcome == TL_CHANNEL_SOMETHING) {
        tl_fuzz_hold(tl_protocol_check(&settings.sizes, &before, enemy, (uint32_t)type, settings.sizes.bytes[type],
                                       NULL) == TL_OK);
    }
}

static void act(unsigned what) {
    switch (what % 4) {
    case 0:
        attack(what);
        break;
    case 1:
        take();
        break;
    case 2:
        offer(what);
        break;
    default:
        if (what % 8 == 3) {
            tl_channel_push(&channel);
        } else {
            tl_channel_event outcome =
                tl_channel_wait(&channel, what / 8 % 2 == 0 ? 1 + what / 16 : 0, 1 + what / 16, 0);
            tl_fuzz_hold(outcome == TL_CHANNEL_BROKEN || !was_broken);
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_fuzz_begin(data, size);
    tl_side side = tl_fuzz_take() % 2 == 0 ? TL_PARENT : TL_CHILD;
    enemy = side == TL_PARENT ? TL_CHILD : TL_PARENT;
    was_broken = false;
    for (int i = 0; i < TL_SIDES; i++) {
        size_t bytes = tl_channel_bytes(&settings, (tl_side)i);
        void *block = NULL;
        tl_fuzz_hold(posix_memalign(&block, PAGE, bytes) == 0);
        memset(block, 0, bytes);
        blocks[i] = block;
    }
    void *const memory[TL_SIDES] = {blocks[TL_PARENT], blocks[TL_CHILD]};
    tl_channel_open(&settings, side, memory, &channel);
    while (!tl_fuzz_is_over()) {
        act(tl_fuzz_take());
        tl_fuzz_hold((channel.fault.status == TL_OK) == (channel.fault.text[0] == '\0'));
        tl_fuzz_hold(!was_broken || channel.fault.status != TL_OK);
        was_broken = channel.fault.status != TL_OK;
    }
    free(blocks[TL_PARENT]);
    free(blocks[TL_CHILD]);
    return 0;
}
