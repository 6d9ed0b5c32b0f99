/* Benchmark: cost of a channel between two processes. Compares steps of some microseconds, with one
 * message in each direction, with the same steps in a loop without a channel. Pin it with taskset.
 * It prints times and checks nothing: README.md.
 *
 *     bench_channel [STEPS [MICROSECONDS [WANTED]]] */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/process/block.h"
#include "firmware/process/channel.h"

enum { TICK = 1300, RESULT = 700, TURNS_TIMED = 1000000, ROUNDS = 5 };

static const tl_channel_settings settings = {
    .sizes = {.bytes = {[TL_MESSAGE_TICK] = TICK, [TL_MESSAGE_RESULT] = RESULT}}};
static long steps = 1000000;
static uint32_t wanted = 128;
static uint64_t turns; /* of the loop of a step */

/* Simulates an FMU's work: takes the same time in each process, and uses no memory. */
static uint64_t work(uint64_t state) {
    for (uint64_t i = 0; i < turns; i++) {
        state = state * 6364136223846793005U + 1442695040888963407U;
        __asm__ volatile("" : "+r"(state)); /* the compiler must not remove the loop */
    }
    return state;
}

static double seconds_since(tl_time begin) {
    return (double)(tl_clock_now(NULL) - begin) / (double)TL_SECOND;
}

static void fit_turns(double microseconds) {
    double best = 1.0;
    turns = TURNS_TIMED;
    for (int i = 0; i < 10; i++) {
        tl_time begin = tl_clock_now(NULL);
        (void)work(1);
        best = seconds_since(begin) < best ? seconds_since(begin) : best;
    }
    turns = (uint64_t)(microseconds * 1e-6 / best * TURNS_TIMED);
}

/* One step: reads a sample and writes a record, as a twin does. */
static void step(const uint8_t *tick, uint8_t *result) {
    uint64_t state = 0;
    memcpy(&state, tick, sizeof state);
    state = work(state);
    memcpy(result, &state, sizeof state);
}

static double run_floor(void) {
    uint8_t tick[TICK] = {0};
    uint8_t result[RESULT] = {0};
    tl_time begin = tl_clock_now(NULL);
    for (long i = 0; i < steps; i++) {
        memcpy(tick, &i, sizeof i);
        step(tick, result);
    }
    return seconds_since(begin);
}

static void be_child(tl_channel *channel) {
    uint8_t tick[TICK];
    uint8_t result[RESULT] = {0};
    tl_message type = TL_MESSAGES;
    (void)tl_channel_offer(channel, TL_MESSAGE_READY, NULL);
    (void)tl_channel_offer(channel, TL_MESSAGE_BUILT, NULL);
    tl_channel_push(channel);
    while (type != TL_MESSAGE_END) {
        if (tl_channel_take(channel, &type, tick) == TL_CHANNEL_NOTHING) {
            (void)tl_channel_wait(channel, wanted, 0, INT64_MAX);
            continue;
        }
        step(tick, result);
        while (type == TL_MESSAGE_TICK && !tl_channel_offer(channel, TL_MESSAGE_RESULT, result)) {
            (void)tl_channel_wait(channel, 0, wanted, INT64_MAX);
        }
        tl_channel_push(channel);
    }
}

static void drive(tl_channel *channel) {
    uint8_t tick[TICK] = {0};
    uint8_t result[RESULT];
    tl_message type = TL_MESSAGES;
    long sent = 0;
    for (long received = -2; received < steps;) {
        while (received >= 0 && sent < steps && tl_channel_offer(channel, TL_MESSAGE_TICK, tick)) {
            sent++;
            memcpy(tick, &sent, sizeof sent);
        }
        tl_channel_push(channel);
        long before = received;
        while (tl_channel_take(channel, &type, result) == TL_CHANNEL_SOMETHING) {
            received++;
        }
        if (before == received) {
            (void)tl_channel_wait(channel, wanted, 0, INT64_MAX);
        }
    }
    (void)tl_channel_offer(channel, TL_MESSAGE_END, NULL);
    tl_channel_push(channel);
}

static double run_channel(void) {
    tl_block blocks[TL_SIDES];
    void *memory[TL_SIDES];
    tl_channel channel;
    tl_error error;
    for (int i = 0; i < TL_SIDES; i++) {
        if (tl_block_make("ring", tl_channel_bytes(&settings, (tl_side)i),
                          i == 0 ? TL_BLOCK_WE_WRITE : TL_BLOCK_THEY_WRITE, &blocks[i], &error) != TL_OK) {
            (void)fprintf(stderr, "%s\n", error.text);
            exit(1);
        }
        memory[i] = blocks[i].bytes;
    }
    pid_t pid = fork();
    tl_channel_open(&settings, pid == 0 ? TL_CHILD : TL_PARENT, memory, &channel);
    if (pid == 0) {
        be_child(&channel);
        _exit(0);
    }
    tl_time begin = tl_clock_now(NULL);
    drive(&channel);
    double seconds = seconds_since(begin);
    (void)waitpid(pid, NULL, 0);
    tl_block_close(&blocks[0]);
    tl_block_close(&blocks[1]);
    return seconds;
}

/* Rounds of both alternate. The result is the fastest round of each, because other programs also
 * use the machine. */
int main(int argc, char **argv) {
    double microseconds = argc > 2 ? strtod(argv[2], NULL) : 3.0;
    double best[2] = {1e9, 1e9};
    steps = argc > 1 ? strtol(argv[1], NULL, 10) : steps;
    wanted = argc > 3 ? (uint32_t)strtoul(argv[3], NULL, 10) : wanted;
    fit_turns(microseconds);
    for (int i = 0; i < ROUNDS; i++) {
        double floor = run_floor();
        double channel = run_channel();
        best[0] = floor < best[0] ? floor : best[0];
        best[1] = channel < best[1] ? channel : best[1];
    }
    (void)printf("steps of %.3f us: %.3f us with a channel, %+.2f %%\n", best[0] / (double)steps * 1e6,
                 best[1] / (double)steps * 1e6, (best[1] / best[0] - 1.0) * 100.0);
    return 0;
}
