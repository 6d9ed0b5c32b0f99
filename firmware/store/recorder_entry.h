/* Packs samples, records and queue entries into bytes, with only the signals that a run has.
 *
 * Purpose: a tl_sample has 1.1 kB; a plant with three signals needs 60 bytes of it. The record
 *          queue, the channel to the FMU process and resume data (resume.h) pack in this way.
 * Format:  an entry is one byte for its kind, then its fields in sequence, then a digest
 *          (checksum). Writer and reader are the same program: no version, no byte order.
 * Trust:   the reader may be in another process than the writer. Kinds, enumerations, texts and the
 *          digest are validated, numbers are not. The digest detects accidental overwriting, but no
 *          forgery.
 * Memory:  the caller's.
 * Thread:  pack: the producer; unpack: the consumer.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_ENTRY_H
#define TL_FIRMWARE_STORE_RECORDER_ENTRY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/config/config.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"
#include "master/base/status.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

enum { TL_RECORDER_REASON = TL_ERROR_TEXT }; /* the reason may be an error's text */

/* Numbers of plant signals, matched outputs, adjusted variables and components of a run: at most
 * TL_MAX_SIGNALS, TL_MAX_MATCH, TL_MAX_ADJUST, TL_RECORDER_COMPONENTS. */
typedef struct tl_recorder_shape {
    size_t plant;
    size_t match;
    size_t adjust;
    size_t components;
} tl_recorder_shape;

/* Returns the shape of a run with this configuration. The plant counts as one more component. */
tl_recorder_shape tl_recorder_shape_of(const tl_config *config);

/* ---- packed structures ---- */

/* Number of elements of a part: one, or a number of the shape. */
typedef enum tl_packed_count { TL_PACKED_ONE, TL_PACKED_PLANT, TL_PACKED_MATCH, TL_PACKED_ADJUST } tl_packed_count;

/* Part of a structure: one element, or an array with as many elements as the shape defines. A table
 * ends with a part of size 0. */
typedef struct tl_packed_part {
    size_t at;   /* offset in the structure */
    size_t size; /* bytes of one element */
    tl_packed_count count;
} tl_packed_part;

extern const tl_packed_part tl_packed_signals[]; /* values, stamps and qualities of a tl_sample */
extern const tl_packed_part tl_packed_record[];  /* a tl_record */

/* Returns the packed size in bytes. */
size_t tl_packed_size(const tl_packed_part *parts, const tl_recorder_shape *shape);

/* Copy the parts in sequence to or from `bytes`, which needs no alignment. Return the end of the
 * bytes. Elements beyond the shape are neither read nor written. Values are not validated. */
unsigned char *tl_pack(const tl_packed_part *parts, const tl_recorder_shape *shape, const void *from,
                       unsigned char *bytes);
const unsigned char *tl_unpack(const tl_packed_part *parts, const tl_recorder_shape *shape, const unsigned char *bytes,
                               void *to);

/* Returns whether outcome, stop, delay state, flags and qualities of a record are valid. Numbers
 * are not validated. `match`: number of matched outputs. */
bool tl_packed_record_is_sound(const tl_record *record, size_t match);

/* ---- entries ---- */

typedef enum tl_recorder_kind {
    TL_ENTRY_START,
    TL_ENTRY_SAMPLE,
    TL_ENTRY_STEP,
    TL_ENTRY_END,
    TL_ENTRY_TUNING /* precedes the sample of its tick */
} tl_recorder_kind;

/* Beginning of a run. */
typedef struct tl_record_queue_start {
    bool holds;                /* safe hold: samples and events only */
    tl_resumption resumption;  /* `start` and `started` are always valid; `run` < 0: the queue's previous run */
    tl_account account;        /* of the twin; undefined if `holds` */
    char fmus[TL_SHA256_TEXT]; /* tl_record_queue_name_fmus(); "": unknown */
    tl_run_tuning configured;  /* tl_record_queue_name_configuration(); hash "": unknown */
} tl_record_queue_start;

/* An entry; the comments name the kinds that set a field. About 42 kB: not for a small stack. */
typedef struct tl_recorder_entry {
    tl_recorder_kind kind;
    uint64_t id;                 /* TL_ENTRY_START, TL_ENTRY_SAMPLE: identifies the run within its queue */
    tl_record_queue_start start; /* TL_ENTRY_START; account and SHA-256 texts are validated, tuning values are not */
    tl_run_tuning tuning;        /* TL_ENTRY_TUNING; its values are not validated */
    tl_sample sample;            /* TL_ENTRY_SAMPLE; `instant` and `moved` are not set */
    tl_record record;            /* TL_ENTRY_STEP */
    tl_execution_counts ledger[TL_RECORDER_COMPONENTS]; /* TL_ENTRY_STEP: counts per component */
    char reason[TL_RECORDER_REASON];                    /* TL_ENTRY_END */
} tl_recorder_entry;

/* Return the size of an entry in bytes: of this kind (TL_ENTRY_START: with an account); of
 * TL_ENTRY_START, without an account in safe hold (`holds`); of the largest kind. */
size_t tl_recorder_entry_size(const tl_recorder_shape *shape, tl_recorder_kind kind);
size_t tl_recorder_entry_size_of_start(bool holds);
size_t tl_recorder_entry_largest(const tl_recorder_shape *shape);

/* ---- into ring memory ---- */

/* Writer: ring memory, and the position of the next entry. Positions count all bytes written so
 * far; byte n lies at n % capacity. `capacity`: bytes of the ring, a power of two. */
typedef struct tl_ring_writer {
    unsigned char *bytes;
    size_t capacity;
    uint64_t position;
    uint64_t digest; /* of the entry being written; any value at first */
} tl_ring_writer;

/* Write an entry and advance the position; the caller has ensured room. Stamps of a sample are
 * stored relative to `start` (t_start, ns) and clamped to the range of tl_time. */
void tl_recorder_entry_pack_start(tl_ring_writer *pen, const tl_record_queue_start *start, uint64_t id);
void tl_recorder_entry_pack_sample(tl_ring_writer *pen, const tl_recorder_shape *shape, const tl_sample *sample,
                                   tl_time start, uint64_t id);
void tl_recorder_entry_pack_step(tl_ring_writer *pen, const tl_recorder_shape *shape, const tl_record *record,
                                 const tl_execution_counts *ledger);

/* Writes TL_ENTRY_TUNING or TL_ENTRY_END, which have one part. */
void tl_recorder_entry_pack_part(tl_ring_writer *pen, tl_recorder_kind kind, const void *part, size_t size);

/* Returns a stamp relative to `start`, clamped as in an entry; TL_TIME_NEVER stays. */
tl_time tl_recorder_entry_stamp(tl_time start, tl_time stamp);

/* Reader: ring memory with entries up to position `end`, which is at most `capacity` bytes after
 * the position of the entry to read. */
typedef struct tl_ring_reader {
    const unsigned char *bytes;
    size_t capacity;
    uint64_t end;
} tl_ring_reader;

/* Reads the entry at `*position`, which is before the end, and advances the position. Returns NULL,
 * or a text that describes the fault; then the position stays and the entry is undefined. Fields
 * beyond the shape are not set. */
const char *tl_recorder_entry_unpack(const tl_ring_reader *page, const tl_recorder_shape *shape, uint64_t *position,
                                     tl_recorder_entry *entry);

/* Returns `digest`, continued over `size` bytes of `part`. An entry ends with the digest of its
 * position and bytes, which detects accidental overwriting. It is fast, one multiplication for 8
 * bytes. A cryptographic digest would not help: a forger could compute it too. */
uint64_t tl_recorder_digest(uint64_t digest, const void *part, size_t size);

/* Replaces control characters (ASCII and Latin 1) in a text from another process by '?'. */
void tl_recorder_text_clean(char *text);

#endif
