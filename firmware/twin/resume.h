/* Resume: finds an earlier run, validates it, and starts a new twin from where that run ended.
 *
 * Memory:  a resume point refers to its image or to the memory of the function that returned it;
 *          each section says which.
 * Thread:  one, unless a section says otherwise.
 */
#ifndef TL_FIRMWARE_TWIN_RESUME_H
#define TL_FIRMWARE_TWIN_RESUME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/config/config.h"
#include "firmware/report/summary.h"
#include "firmware/store/history.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Rule: when a run is resumed, for all sources.
 *
 * Rule:    only the newest run with a step of its own can be resumed: a step after the ticks that
 *          it had followed. It must have been interrupted: by a signal, a crash or a power failure.
 *          Its last tick must be at most `record.resume_s` ago, and its duration must not be over.
 * Result:  a function returns false if the rule forbids resuming; `why` is then the event's text.
 * Thread:  any: the functions are pure.
 */

enum {
    TL_RESUME_WHY = 160,
    TL_RESUME_FRUITLESS = 3 /* after so many runs in a row without a step of their own, no run is resumed */
};

/* Formats the reason into `why`. Always returns false. */
bool tl_resume_refuse(char why[TL_RESUME_WHY], const char *format, ...) TL_PRINTF(2, 3);

/* `run`: number of the run, for `why`; negative: it has none. `reason`: its recorded end reason;
 * NULL: none. Returns false if the run was complete or failed: a resumed run would end likewise. */
bool tl_resume_was_interrupted(int64_t run, const char *reason, char why[TL_RESUME_WHY]);

/* `gap`: ns since the last tick `last` of the run. `lead`: step i is computed at tick i + lead.
 * Returns false if the gap is too long or negative, or if the configured duration is over. */
bool tl_resume_is_in_time(int64_t run, const tl_config *config, int64_t last, tl_time gap, uint32_t lead,
                          char why[TL_RESUME_WHY]);

/* Number of ticks that can be followed within 0.5 s, 1 … TL_RESUME_TICKS. `execution`: ns of one
 * step of one component; 0: unknown, then TL_RESUME_TICKS. `components`: their number. */
int64_t tl_resume_most_followed(tl_time execution, size_t components);

/* ---- Packed ticks: the plant's samples and the committed u that a new twin follows.
 *
 * Purpose: compact form in an image. A packed tick of two signals needs 1/30 of a tl_resume_tick.
 * Format:  one byte with `has_u` and `resets`; the signals (recorder_entry.h) with stamps relative
 *          to t_start; u. Only the same program on the same machine can read it. No alignment.
 * Trust:   tl_resume_read() validates packed bytes; tl_resume_tick_at() trusts them.
 * Owner:   a list owns its memory until tl_resume_ticks_free().
 */

/* Bound of a time in ns, so that the sum of two cannot overflow. */
#define TL_RESUME_FAR (INT64_MAX / 4)

typedef struct tl_resume_tick {
    tl_sample sample;        /* signals that the shape does not contain have quality TL_NO_LINK */
    bool has_u;              /* a step with u was computed; false for the first ticks of a run */
    bool resets;             /* the FMUs were reset before its step (TL_FLAG_RESET) */
    double u[TL_MAX_ADJUST]; /* zeros if there is none */
} tl_resume_tick;

/* Bytes of one packed tick. */
size_t tl_resume_tick_bytes(const tl_recorder_shape *shape);

/* ---- list of packed ticks, to write an image ---- */

/* The caller sets `shape` and zeroes the other fields: an empty list. */
typedef struct tl_resume_ticks {
    tl_recorder_shape shape;
    int64_t first; /* tick of the first entry */
    size_t count;
    size_t capacity;
    unsigned char *bytes; /* count · tl_resume_tick_bytes() are used */
} tl_resume_ticks;

/* Empties the list and keeps its memory. The next tick to be added is `first`. */
void tl_resume_ticks_begin(tl_resume_ticks *ticks, int64_t first);
void tl_resume_ticks_free(tl_resume_ticks *ticks);

/* Adds the next tick, without u. Stamps must be relative to t_start. Returns false if memory is
 * out. */
bool tl_resume_ticks_add(tl_resume_ticks *ticks, const tl_sample *sample);

/* Empties the list and reads the recorded ticks of a run: from tick `from` up to a gap, at most
 * `most` ticks. Adds u if the run has as many adjusted variables as the shape. Errors: those of
 * history.h; TL_TRY_AGAIN if memory is out. */
tl_status tl_resume_ticks_read(tl_resume_ticks *ticks, tl_history *history, const tl_history_run *run, int64_t from,
                               int64_t most, tl_error *error);

/* Sets `u`, `resets` and `has_u` = true of a tick. Ignores a tick that is not in the list. */
void tl_resume_ticks_set_step(tl_resume_ticks *ticks, int64_t tick, const double *u, bool resets);

/* Returns the last tick that can be followed from `first` on. `first` is in the list, or is the
 * next tick. The first few ticks need no u; after the first tick with u, each must have it. Returns
 * first − 1 if no tick can be followed. */
int64_t tl_resume_ticks_last(const tl_resume_ticks *ticks, int64_t first);

/* ---- Resume point: all data from which a new twin resumes, as plain data in one block of memory.
 *
 * Purpose: the new twin starts from a checkpoint, or from the FMUs' start values, and follows the
 *          samples and the u of the earlier run. The data come from a database or from the record
 *          queue of a dead process. A process other than the twin's may find them.
 * Image:   a resume point as bytes without pointers, at most TL_RESUME_MOST: head, checkpoint,
 *          tunings, packed ticks. Valid only for the same program and machine.
 * Samples: an image for a shadow has only samples of the present run, no u; `from` is
 *          TL_RESUMED_NOT.
 * Trust:   an image is untrusted; tl_resume_read() validates all of it. The image must not change
 *          afterwards. If another process can write to its memory, the reader must wait until that
 *          process reports the image as complete, and then read a copy.
 * Owner:   a resume point refers to its image, or to the memory that its source names.
 * Thread:  any: plain data.
 */

enum {
    TL_RESUME_TICKS = 5000, /* maximum number of ticks to follow; the recorder needs about 0.1 ms for each */
    TL_RESUME_TUNINGS = 16, /* maximum number of tunings: that of the first tick, and the newest later ones */
    TL_RESUME_TEXT = 224    /* bytes of a message with its NUL; longer ones are truncated */
};

/* Largest size of an image, bytes. */
#define TL_RESUME_MOST ((size_t)64 * 1024 * 1024)

/* Run number for an earlier run in the same record queue, because runs have no numbers there. */
#define TL_RESUME_UNNUMBERED ((int64_t)-1)

typedef struct tl_resume {
    /* plain fields: an image contains their bytes as they are in memory */
    int64_t run;         /* number of the run to resume, or TL_RESUME_UNNUMBERED */
    int64_t first, last; /* ticks to follow; none if last is first − 1 */
    tl_time step;        /* T_S, ns */
    double start_s;      /* the FMUs' time at tick 0, s */
    tl_time start;       /* t_start of the run on CLOCK_MONOTONIC */
    int64_t started;     /* t_start in UTC, ms */
    size_t checkpoint_size, tuning_count;
    tl_recorder_shape shape;
    tl_resumed_from from;         /* start of the twin: checkpoint or start values; TL_RESUMED_NOT: samples only */
    char signals[TL_SHA256_TEXT]; /* identity of the plant's signals: tl_resume_identify() */
    /* derived by tl_resume_read(), or stored after the head of the image */
    tl_time gap;                     /* ns from tick `last` until the resume point was read, ≥ 0 */
    tl_time age;                     /* ns from the checkpoint to tick `last`; 0: no checkpoint */
    int64_t checkpoint_tick;         /* first − 1 */
    const unsigned char *checkpoint; /* NULL: none */
    const unsigned char
        *tunings; /* array of tl_run_tuning, unaligned; each applies from its tick on, the first one also if earlier */
    const unsigned char *ticks; /* packed ticks first … last */
} tl_resume;

/* Bytes of the plain fields. */
enum { TL_RESUME_PLAIN = offsetof(tl_resume, signals) + TL_SHA256_TEXT };

/* Receives messages to be recorded as events of the source "resume"; `text` is valid during the
 * call. tl_resume_report() formats a message and passes it to `report`. */
typedef void tl_resume_listener(void *context, tl_severity severity, const char *text);
void tl_resume_report(tl_resume_listener *report, void *context, tl_severity severity, const char *format, ...)
    TL_PRINTF(4, 5);

/* Writes the hash of the names of the plant's signals, of a configuration or of a recording. */
void tl_resume_identify(const tl_config *config, char digest[TL_SHA256_TEXT]);
void tl_resume_identify_recorded(const tl_recorder_signal *signals, size_t count, char digest[TL_SHA256_TEXT]);

/* Bytes of an image. `ticks`, `tunings`: their numbers. `checkpoint`: bytes of the checkpoint. */
size_t tl_resume_image_bytes(const tl_recorder_shape *shape, size_t ticks, size_t checkpoint, size_t tunings);

/* Size of the image of this resume point, bytes. */
size_t tl_resume_size(const tl_resume *resume);

/* Moves those tunings to the front of the array that apply at a tick of `first` … `last`. The array
 * must be in order of ticks. Returns the number of tunings at the front. */
size_t tl_resume_choose_tunings(tl_run_tuning *tunings, size_t count, int64_t first, int64_t last);

/* Writes the image, of tl_resume_size() bytes. It does not contain gap and age. */
void tl_resume_write(const tl_resume *resume, void *image);

/* Validates an image and fills `resume`, which points into the image. `now`: CLOCK_MONOTONIC.
 * `config`: after tl_config_use_lookups().
 * Errors: TL_BAD_DATA: the image is invalid, has only samples, or its run ended too long ago. */
tl_status tl_resume_read(const void *image, size_t size, const tl_config *config, tl_time now, tl_resume *resume,
                         tl_error *error);

/* As tl_resume_read(), for an image of samples. `start`: t_start of the present run. Errors:
 * TL_BAD_DATA: the image is invalid, is not one of samples, or has another t_start. */
tl_status tl_resume_read_samples(const void *image, size_t size, const tl_config *config, tl_time start,
                                 tl_resume *resume, tl_error *error);

/* Unpacks a tick; its stamps and instant are on CLOCK_MONOTONIC. Returns false if `tick` is not in
 * first … last. */
bool tl_resume_tick_at(const tl_resume *resume, int64_t tick, tl_resume_tick *out);

/* ---- Following: brings a new twin to the point at which an earlier run ended.
 *
 * Purpose: the twin loads the checkpoint, or starts with the FMUs' start values. It then executes
 *          the ticks of the resume point without a search. It resets the FMUs at the same steps as
 *          in that run. The time without a running twin counts as missed ticks, which the cycle
 *          catches up.
 * Record:  the followed ticks and the checkpoint are recorded again, as part of the new run. So the
 *          new run needs nothing of the earlier one, neither for its replay nor for a later resume.
 * Waiting: the cycle has not started, so no tick is due. If the record queue is full, the twin
 *          waits for room until 2 s after the call; after that, entries without room are lost.
 * Thread:  the FMU thread, before the cycle starts.
 */

typedef enum tl_resume_outcome {
    TL_RESUME_FOLLOWED, /* the twin has reached the end of the run */
    TL_RESUME_REFUSED,  /* the checkpoint cannot be loaded; the twin was rebuilt, nothing recorded: try an older one */
    TL_RESUME_FAILED    /* a tick failed; the twin was rebuilt. End the run that was begun, and begin another one */
} tl_resume_outcome;

typedef struct tl_resume_follow_settings {
    tl_assembly *assembly;  /* its twin must not have begun; it is built again after a failure */
    tl_record_queue *queue; /* receives the new run */
    tl_resume_listener *report;
    void *context; /* of `report` */
} tl_resume_follow_settings;

/* Runs the twin to the end of the resume point and fills the summary; its `resumption` describes
 * the resume. If the resume point is refused or following fails, the summary is zeros.
 * Errors: TL_FMU_FATAL, or the error of building the twin again. */
tl_status tl_resume_follow(const tl_resume_follow_settings *settings, const tl_resume *resume, tl_summary *summary,
                           tl_resume_outcome *outcome, tl_error *error);

/* ---- Resume points from a record queue that a dead process has left.
 *
 * Purpose: the record queue of a twin survives its process (record_queue.h). The next process
 *          resumes from the newest checkpoint in the queue and the entries since, else from the
 *          older checkpoint, else from the entries alone. This needs no file and loses no computed
 *          tick.
 * When:    by the rule above. A run without a step of its own is skipped if the queue still
 *          contains the run before it; two such runs end the search. t_start is kept, because the
 *          system has not rebooted. The caller ensures that both processes have the same
 *          configuration and FMUs.
 * Trust:   the content is untrusted, because a dying process may have written anything. It is
 *          validated like any image.
 * Owner:   a resume point is a copy, so the record queue may be written while the twin follows it.
 *          Call tl_resume_queue_next() only before anything is enqueued.
 * Thread:  the writer of the record queue.
 */

typedef struct tl_resume_queue tl_resume_queue;

/* Queue and assembly must outlive the object. Returns NULL if the queue contains no run with a
 * twin, if `record.resume_s` is 0, or if memory is out. */
tl_resume_queue *tl_resume_queue_open(const tl_record_queue *queue, const tl_assembly *assembly,
                                      tl_resume_listener *report, void *context);

/* NULL is allowed. */
void tl_resume_queue_close(tl_resume_queue *left);

/* Fills `resume` with the newest resume point, at later calls with older ones; valid until the next
 * call. Returns false if no further one exists; the reason was reported. NULL is allowed. */
bool tl_resume_queue_next(tl_resume_queue *left, tl_resume *resume);

/* ---- Resume points from the database.
 *
 * Purpose: finds the newest run with a step of its own. It is resumed if the rule permits this and
 *          if configuration and FMUs are unchanged; older runs are not. Up to 8 checkpoints are
 *          tried, the newest first, then its inputs alone. After a reboot the gap is computed from
 *          UTC. If the run cannot be resumed, a message gives the reason.
 * Twin:    not needed: the settings contain its facts, so a process without FMUs can search.
 * Trust:   the database is untrusted (history.h).
 * Owner:   settings are copied; the objects that they point to are not.
 */

typedef struct tl_resume_history tl_resume_history;

typedef struct tl_resume_history_settings {
    const tl_config *config; /* with further look-ups as signals */
    const char *path;        /* of the database */
    const char *fmus;        /* identity of the FMUs (tl_twin_recorder_identify()) */
    const char *boot;        /* identity of the boot (tl_identity_boot()) */
    size_t components;       /* of the twin, the plant included */
    tl_resume_listener *report;
    void *context; /* of `report` */
} tl_resume_history_settings;

/* Opens the database. Returns NULL if `record.resume_s` is 0, the database cannot be read, or
 * memory is out. The last two cases are reported, and the twin can start a new run. */
tl_resume_history *tl_resume_history_open(const tl_resume_history_settings *settings);

/* NULL is allowed. */
void tl_resume_history_close(tl_resume_history *history);

/* Returns the newest resume point, at the next calls older ones; valid until the next call. Its
 * `gap`, `age` and `checkpoint_tick` are 0. Returns NULL if no further one exists; if the user
 * should know the reason, it was reported. NULL is allowed. */
const tl_resume *tl_resume_history_next(tl_resume_history *history);

/* Instant of the last tick of a run that is not resumed because it had ended, or because its
 * configuration or FMUs differ; CLOCK_MONOTONIC. 0: unknown, or another reason. NULL is allowed. */
tl_time tl_resume_history_ended(const tl_resume_history *history);

/* ---- Recorded samples of the present run, for a shadow. The shadow computes these ticks first, so
 * that its comparison with the live twin has a longer basis.
 *
 * Run:     the newest one, if it belongs to this boot and is still being recorded. If it begins
 *          after the wanted tick, the run that it continues is read instead (same t_start).
 */

/* ns before the newest sample at which an image begins if the caller names no tick: 60 s. */
#define TL_RESUME_SAMPLES_BEFORE (60 * TL_SECOND)

/* Writes an image of samples to `image`, which has `room` bytes: from tick `from` up to a gap, at
 * most TL_RESUME_TICKS. `from` < 0: from 60 s before the newest sample on. `path`: of the database.
 * `boot`: tl_identity_boot(). *size: bytes; 0: no samples. Errors: those of history.h. */
tl_status tl_resume_samples_find(const char *path, const char *boot, int64_t from, void *image, size_t room,
                                 size_t *size, tl_error *error);

#endif
