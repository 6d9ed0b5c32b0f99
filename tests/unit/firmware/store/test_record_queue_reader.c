/* Reader of a record queue: it rejects an invalid queue, and its fault describes the invalid
 * value. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/store/record_queue.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"

enum { RING = 128 * 1024, CHECKPOINT = 100, DIGEST = 8 /* bytes after each entry */ };

static const tl_record_queue_settings settings = {.shape = {.plant = TL_MADE_PLANT,
                                                            .match = TL_MADE_MATCH,
                                                            .adjust = TL_MADE_ADJUST,
                                                            .components = TL_MADE_COMPONENTS},
                                                  .ring_bytes = RING,
                                                  .checkpoint_bytes = CHECKPOINT};
static unsigned char *memory;
static tl_record_queue_taken taken;
static tl_record_queue queue;
static tl_record_queue_reader reader;
static tl_record_queue_start start;
static tl_recorder_entry entry;

void setUp(void) {
    void *made = NULL;
    size_t size = tl_record_queue_bytes(&settings);
    TEST_ASSERT_EQUAL_INT(0, posix_memalign(&made, TL_RECORD_QUEUE_LINE, size));
    memset(made, 0, size);
    memory = made;
    taken = (tl_record_queue_taken){0};
    memset(&start, 0, sizeof start);
    tl_record_queue_open(&settings, memory, &taken, &queue);
    tl_record_queue_reader_open(&settings, memory, &reader);
}

void tearDown(void) {
    free(memory);
}

/* The ring cannot be read any more, and the fault has all parts. */
static void expect_fault(const char *parts) {
    uint64_t position = 0;
    unsigned char bytes[CHECKPOINT];
    size_t size = 0;
    int64_t tick = 0;
    uint64_t number = 0;
    TL_EXPECT_PARTS(parts, reader.fault);
    TEST_ASSERT_EQUAL_UINT64(3, tl_record_queue_reader_end(&reader, 3));
    TEST_ASSERT_FALSE(tl_record_queue_reader_entry(&reader, &position, 1, &entry));
    TEST_ASSERT_EQUAL_UINT64(0, position);
    TEST_ASSERT_FALSE(tl_record_queue_reader_checkpoint(&reader, 0, UINT64_MAX, bytes, &size, &tick, &number));
    TL_EXPECT_PARTS(parts, reader.fault);
}

/* Reads the first entry. */
static bool take(void) {
    uint64_t position = 0;
    uint64_t end = tl_record_queue_reader_end(&reader, 0);
    return position != end && tl_record_queue_reader_entry(&reader, &position, end, &entry);
}

static void put_sample(void) {
    tl_sample sample;
    tl_made_sample(3, &sample);
    TEST_ASSERT_TRUE(tl_record_queue_put_sample(&queue, &sample));
}

static void put_step(void) {
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    tl_made_record(3, &record);
    tl_made_ledger(3, ledger);
    TEST_ASSERT_TRUE(tl_record_queue_put_step(&queue, &record, ledger));
}

static void more_than_a_ring_holds(void) {
    queue.control->head = RING + 1;
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_reader_end(&reader, 0));
    expect_fault("131073 bytes|131072");
}

static void less_than_was_taken(void) {
    queue.control->head = 5;
    TEST_ASSERT_EQUAL_UINT64(6, tl_record_queue_reader_end(&reader, 6));
    expect_fault("18446744073709551615 bytes|131072");
}

/* A sample waits for its step, unless the reader knows that the step is missing. If it comes later,
 * reading continues with it. */
static void a_sample_that_waits(void) {
    tl_record_queue_reader another;
    put_sample();
    TEST_ASSERT_FALSE(take());
    tl_record_queue_reader_finish(&reader);
    TEST_ASSERT_TRUE(take());
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_SAMPLE, entry.kind);
    TEST_ASSERT_EQUAL_INT64(3, entry.sample.tick);
    uint64_t position = tl_record_queue_reader_end(&reader, 0);
    tl_record_queue_reader_open(&settings, memory, &another);
    TEST_ASSERT_EQUAL_UINT64(position, tl_record_queue_reader_end(&another, position));
    put_step();
    uint64_t end = tl_record_queue_reader_end(&another, position);
    TEST_ASSERT_TRUE(tl_record_queue_reader_entry(&another, &position, end, &entry));
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_STEP, entry.kind);
    TEST_ASSERT_EQUAL_UINT64(end, position);
}

/* A wrong count of waiting bytes is limited to the ring. */
static void more_waits_than_a_ring_holds(void) {
    queue.control->put = RING + 1;
    tl_record_queue_reader_finish(&reader);
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_reader_end(&reader, 0));
    queue.control->head = 10;
    queue.control->put = RING + 1;
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_reader_end(&reader, 0));
    expect_fault("131073 bytes|131072");
}

static void an_unknown_kind(void) {
    for (unsigned kind = 0; kind < 256; kind++) {
        tearDown();
        setUp();
        put_sample();
        put_step();
        unsigned char right = queue.ring[0];
        queue.ring[0] = (unsigned char)kind;
        TEST_ASSERT_EQUAL_INT(kind == right, take());
        if (kind + 1 < right || kind > right + 3U) {
            expect_fault("entry|kind");
        } else if (kind != right) {
            TEST_ASSERT_NOT_EQUAL_INT('\0', reader.fault[0]); /* another kind and size */
        }
    }
}

static void a_truncated_entry(void) {
    put_sample();
    put_step();
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "end"));
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    uint64_t begin = 0;
    for (int i = 0; i < 4; i++) {
        uint64_t behind = begin;
        TEST_ASSERT_TRUE(
            tl_record_queue_reader_entry(&reader, &behind, tl_record_queue_reader_end(&reader, 0), &entry));
        for (uint64_t end = begin + 1; end < behind; end++) {
            tl_record_queue_reader another;
            uint64_t position = begin;
            tl_record_queue_reader_open(&settings, memory, &another);
            TEST_ASSERT_FALSE(tl_record_queue_reader_entry(&another, &position, end, &entry));
            TL_EXPECT_PARTS("truncated", another.fault);
            TEST_ASSERT_EQUAL_UINT64(begin, position);
        }
        begin = behind;
    }
}

/* Writes a byte, and reads the first entry, which fails. */
static void spoil(size_t offset, unsigned char value) {
    queue.ring[offset] = value;
    TEST_ASSERT_FALSE(take());
}

static void unknown_qualities(void) {
    size_t quality = tl_recorder_entry_size(&settings.shape, TL_ENTRY_SAMPLE) - DIGEST - 1;
    put_sample();
    put_step();
    TEST_ASSERT_TRUE(take());
    spoil(quality, TL_LAST_QUALITY + 1);
    expect_fault("enumeration");
}

/* If any byte of an entry is overwritten, the entry is not read. The fault names an enumeration. */
static void an_overwritten_byte(void) {
    put_sample();
    put_step();
    size_t size = (size_t)queue.written;
    int enumerations = 0;
    for (size_t i = 0; i < size; i++) {
        unsigned char right = queue.ring[i];
        uint64_t position = 0;
        queue.ring[i] = right == 0xFF ? 0 : 0xFF;
        tl_record_queue_reader_open(&settings, memory, &reader);
        while (position != size && tl_record_queue_reader_entry(&reader, &position, size, &entry)) {
        }
        TEST_ASSERT_TRUE(position != size && reader.is_ring_broken);
        enumerations += tl_test_has_parts(reader.fault, "enumeration") ? 1 : 0;
        queue.ring[i] = right;
    }
    /* qualities; outcome, stop and delay state with 4 bytes each; unknown flags */
    TEST_ASSERT_EQUAL_INT(TL_MADE_PLANT + TL_MADE_MATCH + 3 * 4 + 3, enumerations);
}

/* The writer continues after the bytes that the reader skips, also if the end was overwritten. */
static void skipped_bytes(void) {
    put_sample();
    put_step();
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_reader_skip(&reader, 0)); /* nothing is damaged */
    queue.ring[20] ^= 1;
    queue.control->head += 30;
    uint64_t end = queue.control->head;
    TEST_ASSERT_EQUAL_UINT64(end, tl_record_queue_reader_skip(&reader, 0));
    taken.ring = end;
    tl_record_queue_reader_open(&settings, memory, &reader);
    put_sample();
    put_step();
    uint64_t position = end;
    end = tl_record_queue_reader_end(&reader, position);
    TEST_ASSERT_TRUE(tl_record_queue_reader_entry(&reader, &position, end, &entry));
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_SAMPLE, entry.kind);
    TEST_ASSERT_TRUE(tl_record_queue_reader_entry(&reader, &position, end, &entry));
    TEST_ASSERT_EQUAL_UINT64(end, position);
    queue.control->head += RING + 1; /* the end is unknown until the writer sets it */
    TEST_ASSERT_EQUAL_UINT64(position, tl_record_queue_reader_skip(&reader, position));
    TEST_ASSERT_TRUE(reader.is_ring_broken);
}

static void an_invalid_start(void) {
    tl_resumption beginning = {.from = (tl_resumed_from)(TL_RESUMED_INPUTS + 1)};
    start.holds = true;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    spoil(1, 2); /* not a Boolean */
    expect_fault("enumeration");
    tl_record_queue_reader_open(&settings, memory, &reader);
    queue.ring[1] = 1;
    memcpy(queue.ring + 2, &beginning, sizeof beginning);
    TEST_ASSERT_FALSE(take());
    expect_fault("enumeration");
}

static void an_invalid_account(void) {
    start.account.components = TL_ACCOUNT_COMPONENTS + 1;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_FALSE(take());
    expect_fault("account");
}

static void an_invalid_digest_of_fmus(void) {
    start.holds = false;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_TRUE(take());
    spoil(tl_recorder_entry_size_of_start(false) - DIGEST - sizeof(tl_run_tuning) - TL_SHA256_TEXT, 'a');
    expect_fault("digest|FMUs");
}

static void an_invalid_digest_of_a_configuration(void) {
    size_t hash = offsetof(tl_run_tuning, hash);
    start.holds = false;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_TRUE(take());
    spoil(tl_recorder_entry_size_of_start(false) - DIGEST - sizeof(tl_run_tuning) + hash, 'a');
    expect_fault("digest|configuration");
    tearDown();
    setUp();
    tl_run_tuning tuning = {.tick = 5};
    TEST_ASSERT_TRUE(tl_record_queue_put_tuning(&queue, &tuning));
    TEST_ASSERT_TRUE(take());
    TEST_ASSERT_EQUAL_INT64(5, entry.tuning.tick);
    spoil(1 + hash, 'g');
    expect_fault("digest|configuration");
}

static void an_unterminated_reason(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "x\x1b[2J \xc2\x9b y\x7f \xc3\xa4"));
    TEST_ASSERT_TRUE(take());
    TEST_ASSERT_EQUAL_STRING("x?[2J ?? y? \xc3\xa4", entry.reason);
    memset(queue.ring + 1, 'x', TL_RECORDER_REASON);
    TEST_ASSERT_FALSE(take());
    expect_fault("text");
}

/* ---- events ---- */

static tl_recorder_event_entry *put_event(void) {
    tl_record_queue_event(&queue, 7, TL_EVENT_INFO, "so\turce", "text");
    return &queue.control->slots[0].entry;
}

static void expect_bad_event(const char *parts) {
    tl_recorder_event_entry event;
    bool skip = false;
    put_sample();
    put_step();
    TEST_ASSERT_FALSE(tl_record_queue_reader_event(&reader, 0, &event, &skip));
    TL_EXPECT_PARTS(parts, reader.fault);
    TEST_ASSERT_FALSE(tl_record_queue_reader_event(&reader, 0, &event, &skip));
    TEST_ASSERT_TRUE(take()); /* the ring is not affected */
}

static void an_unknown_severity(void) {
    put_event()->severity = (tl_severity)3;
    expect_bad_event("event|severity");
}

static void unterminated_events(void) {
    memset(put_event()->text, 'x', TL_EVENT_TEXT);
    expect_bad_event("event|text");
    tl_record_queue_reader_open(&settings, memory, &reader);
    queue.control->slots[0].entry.text[5] = '\0';
    memset(queue.control->slots[0].entry.source, 'x', TL_EVENT_SOURCE);
    expect_bad_event("event|text");
}

static void overwritten_events(void) {
    (void)put_event();
    queue.control->slots[0].state += (uint64_t)2 * TL_RECORDER_EVENTS;
    expect_bad_event("overwritten|events");
}

static void control_characters_of_events(void) {
    tl_recorder_event_entry event;
    bool skip = true;
    (void)put_event();
    TEST_ASSERT_TRUE(tl_record_queue_reader_event(&reader, 0, &event, &skip));
    TEST_ASSERT_FALSE(skip);
    TEST_ASSERT_EQUAL_STRING("so?urce", event.source);
}

/* ---- checkpoints ---- */

/* Makes a checkpoint with any mark and a valid digest. */
static void make_place(uint64_t number, const tl_record_queue_mark *mark) {
    tl_record_queue_checkpoint *place = &queue.control->places[number % TL_RECORD_QUEUE_CHECKPOINTS];
    memcpy(place->mark, mark, sizeof *mark);
    const unsigned char *bytes =
        (const unsigned char *)queue.control + tl_record_queue_checkpoint_at(&queue.settings, 0);
    place->digest = mark->size > CHECKPOINT ? 0 : tl_record_queue_digest(number, mark, bytes);
    place->number = number;
}

static bool take_checkpoint(uint64_t resume, uint64_t position) {
    unsigned char bytes[CHECKPOINT];
    size_t size = 0;
    int64_t tick = 0;
    uint64_t number = 0;
    bool there = tl_record_queue_reader_checkpoint(&reader, resume, position, bytes, &size, &tick, &number);
    TEST_ASSERT_TRUE(!there || (size > 0 && size <= CHECKPOINT && number > resume));
    TEST_ASSERT_EQUAL_STRING("", reader.fault);
    return there;
}

static void invalid_checkpoints_are_ignored(void) {
    tl_record_queue_mark mark;
    memset(&mark, 0, sizeof mark);
    mark.size = CHECKPOINT;
    mark.behind = 50;
    make_place(2, &mark);
    TEST_ASSERT_TRUE(take_checkpoint(1, 50));
    TEST_ASSERT_FALSE(take_checkpoint(2, 50));
    TEST_ASSERT_FALSE(take_checkpoint(1, 49));
    make_place(UINT64_MAX - 1, &mark);
    TEST_ASSERT_FALSE(take_checkpoint(1, 50));
    mark.size = CHECKPOINT + 1;
    make_place(2, &mark);
    TEST_ASSERT_FALSE(take_checkpoint(1, 50));
    mark.size = UINT64_MAX;
    make_place(2, &mark);
    TEST_ASSERT_FALSE(take_checkpoint(1, 50));
    mark.size = 0;
    make_place(2, &mark);
    TEST_ASSERT_FALSE(take_checkpoint(1, 50));
    mark.size = 10;
    mark.beginning.from = (tl_resumed_from)4;
    make_place(2, &mark);
    TEST_ASSERT_FALSE(take_checkpoint(1, 50));
}

/* If the newest checkpoint is damaged, the other one is read. */
static void the_other_checkpoint_is_read(void) {
    tl_record_queue_mark mark;
    memset(&mark, 0, sizeof mark);
    mark.size = 10;
    make_place(2, &mark);
    make_place(3, &mark);
    queue.control->places[1].digest++;
    TEST_ASSERT_TRUE(take_checkpoint(1, 0));
    TEST_ASSERT_FALSE(take_checkpoint(2, 0));
    queue.control->places[0].mark[1] ^= 1;
    TEST_ASSERT_FALSE(take_checkpoint(1, 0));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(more_than_a_ring_holds);
    RUN_TEST(less_than_was_taken);
    RUN_TEST(a_sample_that_waits);
    RUN_TEST(more_waits_than_a_ring_holds);
    RUN_TEST(an_unknown_kind);
    RUN_TEST(a_truncated_entry);
    RUN_TEST(unknown_qualities);
    RUN_TEST(an_overwritten_byte);
    RUN_TEST(skipped_bytes);
    RUN_TEST(an_invalid_start);
    RUN_TEST(an_invalid_account);
    RUN_TEST(an_invalid_digest_of_fmus);
    RUN_TEST(an_invalid_digest_of_a_configuration);
    RUN_TEST(an_unterminated_reason);
    RUN_TEST(an_unknown_severity);
    RUN_TEST(unterminated_events);
    RUN_TEST(overwritten_events);
    RUN_TEST(control_characters_of_events);
    RUN_TEST(invalid_checkpoints_are_ignored);
    RUN_TEST(the_other_checkpoint_is_read);
    return UNITY_END();
}
