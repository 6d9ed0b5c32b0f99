/* The reader's side of an outbox. The header says how much it believes. What is looked at is copied first: see recorder_entry.c. */
#include "firmware/store/outbox_reader.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "firmware/store/outbox_parts.h"

void tl_outbox_reader_open(const tl_outbox_settings *settings, const void *memory, tl_outbox_reader *reader) {
    const unsigned char *bytes = memory;
    *reader = (tl_outbox_reader){.settings = *settings,
                                 .control = memory,
                                 .ring = bytes + tl_outbox_ring_at(),
                                 .checkpoints = bytes + tl_outbox_place_at(settings, 0)};
}

static bool refuse(tl_outbox_reader *reader, bool *part, const char *format, ...) TL_PRINTF(3, 4);

/* The part is not read any more. */
static bool refuse(tl_outbox_reader *reader, bool *part, const char *format, ...) {
    va_list arguments;
    *part = true;
    va_start(arguments, format);
    (void)vsnprintf(reader->fault, sizeof reader->fault, format, arguments);
    va_end(arguments);
    return false;
}

void tl_outbox_reader_leave(tl_outbox_reader *reader) {
    reader->is_left = true;
}

/* A reader before this one may have thought that the writer was no more, and have taken what waited: then that is not there yet, seen from here. */
uint64_t tl_outbox_reader_end(tl_outbox_reader *reader, uint64_t taken) {
    uint64_t ring = reader->settings.ring_bytes;
    uint64_t head = __atomic_load_n(&reader->control->head, __ATOMIC_ACQUIRE);
    uint64_t waiting = __atomic_load_n(&reader->control->put, __ATOMIC_ACQUIRE) - head;
    bool waits = waiting <= ring && (reader->is_left || taken - head <= waiting);
    uint64_t end = !waits ? head : reader->is_left ? head + waiting : taken;
    if (!reader->is_ring_broken && end - taken > ring) {
        (void)refuse(reader, &reader->is_ring_broken, "counts %" PRIu64 " bytes in a ring of %" PRIu64, end - taken,
                     ring);
    }
    return reader->is_ring_broken ? taken : end;
}

uint64_t tl_outbox_reader_skip(tl_outbox_reader *reader, uint64_t taken) {
    static tl_recorder_entry entry; /* too large for a small stack */
    uint64_t end = tl_outbox_reader_end(reader, taken);
    uint64_t position = taken;
    while (position != end && tl_outbox_reader_entry(reader, &position, end, &entry)) {
    }
    return reader->is_ring_broken ? end : taken;
}

bool tl_outbox_reader_entry(tl_outbox_reader *reader, uint64_t *position, uint64_t end, tl_recorder_entry *entry) {
    const tl_recorder_page page = {.bytes = reader->ring, .capacity = reader->settings.ring_bytes, .end = end};
    if (reader->is_ring_broken) {
        return false;
    }
    const char *fault = tl_recorder_entry_unpack(&page, &reader->settings.shape, position, entry);
    return fault == NULL || refuse(reader, &reader->is_ring_broken, "holds %s", fault);
}

bool tl_outbox_reader_event(tl_outbox_reader *reader, uint64_t number, tl_recorder_event_entry *event, bool *skip) {
    const tl_outbox_slot *slot = &reader->control->slots[number % TL_RECORDER_EVENTS];
    int64_t ahead = (int64_t)(__atomic_load_n(&slot->state, __ATOMIC_ACQUIRE) - tl_outbox_state_if_there(number));
    *skip = ahead == 1;
    if (reader->are_events_broken || ahead < 0) {
        return false;
    }
    if (ahead > 1) {
        return refuse(reader, &reader->are_events_broken, "has overwritten events that were not taken");
    }
    if (*skip) {
        return true;
    }
    memcpy(event, &slot->entry, sizeof *event);
    __atomic_signal_fence(__ATOMIC_SEQ_CST);
    const char *fault = tl_outbox_event_fault(event);
    if (fault != NULL) {
        return refuse(reader, &reader->are_events_broken, "holds %s", fault);
    }
    tl_recorder_text_clean(event->source);
    tl_recorder_text_clean(event->text);
    return true;
}

static void load_bytes(unsigned char *to, const unsigned char *from, size_t size) {
    for (size_t at = 0; at < size; at += sizeof(size_t)) { /* a place has whole pages */
        size_t word = __atomic_load_n((const size_t *)(const void *)(from + at), __ATOMIC_RELAXED);
        memcpy(to + at, &word, size - at < sizeof word ? size - at : sizeof word);
    }
}

/* One that may be taken, as far as its place tells. */
typedef struct offer {
    unsigned place;
    uint64_t number; /* 0: none */
    uint64_t digest;
    tl_outbox_mark mark;
} offer;

static offer look(const tl_outbox_reader *reader, unsigned place, uint64_t taken, uint64_t position) {
    offer found = {.place = place};
    bool good = tl_outbox_place_look(&reader->control->places[place], &found.number, &found.digest, &found.mark) &&
                found.number > taken && found.mark.behind <= position && found.mark.size > 0 &&
                found.mark.size <= reader->settings.checkpoint_bytes;
    found.number = good ? found.number : 0;
    return found;
}

/* False: it is not whole, or was overwritten meanwhile. */
static bool copy(const tl_outbox_reader *reader, const offer *offered, unsigned char *bytes) {
    size_t stride = tl_outbox_place_at(&reader->settings, 1) - tl_outbox_place_at(&reader->settings, 0);
    load_bytes(bytes, reader->checkpoints + offered->place * stride, (size_t)offered->mark.size);
    return tl_outbox_digest(offered->number, &offered->mark, bytes) == offered->digest;
}

bool tl_outbox_reader_checkpoint(tl_outbox_reader *reader, uint64_t taken, uint64_t position, unsigned char *bytes,
                                 size_t *size, int64_t *tick, uint64_t *number) {
    offer first = look(reader, 0, taken, position);
    offer second = look(reader, 1, taken, position);
    const offer *newer = second.number > first.number ? &second : &first;
    const offer *older = newer == &first ? &second : &first;
    bool taken_one = false;
    for (const offer *offered = older; offered != NULL && !taken_one && !reader->is_ring_broken;
         offered = offered == older ? newer : NULL) {
        taken_one = offered->number != 0 && copy(reader, offered, bytes);
        *size = (size_t)offered->mark.size;
        *tick = offered->mark.tick;
        *number = offered->number;
    }
    return taken_one;
}

uint64_t tl_outbox_reader_lost(const tl_outbox_reader *reader) {
    return __atomic_load_n(&reader->control->lost, __ATOMIC_RELAXED);
}
