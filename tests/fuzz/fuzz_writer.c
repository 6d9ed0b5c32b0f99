/* Fuzzes the recorder's writer with a record queue into whose memory a hostile process writes.
 *
 * Input:  actions. A twin puts entries, events and checkpoints with any numbers and texts. The
 *         hostile process writes a word anywhere into the record queue. The writer writes, or
 *         another writer continues with its state. A successor of the twin opens the record queue.
 * Holds:  no failure ends the writer; a history reads all runs completely, without damage. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/store/history.h"
#include "firmware/store/recorder_writer.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { PAGE = 4096, RING = 256 * 1024, CHECKPOINT = 60, TICKS_MOST = 1000 };

static const tl_recorder_signal signals[] = {{.name = "a", .unit = "", .to = "b", .type = TL_REAL},
                                             {.name = "b", .unit = "", .to = "a", .type = TL_REAL}};
static const tl_record_queue_settings settings = {.shape = {.plant = 2, .match = 1, .adjust = 1, .components = 1},
                                                  .ring_bytes = RING,
                                                  .checkpoint_bytes = CHECKPOINT};
static char path[512];
static uint8_t *memory; /* allocated once */
static tl_recorder_writer_state state;
static tl_recorder_writer *writer;
static tl_record_queue queue;

static const tl_recorder_known known = {.number = 2,
                                        .hash = "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
                                        .text = "{\"another\": 1}",
                                        .who = "who",
                                        .origin = "origin",
                                        .why = "why"};

static tl_recorder_settings record(void) {
    return (tl_recorder_settings){.path = path,
                                  .open_policy = TL_DATABASE_ANYHOW,
                                  .max_bytes = 1000000,
                                  .commit = TL_SECOND,
                                  .verb = "run",
                                  .name = "fuzz",
                                  .configuration = "{}",
                                  .step = TL_SECOND / 1000,
                                  .plant = signals,
                                  .match = signals,
                                  .adjust = signals,
                                  .plant_count = 2,
                                  .match_count = 1,
                                  .adjust_count = 1,
                                  .known = &known,
                                  .known_count = 1};
}

static void open_writer(void) {
    const tl_recorder_settings made = record();
    const tl_recorder_writer_queue only = {"twin", settings, memory};
    const tl_recorder_writer_settings wanted = {.record = &made, .queues = &only, .queue_count = 1, .state = &state};
    tl_fuzz_hold(tl_recorder_writer_open(&wanted, &writer, NULL) == TL_OK);
}

/* ---- the twin ---- */

/* Returns a number that is usually small, else arbitrary. */
static int64_t number(void) {
    unsigned what = tl_fuzz_take();
    if (what < 200) {
        return what;
    }
    uint64_t bits = (uint64_t)tl_fuzz_take_word() << 32 | tl_fuzz_take_word();
    return (int64_t)(what % 2 == 0 ? bits >> what % 64 : ~(bits >> what % 64));
}

static double value(void) {
    uint64_t bits = (uint64_t)number();
    double result = 0.0;
    memcpy(&result, &bits, sizeof result);
    return result;
}

static void put_start(unsigned what) {
    static tl_record_queue_start start;
    memset(&start, 0, sizeof start);
    start.holds = what % 4 == 0;
    start.resumption = (tl_resumption){
        .from = (tl_resumed_from)(what % 4), .run = number(), .tick = number(), .start = number(), .started = number()};
    start.account.components = what % 3;
    start.account.matches = what % 2;
    start.account.prediction = (uint32_t)number();
    start.account.lead = (uint32_t)number();
    start.account.component[0].name[0] = (char)(tl_fuzz_take() | 0xA0);
    start.account.match[0].unit[0] = (char)(tl_fuzz_take() | 0xA0);
    (void)tl_record_queue_put_start(&queue, &start);
}

/* Puts a tuning of a known or an unknown configuration. */
static void put_tuning(unsigned what) {
    tl_run_tuning tuning = {.tick = number(), .number = (uint32_t)what};
    memset(tuning.hash, what % 4 == 1 ? 'b' : 'a', sizeof tuning.hash - 1);
    (void)tl_record_queue_put_tuning(&queue, &tuning);
}

static void put_entry(unsigned what) {
    if (what % 7 == 4) {
        put_tuning(what);
        return;
    }
    if (what % 2 == 0) {
        tl_sample sample = {.tick = number(), .values = {value(), value()}, .stamps = {number(), number()}};
        sample.quality[0] = (uint8_t)(what % (TL_LAST_QUALITY + 1));
        (void)tl_record_queue_put_sample(&queue, &sample);
        return;
    }
    tl_record entry = {.step = number(), .used = number(), .objective = value(), .flags = what % 32};
    tl_execution_counts ledger = {(uint64_t)number(), (uint64_t)number(), (uint64_t)number(), 0, 0};
    entry.y[0] = value();
    entry.u[0] = value();
    (void)tl_record_queue_put_step(&queue, &entry, &ledger);
}

static void put_checkpoint(unsigned what) {
    size_t capacity = 0;
    (void)tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT);
    memset(tl_record_queue_checkpoint_room(&queue, &capacity), (int)what, CHECKPOINT);
    tl_record_queue_put_checkpoint(&queue, number(), what % (CHECKPOINT + 1));
}

static void put_event(unsigned what) {
    const char text[] = {(char)tl_fuzz_take(), (char)tl_fuzz_take(), (char)tl_fuzz_take(), '\0'};
    tl_record_queue_event(&queue, number(), (tl_severity)(what % 3), text + 1, text);
}

static void attack(void) {
    uint32_t word = tl_fuzz_take_word();
    uint32_t place = tl_fuzz_take_word();
    size_t bytes = place % 2 == 0 ? tl_record_queue_bytes(&settings) : 2 * PAGE; /* where it matters more */
    memcpy(memory + place / 2 % (bytes / 4) * 4, &word, 4);
}

/* ---- the history ---- */

static void walk_ticks(tl_history *history, const tl_history_run *run) {
    tl_history_ticks *ticks = NULL;
    tl_history_tick tick;
    bool end = false;
    tl_fuzz_hold(tl_history_ticks_begin(history, run, 0, &ticks, NULL) == TL_OK);
    for (int i = 0; i < TICKS_MOST && !end; i++) {
        tl_fuzz_hold(tl_history_ticks_next(ticks, &tick, &end, NULL) == TL_OK);
    }
    tl_history_ticks_end(ticks);
}

static void read_run(tl_history *history, const tl_history_run *run) {
    const tl_run_component *components = NULL;
    const tl_recorder_signal *found = NULL;
    const tl_history_checkpoint *checkpoint = NULL;
    size_t count = 0;
    int64_t step = 0;
    const tl_history_tuning *tunings = NULL;
    const char *text = NULL;
    tl_fuzz_hold(tl_history_tunings(history, run, &tunings, &count, NULL) == TL_OK);
    tl_fuzz_hold(count == 0 || tl_history_configuration_text(history, tunings[0].hash, &text, NULL) == TL_OK);
    tl_fuzz_hold(tl_history_ledger(history, run, &components, &count, NULL) == TL_OK);
    tl_fuzz_hold(tl_history_signals(history, run, TL_HISTORY_MATCH, &found, &count, NULL) == TL_OK);
    tl_fuzz_hold(tl_history_last_step(history, run, &step, NULL) == TL_OK);
    tl_fuzz_hold(tl_history_checkpoint_before(history, run, INT64_MAX, &checkpoint, NULL) == TL_OK);
    walk_ticks(history, run);
}

static void read_history(void) {
    tl_history *history = NULL;
    const tl_history_run *runs = NULL;
    size_t count = 0;
    tl_fuzz_hold(tl_history_open(path, &history, NULL) == TL_OK);
    tl_fuzz_hold(tl_history_runs(history, &runs, &count, NULL) == TL_OK);
    for (size_t i = 0; i < count; i++) {
        read_run(history, &runs[i]);
    }
    tl_history_close(history);
}

/* ---- all of it ---- */

static void act(unsigned what) {
    switch (what % 9) {
    case 0:
        put_start(what / 9);
        break;
    case 1:
    case 2:
    case 3:
        put_entry(what / 9);
        break;
    case 4:
        put_event(what / 9);
        break;
    case 5:
        put_checkpoint(what / 9);
        break;
    case 6:
        attack();
        break;
    case 7:
        tl_recorder_writer_write(writer);
        break;
    default:
        if (what / 9 % 4 == 0) {
            (void)tl_record_queue_put_end(&queue, "\xFF\n");
        } else if (what / 9 % 4 == 1) {
            tl_record_queue_open(&settings, memory, &state.taken[0], &queue);
        } else {
            (void)tl_recorder_writer_close(writer, 0, NULL);
            open_writer();
        }
    }
}

/* What was recorded for the input before. */
static void remove_database(void) {
    static const char *const ends[] = {"", "-wal", "-shm"};
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        char name[sizeof path + 8];
        (void)snprintf(name, sizeof name, "%s%s", path, ends[i]);
        (void)remove(name);
    }
}

static void begin(void) {
    size_t bytes = tl_record_queue_bytes(&settings);
    if (memory == NULL) {
        void *made = NULL;
        tl_fuzz_hold(posix_memalign(&made, PAGE, bytes) == 0);
        memory = made;
        (void)snprintf(path, sizeof path, "%s/writer.db", tl_fuzz_folder());
        tl_log_set_level(TL_LOG_ERROR - 1);
    }
    remove_database();
    memset(memory, 0, bytes);
    memset(&state, 0, sizeof state);
    tl_record_queue_open(&settings, memory, &state.taken[0], &queue);
    open_writer();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    begin();
    tl_fuzz_begin(data, size);
    while (!tl_fuzz_is_over()) {
        act(tl_fuzz_take());
    }
    (void)tl_recorder_writer_close(writer, 0, NULL);
    read_history();
    return 0;
}
