/* Record queue: passes a run and its events from a process to the recorder, through shared memory.
 *
 * Parts:   an event; the producer's side; the memory layout; the reader's side; a count for the
 *          supervisor. Each part describes its memory and threads.
 * Trust:   each side treats the data of the other side as untrusted.
 */
#ifndef TL_FIRMWARE_STORE_RECORD_QUEUE_H
#define TL_FIRMWARE_STORE_RECORD_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

/* ---- Event that waits until the recorder writes it into the database.
 *
 * Size:   fixed; texts are truncated. No pointers, so that another process can read it.
 */

/* Maximum number of events that wait; a power of two. */
enum { TL_RECORDER_EVENTS = 512 };
enum { TL_EVENT_SOURCE = 32, TL_EVENT_TEXT = 224 }; /* bytes, including the NUL */

typedef struct tl_recorder_event_entry {
    int64_t at;        /* CLOCK_MONOTONIC, ms; the recorder converts it to UTC */
    int64_t tick;      /* −1: no tick */
    uint64_t position; /* end of the published entries when it was put; 0: put into no record queue */
    tl_severity severity;
    char source[TL_EVENT_SOURCE];
    char text[TL_EVENT_TEXT];
} tl_recorder_event_entry;

/* Fills an entry: the texts, truncated to its size, the present time, and position 0. */
void tl_recorder_event_fill(tl_recorder_event_entry *entry, int64_t tick, tl_severity severity, const char *source,
                            const char *text);

/* ---- Record queue, producer's side.
 *
 * Purpose: entries pass through a ring of bytes: the beginning of a run, its samples, steps,
 *          tunings and end. Events pass through a queue for many threads. Checkpoints (saved twins)
 *          lie in two slots that alternate. The producer never waits for the recorder.
 * Memory:  the caller's, zeroed at first, aligned to 64 bytes: of this process, or a shared block
 *          (block.h) that only this process writes. No pointers. tl_record_queue_taken, the
 *          reader's progress, lies in the reader's memory.
 * Terms:   a position counts all bytes ever put into the ring. It never wraps around.
 * Death:   the memory may outlive the producer. A successor continues in it. Published entries
 *          remain. If an entry that the reader has not taken is invalid, the successor removes this
 *          entry and all later ones. The successor can also read taken entries: they stay in the
 *          ring until new entries need their bytes. The ring has room for 30 s of new entries, and
 *          for those since the older checkpoint; at most 16 MiB.
 * New:     zeroed memory may replace a record queue of which the reader has taken all entries. The
 *          producer then continues the positions and numbers of the reader's progress.
 * Ticks:   a sample waits for its step. The producer publishes it with the step, or with the next
 *          other entry. If the producer dies within a tick, the reader gets nothing of that tick,
 *          unless it knows that there is no successor. A successor that continues with that tick
 *          puts the sample again. If the successor begins another run, the waiting sample becomes
 *          the last one of the earlier run.
 * Loss:    an entry without room is dropped and counted as lost. Only a slow reader causes loss:
 *          entries that the reader has taken never prevent a new entry.
 * Damage:  if the reader finds an invalid entry, it may skip to the end of the ring. The producer's
 *          next entry follows the skipped bytes.
 * Order:   the beginning of a run precedes all its entries. A beginning without room waits and is
 *          put first; until then other entries are lost.
 * Thread:  put_* and checkpoints: one thread, that of the cycle; event() and lost(): any thread.
 *          Lock-free: event() retries only if another thread puts an event at the same time.
 * Trust:   the reader validates all data of the producer, and the producer validates the progress
 *          of the reader.
 */

/* Settings; producer and reader must use equal ones. */
typedef struct tl_record_queue_settings {
    tl_recorder_shape shape; /* numbers of signals and components, which define the size of entries */
    size_t ring_bytes;       /* a power of two, at least tl_record_queue_ring_bytes(); 0: events only */
    size_t checkpoint_bytes; /* largest checkpoint, allocated on first use. 0: no checkpoints */
} tl_record_queue_settings;

/* Progress of the reader: what it has taken, that is, will not read again. It lies in the reader's
 * memory, and the producer reads it. Values never decrease. */
typedef struct tl_record_queue_taken {
    uint64_t ring;       /* position of the first entry that is not taken, bytes */
    uint64_t events;     /* number of taken events */
    uint64_t checkpoint; /* number of the newest taken checkpoint; 0: none */
} tl_record_queue_taken;

/* Fields are private; the caller provides the memory. */
typedef struct tl_record_queue {
    tl_record_queue_settings settings;
    struct tl_record_queue_control *control;
    unsigned char *ring;
    const tl_record_queue_taken *taken; /* NULL: no reader */
    uint64_t written;                   /* position: end of all entries */
    uint64_t published;                 /* end of the published entries; a waiting sample lies between the two ends */
    int64_t waiting;                    /* tick of the waiting sample */
    uint64_t number;                    /* of the newest checkpoint */
    size_t reserved;                    /* bytes reserved for each checkpoint */
    bool hides;                         /* tl_record_queue_hide_unused() was called */
    char fmus[TL_SHA256_TEXT];          /* for runs that begin from now on */
    tl_run_tuning configured;           /* for runs that begin from now on */
    tl_run_tuning tuning;               /* present tuning */
    tl_resumption beginning;            /* of the run; stamps are relative to its start */
    uint64_t id;                        /* of the run: its beginning's CLOCK_MONOTONIC, ns; 0: no run */
} tl_record_queue;

/* Returns the ring size in bytes, a power of two: room for 30 s of a run with this shape, and for
 * the entries that a successor may read. Range: 256 KiB … 16 MiB. `step`: T_S, ns. */
size_t tl_record_queue_ring_bytes(const tl_recorder_shape *shape, tl_time step);

/* Returns the size in bytes of the memory for tl_record_queue_open(). */
size_t tl_record_queue_bytes(const tl_record_queue_settings *settings);

/* Starts a record queue, or continues in the memory of a dead producer. Touches all pages of the
 * ring. `taken`: progress of the reader, usually in its block. NULL: there is no reader; then the
 * ring only keeps entries for a successor, and events are dropped. Needs about 50 kB of stack. */
void tl_record_queue_open(const tl_record_queue_settings *settings, void *memory, const tl_record_queue_taken *taken,
                          tl_record_queue *queue);

/* ---- a run ---- */

/* Sets the identity of the FMUs (identity.h) for runs that begin from now on. A run in safe hold
 * does not record it. */
void tl_record_queue_name_fmus(tl_record_queue *queue, const char fmus[TL_SHA256_TEXT]);

/* Sets the configuration and tuning for runs that begin from now on, and the result of
 * tl_record_queue_tuning(). A run in safe hold does not record them. */
void tl_record_queue_name_configuration(tl_record_queue *queue, const tl_run_tuning *configured);

/* Put an entry; return false if there is no room. A beginning without room is put before the next
 * entry that has room; any other entry is counted as lost. Stamps are stored relative to t_start.
 * A sample needs room for its step too. `ledger`: counts of all components after the step. */
bool tl_record_queue_put_start(tl_record_queue *queue, const tl_record_queue_start *start);
bool tl_record_queue_put_sample(tl_record_queue *queue, const tl_sample *sample);
bool tl_record_queue_put_step(tl_record_queue *queue, const tl_record *record, const tl_execution_counts *ledger);
bool tl_record_queue_put_end(tl_record_queue *queue, const char *reason); /* truncated to TL_RECORDER_REASON */

/* put_tuning() records that the twin uses this tuning from tuning->tick on; call it just before
 * that tick's sample. It returns false if there is no room. If has_room_for_tuning() returns true,
 * the tuning, the sample and step of that tick, and the step before it have room. */
bool tl_record_queue_has_room_for_tuning(const tl_record_queue *queue);
bool tl_record_queue_put_tuning(tl_record_queue *queue, const tl_run_tuning *tuning);

/* Returns the tuning of the last put_tuning(), put_start() or name_configuration(). */
const tl_run_tuning *tl_record_queue_tuning(const tl_record_queue *queue);

/* Returns how the present run began. */
const tl_resumption *tl_record_queue_beginning(const tl_record_queue *queue);

/* Sleeps in steps of 1 ms until there is room for a tuning, a sample, a step and an end. Returns
 * false if there is still no room at `until` (CLOCK_MONOTONIC). For a producer that catches up. */
bool tl_record_queue_wait_for_room(tl_record_queue *queue, tl_time until);

/* Puts an event; any thread. If TL_RECORDER_EVENTS events wait, it is counted as lost. `source` is
 * one word; `tick` −1: no tick. Texts are truncated to the size of an entry. */
void tl_record_queue_event(tl_record_queue *queue, int64_t tick, tl_severity severity, const char *source,
                           const char *text);

/* Returns the number of entries and events that were lost. */
uint64_t tl_record_queue_lost(const tl_record_queue *queue);

/* ---- checkpoints ---- */

/* Touches the pages for checkpoints of up to `size` bytes, so that saving one causes no page fault.
 * Existing checkpoints remain. Returns false if `size` exceeds settings.checkpoint_bytes, or if
 * hidden pages cannot be made accessible. */
bool tl_record_queue_reserve_checkpoint(tl_record_queue *queue, size_t size);

/* Returns the memory for the next checkpoint, and its size; NULL if none is reserved. */
unsigned char *tl_record_queue_checkpoint_room(tl_record_queue *queue, size_t *capacity);

/* Publishes the checkpoint that was made in that memory: the twin after `tick` and after all
 * entries put so far. Overwrites the older checkpoint, even if the reader has not taken it. `size`:
 * bytes, at most the reserved size; 0: the twin cannot be saved, and only the position is stored.
 * Then a successor can still read the entries put since. */
void tl_record_queue_put_checkpoint(tl_record_queue *queue, int64_t tick, size_t size);

/* Makes the unused part of the checkpoint memory inaccessible until it is reserved. So mlockall()
 * does not allocate pages for it. Reserved memory and existing checkpoints stay accessible. The
 * queue's memory must begin at a page boundary. */
void tl_record_queue_hide_unused(tl_record_queue *queue);

/* ---- for a successor, before it puts anything ---- */

/* A checkpoint of the dead producer. */
typedef struct tl_record_queue_saved {
    int64_t tick;
    const unsigned char *bytes; /* in the queue's memory, valid until the next checkpoint; size 0: none */
    size_t size;
    uint64_t position;       /* of the first entry after it */
    tl_resumption beginning; /* of its run */
    tl_run_tuning tuning;    /* in use after `tick`; the hash is validated, the values are not */
} tl_record_queue_saved;

/* Finds a valid checkpoint since which all entries are still in the ring. `which`: 0 the newest, 1
 * the older one. Returns false if there is no such checkpoint. */
bool tl_record_queue_saved_checkpoint(const tl_record_queue *queue, unsigned which, tl_record_queue_saved *left);

/* Reads the entry at `*position` and advances the position. Returns false if there is no further
 * entry, or if it is invalid (recorder_entry.h) or overwritten. Its stamps may have any value. */
bool tl_record_queue_saved_entry(const tl_record_queue *queue, uint64_t *position, tl_recorder_entry *entry);

/* ---- Memory layout of a record queue, for both sides.
 *
 * Layout:  control data with the events; the ring; two checkpoint slots; the memory in which the
 *          next checkpoint is made. Each part begins at a page boundary.
 * Atomics: fields that both sides access at the same time have 8 bytes and 8-byte alignment, so
 *          that a 32-bit CPU also accesses them atomically.
 */

enum { TL_RECORD_QUEUE_LINE = 64, TL_RECORD_QUEUE_CHECKPOINTS = 2 };

/* Event n lies in slot n % TL_RECORDER_EVENTS. Until it is put, `state` is of an earlier event. */
typedef struct tl_record_queue_slot {
    uint64_t state __attribute__((aligned(8))); /* 2 n + 2: event n is complete; 2 n + 3: left incomplete */
    tl_recorder_event_entry entry;
} tl_record_queue_slot;

/* Description of a checkpoint. */
typedef struct tl_record_queue_mark {
    int64_t tick;
    uint64_t size;
    uint64_t position; /* of the first entry after it */
    uint64_t behind;   /* the reader takes it after all entries up to here, including a beginning that still waits */
    tl_resumption beginning;
    tl_run_tuning tuning; /* in use after `tick` */
} tl_record_queue_mark;

enum { TL_RECORD_QUEUE_MARK_WORDS = (sizeof(tl_record_queue_mark) + 7) / 8 };

/* Checkpoint n lies in slot n % 2. Number 0: none, or it is being written. The digest covers
 * number, mark and bytes. So the reader detects a checkpoint that changed while it was read, in
 * whatever order the CPU accesses memory. */
typedef struct tl_record_queue_checkpoint {
    uint64_t number __attribute__((aligned(TL_RECORD_QUEUE_LINE)));
    uint64_t digest;
    uint64_t mark[TL_RECORD_QUEUE_MARK_WORDS];
} tl_record_queue_checkpoint;

typedef struct tl_record_queue_control {
    uint64_t head __attribute__((aligned(TL_RECORD_QUEUE_LINE))); /* end of the published entries */
    uint64_t put; /* end including a waiting sample; used by a successor, or by a reader if there is none */
    uint64_t next __attribute__((aligned(TL_RECORD_QUEUE_LINE))); /* number of the next event */
    uint64_t lost __attribute__((aligned(TL_RECORD_QUEUE_LINE))); /* entries and events */
    tl_record_queue_checkpoint places[TL_RECORD_QUEUE_CHECKPOINTS];
    tl_record_queue_slot slots[TL_RECORDER_EVENTS];
    bool start_waits;            /* private to the producer */
    tl_record_queue_start start; /* the beginning that waits for room */
} tl_record_queue_control;

/* Returns the offset of a checkpoint slot in the memory, bytes. */
size_t tl_record_queue_checkpoint_at(const tl_record_queue_settings *settings,
                                     unsigned checkpoint_slot); /* 0, 1: slots; 2: where the next is made; 3: end */

/* Upper limit of checkpoint numbers, so that they never wrap around. */
#define TL_RECORD_QUEUE_NUMBERS (UINT64_MAX / 2)

/* Digest of number, mark (with padding) and bytes. */
uint64_t tl_record_queue_digest(uint64_t number, const tl_record_queue_mark *mark, const unsigned char *bytes);

/* ---- Record queue, reader's side. The producer may be hostile.
 *
 * Purpose: returns copies of the entries, each validated: kinds, sizes, positions, enumerations,
 *          texts, digests. Other numbers may have any value. Control characters become '?'.
 * Damage:  a queue has two parts, the ring and the events. At the first invalid value the reader
 *          stops reading that part; `fault` describes the value. A newly opened reader can continue
 *          if a successor of the producer has repaired the part, or if it skips the damaged bytes.
 * Repeat:  a newly opened reader continues at tl_record_queue_taken, which the reader's owner
 *          stores. Entries after that position are read again.
 * Death:   an event that the producer left incomplete blocks the later ones until a successor has
 *          repaired the queue.
 * Trust:   the whole memory is untrusted.
 * Thread:  one.
 */

/* Fields are private except `fault`; the caller provides the memory. */
typedef struct tl_record_queue_reader {
    tl_record_queue_settings settings;
    const struct tl_record_queue_control *control;
    const unsigned char *ring;
    bool is_left; /* tl_record_queue_reader_finish() was called */
    bool is_ring_broken;
    bool are_events_broken;
    char fault[TL_ERROR_TEXT]; /* "": none */
} tl_record_queue_reader;

/* Opens a reader. `settings`: those of the producer. `memory` must outlive the reader. */
void tl_record_queue_reader_open(const tl_record_queue_settings *settings, const void *memory,
                                 tl_record_queue_reader *reader);

/* Call it when the producer has ended and has no successor. From now on the reader also returns a
 * sample that waits for its step. */
void tl_record_queue_reader_finish(tl_record_queue_reader *reader);

/* Returns the position after the newest entry that can be read now. `taken`: position up to which
 * the caller has taken entries; it is returned if nothing can be read or the ring is invalid. */
uint64_t tl_record_queue_reader_end(tl_record_queue_reader *reader, uint64_t taken);

/* Reads the entry at `*position`, which is before `end`, and advances the position. Returns false
 * and sets `fault` if the entry is invalid. */
bool tl_record_queue_reader_entry(tl_record_queue_reader *reader, uint64_t *position, uint64_t end,
                                  tl_recorder_entry *entry);

/* For a newly opened reader: returns the position at which to continue. If all entries are valid,
 * or the end itself is invalid, this is `taken`. If an entry is invalid, this is the end, because a
 * live producer continues there. Then the reader must be opened again. */
uint64_t tl_record_queue_reader_skip(tl_record_queue_reader *reader, uint64_t taken);

/* Reads event `number`, counted from 0. Returns false if it is not there yet, or if it is invalid.
 * If it returns true with *skip, the producer left the event incomplete, and `event` is not set. */
bool tl_record_queue_reader_event(tl_record_queue_reader *reader, uint64_t number, tl_recorder_event_entry *event,
                                  bool *skip);

/* Copies a valid checkpoint to `bytes` (settings.checkpoint_bytes long), and sets its size, tick
 * and number. Its number must be above `taken`, and all entries before it, including its run's
 * beginning, must end at or before `position`. If both qualify, copies the older one (a run may
 * begin with it): repeat the call. Returns false if there is none now; `bytes` is undefined. */
bool tl_record_queue_reader_checkpoint(tl_record_queue_reader *reader, uint64_t taken, uint64_t position,
                                       unsigned char *bytes, size_t *size, int64_t *tick, uint64_t *number);

/* Returns the producer's count of lost entries. */
uint64_t tl_record_queue_reader_lost(const tl_record_queue_reader *reader);

/* ---- Entries that remain in a record queue after the recorder has ended.
 *
 * Purpose: counts what is lost at the end of a run. The supervisor uses it.
 * Trust:   the queue and `taken` are untrusted.
 * Thread:  one at a time.
 */

/* Counts the samples, steps and events that were not taken, up to the first invalid value. */
uint64_t tl_record_queue_count_remaining(const tl_record_queue_settings *settings, const void *memory,
                                         const tl_record_queue_taken *taken);

#endif
