/* Record queue: see record_queue.h. */
#include "firmware/store/record_queue.h"

#include <assert.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include "firmware/base/os.h"

/* ---- Recorder events ---- */

static void copy_text(char *to, size_t size, const char *from) {
    size_t length = strnlen(from, size - 1);
    memcpy(to, from, length);
    memset(to + length, 0, size - length);
}

void tl_recorder_event_fill(tl_recorder_event_entry *entry, int64_t tick, tl_severity severity, const char *source,
                            const char *text) {
    entry->at = tl_clock_now(NULL) / (TL_SECOND / 1000);
    entry->tick = tick;
    entry->position = 0;
    entry->severity = severity;
    copy_text(entry->source, sizeof entry->source, source);
    copy_text(entry->text, sizeof entry->text, text);
}

/* ---- Record queue, producer's side.
 *
 * Ring:        the producer publishes the new end with a release store; the reader returns room
 *              through `taken`, which is loaded with acquire. If the producer dies, entries that
 *              are not published do not exist. A sample that waits for its step has an end of its
 *              own (`put`), used only by a successor or by a reader without a producer.
 * Kept:        an entry stays until another one needs its bytes. Its position shows whether that
 *              has happened, because at most one entry is written beyond the published end.
 * Events:      a thread reserves a number if its slot is free, fills the slot, and publishes it
 *              with a release store. If it dies in between, a gap remains, which the successor
 *              marks.
 * Checkpoints: see tl_record_queue_checkpoint. Both sides copy word by word, relaxed: no thread
 *              waits for another, and no fence is needed (ThreadSanitizer does not support fences).
 * Death:       a successor sees all stores of a dead process, in their order.
 */

enum { PAGE = 4096, RING_LEAST = 256 * 1024, RING_MOST = 16 * 1024 * 1024, LOOK_BACK_TICKS = 2000 };

static const tl_time RING_TIME = 30 * TL_SECOND;
static const tl_time LOOK_BACK = 10 * TL_SECOND;    /* between two checkpoints, or LOOK_BACK_TICKS */
static const tl_time ROOM_PAUSE = TL_SECOND / 1000; /* between two checks for room */

/* ---- Sizes ---- */

static size_t round_up(size_t bytes, size_t to) {
    return (bytes + to - 1) / to * to;
}

/* Offsets of the parts in the memory. */
static size_t tl_record_queue_ring_at(void) {
    return round_up(sizeof(tl_record_queue_control), PAGE);
}

size_t tl_record_queue_checkpoint_at(const tl_record_queue_settings *settings, unsigned checkpoint_slot) {
    return tl_record_queue_ring_at() + round_up(settings->ring_bytes, PAGE) +
           checkpoint_slot * round_up(settings->checkpoint_bytes, PAGE);
}

size_t tl_record_queue_bytes(const tl_record_queue_settings *settings) {
    return tl_record_queue_checkpoint_at(settings, TL_RECORD_QUEUE_CHECKPOINTS + 1);
}

size_t tl_record_queue_ring_bytes(const tl_recorder_shape *shape, tl_time step) {
    uint64_t each = tl_recorder_entry_size(shape, TL_ENTRY_SAMPLE) + tl_recorder_entry_size(shape, TL_ENTRY_STEP);
    uint64_t ticks = (uint64_t)(RING_TIME / step) + 1;
    uint64_t back = (uint64_t)(LOOK_BACK / step) + 1;
    ticks += 2 * (back < LOOK_BACK_TICKS ? back : LOOK_BACK_TICKS);
    uint64_t bytes = ticks < RING_MOST ? ticks * each + 2 * tl_recorder_entry_largest(shape) : RING_MOST;
    size_t rounded = RING_LEAST;
    while (rounded < bytes && rounded < RING_MOST) {
        rounded *= 2;
    }
    return rounded;
}

/* ---- Room in the ring ---- */

static void count_loss(const tl_record_queue *queue) {
    (void)__atomic_add_fetch(&queue->control->lost, 1, __ATOMIC_RELAXED);
}

static bool has_reader(const tl_record_queue *queue) {
    return queue->taken != NULL;
}

/* A position of the reader that is impossible counts as no room. */
static bool has_room(const tl_record_queue *queue, size_t size) {
    uint64_t waiting = has_reader(queue) ? queue->written - __atomic_load_n(&queue->taken->ring, __ATOMIC_ACQUIRE) : 0;
    return waiting <= queue->settings.ring_bytes && queue->settings.ring_bytes - waiting >= size;
}

static tl_ring_writer pen_of(const tl_record_queue *queue) {
    return (tl_ring_writer){.bytes = queue->ring, .capacity = queue->settings.ring_bytes, .position = queue->written};
}

/* Publishes all entries. If the producer dies between the two stores, no sample waits. */
static void publish_all(tl_record_queue *queue) {
    queue->published = queue->written;
    __atomic_store_n(&queue->control->head, queue->written, __ATOMIC_RELEASE);
    __atomic_store_n(&queue->control->put, queue->written, __ATOMIC_RELEASE);
}

/* A reader that has found the ring corrupted skips to its end, and may have read a wrong end. The
 * next entry is put there. */
static void skip_to_reader(tl_record_queue *queue) {
    uint64_t taken = has_reader(queue) ? __atomic_load_n(&queue->taken->ring, __ATOMIC_ACQUIRE) : queue->written;
    uint64_t ahead = taken - queue->written;
    if (ahead != 0 && ahead <= queue->settings.ring_bytes) {
        queue->written = taken;
        publish_all(queue);
    }
}

static void publish_entry(tl_record_queue *queue, const tl_ring_writer *pen) {
    queue->written = pen->position;
    publish_all(queue);
}

/* Puts the beginning of the run if it still waits. Returns false if it has no room; then no other
 * entry may be put. */
static bool put_waiting_start(tl_record_queue *queue) {
    tl_record_queue_control *control = queue->control;
    skip_to_reader(queue);
    if (!control->start_waits) {
        return true;
    }
    if (!has_room(queue, tl_recorder_entry_size_of_start(control->start.holds))) {
        return false;
    }
    tl_ring_writer pen = pen_of(queue);
    tl_recorder_entry_pack_start(&pen, &control->start, queue->id);
    publish_entry(queue, &pen);
    control->start_waits = false;
    return true;
}

/* Finds room for an entry of this kind (a sample: with its step). Counts a loss if there is none.
 */
static bool find_room(tl_record_queue *queue, tl_recorder_kind kind, tl_ring_writer *pen) {
    size_t size = tl_recorder_entry_size(&queue->settings.shape, kind);
    size_t step = kind == TL_ENTRY_SAMPLE ? tl_recorder_entry_size(&queue->settings.shape, TL_ENTRY_STEP) : 0;
    bool found = put_waiting_start(queue) && has_room(queue, size + step);
    if (!found) {
        count_loss(queue);
    }
    *pen = pen_of(queue);
    return found;
}

/* Returns whether no entry up to `end` has overwritten the one at `position`. */
static bool is_kept(const tl_record_queue *queue, uint64_t end, uint64_t position) {
    uint64_t since = end - position;
    size_t reach = queue->settings.ring_bytes;
    size_t slack = tl_recorder_entry_largest(&queue->settings.shape);
    return reach > slack && since <= reach - slack;
}

static void store_bytes(unsigned char *to, const unsigned char *from, size_t size) {
    for (size_t at = 0; at < size; at += sizeof(size_t)) { /* whole words: both sides have room for them */
        size_t word = 0;
        memcpy(&word, from + at, sizeof word);
        __atomic_store_n((size_t *)(void *)(to + at), word, __ATOMIC_RELAXED);
    }
}

static void load_bytes(unsigned char *to, const unsigned char *from, size_t size) {
    for (size_t at = 0; at < size; at += sizeof(size_t)) { /* the source has whole words */
        size_t word = __atomic_load_n((const size_t *)(const void *)(from + at), __ATOMIC_RELAXED);
        memcpy(to + at, &word, size - at < sizeof word ? size - at : sizeof word);
    }
}

/* Reads the mark of a checkpoint slot. Returns false if it has no valid mark. The checkpoint's
 * bytes may belong to another mark. */
static bool read_mark(const tl_record_queue_checkpoint *checkpoint_slot, uint64_t *number, uint64_t *digest,
                      tl_record_queue_mark *mark) {
    *number = __atomic_load_n(&checkpoint_slot->number, __ATOMIC_ACQUIRE);
    *digest = __atomic_load_n(&checkpoint_slot->digest, __ATOMIC_RELAXED);
    load_bytes((unsigned char *)mark, (const unsigned char *)checkpoint_slot->mark, sizeof *mark);
    return *number != 0 && *number < TL_RECORD_QUEUE_NUMBERS &&
           (unsigned)mark->beginning.from <= (unsigned)TL_RESUMED_INPUTS && tl_identity_is_sound(mark->tuning.hash);
}

/* Sets the end back. Entries behind the new end may have overwritten older ones, and a successor
 * must not resume from a position behind it. So checkpoints with such positions are removed. */
static void rewind_end(tl_record_queue *queue, uint64_t end) {
    uint64_t before = queue->written;
    queue->written = end;
    for (unsigned checkpoint_slot = 0; checkpoint_slot < TL_RECORD_QUEUE_CHECKPOINTS; checkpoint_slot++) {
        tl_record_queue_checkpoint *there = &queue->control->places[checkpoint_slot];
        uint64_t number = 0;
        uint64_t digest = 0;
        tl_record_queue_mark mark;
        if (!read_mark(there, &number, &digest, &mark) || !is_kept(queue, before, mark.position) ||
            !is_kept(queue, end, mark.position)) {
            __atomic_store_n(&there->number, 0, __ATOMIC_RELAXED);
        }
    }
}

/* ---- A run ---- */

/* A dead producer may have left a sample that waits for its step. If the new run contains that
 * tick, it takes the sample again. Otherwise the sample is published together with the beginning.
 * If this process dies earlier, its successor decides. */
static void settle_sample(tl_record_queue *queue, const tl_resumption *beginning) {
    bool waits = queue->written != queue->published;
    if (waits && beginning->from != TL_RESUMED_NOT && queue->waiting >= beginning->tick) {
        rewind_end(queue, queue->published);
        publish_all(queue);
    }
}

void tl_record_queue_name_fmus(tl_record_queue *queue, const char fmus[TL_SHA256_TEXT]) {
    memcpy(queue->fmus, fmus, sizeof queue->fmus);
}

void tl_record_queue_name_configuration(tl_record_queue *queue, const tl_run_tuning *configured) {
    queue->configured = *configured;
    queue->tuning = *configured;
}

bool tl_record_queue_put_start(tl_record_queue *queue, const tl_record_queue_start *start) {
    settle_sample(queue, &start->resumption);
    queue->control->start = *start;
    memcpy(queue->control->start.fmus, start->holds ? "" : queue->fmus, start->holds ? 1 : sizeof queue->fmus);
    queue->control->start.configured = queue->configured;
    queue->control->start_waits = true;
    queue->beginning = start->resumption;
    queue->id = (uint64_t)tl_clock_now(NULL);
    queue->tuning = queue->configured;
    return put_waiting_start(queue);
}

bool tl_record_queue_put_sample(tl_record_queue *queue, const tl_sample *sample) {
    tl_ring_writer pen;
    bool found = find_room(queue, TL_ENTRY_SAMPLE, &pen);
    if (found) {
        publish_all(queue);
        tl_recorder_entry_pack_sample(&pen, &queue->settings.shape, sample, queue->beginning.start, queue->id);
        queue->written = pen.position;
        queue->waiting = sample->tick;
        __atomic_store_n(&queue->control->put, queue->written, __ATOMIC_RELEASE);
    }
    return found;
}

bool tl_record_queue_put_step(tl_record_queue *queue, const tl_record *record, const tl_execution_counts *ledger) {
    tl_ring_writer pen;
    bool found = find_room(queue, TL_ENTRY_STEP, &pen);
    if (found) {
        tl_recorder_entry_pack_step(&pen, &queue->settings.shape, record, ledger);
        publish_entry(queue, &pen);
    }
    return found;
}

bool tl_record_queue_has_room_for_tuning(const tl_record_queue *queue) {
    const tl_recorder_shape *shape = &queue->settings.shape;
    return !queue->control->start_waits && has_room(queue, tl_recorder_entry_size(shape, TL_ENTRY_TUNING) +
                                                               tl_recorder_entry_size(shape, TL_ENTRY_SAMPLE) +
                                                               2 * tl_recorder_entry_size(shape, TL_ENTRY_STEP));
}

static bool put_part(tl_record_queue *queue, tl_recorder_kind kind, const void *is_broken, size_t size) {
    tl_ring_writer pen;
    bool found = find_room(queue, kind, &pen);
    if (found) {
        tl_recorder_entry_pack_part(&pen, kind, is_broken, size);
        publish_entry(queue, &pen);
    }
    return found;
}

bool tl_record_queue_put_tuning(tl_record_queue *queue, const tl_run_tuning *tuning) {
    queue->tuning = *tuning;
    return put_part(queue, TL_ENTRY_TUNING, tuning, sizeof *tuning);
}

const tl_run_tuning *tl_record_queue_tuning(const tl_record_queue *queue) {
    return &queue->tuning;
}

const tl_resumption *tl_record_queue_beginning(const tl_record_queue *queue) {
    return &queue->beginning;
}

bool tl_record_queue_put_end(tl_record_queue *queue, const char *reason) {
    char text[TL_RECORDER_REASON];
    copy_text(text, sizeof text, reason);
    return put_part(queue, TL_ENTRY_END, text, sizeof text);
}

bool tl_record_queue_wait_for_room(tl_record_queue *queue, tl_time until) {
    const tl_recorder_shape *shape = &queue->settings.shape;
    size_t size = tl_recorder_entry_size(shape, TL_ENTRY_SAMPLE) + tl_recorder_entry_size(shape, TL_ENTRY_STEP) +
                  tl_recorder_entry_size(shape, TL_ENTRY_END) + tl_recorder_entry_size(shape, TL_ENTRY_TUNING) +
                  (queue->control->start_waits ? tl_recorder_entry_size(shape, TL_ENTRY_START) : 0);
    tl_time now = tl_clock_now(NULL);
    skip_to_reader(queue);
    while (!has_room(queue, size) && now < until) {
        tl_clock_sleep_until(now + ROOM_PAUSE < until ? now + ROOM_PAUSE : until);
        now = tl_clock_now(NULL);
    }
    return has_room(queue, size);
}

uint64_t tl_record_queue_lost(const tl_record_queue *queue) {
    return __atomic_load_n(&queue->control->lost, __ATOMIC_RELAXED);
}

/* ---- Events ---- */

static uint64_t tl_record_queue_state_if_there(uint64_t number) {
    return 2 * number + 2;
}

/* Reserves the number of an event. Returns false if its slot is not free. */
static bool reserve_number(const tl_record_queue *queue, uint64_t *number) {
    uint64_t *next = &queue->control->next;
    bool is_reserved = false;
    bool is_free = true;
    while (is_free && !is_reserved) { /* retries only if another thread has reserved one */
        uint64_t taken = __atomic_load_n(&queue->taken->events, __ATOMIC_ACQUIRE); /* must be loaded first */
        *number = __atomic_load_n(next, __ATOMIC_RELAXED);
        is_free = *number - taken < TL_RECORDER_EVENTS;
        is_reserved = is_free &&
                      __atomic_compare_exchange_n(next, number, *number + 1, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED);
    }
    return is_reserved;
}

void tl_record_queue_event(tl_record_queue *queue, int64_t tick, tl_severity severity, const char *source,
                           const char *text) {
    uint64_t number = 0;
    uint64_t position = __atomic_load_n(&queue->control->head, __ATOMIC_RELAXED);
    if (!has_reader(queue)) {
        return;
    }
    if (!reserve_number(queue, &number)) {
        count_loss(queue);
        return;
    }
    tl_record_queue_slot *slot = &queue->control->slots[number % TL_RECORDER_EVENTS];
    /* The reader has released the slot. This load also orders the stores of the thread that filled
     * it before, because ThreadSanitizer does not know what a reader in another process has seen.
     */
    (void)__atomic_load_n(&slot->state, __ATOMIC_ACQUIRE);
    tl_recorder_event_fill(&slot->entry, tick, severity, source, text);
    slot->entry.position = position;
    __atomic_store_n(&slot->state, tl_record_queue_state_if_there(number), __ATOMIC_RELEASE);
}

/* Returns NULL, or a text that describes what is invalid in an event. */
static const char *tl_record_queue_event_fault(const tl_recorder_event_entry *event) {
    if ((unsigned)event->severity > (unsigned)TL_EVENT_ERROR) {
        return "an event of unknown severity";
    }
    bool end = memchr(event->source, '\0', sizeof event->source) != NULL &&
               memchr(event->text, '\0', sizeof event->text) != NULL;
    return end ? NULL : "an event with an unterminated text";
}

/* ---- Checkpoints ---- */

uint64_t tl_record_queue_digest(uint64_t number, const tl_record_queue_mark *mark, const unsigned char *bytes) {
    return tl_recorder_digest(tl_recorder_digest(number, mark, sizeof *mark), bytes, (size_t)mark->size);
}

static unsigned char *slot_bytes(const tl_record_queue *queue, unsigned checkpoint_slot) {
    return (unsigned char *)queue->control + tl_record_queue_checkpoint_at(&queue->settings, checkpoint_slot);
}

/* Touches the pages, so that later stores cause no page fault. The content stays, and may be read
 * meanwhile. */
static void touch_pages(unsigned char *bytes, size_t size) {
    for (size_t i = 0; i < size; i += PAGE) {
        volatile size_t *word = (volatile size_t *)(void *)(bytes + i);
        __atomic_store_n(word, __atomic_load_n(word, __ATOMIC_RELAXED), __ATOMIC_RELAXED);
    }
}

bool tl_record_queue_reserve_checkpoint(tl_record_queue *queue, size_t size) {
    if (size > queue->settings.checkpoint_bytes) {
        return false;
    }
    bool there = true;
    for (unsigned checkpoint_slot = 0; checkpoint_slot <= TL_RECORD_QUEUE_CHECKPOINTS && there; checkpoint_slot++) {
        unsigned char *bytes = slot_bytes(queue, checkpoint_slot);
        there = !queue->hides || mprotect(bytes, round_up(size, PAGE), PROT_READ | PROT_WRITE) == 0;
        touch_pages(bytes, there ? size : 0);
    }
    queue->reserved = there ? size : 0;
    return there;
}

unsigned char *tl_record_queue_checkpoint_room(tl_record_queue *queue, size_t *capacity) {
    *capacity = queue->reserved;
    return queue->reserved == 0 ? NULL : slot_bytes(queue, TL_RECORD_QUEUE_CHECKPOINTS);
}

void tl_record_queue_put_checkpoint(tl_record_queue *queue, int64_t tick, size_t size) {
    uint64_t number = queue->number + 1;
    const unsigned char *room = slot_bytes(queue, TL_RECORD_QUEUE_CHECKPOINTS);
    tl_record_queue_checkpoint *checkpoint_slot = &queue->control->places[number % TL_RECORD_QUEUE_CHECKPOINTS];
    const tl_record_queue_control *control = queue->control;
    size_t waiting = control->start_waits ? tl_recorder_entry_size_of_start(control->start.holds) : 0;
    tl_record_queue_mark mark = {.tick = tick,
                                 .size = size,
                                 .position = queue->written,
                                 .behind = queue->written + waiting,
                                 .beginning = queue->beginning,
                                 .tuning = queue->tuning};
    assert(size <= queue->reserved);
    __atomic_store_n(&checkpoint_slot->number, 0, __ATOMIC_RELAXED);
    store_bytes((unsigned char *)checkpoint_slot->mark, (const unsigned char *)&mark, sizeof mark);
    store_bytes(slot_bytes(queue, (unsigned)(number % TL_RECORD_QUEUE_CHECKPOINTS)), room, size);
    __atomic_store_n(&checkpoint_slot->digest, tl_record_queue_digest(number, &mark, room), __ATOMIC_RELAXED);
    __atomic_store_n(&checkpoint_slot->number, number, __ATOMIC_RELEASE);
    queue->number = number;
}

/* ---- For a successor ---- */

static tl_ring_reader page_of(const tl_record_queue *queue) {
    return (tl_ring_reader){.bytes = queue->ring, .capacity = queue->settings.ring_bytes, .end = queue->written};
}

/* Returns the number of the valid checkpoint in a slot; 0: none. */
static uint64_t check_slot(const tl_record_queue *queue, unsigned checkpoint_slot, tl_record_queue_mark *mark) {
    uint64_t number = 0;
    uint64_t digest = 0;
    bool whole = read_mark(&queue->control->places[checkpoint_slot], &number, &digest, mark) &&
                 number % TL_RECORD_QUEUE_CHECKPOINTS == checkpoint_slot &&
                 mark->size <= queue->settings.checkpoint_bytes &&
                 tl_record_queue_digest(number, mark, slot_bytes(queue, checkpoint_slot)) == digest;
    return whole ? number : 0;
}

void tl_record_queue_hide_unused(tl_record_queue *queue) {
    size_t capacity = round_up(queue->settings.checkpoint_bytes, PAGE);
    for (unsigned checkpoint_slot = 0; checkpoint_slot <= TL_RECORD_QUEUE_CHECKPOINTS; checkpoint_slot++) {
        tl_record_queue_mark mark = {.size = 0};
        bool is_used = checkpoint_slot < TL_RECORD_QUEUE_CHECKPOINTS && check_slot(queue, checkpoint_slot, &mark) != 0;
        size_t used = is_used ? (size_t)mark.size : 0;
        used = round_up(used > queue->reserved ? used : queue->reserved, PAGE);
        if (checkpoint_slot < TL_RECORD_QUEUE_CHECKPOINTS && !is_used) { /* a reader must not read hidden pages */
            __atomic_store_n(&queue->control->places[checkpoint_slot].number, 0, __ATOMIC_RELAXED);
        }
        if (used < capacity) {
            (void)mprotect(slot_bytes(queue, checkpoint_slot) + used, capacity - used, PROT_NONE);
        }
    }
    queue->hides = true;
}

bool tl_record_queue_saved_checkpoint(const tl_record_queue *queue, unsigned which, tl_record_queue_saved *left) {
    tl_record_queue_mark marks[TL_RECORD_QUEUE_CHECKPOINTS];
    uint64_t numbers[TL_RECORD_QUEUE_CHECKPOINTS];
    for (unsigned checkpoint_slot = 0; checkpoint_slot < TL_RECORD_QUEUE_CHECKPOINTS; checkpoint_slot++) {
        numbers[checkpoint_slot] = check_slot(queue, checkpoint_slot, &marks[checkpoint_slot]);
        numbers[checkpoint_slot] =
            is_kept(queue, queue->written, marks[checkpoint_slot].position) ? numbers[checkpoint_slot] : 0;
    }
    unsigned newest = numbers[1] > numbers[0] ? 1 : 0;
    unsigned checkpoint_slot = which == 0 ? newest : 1 - newest;
    if (which >= TL_RECORD_QUEUE_CHECKPOINTS || numbers[checkpoint_slot] == 0) {
        return false;
    }
    *left = (tl_record_queue_saved){.tick = marks[checkpoint_slot].tick,
                                    .bytes = slot_bytes(queue, checkpoint_slot),
                                    .size = (size_t)marks[checkpoint_slot].size,
                                    .position = marks[checkpoint_slot].position,
                                    .beginning = marks[checkpoint_slot].beginning,
                                    .tuning = marks[checkpoint_slot].tuning};
    return true;
}

bool tl_record_queue_saved_entry(const tl_record_queue *queue, uint64_t *position, tl_recorder_entry *entry) {
    tl_ring_reader page = page_of(queue);
    return is_kept(queue, queue->written, *position) && *position != queue->written &&
           tl_recorder_entry_unpack(&page, &queue->settings.shape, position, entry) == NULL;
}

/* ---- Opening ---- */

/* Finds the end of the last valid entry. If that entry is a sample that was not published, it
 * waits. A stray store of the dead process may have changed its entries or the ends. */
static void mend_ring(tl_record_queue *queue) {
    tl_recorder_entry entry;
    uint64_t head = __atomic_load_n(&queue->control->head, __ATOMIC_ACQUIRE);
    uint64_t waiting = __atomic_load_n(&queue->control->put, __ATOMIC_ACQUIRE) - head;
    uint64_t end = waiting <= queue->settings.ring_bytes ? head + waiting : head; /* of the dead producer */
    uint64_t taken = has_reader(queue) ? __atomic_load_n(&queue->taken->ring, __ATOMIC_ACQUIRE) : head;
    uint64_t there = taken - head <= end - head ? 0 : head - taken; /* bytes for the reader */
    uint64_t position = taken;
    bool sound = end - taken <= queue->settings.ring_bytes;
    queue->written = end;
    queue->published = taken;
    tl_ring_reader page = page_of(queue);
    while (sound && position != end) {
        uint64_t before = position;
        sound = tl_recorder_entry_unpack(&page, &queue->settings.shape, &position, &entry) == NULL;
        bool waits = sound && entry.kind == TL_ENTRY_SAMPLE && position - taken > there;
        queue->published = waits ? before : position;
        queue->waiting = waits ? entry.sample.tick : 0;
    }
    if (!sound) {
        count_loss(queue);
        rewind_end(queue, position);
    }
    __atomic_store_n(&queue->control->head, queue->published, __ATOMIC_RELEASE);
    __atomic_store_n(&queue->control->put, queue->written, __ATOMIC_RELEASE);
}

/* Repairs the slot of a reserved event. */
static void mend_event(tl_record_queue_slot *slot, uint64_t number, uint64_t head) {
    uint64_t state = __atomic_load_n(&slot->state, __ATOMIC_RELAXED);
    if (slot->entry.position > head) { /* the entries before it were removed */
        slot->entry.position = head;
    }
    bool known = state == tl_record_queue_state_if_there(number) + 1 ||
                 (state == tl_record_queue_state_if_there(number) && tl_record_queue_event_fault(&slot->entry) == NULL);
    if (!known) {
        __atomic_store_n(&slot->state, tl_record_queue_state_if_there(number) + 1, __ATOMIC_RELEASE);
    }
}

static void mend_events(tl_record_queue *queue) {
    tl_record_queue_control *control = queue->control;
    uint64_t taken = has_reader(queue) ? __atomic_load_n(&queue->taken->events, __ATOMIC_ACQUIRE) : control->next;
    if (control->next - taken > TL_RECORDER_EVENTS) {
        count_loss(queue);
        control->next = taken;
    }
    for (uint64_t number = taken; number != taken + TL_RECORDER_EVENTS; number++) {
        tl_record_queue_slot *slot = &control->slots[number % TL_RECORDER_EVENTS];
        if (number - taken < control->next - taken) {
            mend_event(slot, number, queue->written);
        } else { /* not used yet: as if the event before it were there */
            __atomic_store_n(&slot->state, tl_record_queue_state_if_there(number - TL_RECORDER_EVENTS),
                             __ATOMIC_RELAXED);
        }
    }
}

/* Sets the number so that the next checkpoint does not overwrite the newest one. */
static void mend_checkpoints(tl_record_queue *queue) {
    uint64_t taken = has_reader(queue) ? __atomic_load_n(&queue->taken->checkpoint, __ATOMIC_ACQUIRE) : 0;
    uint64_t newest = 0;
    for (unsigned checkpoint_slot = 0; checkpoint_slot < TL_RECORD_QUEUE_CHECKPOINTS; checkpoint_slot++) {
        tl_record_queue_mark mark;
        uint64_t number = check_slot(queue, checkpoint_slot, &mark);
        newest = number > newest ? number : newest;
    }
    queue->number = newest;
    if (taken > newest && taken < TL_RECORD_QUEUE_NUMBERS) { /* the newest that was taken is damaged now */
        queue->number = taken + (newest != 0 && (taken + 1 - newest) % TL_RECORD_QUEUE_CHECKPOINTS == 0 ? 1 : 0);
    }
}

/* New memory replaces a queue that the reader knows, and continues its numbers. */
static void follow_numbers(tl_record_queue *queue) {
    tl_record_queue_control *control = queue->control;
    uint64_t head = __atomic_load_n(&control->head, __ATOMIC_ACQUIRE);
    uint64_t put = __atomic_load_n(&control->put, __ATOMIC_ACQUIRE);
    if (has_reader(queue) && (head | put | control->next | control->lost) == 0) {
        uint64_t taken = __atomic_load_n(&queue->taken->ring, __ATOMIC_ACQUIRE);
        control->next = __atomic_load_n(&queue->taken->events, __ATOMIC_ACQUIRE);
        __atomic_store_n(&control->head, taken, __ATOMIC_RELEASE);
        __atomic_store_n(&control->put, taken, __ATOMIC_RELEASE);
    }
}

void tl_record_queue_open(const tl_record_queue_settings *settings, void *memory, const tl_record_queue_taken *taken,
                          tl_record_queue *queue) {
    unsigned char *bytes = memory;
    size_t ring = settings->ring_bytes;
    assert((uintptr_t)memory % TL_RECORD_QUEUE_LINE == 0);
    assert((ring & (ring - 1)) == 0 && (ring == 0 || ring > 2 * tl_recorder_entry_largest(&settings->shape)));
    (void)ring;
    *queue = (tl_record_queue){
        .settings = *settings, .control = memory, .ring = bytes + tl_record_queue_ring_at(), .taken = taken};
    touch_pages(bytes, tl_record_queue_checkpoint_at(settings, 0));
    queue->control->start_waits = false;
    follow_numbers(queue);
    mend_ring(queue);
    mend_events(queue);
    mend_checkpoints(queue);
}

/* ---- Record queue, reader's side. Data is copied before it is validated: see recorder_entry.c. */

void tl_record_queue_reader_open(const tl_record_queue_settings *settings, const void *memory,
                                 tl_record_queue_reader *reader) {
    *reader = (tl_record_queue_reader){
        .settings = *settings, .control = memory, .ring = (const unsigned char *)memory + tl_record_queue_ring_at()};
}

static bool set_fault(tl_record_queue_reader *reader, bool *is_broken, const char *format, ...) TL_PRINTF(3, 4);

static bool set_fault(tl_record_queue_reader *reader, bool *is_broken, const char *format, ...) {
    va_list arguments;
    *is_broken = true;
    va_start(arguments, format);
    (void)vsnprintf(reader->fault, sizeof reader->fault, format, arguments);
    va_end(arguments);
    return false;
}

void tl_record_queue_reader_finish(tl_record_queue_reader *reader) {
    reader->is_left = true;
}

/* An earlier reader may have assumed that the producer had ended, and have taken the waiting
 * sample. Then `taken` is ahead of the published end. */
uint64_t tl_record_queue_reader_end(tl_record_queue_reader *reader, uint64_t taken) {
    uint64_t ring = reader->settings.ring_bytes;
    uint64_t head = __atomic_load_n(&reader->control->head, __ATOMIC_ACQUIRE);
    uint64_t waiting = __atomic_load_n(&reader->control->put, __ATOMIC_ACQUIRE) - head;
    bool waits = waiting <= ring && (reader->is_left || taken - head <= waiting);
    uint64_t end = !waits ? head : reader->is_left ? head + waiting : taken;
    if (!reader->is_ring_broken && end - taken > ring) {
        (void)set_fault(reader, &reader->is_ring_broken, "claims %" PRIu64 " bytes in a ring of %" PRIu64, end - taken,
                        ring);
    }
    return reader->is_ring_broken ? taken : end;
}

uint64_t tl_record_queue_reader_skip(tl_record_queue_reader *reader, uint64_t taken) {
    static tl_recorder_entry entry; /* too large for a small stack */
    uint64_t end = tl_record_queue_reader_end(reader, taken);
    uint64_t position = taken;
    while (position != end && tl_record_queue_reader_entry(reader, &position, end, &entry)) {
    }
    return reader->is_ring_broken ? end : taken;
}

bool tl_record_queue_reader_entry(tl_record_queue_reader *reader, uint64_t *position, uint64_t end,
                                  tl_recorder_entry *entry) {
    const tl_ring_reader page = {.bytes = reader->ring, .capacity = reader->settings.ring_bytes, .end = end};
    if (reader->is_ring_broken) {
        return false;
    }
    const char *fault = tl_recorder_entry_unpack(&page, &reader->settings.shape, position, entry);
    return fault == NULL || set_fault(reader, &reader->is_ring_broken, "holds %s", fault);
}

bool tl_record_queue_reader_event(tl_record_queue_reader *reader, uint64_t number, tl_recorder_event_entry *event,
                                  bool *skip) {
    const tl_record_queue_slot *slot = &reader->control->slots[number % TL_RECORDER_EVENTS];
    int64_t ahead = (int64_t)(__atomic_load_n(&slot->state, __ATOMIC_ACQUIRE) - tl_record_queue_state_if_there(number));
    *skip = ahead == 1;
    if (reader->are_events_broken || ahead < 0) {
        return false;
    }
    if (ahead > 1) {
        return set_fault(reader, &reader->are_events_broken, "has overwritten events before they were read");
    }
    if (*skip) {
        return true;
    }
    memcpy(event, &slot->entry, sizeof *event);
    __atomic_signal_fence(__ATOMIC_SEQ_CST);
    const char *fault = tl_record_queue_event_fault(event);
    if (fault != NULL) {
        return set_fault(reader, &reader->are_events_broken, "holds %s", fault);
    }
    tl_recorder_text_clean(event->source);
    tl_recorder_text_clean(event->text);
    return true;
}

/* A checkpoint that may be taken according to its mark. */
typedef struct checkpoint_choice {
    unsigned checkpoint_slot;
    uint64_t number; /* 0: none */
    uint64_t digest;
    tl_record_queue_mark mark;
} checkpoint_choice;

static checkpoint_choice find_candidate(const tl_record_queue_reader *reader, unsigned checkpoint_slot, uint64_t taken,
                                        uint64_t position) {
    checkpoint_choice found = {.checkpoint_slot = checkpoint_slot};
    bool good = read_mark(&reader->control->places[checkpoint_slot], &found.number, &found.digest, &found.mark) &&
                found.number > taken && found.mark.behind <= position && found.mark.size > 0 &&
                found.mark.size <= reader->settings.checkpoint_bytes;
    found.number = good ? found.number : 0;
    return found;
}

/* Returns false if there is none, if it is invalid, or if it was overwritten meanwhile. */
static bool copy_candidate(const tl_record_queue_reader *reader, const checkpoint_choice *chosen,
                           unsigned char *bytes) {
    const unsigned char *there = (const unsigned char *)reader->control;
    if (chosen->number == 0 || reader->is_ring_broken) {
        return false;
    }
    load_bytes(bytes, there + tl_record_queue_checkpoint_at(&reader->settings, chosen->checkpoint_slot),
               (size_t)chosen->mark.size);
    return tl_record_queue_digest(chosen->number, &chosen->mark, bytes) == chosen->digest;
}

bool tl_record_queue_reader_checkpoint(tl_record_queue_reader *reader, uint64_t taken, uint64_t position,
                                       unsigned char *bytes, size_t *size, int64_t *tick, uint64_t *number) {
    checkpoint_choice first = find_candidate(reader, 0, taken, position);
    checkpoint_choice second = find_candidate(reader, 1, taken, position);
    const checkpoint_choice *newer = second.number > first.number ? &second : &first;
    const checkpoint_choice *older = newer == &first ? &second : &first;
    const checkpoint_choice *chosen = copy_candidate(reader, older, bytes)   ? older
                                      : copy_candidate(reader, newer, bytes) ? newer
                                                                             : NULL;
    if (chosen == NULL) {
        return false;
    }
    *size = (size_t)chosen->mark.size;
    *tick = chosen->mark.tick;
    *number = chosen->number;
    return true;
}

uint64_t tl_record_queue_reader_lost(const tl_record_queue_reader *reader) {
    return __atomic_load_n(&reader->control->lost, __ATOMIC_RELAXED);
}

/* ---- Remaining entries ---- */

uint64_t tl_record_queue_count_remaining(const tl_record_queue_settings *settings, const void *memory,
                                         const tl_record_queue_taken *taken) {
    static tl_recorder_entry entry; /* too large for a small stack */
    tl_recorder_event_entry event;
    tl_record_queue_reader reader;
    uint64_t position = taken->ring;
    uint64_t count = 0;
    bool skip = false;
    tl_record_queue_reader_open(settings, memory, &reader);
    uint64_t end = settings->ring_bytes > 0 ? tl_record_queue_reader_end(&reader, position) : position;
    for (uint64_t i = 0;
         i < TL_RECORDER_EVENTS && tl_record_queue_reader_event(&reader, taken->events + i, &event, &skip); i++) {
        count += skip ? 0 : 1;
    }
    while (position != end && tl_record_queue_reader_entry(&reader, &position, end, &entry)) {
        count += entry.kind == TL_ENTRY_SAMPLE || entry.kind == TL_ENTRY_STEP ? 1 : 0;
    }
    return count;
}
