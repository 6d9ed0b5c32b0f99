/* Fuzzes a record queue into whose memory a hostile process writes: its reader, and a successor
 * that continues in it.
 *
 * Input:  actions. We put valid entries, events and checkpoints. The hostile process changes a
 *         counter or a byte of an entry, makes a checkpoint with a valid digest, or writes a word
 *         anywhere. The reader takes. A successor opens the record queue, reads back and puts.
 * Holds:  all that the reader returns is valid; a fault stays and has a text. After a successor has
 *         opened the record queue, a reader finds no fault, and finds the successor's entries. The
 *         memory has no spare bytes, so that an access outside of it is detected. */
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/store/record_queue.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { PAGE = 4096, RING = 128 * 1024, CHECKPOINT = 60, CANARY = 0x5A };

static const tl_record_queue_settings settings = {.shape = {.plant = 2, .match = 1, .adjust = 1, .components = 1},
                                                  .ring_bytes = RING,
                                                  .checkpoint_bytes = CHECKPOINT};
static uint8_t *memory; /* allocated once */
static tl_record_queue_taken taken;
static tl_record_queue queue; /* of the present producer */
static tl_record_queue_reader reader;
static tl_recorder_entry entry;

/* ---- we ---- */

static bool put_sample(unsigned what) {
    tl_sample sample = {.tick = what, .quality = {TL_GOOD, TL_STALE}};
    return tl_record_queue_put_sample(&queue, &sample);
}

static void put_start(unsigned what) {
    static tl_record_queue_start start;
    start.holds = what % 8 != 0;
    start.resumption.from = what % 3 == 0 ? TL_RESUMED_CHECKPOINT : TL_RESUMED_NOT;
    start.resumption.tick = what;
    (void)tl_record_queue_put_start(&queue, &start);
}

static bool put_step(unsigned what) {
    tl_record record = {.step = what, .flags = what % 32};
    tl_execution_counts ledger = {.plain = what};
    return tl_record_queue_put_step(&queue, &record, &ledger);
}

static void put_checkpoint(unsigned what) {
    size_t capacity = 0;
    size_t size = what % (CHECKPOINT + 1);
    (void)tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT);
    memset(tl_record_queue_checkpoint_room(&queue, &capacity), (int)what, size);
    tl_record_queue_put_checkpoint(&queue, what, size);
}

static void put_tuning(unsigned what) {
    tl_run_tuning tuning = {.tick = what, .number = what};
    memset(tuning.hash, what % 16 == 6 ? 'x' : 'a', what % 3 == 0 ? 0 : sizeof tuning.hash - 1);
    (void)tl_record_queue_put_tuning(&queue, &tuning);
}

static void put(unsigned what) {
    switch (what % 7) {
    case 0:
        (void)put_sample(what);
        break;
    case 1:
        (void)put_step(what);
        break;
    case 2:
        put_start(what);
        break;
    case 3:
        (void)tl_record_queue_put_end(&queue, "SIGTERM");
        break;
    case 4:
        tl_record_queue_event(&queue, what, TL_EVENT_INFO, "fuzz", "text");
        break;
    case 6:
        put_tuning(what);
        break;
    default:
        put_checkpoint(what);
    }
}

/* ---- the enemy ---- */

static void move_counter(unsigned what) {
    uint64_t *const counters[] = {&queue.control->head, &queue.control->put, &queue.control->next, &queue.control->lost,
                                  &queue.control->slots[what % TL_RECORDER_EVENTS].state};
    uint64_t by = what % 3 == 0 ? (uint64_t)tl_fuzz_take_word() << (what % 33) : tl_fuzz_take();
    *counters[tl_fuzz_take() % 5] += what % 2 == 0 ? by : -by;
}

/* Makes a checkpoint with any content and a valid digest. */
static void make_checkpoint(unsigned what) {
    uint64_t number = what % 4 == 0 ? UINT64_MAX / 2 - tl_fuzz_take() : tl_fuzz_take();
    tl_record_queue_checkpoint *place = &queue.control->places[number % TL_RECORD_QUEUE_CHECKPOINTS];
    tl_record_queue_mark mark;
    memset(&mark, 0, sizeof mark);
    mark.tick = tl_fuzz_take();
    mark.size = what % 8 == 1 ? tl_fuzz_take_word() : tl_fuzz_take() % (CHECKPOINT + 2);
    mark.position = queue.control->head - tl_fuzz_take_word() % (RING + 4096);
    mark.behind = mark.position;
    mark.beginning.from = (tl_resumed_from)(what % 6);
    const unsigned char *bytes =
        (const unsigned char *)queue.control + tl_record_queue_checkpoint_at(&queue.settings, 0);
    place->digest = mark.size > CHECKPOINT ? what : tl_record_queue_digest(number, &mark, bytes);
    memcpy(place->mark, &mark, sizeof mark);
    place->number = number;
}

static void attack(unsigned what) {
    size_t bytes = tl_record_queue_bytes(&settings);
    switch (what % 5) {
    case 0:
        move_counter(tl_fuzz_take());
        break;
    case 1: /* a byte of the last entries */
        queue.ring[(queue.control->head - tl_fuzz_take() - 1) % RING] = (uint8_t)tl_fuzz_take();
        break;
    case 2:
        make_checkpoint(tl_fuzz_take());
        break;
    case 3: {
        tl_recorder_event_entry *event = &queue.control->slots[(queue.control->next - 1) % TL_RECORDER_EVENTS].entry;
        ((uint8_t *)event)[tl_fuzz_take_word() % sizeof *event] = (uint8_t)tl_fuzz_take();
        break;
    }
    default: {
        uint32_t word = tl_fuzz_take_word();
        memcpy(memory + word % (bytes / 4) * 4, &word, 4);
    }
    }
}

/* ---- the reader ---- */

static bool is_text(const char *text, size_t size) {
    size_t length = strnlen(text, size);
    for (size_t i = 0; i < length; i++) {
        if ((unsigned char)text[i] < ' ' || text[i] == 0x7F) {
            return false;
        }
    }
    return length < size;
}

static void check_entry(void) {
    switch (entry.kind) {
    case TL_ENTRY_START:
        tl_fuzz_hold((unsigned)entry.start.resumption.from <= TL_RESUMED_INPUTS);
        tl_fuzz_hold(entry.start.holds || tl_account_is_sound(&entry.start.account));
        break;
    case TL_ENTRY_SAMPLE:
        tl_fuzz_hold(entry.sample.quality[0] <= TL_LAST_QUALITY && entry.sample.quality[1] <= TL_LAST_QUALITY);
        break;
    case TL_ENTRY_STEP:
        tl_fuzz_hold((unsigned)entry.record.outcome < TL_OUTCOMES && (unsigned)entry.record.stop <= TL_STOP_TIME &&
                     entry.record.flags < 2 * TL_LAST_FLAG && entry.record.measured_quality[0] <= TL_LAST_QUALITY);
        break;
    case TL_ENTRY_END:
        tl_fuzz_hold(is_text(entry.reason, sizeof entry.reason));
        break;
    case TL_ENTRY_TUNING:
        tl_fuzz_hold(tl_identity_is_sound(entry.tuning.hash));
        break;
    default:
        tl_fuzz_hold(false);
    }
}

/* Takes at most `most` entries. Returns true if none is left. */
static bool take_entries(unsigned most) {
    uint64_t end = tl_record_queue_reader_end(&reader, taken.ring);
    tl_fuzz_hold(end - taken.ring <= RING);
    while (taken.ring != end && most-- > 0) {
        uint64_t before = taken.ring;
        if (!tl_record_queue_reader_entry(&reader, &taken.ring, end, &entry)) {
            tl_fuzz_hold(taken.ring == before && reader.fault[0] != '\0');
            return false;
        }
        tl_fuzz_hold(taken.ring - before > 0 && end - taken.ring < end - before);
        check_entry();
    }
    return taken.ring == end;
}

static void take_events(unsigned most) {
    tl_recorder_event_entry event;
    bool skip = false;
    while (most-- > 0 && tl_record_queue_reader_event(&reader, taken.events, &event, &skip)) {
        tl_fuzz_hold(skip || ((unsigned)event.severity <= TL_EVENT_ERROR &&
                              is_text(event.source, sizeof event.source) && is_text(event.text, sizeof event.text)));
        taken.events++;
    }
}

static void take_checkpoint(void) {
    uint8_t bytes[CHECKPOINT + 16];
    size_t size = 0;
    int64_t tick = 0;
    uint64_t number = 0;
    memset(bytes, CANARY, sizeof bytes);
    bool there = tl_record_queue_reader_checkpoint(&reader, taken.checkpoint, taken.ring, bytes, &size, &tick, &number);
    for (size_t i = CHECKPOINT; i < sizeof bytes; i++) {
        tl_fuzz_hold(bytes[i] == CANARY);
    }
    if (there) {
        tl_fuzz_hold(number > taken.checkpoint && size > 0 && size <= CHECKPOINT);
        taken.checkpoint = number;
    }
}

static void take(unsigned what) {
    bool was_broken = reader.fault[0] != '\0';
    (void)take_entries(1 + what);
    take_events(1 + what);
    take_checkpoint();
    tl_fuzz_hold(!was_broken || reader.fault[0] != '\0');
}

/* ---- the successor ---- */

static void look_back(void) {
    tl_record_queue_saved left;
    uint64_t sum = 0;
    for (unsigned which = 0; which < 3; which++) {
        if (!tl_record_queue_saved_checkpoint(&queue, which, &left)) {
            continue;
        }
        tl_fuzz_hold(which < 2 && left.size <= CHECKPOINT && (unsigned)left.beginning.from <= TL_RESUMED_INPUTS);
        for (size_t i = 0; i < left.size; i++) {
            sum += left.bytes[i];
        }
        for (uint64_t left_to_read = queue.written - left.position;
             tl_record_queue_saved_entry(&queue, &left.position, &entry);
             left_to_read = queue.written - left.position) {
            tl_fuzz_hold(queue.written - left.position < left_to_read);
            check_entry();
        }
    }
    tl_fuzz_hold(sum <= (uint64_t)2 * 255 * CHECKPOINT);
}

/* A successor opens the record queue, whatever its content is. Then the queue must be valid, and a
 * reader must find the successor's entries. */
static void succeed(unsigned what) {
    tl_recorder_event_entry event;
    bool skip = false;
    if (what % 8 == 7) { /* first, a successor without a reader */
        tl_record_queue_open(&settings, memory, NULL, &queue);
        tl_fuzz_hold(put_sample(what));
    }
    tl_record_queue_open(&settings, memory, &taken, &queue);
    if (what % 8 == 6) {
        tl_record_queue_hide_unused(&queue);
    }
    look_back();
    tl_fuzz_hold(tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT)); /* its memory is accessible again */
    tl_record_queue_reader_open(&settings, memory, &reader);
    tl_fuzz_hold(take_entries(UINT16_MAX));
    for (int i = 0; i <= TL_RECORDER_EVENTS && tl_record_queue_reader_event(&reader, taken.events, &event, &skip);
         i++) {
        taken.events++;
    }
    put_start(what);
    tl_fuzz_hold(put_sample(what) && put_step(what));
    uint64_t lost = tl_record_queue_lost(&queue);
    tl_record_queue_event(&queue, what, TL_EVENT_INFO, "fuzz", "successor");
    tl_fuzz_hold(tl_record_queue_lost(&queue) == lost);
    tl_fuzz_hold(take_entries(UINT16_MAX) && entry.kind == TL_ENTRY_STEP && entry.record.step == what);
    tl_fuzz_hold(tl_record_queue_reader_event(&reader, taken.events, &event, &skip) && !skip &&
                 strcmp(event.text, "successor") == 0);
    taken.events++;
    tl_fuzz_hold(reader.fault[0] == '\0');
}

static void act(unsigned what) {
    switch (what % 8) {
    case 0:
    case 1:
    case 2:
        put(what / 8);
        break;
    case 3:
    case 4:
        attack(what / 8);
        break;
    case 5:
        succeed(what / 8);
        break;
    case 6: /* a hostile reader changes its progress */
        if (what / 8 % 4 == 0) {
            uint64_t *const positions[] = {&taken.ring, &taken.events, &taken.checkpoint};
            *positions[what / 32 % 3] += (uint64_t)tl_fuzz_take_word() << tl_fuzz_take() % 33;
            break;
        }
        take(what / 8);
        break;
    default:
        take(what / 8);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    size_t bytes = tl_record_queue_bytes(&settings);
    if (memory == NULL) {
        void *made = NULL;
        tl_fuzz_hold(posix_memalign(&made, PAGE, bytes) == 0);
        memory = made;
    }
    memset(memory, 0, bytes);
    taken = (tl_record_queue_taken){0};
    tl_record_queue_open(&settings, memory, &taken, &queue);
    tl_record_queue_reader_open(&settings, memory, &reader);
    tl_fuzz_begin(data, size);
    while (!tl_fuzz_is_over()) {
        act(tl_fuzz_take());
    }
    return 0;
}
