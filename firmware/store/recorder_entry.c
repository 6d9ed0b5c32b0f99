/* Packs and unpacks entries. Both directions must use the same fields in the same order.
 *
 * The first byte of an entry does not occur in corrupted memory by chance: zeros are no entry.
 * Unpacking copies the bytes first and validates the copy, because another process may change the
 * memory meanwhile.
 */
#include "firmware/store/recorder_entry.h"

#include <string.h>

#include "firmware/base/identity.h"

enum { MARK = 0xB4 }; /* added to each kind */

/* Most parts have one or two words. For a tick of two signals this loop needs two thirds of the
 * time of calls to memcpy(). */
static inline void copy_part(unsigned char *to, const unsigned char *from, size_t size) {
    if (size > 8 * sizeof(uint64_t)) {
        memcpy(to, from, size);
        return;
    }
    size_t at = 0;
    for (; at + sizeof(uint64_t) <= size; at += sizeof(uint64_t)) {
        memcpy(to + at, from + at, sizeof(uint64_t));
    }
    for (; at < size; at++) {
        to[at] = from[at];
    }
}

/* Invertible, so that a changed word always changes the digest. */
static uint64_t mix_word(uint64_t digest, uint64_t word) {
    digest = (digest ^ word) * UINT64_C(0x9E3779B97F4A7C15);
    return digest ^ digest >> 29;
}

uint64_t tl_recorder_digest(uint64_t digest, const void *part, size_t size) {
    const unsigned char *bytes = part;
    uint64_t word = 0;
    for (; size >= sizeof word; size -= sizeof word, bytes += sizeof word) {
        memcpy(&word, bytes, sizeof word);
        digest = mix_word(digest, word);
    }
    if (size > 0) {
        word = 0;
        copy_part((unsigned char *)&word, bytes, size);
        digest = mix_word(digest, word);
    }
    return digest;
}

/* ---- Packed structures ---- */

const tl_packed_part tl_packed_signals[] = {
    {offsetof(tl_sample, values), sizeof(double), TL_PACKED_PLANT},
    {offsetof(tl_sample, stamps), sizeof(tl_time), TL_PACKED_PLANT},
    {offsetof(tl_sample, quality), sizeof(uint8_t), TL_PACKED_PLANT},
    {0},
};

/* Without padding, so that each byte is defined. */
const tl_packed_part tl_packed_record[] = {
    {offsetof(tl_record, step), offsetof(tl_record, held) + sizeof(uint32_t), TL_PACKED_ONE}, /* up to `held` */
    {offsetof(tl_record, bad_outputs), sizeof(uint64_t), TL_PACKED_ONE},
    {offsetof(tl_record, refused), sizeof(tl_record_refused), TL_PACKED_ONE},
    {offsetof(tl_record, used), sizeof(tl_time), TL_PACKED_ONE},
    {offsetof(tl_record, delay_state), sizeof(tl_delay_state), TL_PACKED_ONE},
    {offsetof(tl_record, delay), sizeof(tl_time), TL_PACKED_ONE},
    {offsetof(tl_record, release_age), sizeof(uint32_t), TL_PACKED_ONE},
    {offsetof(tl_record, y), sizeof(double), TL_PACKED_MATCH},
    {offsetof(tl_record, measured), sizeof(double), TL_PACKED_MATCH},
    {offsetof(tl_record, readings), sizeof(tl_record_readings), TL_PACKED_MATCH},
    {offsetof(tl_record, released), sizeof(double), TL_PACKED_MATCH},
    {offsetof(tl_record, u), sizeof(double), TL_PACKED_ADJUST},
    {offsetof(tl_record, nominal), sizeof(double), TL_PACKED_ADJUST},
    {offsetof(tl_record, measured_quality), sizeof(uint8_t), TL_PACKED_MATCH},
    {0},
};

tl_recorder_shape tl_recorder_shape_of(const tl_config *config) {
    return (tl_recorder_shape){.plant = config->signal_count,
                               .match = config->match_count,
                               .adjust = config->adjust_count,
                               .components = config->component_count + 1};
}

static size_t bytes_of(const tl_packed_part *part, const tl_recorder_shape *shape) {
    const size_t counts[] = {1, shape->plant, shape->match, shape->adjust};
    return part->size * counts[part->count];
}

size_t tl_packed_size(const tl_packed_part *parts, const tl_recorder_shape *shape) {
    size_t size = 0;
    for (; parts->size != 0; parts++) {
        size += bytes_of(parts, shape);
    }
    return size;
}

unsigned char *tl_pack(const tl_packed_part *parts, const tl_recorder_shape *shape, const void *from,
                       unsigned char *bytes) {
    for (; parts->size != 0; parts++) {
        size_t size = bytes_of(parts, shape);
        copy_part(bytes, (const unsigned char *)from + parts->at, size);
        bytes += size;
    }
    return bytes;
}

const unsigned char *tl_unpack(const tl_packed_part *parts, const tl_recorder_shape *shape, const unsigned char *bytes,
                               void *to) {
    for (; parts->size != 0; parts++) {
        size_t size = bytes_of(parts, shape);
        copy_part((unsigned char *)to + parts->at, bytes, size);
        bytes += size;
    }
    return bytes;
}

static bool are_qualities(const uint8_t *quality, size_t count) {
    size_t i = 0;
    while (i < count && quality[i] <= TL_LAST_QUALITY) {
        i++;
    }
    return i == count;
}

bool tl_packed_record_is_sound(const tl_record *record, size_t match) {
    return (unsigned)record->outcome < TL_OUTCOMES && (unsigned)record->stop <= TL_STOP_TIME &&
           (unsigned)record->delay_state <= TL_DELAY_LOST && record->flags < 2U * TL_LAST_FLAG &&
           are_qualities(record->measured_quality, match);
}

/* ---- Sizes ---- */

size_t tl_recorder_entry_size_of_start(bool holds) {
    size_t account_size = holds ? 0 : sizeof(tl_account) + TL_SHA256_TEXT + sizeof(tl_run_tuning);
    return 2 + sizeof(tl_resumption) + 2 * sizeof(uint64_t) + account_size;
}

size_t tl_recorder_entry_size(const tl_recorder_shape *shape, tl_recorder_kind kind) {
    size_t ends = 1 + sizeof(uint64_t); /* the kind and the digest */
    switch (kind) {
    case TL_ENTRY_START:
        break;
    case TL_ENTRY_SAMPLE:
        return ends + sizeof(uint64_t) + sizeof(int64_t) + tl_packed_size(tl_packed_signals, shape);
    case TL_ENTRY_STEP:
        return ends + tl_packed_size(tl_packed_record, shape) + shape->components * sizeof(tl_execution_counts);
    case TL_ENTRY_END:
        return ends + TL_RECORDER_REASON;
    case TL_ENTRY_TUNING:
        return ends + sizeof(tl_run_tuning);
    }
    return tl_recorder_entry_size_of_start(false);
}

size_t tl_recorder_entry_largest(const tl_recorder_shape *shape) {
    size_t largest = 0;
    for (int kind = TL_ENTRY_START; kind <= TL_ENTRY_TUNING; kind++) {
        size_t size = tl_recorder_entry_size(shape, (tl_recorder_kind)kind);
        largest = size > largest ? size : largest;
    }
    return largest;
}

/* ---- Packing ---- */

static void put_bytes(tl_ring_writer *pen, const void *part, size_t size) {
    pen->digest = tl_recorder_digest(pen->digest, part, size);
    size_t at = (size_t)(pen->position & (pen->capacity - 1));
    size_t first = size < pen->capacity - at ? size : pen->capacity - at;
    copy_part(pen->bytes + at, part, first);
    copy_part(pen->bytes, (const unsigned char *)part + first, size - first);
    pen->position += size;
}

static void put_parts(tl_ring_writer *pen, const tl_packed_part *parts, const tl_recorder_shape *shape,
                      const void *from) {
    for (; parts->size != 0; parts++) {
        put_bytes(pen, (const unsigned char *)from + parts->at, bytes_of(parts, shape));
    }
}

static void put_byte(tl_ring_writer *pen, unsigned value) {
    unsigned char byte = (unsigned char)value;
    put_bytes(pen, &byte, 1);
}

static void put_kind(tl_ring_writer *pen, tl_recorder_kind kind) {
    pen->digest = pen->position;
    put_byte(pen, MARK + (unsigned)kind);
}

static void put_digest(tl_ring_writer *pen) {
    uint64_t digest = pen->digest;
    put_bytes(pen, &digest, sizeof digest);
}

void tl_recorder_entry_pack_start(tl_ring_writer *pen, const tl_record_queue_start *start, uint64_t id) {
    put_kind(pen, TL_ENTRY_START);
    put_byte(pen, start->holds);
    put_bytes(pen, &start->resumption, sizeof start->resumption);
    put_bytes(pen, &id, sizeof id);
    if (!start->holds) {
        put_bytes(pen, &start->account, sizeof start->account);
        put_bytes(pen, start->fmus, sizeof start->fmus);
        put_bytes(pen, &start->configured, sizeof start->configured);
    }
    put_digest(pen);
}

/* A stamp comes from a driver's process, and may have any value. */
tl_time tl_recorder_entry_stamp(tl_time start, tl_time stamp) {
    tl_time difference = 0;
    if (stamp == TL_TIME_NEVER) {
        return TL_TIME_NEVER;
    }
    if (__builtin_sub_overflow(stamp, start, &difference) || difference == TL_TIME_NEVER) {
        return stamp < start ? TL_TIME_NEVER + 1 : INT64_MAX;
    }
    return difference;
}

void tl_recorder_entry_pack_sample(tl_ring_writer *pen, const tl_recorder_shape *shape, const tl_sample *sample,
                                   tl_time start, uint64_t id) {
    tl_sample relative = *sample;
    for (size_t i = 0; i < shape->plant; i++) {
        relative.stamps[i] = tl_recorder_entry_stamp(start, sample->stamps[i]);
    }
    put_kind(pen, TL_ENTRY_SAMPLE);
    put_bytes(pen, &id, sizeof id);
    put_bytes(pen, &relative.tick, sizeof relative.tick);
    put_parts(pen, tl_packed_signals, shape, &relative);
    put_digest(pen);
}

void tl_recorder_entry_pack_step(tl_ring_writer *pen, const tl_recorder_shape *shape, const tl_record *record,
                                 const tl_execution_counts *ledger) {
    put_kind(pen, TL_ENTRY_STEP);
    put_parts(pen, tl_packed_record, shape, record);
    put_bytes(pen, ledger, shape->components * sizeof *ledger);
    put_digest(pen);
}

void tl_recorder_entry_pack_part(tl_ring_writer *pen, tl_recorder_kind kind, const void *part, size_t size) {
    put_kind(pen, kind);
    put_bytes(pen, part, size);
    put_digest(pen);
}

/* ---- Unpacking ---- */

/* Read position within an entry. */
typedef struct cursor {
    const tl_ring_reader *page;
    uint64_t position;
    uint64_t digest;
} cursor;

/* Returns false if the part would exceed the end. Each byte is copied once and then not read from
 * the memory again. */
static bool get_bytes(cursor *at, void *part, size_t size) {
    const tl_ring_reader *page = at->page;
    size_t from = (size_t)(at->position & (page->capacity - 1));
    size_t first = size < page->capacity - from ? size : page->capacity - from;
    if (page->end - at->position < size) {
        return false;
    }
    copy_part(part, page->bytes + from, first);
    copy_part((unsigned char *)part + first, page->bytes, size - first);
    __atomic_signal_fence(__ATOMIC_SEQ_CST);
    at->position += size;
    at->digest = tl_recorder_digest(at->digest, part, size);
    return true;
}

static bool get_parts(cursor *at, const tl_packed_part *parts, const tl_recorder_shape *shape, void *to) {
    bool whole = true;
    for (; whole && parts->size != 0; parts++) {
        whole = get_bytes(at, (unsigned char *)to + parts->at, bytes_of(parts, shape));
    }
    return whole;
}

static const char *const CUT = "a truncated entry";
static const char *const UNKNOWN = "an enumeration with an unknown value";

static const char *get_tuning(cursor *at, tl_run_tuning *tuning) {
    if (!get_bytes(at, tuning, sizeof *tuning)) {
        return CUT;
    }
    return tl_identity_is_sound(tuning->hash) ? NULL : "an invalid digest of a configuration";
}

static const char *get_start(cursor *at, tl_recorder_entry *entry) {
    tl_record_queue_start *start = &entry->start;
    uint8_t holds = 0;
    memset(start, 0, sizeof *start);
    if (!get_bytes(at, &holds, 1) || !get_bytes(at, &start->resumption, sizeof start->resumption) ||
        !get_bytes(at, &entry->id, sizeof entry->id)) {
        return CUT;
    }
    if (holds > 1 || (unsigned)start->resumption.from > (unsigned)TL_RESUMED_INPUTS) {
        return UNKNOWN;
    }
    start->holds = holds == 1;
    if (start->holds) {
        return NULL;
    }
    if (!get_bytes(at, &start->account, sizeof start->account) || !get_bytes(at, start->fmus, sizeof start->fmus)) {
        return CUT;
    }
    if (!tl_identity_is_sound(start->fmus)) {
        return "an invalid digest of the FMUs";
    }
    return tl_account_is_sound(&start->account) ? get_tuning(at, &start->configured) : "an invalid account";
}

static const char *get_sample(cursor *at, const tl_recorder_shape *shape, uint64_t *id, tl_sample *sample) {
    bool whole = get_bytes(at, id, sizeof *id) && get_bytes(at, &sample->tick, sizeof sample->tick) &&
                 get_parts(at, tl_packed_signals, shape, sample);
    return !whole ? CUT : are_qualities(sample->quality, shape->plant) ? NULL : UNKNOWN;
}

static const char *get_step(cursor *at, const tl_recorder_shape *shape, tl_recorder_entry *entry) {
    bool whole = get_parts(at, tl_packed_record, shape, &entry->record) &&
                 get_bytes(at, entry->ledger, shape->components * sizeof *entry->ledger);
    return !whole ? CUT : tl_packed_record_is_sound(&entry->record, shape->match) ? NULL : UNKNOWN;
}

static const char *get_end(cursor *at, char reason[TL_RECORDER_REASON]) {
    if (!get_bytes(at, reason, TL_RECORDER_REASON)) {
        return CUT;
    }
    if (memchr(reason, '\0', TL_RECORDER_REASON) == NULL) {
        return "an unterminated text";
    }
    tl_recorder_text_clean(reason);
    return NULL;
}

static const char *check_digest(cursor *at) {
    uint64_t digest = at->digest;
    uint64_t found = 0;
    return !get_bytes(at, &found, sizeof found) ? CUT : found == digest ? NULL : "an overwritten entry";
}

const char *tl_recorder_entry_unpack(const tl_ring_reader *page, const tl_recorder_shape *shape, uint64_t *position,
                                     tl_recorder_entry *entry) {
    cursor at = {page, *position, *position};
    uint8_t kind = 0;
    const char *fault = get_bytes(&at, &kind, 1) ? "an entry of unknown kind" : CUT;
    switch (kind) {
    case MARK + TL_ENTRY_START:
        fault = get_start(&at, entry);
        break;
    case MARK + TL_ENTRY_SAMPLE:
        fault = get_sample(&at, shape, &entry->id, &entry->sample);
        break;
    case MARK + TL_ENTRY_STEP:
        fault = get_step(&at, shape, entry);
        break;
    case MARK + TL_ENTRY_END:
        fault = get_end(&at, entry->reason);
        break;
    case MARK + TL_ENTRY_TUNING:
        fault = get_tuning(&at, &entry->tuning);
        break;
    default:
        break;
    }
    fault = fault == NULL ? check_digest(&at) : fault;
    if (fault == NULL) {
        entry->kind = (tl_recorder_kind)(kind - MARK);
        *position = at.position;
    }
    return fault;
}

/* Replaces control characters of ASCII and of Latin 1 (in UTF-8: C2 80 … C2 9F). */
void tl_recorder_text_clean(char *text) {
    for (unsigned char *byte = (unsigned char *)text; *byte != '\0'; byte++) {
        if (*byte < ' ' || *byte == 0x7FU) {
            *byte = '?';
        } else if (*byte == 0xC2U && byte[1] >= 0x80U && byte[1] < 0xA0U) {
            byte[0] = byte[1] = '?';
        }
    }
}
