/* The beginning of a resumed twin: found in an earlier run, checked, followed.
 *
 * Thread:  one.
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

/* ---- The rule by which a run is gone on with, wherever it was found.
 *
 * Rule:    the newest run that got anywhere, if it did not end by itself or with an error, if its last tick is at most `record.resume_s` ago,
 *          and if there is anything left to do of its duration.
 * Result:  false, and why, in words for an event.
 * Thread:  pure.
 */

enum {
    TL_RESUME_WHY = 160,
    TL_RESUME_FRUITLESS = 3 /* restarts in a row that got no further than the run they went on with, at most */
};

/* Says why, and is false. */
bool tl_resume_refuse(char why[TL_RESUME_WHY], const char *format, ...) TL_PRINTF(2, 3);

/* Of a run that ended with `reason`; NULL: it did not. A run that came to its end, or failed, is not gone on with: it would come to the same
 * end. */
bool tl_resume_was_interrupted(int64_t run, const char *reason, char why[TL_RESUME_WHY]);

/* Whether its last tick, `gap` ns ago, was not too long ago, and the run, as it is asked for now, has anything left to do. */
bool tl_resume_is_under_way(int64_t run, const tl_config *config, int64_t last, tl_time gap, uint32_t lead,
                            char why[TL_RESUME_WHY]);

/* Ticks that can be followed in the time for it, if one execution takes so many ns and there are so many components; 0 ns: it is not known. */
int64_t tl_resume_most_followed(tl_time execution, size_t components);

/* ---- Ticks to be followed, packed one after the other: what the plant showed, and the u that was committed.
 *
 * Purpose: in an image, and for the maker of one. A tick of two signals takes a thirtieth of what a tl_resume_tick takes.
 * Format:  whether the tick has u, and whether the FMUs began anew before its step (a byte), the signals (recorder_entry.h) with stamps
 *          relative to t_start, u; private to program and machine. It may lie anywhere.
 * Trust:   tl_resume_read() checks packed bytes; tl_resume_tick_at() trusts them.
 * Owner:   the memory of a row is its own until tl_resume_ticks_free().
 */

/* What a time in ns is nearer to 0 than: sums of two are in range. */
#define TL_RESUME_FAR (INT64_MAX / 4)

typedef struct tl_resume_tick {
    tl_sample sample;        /* signals that the shape does not have: no link */
    bool has_u;              /* false for the first ticks of a run */
    bool resets;             /* before its step the FMUs began anew (TL_FLAG_RESET) */
    double u[TL_MAX_ADJUST]; /* zeros if it has none */
} tl_resume_tick;

size_t tl_resume_tick_bytes(const tl_recorder_shape *shape);

/* ---- a row of them, for who makes one ---- */

/* A zeroed row with its shape is empty. */
typedef struct tl_resume_ticks {
    tl_recorder_shape shape;
    int64_t first;
    size_t count;
    size_t capacity;
    unsigned char *bytes; /* count · tl_resume_tick_bytes() of them are used */
} tl_resume_ticks;

/* Forgets what is in it. The next one to be added is `first`. */
void tl_resume_ticks_begin(tl_resume_ticks *ticks, int64_t first);
void tl_resume_ticks_free(tl_resume_ticks *ticks);

/* The next tick, without u. False: memory is out. Stamps count from t_start. */
bool tl_resume_ticks_add(tl_resume_ticks *ticks, const tl_sample *sample);

/* Begins anew: the recorded ticks of a run from `from` on, up to a hole, at most `most` of them; u if the run has as many as the shape. Errors:
 * those of history.h. */
tl_status tl_resume_ticks_read(tl_resume_ticks *ticks, tl_history *history, const tl_history_run *run, int64_t from,
                               int64_t most, tl_error *error);

/* The u of a tick that was added, and whether the FMUs began anew before its step; of other ticks it is ignored. */
void tl_resume_ticks_set_step(tl_resume_ticks *ticks, int64_t tick, const double *u, bool resets);

/* The last one that can be followed from `first` on, which is one of them, or the next: the first few need no u, but from the first that has it each must.
 * first − 1: none can. */
int64_t tl_resume_ticks_last(const tl_resume_ticks *ticks, int64_t first);

/* ---- A past: what a new twin goes on from, as plain data in one piece of memory, whoever found it.
 *
 * Purpose: a run that was ended by a kill, a crash, a restart or a reboot is gone on with: from a checkpoint, or from the FMUs' start values,
 *          the new twin is led along the samples and the u of that run. Who looks for them, in a database
 *          or in what a dead process has left, may be another process than the twin's.
 * Image:   a past as bytes without pointers, at most TL_RESUME_MOST of them: a head, the checkpoint, the tunings, the packed ticks. It is for the same program
 *          and machine only.
 * Samples: the image of a run that is under way, for a twin that begins beside it: ticks without u, with which nothing else comes (from = TL_RESUMED_NOT).
 * Trust:   tl_resume_read() believes nothing of an image, and checks all of it. What is checked may not change any more: an image that
 *          others can write is copied first, and they say when it is whole.
 * Owner:   a past points into its image, or to what its maker says.
 * Thread:  plain data.
 */

enum {
    TL_RESUME_TICKS = 5000, /* to be followed at most; what records them takes some 0.1 ms each */
    TL_RESUME_TUNINGS = 16, /* what was in force first, and the newest of what was taken since */
    TL_RESUME_TEXT = 224    /* of what is told */
};

/* Bytes of an image at most. */
#define TL_RESUME_MOST ((size_t)64 * 1024 * 1024)

/* The run before in the same outbox, which has no number there. */
#define TL_RESUME_UNNUMBERED ((int64_t)-1)

typedef struct tl_resume {
    /* plain: in the image as it is here, without padding */
    int64_t run;         /* that is gone on with */
    int64_t first, last; /* ticks to be followed; none if last is first − 1 */
    tl_time step;        /* T_S, ns */
    tl_time start;       /* its t_start on CLOCK_MONOTONIC, */
    int64_t started;     /* and UTC, ms */
    size_t checkpoint_size, tuning_count;
    tl_recorder_shape shape;
    tl_resumed_from from;         /* TL_RESUMED_NOT: samples only */
    char signals[TL_SHA256_TEXT]; /* which the signals of the plant are: tl_resume_identify() */
    /* not in the image, or behind its head */
    tl_time gap;                     /* ns for which nobody ran, when the past was read */
    tl_time age;                     /* ns, of the checkpoint when the run ended */
    int64_t checkpoint_tick;         /* first − 1 */
    const unsigned char *checkpoint; /* NULL: none */
    const unsigned char *
        tunings; /* tl_run_tuning one behind the other, anywhere; in force at their ticks, or before the first of all */
    const unsigned char *ticks; /* packed */
} tl_resume;

/* Bytes of the plain fields. */
enum { TL_RESUME_PLAIN = offsetof(tl_resume, signals) + TL_SHA256_TEXT };

/* What is worth being said, as events of the source "resume". `text` lives during the call. */
typedef void tl_resume_tell(void *context, tl_severity severity, const char *text);
void tl_resume_say(tl_resume_tell *tell, void *context, tl_severity severity, const char *format, ...) TL_PRINTF(4, 5);

/* The signals of the plant, by name, as a configuration has them, and as they are recorded. */
void tl_resume_identify(const tl_config *config, char digest[TL_SHA256_TEXT]);
void tl_resume_identify_recorded(const tl_recorder_signal *signals, size_t count, char digest[TL_SHA256_TEXT]);

/* An image of so many ticks, a checkpoint of so many bytes, and so many tunings. */
size_t tl_resume_image_bytes(const tl_recorder_shape *shape, size_t ticks, size_t checkpoint, size_t tunings);

size_t tl_resume_size(const tl_resume *resume);

/* Of all that was taken in a run, in the order of their ticks, what matters from `first` to `last`: to the front. How many. */
size_t tl_resume_choose_tunings(tl_run_tuning *tunings, size_t count, int64_t first, int64_t last);

/* The image, as large as that. Gap and age are not in it. */
void tl_resume_write(const tl_resume *resume, void *image);

/* `now` is CLOCK_MONOTONIC. `config` is one whose second look-ups are signals (tl_config_use_lookups()).
 * Errors: TL_BAD_DATA: it is no image, or not one of such a run that was under way just now. */
tl_status tl_resume_read(const void *image, size_t size, const tl_config *config, tl_time now, tl_resume *resume,
                         tl_error *error);

/* An image of samples of the run with this t_start and configuration. Errors: as above. */
tl_status tl_resume_read_samples(const void *image, size_t size, const tl_config *config, tl_time start,
                                 tl_resume *resume, tl_error *error);

/* One of the ticks first … last, its stamps and instant on CLOCK_MONOTONIC; false: it is none of them. */
bool tl_resume_tick_at(const tl_resume *resume, int64_t tick, tl_resume_tick *out);

/* ---- Going on with a past: the new twin is brought to where an earlier run was ended.
 *
 * Purpose: the twin loads the checkpoint, or begins with the FMUs' start values, and is led along the ticks of the past without a
 *          search; before the steps before which the FMUs of that run began anew, its own do too. The time in which nobody ran is missed ticks
 *          then, for the cycle to make up.
 * Own:     what is followed is recorded again, as the new run's, and so is the checkpoint: it then needs nothing of the earlier
 *          run, for its replay, or when it is itself ended before it has got any further.
 * Waiting: nobody is late while a twin goes on, so room in the outbox is waited for, for two seconds in all; what finds none after that is lost.
 * Thread:  that of the FMUs, before the cycle starts.
 */

typedef enum tl_resume_outcome {
    TL_RESUME_FOLLOWED, /* the twin is there */
    TL_RESUME_REFUSED, /* its checkpoint is of no use. Nothing was recorded, and the twin is a new one again: try an older past */
    TL_RESUME_FAILED /* the same, but a run was begun, and has got steps of the attempt: end it, and begin another, anew */
} tl_resume_outcome;

typedef struct tl_resume_follow_settings {
    tl_assembly *assembly;  /* its twin has not begun, and may be built anew */
    tl_record_queue *queue; /* into which the new run goes */
    tl_resume_tell *tell;
    void *context; /* of tell */
} tl_resume_follow_settings;

/* Leads the twin, and fills the summary, in which `resumption` says what was done; of what does not go well it is zeros.
 * Errors: TL_FMU_FATAL, or what building the twin anew has met. */
tl_status tl_resume_follow(const tl_resume_follow_settings *settings, const tl_resume *resume, tl_summary *summary,
                           tl_resume_outcome *outcome, tl_error *error);

/* ---- Pasts out of an outbox: what a dead process has left for its successor.
 *
 * Purpose: the twin's outbox outlives it (record_queue.h). Its successor goes on from the newest checkpoint in it and the entries since, or from
 *          the older one; at last from the entries alone. That needs no file, and loses no tick that was computed.
 * When:    as the rule says. A run that was ended before it had got any further than that which it went on with is passed over, if
 *          what is left reaches back to the one before. It is the same boot, so t_start stands as it is. That configuration and FMUs are
 *          those of the predecessor is the affair of who starts both.
 * Trust:   none in what is left: whoever died may have written anything before. What comes of it is checked as any image.
 * Owner:   pasts are copies, so that the outbox may be written while one is followed. Looking for the next one must come before that.
 * Thread:  that of the outbox's writer.
 */

typedef struct tl_resume_queue tl_resume_queue;

/* Both must outlive it. NULL: no run is left in it, nobody wants one (`record.resume_s` is 0), or memory is out. */
tl_resume_queue *tl_resume_queue_open(const tl_record_queue *queue, const tl_assembly *assembly, tl_resume_tell *tell,
                                      void *context);

/* NULL is allowed. */
void tl_resume_queue_close(tl_resume_queue *left);

/* The newest past, then ever older ones, as long as nothing was put into the outbox; `resume` lives until the next call. False: there is none
 * (any more), and why was told. NULL is allowed. */
bool tl_resume_queue_next(tl_resume_queue *left, tl_resume *resume);

/* ---- Pasts out of a database: the box's memory.
 *
 * Purpose: finds the newest run that can be gone on with, if it had the same configuration and FMUs, and from where: its
 *          newest checkpoint first, then older ones, at last its inputs without any. After a reboot UTC says how long ago it was. If there is
 *          none, what is told says why the twin begins anew.
 * Twin:    none: what must be known of it is given, so that a process without FMUs can look.
 * Trust:   none in the database (history.h).
 * Owner:   settings are copied, what they point to is not.
 * Thread:  one at a time.
 */

typedef struct tl_resume_history tl_resume_history;

typedef struct tl_resume_history_settings {
    const tl_config *config; /* whose second look-ups are signals */
    const char *path;        /* of the database */
    const char *fmus;        /* which FMUs these are (tl_twin_recorder_identify()), */
    const char *boot;        /* and which boot (tl_identity_boot()) */
    size_t components;       /* of the twin, the plant included */
    tl_resume_tell *tell;
    void *context; /* of tell */
} tl_resume_history_settings;

/* Opens the database. NULL: it cannot be read, which was told and keeps no twin from running; or `record.resume_s` is 0. */
tl_resume_history *tl_resume_history_open(const tl_resume_history_settings *settings);

/* NULL is allowed. */
void tl_resume_history_close(tl_resume_history *history);

/* The newest past, then ever older ones; it lives until the next call. NULL: there is none (any more), and if that is worth saying it
 * was told. NULL is allowed. */
const tl_resume *tl_resume_history_next(tl_resume_history *history);

/* If the newest run is not gone on with (another configuration, for example): when its last tick was, on the clock of now. 0: not known. NULL is allowed. */
tl_time tl_resume_history_ended(const tl_resume_history *history);

/* ---- Recorded samples of the run that is under way, for a twin that begins beside it: a shadow has minutes behind it before it is compared.
 *
 * Run:     the newest one of this boot that is being written; of ticks before it begins, those of the run that it goes on with, which has the same t_start.
 */

/* From where the newest are given, if nobody says from which tick on. */
#define TL_RESUME_SAMPLES_BEFORE (60 * TL_SECOND)

/* Into `image`, which has `room` bytes: samples from tick `from` on, up to a hole, for tl_resume_read_samples(); below 0: from a minute before the newest on. `boot` is
 * tl_identity_boot(). *size is 0 if there are none. Errors: those of history.h. */
tl_status tl_resume_samples_find(const char *path, const char *boot, int64_t from, void *image, size_t room,
                                 size_t *size, tl_error *error);

#endif
