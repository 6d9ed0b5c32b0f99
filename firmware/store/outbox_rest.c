/* The rest: see outbox_rest.h. */
#include "firmware/store/outbox_rest.h"

#include "firmware/store/outbox_reader.h"

static uint64_t count_entries(tl_outbox_reader *reader, uint64_t position) {
    static tl_recorder_entry entry; /* too large for a small stack */
    uint64_t end = tl_outbox_reader_end(reader, position);
    uint64_t count = 0;
    while (position != end && tl_outbox_reader_entry(reader, &position, end, &entry)) {
        count += entry.kind == TL_ENTRY_SAMPLE || entry.kind == TL_ENTRY_STEP ? 1 : 0;
    }
    return count;
}

static uint64_t count_events(tl_outbox_reader *reader, uint64_t number) {
    tl_recorder_event_entry event;
    uint64_t count = 0;
    bool skip = false;
    for (int i = 0; i < TL_RECORDER_EVENTS && tl_outbox_reader_event(reader, number, &event, &skip); i++) {
        number++;
        count += skip ? 0 : 1;
    }
    return count;
}

uint64_t tl_outbox_rest_count(const tl_outbox_settings *settings, const void *memory, const tl_outbox_taken *taken) {
    tl_outbox_reader reader;
    tl_outbox_reader_open(settings, memory, &reader);
    uint64_t events = count_events(&reader, taken->events);
    return events + (settings->ring_bytes > 0 ? count_entries(&reader, taken->ring) : 0);
}
