/* Packs samples and records to the signals that a run has, and packs the entries of the recorder's ring.
 *
 * Purpose: a tl_sample is 1.1 kB, of which a plant with three signals uses 60 bytes. The ring, the channel to the process of the FMUs
 *          and the images of earlier runs (resume.h) pack the same tables.
 * Format:  an entry is one byte that says what follows, then its fields one after the other, then a digest; the same program on both sides.
 * Trust:   whoever reads may do so in another process than that which wrote. Of what is there each kind, enumeration, text and digest is
 *          checked: a stray store is detected, but not a forged entry. Numbers are not judged.
 * Thread:  put: the producer; take: the consumer.
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

enum { TL_RECORDER_REASON = TL_ERROR_TEXT }; /* why a run ended may be an error's text */

/* How many of each the run has: at most TL_MAX_SIGNALS, TL_MAX_MATCH, TL_MAX_ADJUST, TL_RECORDER_COMPONENTS. */
typedef struct tl_recorder_shape {
    size_t plant;
    size_t match;
    size_t adjust;
    size_t components;
} tl_recorder_shape;

/* Of a twin; its components are those of the configuration and the plant. */
tl_recorder_shape tl_recorder_shape_of(const tl_config *config);

/* ---- packed structures ---- */

typedef enum tl_packed_count { TL_PACKED_ONE, TL_PACKED_PLANT, TL_PACKED_MATCH, TL_PACKED_ADJUST } tl_packed_count;

/* A part of a structure: an array of one element, or of as many as the shape says. The last part of a table has the size 0. */
typedef struct tl_packed_part {
    size_t at;   /* offset in the structure */
    size_t size; /* bytes of one element */
    tl_packed_count count;
} tl_packed_part;

extern const tl_packed_part tl_packed_signals[]; /* values, stamps and qualities of a tl_sample */
extern const tl_packed_part tl_packed_record[];  /* a tl_record */

/* Bytes of the packed parts. */
size_t tl_packed_size(const tl_packed_part *parts, const tl_recorder_shape *shape);

/* Copies the parts, one after the other, to or from `bytes`, which may lie anywhere. Returns the end of these bytes. Elements beyond the
 * shape are not read and not written. Values are not checked. */
unsigned char *tl_pack(const tl_packed_part *parts, const tl_recorder_shape *shape, const void *from,
                       unsigned char *bytes);
const unsigned char *tl_unpack(const tl_packed_part *parts, const tl_recorder_shape *shape, const unsigned char *bytes,
                               void *to);

/* Whether outcome, stop, delay state, flags and qualities of a record exist. Numbers are not checked. */
bool tl_packed_record_is_sound(const tl_record *record, size_t match);

/* ---- entries ---- */

typedef enum tl_recorder_kind {
    TL_ENTRY_START,
    TL_ENTRY_SAMPLE,
    TL_ENTRY_STEP,
    TL_ENTRY_END,
    TL_ENTRY_TUNING /* before the sample of its tick */
} tl_recorder_kind;

/* A run begins. */
typedef struct tl_record_queue_start {
    bool holds;                /* safe hold: samples and events only */
    tl_resumption resumption;  /* `start` and `started` always count. Its run, if below 0: the one before in here */
    tl_account account;        /* of the twin; nothing if it holds */
    char fmus[TL_SHA256_TEXT]; /* which FMUs it has: see tl_record_queue_name_fmus(). "": nobody has named them */
    tl_run_tuning configured;  /* what it was built with: tl_record_queue_name_configuration(). Hash "": not named */
} tl_record_queue_start;

/* Some 20 KB: not for a small stack. */
typedef struct tl_recorder_entry {
    tl_recorder_kind kind;
    uint64_t id;                 /* TL_ENTRY_START, TL_ENTRY_SAMPLE: of the run */
    tl_record_queue_start start; /* TL_ENTRY_START. The account is sound, and so are digests: tl_identity_is_sound() */
    tl_run_tuning tuning;        /* TL_ENTRY_TUNING. Its values are not judged, nor are those in `start` */
    tl_sample sample;            /* TL_ENTRY_SAMPLE; without its instant */
    tl_record record;            /* TL_ENTRY_STEP */
    tl_recorder_component ledger[TL_RECORDER_COMPONENTS]; /* as of the record */
    char reason[TL_RECORDER_REASON];                      /* TL_ENTRY_END */
} tl_recorder_entry;

/* Bytes of an entry; of TL_ENTRY_START with an account, and without one. The largest of all. */
size_t tl_recorder_entry_size(const tl_recorder_shape *shape, tl_recorder_kind kind);
size_t tl_recorder_entry_size_of_start(bool holds);
size_t tl_recorder_entry_largest(const tl_recorder_shape *shape);

/* ---- into memory, around its end ---- */

/* Where the next entry goes. Positions count bytes for ever; `capacity` is a power of two. */
typedef struct tl_recorder_pen {
    unsigned char *bytes;
    size_t capacity;
    uint64_t position;
    uint64_t digest; /* of the entry that is being written; any at first */
} tl_recorder_pen;

/* There is room for it. Stamps become relative to `start`; what is too far from it stays at the end of what can be told. */
void tl_recorder_entry_pack_start(tl_recorder_pen *pen, const tl_record_queue_start *start, uint64_t id);
void tl_recorder_entry_pack_sample(tl_recorder_pen *pen, const tl_recorder_shape *shape, const tl_sample *sample,
                                   tl_time start, uint64_t id);
void tl_recorder_entry_pack_step(tl_recorder_pen *pen, const tl_recorder_shape *shape, const tl_record *record,
                                 const tl_recorder_component *ledger);

/* TL_ENTRY_TUNING or TL_ENTRY_END, which have one part. */
void tl_recorder_entry_pack_part(tl_recorder_pen *pen, tl_recorder_kind kind, const void *part, size_t size);

/* A stamp relative to `start`, as in an entry. */
tl_time tl_recorder_entry_stamp(tl_time start, tl_time stamp);

/* What is written, up to a position that is at most `capacity` further. */
typedef struct tl_recorder_page {
    const unsigned char *bytes;
    size_t capacity;
    uint64_t end;
} tl_recorder_page;

/* The entry at the position, which is before the end and moves behind the entry. NULL, or what is wrong with it: then nothing
 * moves, and the entry means nothing. Fields beyond the shape are not set. */
const char *tl_recorder_entry_unpack(const tl_recorder_page *page, const tl_recorder_shape *shape, uint64_t *position,
                                     tl_recorder_entry *entry);

/* Goes on with a digest. An entry ends with one of its position and bytes: a wild store does not pass for a value. One multiplication for 8 bytes,
 * since the cycle pays for it; a cryptographic one would keep nobody out, since whoever may write here may write that too. */
uint64_t tl_recorder_digest(uint64_t digest, const void *part, size_t size);

/* Of a text of another process: what a terminal would not show becomes '?'. */
void tl_recorder_text_clean(char *text);

#endif
