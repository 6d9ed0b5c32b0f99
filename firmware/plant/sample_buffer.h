/* Sample buffers: the newest readings of each signal, in memory that the plant reader writes and
 * the cycle reads.
 *
 * Thread: each section says which.
 */
#ifndef TL_FIRMWARE_PLANT_SAMPLE_BUFFER_H
#define TL_FIRMWARE_PLANT_SAMPLE_BUFFER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "master/base/signal.h"

/* ---- A sample buffer: the newest readings of one signal, from one writer to several readers,
 * wait-free.
 *
 * Purpose: plant I/O posts readings and the cycle looks them up; neither waits for the other. The
 *          newest `depth` readings are kept. So a twin that missed ticks or was restarted can still
 *          look up each sample at its own instant.
 * Memory:  the caller's, zeroed initially: of this process, or a block (block.h) that only the
 *          writer's process can write. It contains no pointers; each side has its own handle. A
 *          reader may map it read-only.
 * Death:   the memory may outlive its writer. The next writer repairs it and continues; readers are
 *          not affected.
 * Thread:  one writer at a time; any number of readers.
 * Trust:   the memory is untrusted for readers. Whatever it contains, and even if it changes during
 *          a look-up, the look-up terminates, reads only this memory, and returns a valid quality.
 *          Value and stamp may be arbitrary.
 * Bound:   post O(1); look-up O(log depth).
 */

/* Fields are private. */
typedef struct tl_sample_buffer_slot {
    uint64_t sequence; /* odd during a write */
    uint64_t value;    /* bits of the double */
    int64_t stamp;
    uint64_t quality;
} tl_sample_buffer_slot;

/* A handle of a sample buffer. */
typedef struct tl_sample_buffer {
    tl_sample_buffer_slot *slots; /* `depth` of them */
    uint64_t *count;              /* number of posted readings */
    uint32_t depth;               /* a power of two */
} tl_sample_buffer;

/* Writer: posts a reading; overwrites the oldest one if the buffer is full. Stamps should not
 * decrease. If a stamp is earlier than the one before, look-ups find the reading only while it is
 * among the newest few. Later, a look-up near its stamp may return a neighbour. */
void tl_sample_buffer_post(const tl_sample_buffer *buffer, const tl_reading *reading);

/* Reader: returns the number of readings that were posted. */
uint64_t tl_sample_buffer_posts(const tl_sample_buffer *buffer);

/* Writer: repairs the buffer after an earlier writer died; call it before the first post. Complete
 * posts are kept; an incomplete one is dropped. */
void tl_sample_buffer_repair(const tl_sample_buffer *buffer);

/* Reader, `from` ≤ `until`: finds the first reading with `from` ≤ stamp ≤ `until`; of equal stamps,
 * the last posted one. If there is none: the newest reading before `from`. If there is neither, but
 * readings were overwritten: the oldest kept one. Returns false, and changes nothing, if there is
 * none. */
bool tl_sample_buffer_from(const tl_sample_buffer *buffer, tl_time from, tl_time until, tl_reading *reading);

/* Reader, `at` ≤ `until`: sets *before to the newest reading with stamp ≤ `at`. Sets *after to the
 * next one if its stamp is ≤ `until`; else its stamp is TL_TIME_NEVER. Returns false if there is no
 * reading with stamp ≤ `at`, or if it is overwritten; both outputs are then unchanged. */
bool tl_sample_buffer_around(const tl_sample_buffer *buffer, tl_time at, tl_time until, tl_reading *before,
                             tl_reading *after);

/* Reader, for all readings in order: gets post number *next if it is still kept and has a stamp ≤
 * `until`; else the first such post among the next few. Sets *next to the number after that post;
 * the caller starts with 0. Returns false if there is none; *reading is then unchanged. */
bool tl_sample_buffer_next(const tl_sample_buffer *buffer, tl_time until, uint64_t *next, tl_reading *reading);

/* Reader: gets the newest reading with stamp ≤ instant. If all kept readings are later and older
 * ones were overwritten, gets the oldest kept one. Returns false if there is none; *reading is then
 * unchanged. */
bool tl_sample_buffer_at(const tl_sample_buffer *buffer, tl_time instant, tl_reading *reading);

/* ---- The sample memory: the sample buffers of all signals of a configuration in one block.
 *
 * Purpose:  plant I/O writes the block, the cycle reads it; between two processes it is shared
 *           memory (block.h). Its size and layout follow from the configuration alone, which both
 *           sides have. Nothing of the layout is read from the memory.
 * Memory:   the caller's, zeroed initially, aligned to 8 bytes (better to a page, as a block is).
 *           The counts of all buffers come first, each on its own cache line, then the slots of one
 *           signal after the other.
 * Look-ups: a further look-up of a signal (NAME@…) uses the buffer of that signal. So twins with
 *           different look-ups can read the same memory.
 * Thread:   plain data; for the sample buffers see above.
 */

enum { TL_SAMPLE_BUFFERS_LEAST = 256, TL_SAMPLE_BUFFERS_MOST = 65536 }; /* limits of the depth */

typedef struct tl_sample_buffers_shape {
    size_t signals;                 /* number of signals */
    uint32_t depth[TL_MAX_SIGNALS]; /* of each buffer, readings; powers of two */
    size_t of[TL_MAX_SIGNALS]; /* of each signal: index of the signal whose buffer is used, its own or an earlier one */
} tl_sample_buffers_shape;

/* Computes the depths for a live run, within the limits above. Each buffer has room for the
 * readings of hang_s + 10 s at the polling period of its source (period_s; CAN: 1 ms). The period
 * counts as at most one step and at least 1 ms. Call tl_config_use_lookups() before. */
void tl_sample_buffers_shape_of(const tl_config *config, tl_sample_buffers_shape *shape);

/* Returns the time for which live readings should be kept, ns: hang_s + 10 s. A buffer keeps them
 * for a shorter time if they are more than TL_SAMPLE_BUFFERS_MOST. */
tl_time tl_sample_buffers_kept(const tl_config *config);

/* Returns the size of the memory in bytes; never 0. */
size_t tl_sample_buffers_bytes(const tl_sample_buffers_shape *shape);

/* Opens handles on the memory, for either side. A reader may have mapped it read-only. */
void tl_sample_buffers_open(const tl_sample_buffers_shape *shape, void *memory,
                            tl_sample_buffer buffers[TL_MAX_SIGNALS]);

/* Allocates memory with the least depth in this process, and opens it. For recordings, whose
 * readings are looked up as they come. The caller frees it with free(). Returns NULL if memory is
 * out. */
void *tl_sample_buffers_make_least(size_t signals, tl_sample_buffer buffers[TL_MAX_SIGNALS]);

#endif
