/* Heartbeats: show the supervisor that the threads of another process are alive. They are in that
 * process's status block (shared memory), with other data for the supervisor.
 *
 * Purpose: the threads of a process count their heartbeats, and the supervisor (supervisor.h) polls
 *          the counters. The block also contains a ready flag, a status line, the current FMU call
 *          (fmu_call.h), and, before the process ends, the end cause.
 * Clock:   heartbeats are counted, without a time stamp. The supervisor adds up how long a count
 *          has not changed, at most TL_HEARTBEAT_POLL per poll. So a change of the clock, a
 *          suspended machine or a late supervisor causes no false alarm.
 * Memory:  the caller provides a zeroed block (block.h) that the monitored process writes. It has
 *          room for TL_HEARTBEATS threads.
 * Thread:  a heartbeat belongs to the thread that started it. The supervisor polls from another
 *          process. Wait-free.
 */
#ifndef TL_FIRMWARE_PROCESS_HEARTBEAT_H
#define TL_FIRMWARE_PROCESS_HEARTBEAT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/os.h"
#include "firmware/process/fmu_call.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"

enum {
    TL_HEARTBEATS = TL_MAX_SIGNALS + 8, /* one per plant source, and those of the process itself */
    TL_HEARTBEAT_NAME = 40,             /* bytes of a name with its terminating 0 */
    TL_HEARTBEAT_STATUS = 512           /* bytes of the status line with its terminating 0 */
};

/* Longest silence that one poll can add, ns. If more time has passed since the last poll, only this
 * much is added. */
#define TL_HEARTBEAT_POLL (TL_SECOND / 5)

/* Longest allowed time without any started heartbeat, ns, if the process had one before. The main
 * thread never stops its heartbeat, so a process without heartbeats is faulty. */
#define TL_HEARTBEAT_NONE (2 * TL_SECOND)

/* Heartbeat of one thread. Fields are private. */
typedef struct tl_thread_heartbeat {
    uint64_t beats;
    tl_time patience; /* longest allowed silence, ns; 0: not monitored */
    char name[TL_HEARTBEAT_NAME];
} tl_thread_heartbeat;

/* Status block of a process. It is zeroed before each start of the process. Fields are private,
 * except `calls`. */
typedef struct tl_heartbeats {
    tl_thread_heartbeat hearts[TL_HEARTBEATS];
    size_t count;
    bool ready;
    uint32_t announced_cause; /* exit code · 256 + end cause */
    tl_fmu_calls calls;       /* for tl_fmu_calls_use() */
    tl_latest status;
} tl_heartbeats;

/* Why a process ends. An FMU can end the process too, with any exit code, so only an announced
 * cause is trusted. */
typedef enum tl_end_cause {
    TL_END_CAUSE_NONE,      /* nothing was announced */
    TL_END_CAUSE_REQUESTED, /* a signal requested it */
    TL_END_CAUSE_OVER,      /* the duration of the run has elapsed */
    TL_END_CAUSE_REFUSED,   /* it could not start: an error in a configuration, an FMU or a source */
    TL_END_CAUSE_FAILED     /* it was ready and then failed */
} tl_end_cause;

/* ---- in the monitored process; the functions of one heartbeat do nothing if it is NULL ---- */

/* Starts a heartbeat with this name ("cycle", "plant.gateway"; truncated) and a timeout of
 * `patience` (ns, > 0). Returns NULL if `beats` is NULL, or after TL_HEARTBEATS starts. */
tl_thread_heartbeat *tl_thread_heartbeat_start(tl_heartbeats *beats, const char *name, tl_time patience);
void tl_thread_heartbeat_beat(tl_thread_heartbeat *heartbeat);
void tl_thread_heartbeat_set_timeout(tl_thread_heartbeat *heartbeat, tl_time patience); /* from now on; also beats */
void tl_thread_heartbeat_stop(tl_thread_heartbeat *heartbeat);                          /* the thread ends as planned */

/* Marks the process as ready. */
void tl_heartbeats_set_ready(tl_heartbeats *beats);

/* Sets the status line, truncated to TL_HEARTBEAT_STATUS - 1 bytes; one thread only. */
void tl_heartbeats_set_status(tl_heartbeats *beats, const char *text);

/* Announces the end of the process, with its cause and its exit code, 0 … 255. Call it once, after
 * all data is saved. */
void tl_heartbeats_announce(tl_heartbeats *beats, tl_end_cause why, int code);

/* ---- in the supervisor ---- */

/* State of the supervisor's polls. The supervisor zeroes it at first and when the process
 * restarts. Fields are private. */
typedef struct tl_heartbeats_seen {
    uint64_t beats[TL_HEARTBEATS];
    tl_time silence[TL_HEARTBEATS]; /* ns */
    bool had;                       /* the process has had a started heartbeat */
    tl_time no_heart;               /* how long there has been no started one, ns, counted only if `had`; else 0 */
    tl_time polled_at;              /* instant of the last poll, ns; 0: none */
    uint32_t call;                  /* number of the FMU call at the last poll */
    tl_time lasted;                 /* duration of that call so far, ns */
} tl_heartbeats_seen;

/* Polls all heartbeats at the instant `now` (ns). Returns NULL if all threads are alive. Else
 * returns the name of a thread that exceeds its timeout, and sets *silence to the time since its
 * last heartbeat, ns. Returns "every thread" if a process that had heartbeats has none for longer
 * than TL_HEARTBEAT_NONE, for example because its memory was overwritten. The name may lie in the
 * block, so it is untrusted: use at most TL_HEARTBEAT_NAME bytes. */
const char *tl_heartbeats_read(const tl_heartbeats *beats, tl_heartbeats_seen *seen, tl_time now, tl_time *silence);

/* Reads the current FMU call if its duration was at least `least` ns at the last
 * tl_heartbeats_read(). `least` 0: any call. Returns false if there is no such call. */
bool tl_heartbeats_get_call(const tl_heartbeats *beats, const tl_heartbeats_seen *seen, tl_time least,
                            tl_fmu_call *call);

/* Returns the announced end cause and sets *code to the announced exit code. Both are 0 if nothing
 * was announced. */
tl_end_cause tl_heartbeats_get_end_cause(const tl_heartbeats *beats, int *code);

/* Returns true after tl_heartbeats_set_ready(). */
bool tl_heartbeats_is_ready(const tl_heartbeats *beats);

/* Reads the status line ("": not set). Returns false if the process changes it at the same time. */
bool tl_heartbeats_get_status(const tl_heartbeats *beats, char text[TL_HEARTBEAT_STATUS]);

#endif
