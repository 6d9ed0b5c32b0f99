/* Heartbeats: that a thread is alive, seen from another process; with them, what else the supervisor knows of a process.
 *
 * Purpose: the threads of a process beat, the supervisor (supervisor.h) looks. Beside the beats: whether the process is ready, a
 *          line about how it is, the FMU call that is under way (fmu_call.h), and, before it ends, why it will.
 * Clock:   beats are counted, not timed. How long a thread has been silent is added up by the one who looks, and of the
 *          time between two looks at most TL_HEARTBEAT_LOOK counts: a clock that is set, a box that was suspended and a
 *          supervisor that slept make nobody look dead.
 * Memory:  of the caller, zeroed at first: a block (block.h) that the beating process writes, so that both see it; TL_HEARTBEATS places.
 * Thread:  a heart belongs to one thread, which begins it before any other thread looks for it; the one who looks is in another
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
    TL_HEARTBEAT_NAME = 40,
    TL_HEARTBEAT_STATUS = 512
};

/* Of the time between two looks, what counts at most. */
#define TL_HEARTBEAT_LOOK (TL_SECOND / 5)

/* For how long a process may have no heart that is watched, once it had one: the main thread's never ends. */
#define TL_HEARTBEAT_NONE (2 * TL_SECOND)

/* One thread's heart. Fields are private. */
typedef struct tl_thread_heartbeat {
    uint64_t beats;
    tl_time patience; /* silence that is taken for life; 0: nobody looks */
    char name[TL_HEARTBEAT_NAME];
} tl_thread_heartbeat;

/* All that a process shows of its life. It is zeroed before another process begins. Fields are private, but for `calls`. */
typedef struct tl_heartbeats {
    tl_thread_heartbeat hearts[TL_HEARTBEATS];
    size_t count;
    bool ready;
    uint32_t farewell;  /* exit code · 256 + why */
    tl_fmu_calls calls; /* for tl_fmu_calls_use() */
    tl_latest status;
} tl_heartbeats;

/* Why a process ends. An FMU can end the process too, with any exit code, so an end is what it was announced to be. */
typedef enum tl_end_cause {
    TL_END_CAUSE_NONE,    /* nothing was announced */
    TL_END_CAUSE_ASKED,   /* a signal asked for it */
    TL_END_CAUSE_OVER,    /* the duration is over */
    TL_END_CAUSE_REFUSED, /* it could not begin: a configuration, an FMU, a source */
    TL_END_CAUSE_FAILED   /* it was ready, and could not go on */
} tl_end_cause;

/* ---- in the process that beats; tl_heart_… take NULL, and do nothing then: nobody listens ---- */

/* A heart of that name ("cycle", "plant.gateway"; cut to what fits), watched from now on with `patience` (ns, > 0). NULL where there
 * is no place left. */
tl_thread_heartbeat *tl_thread_heartbeat_start(tl_heartbeats *beats, const char *name, tl_time patience);
void tl_thread_heartbeat_beat(tl_thread_heartbeat *heartbeat);
void tl_thread_heartbeat_set_timeout(tl_thread_heartbeat *heartbeat, tl_time patience); /* from now on; beats */
void tl_thread_heartbeat_stop(tl_thread_heartbeat *heartbeat); /* the thread ends, as it should */

/* The process does what it is there for. */
void tl_heartbeats_set_ready(tl_heartbeats *beats);

/* A line for who asks how it is; by one thread. */
void tl_heartbeats_set_status(tl_heartbeats *beats, const char *text);

/* Its work is done, all that was to be kept is kept, and it will end with this exit code, 0 … 255. Once. */
void tl_heartbeats_announce(tl_heartbeats *beats, tl_end_cause why, int code);

/* ---- in the supervisor ---- */

/* What was seen so far; zeroed at first, and when the process begins anew. Private. */
typedef struct tl_heartbeats_seen {
    uint64_t beats[TL_HEARTBEATS];
    tl_time silence[TL_HEARTBEATS];
    bool had;         /* a heart that is watched, */
    tl_time no_heart; /* and for how long it was seen to have none */
    tl_time looked;   /* 0: never */
    uint32_t call;    /* FMU call, */
    tl_time lasted;   /* and how long it was seen to be under way */
} tl_heartbeats_seen;

/* Looks. NULL: everybody is alive. Else the name of one that has been silent for longer than its patience, and in `silence` for how long. A process that
 * had a heart and has none for longer than TL_HEARTBEAT_NONE, as one whose memory was written over, is "every thread". */
const char *tl_heartbeats_look(const tl_heartbeats *beats, tl_heartbeats_seen *seen, tl_time now, tl_time *silence);

/* The FMU call that is under way, where it has lasted for at least so long when tl_heartbeats_look() looked last; 0: any. False where there is none. */
bool tl_heartbeats_get_call(const tl_heartbeats *beats, const tl_heartbeats_seen *seen, tl_time least,
                            tl_fmu_call *call);

/* What was announced, and the exit code. */
tl_end_cause tl_heartbeats_get_end_cause(const tl_heartbeats *beats, int *code);

bool tl_heartbeats_is_ready(const tl_heartbeats *beats);

/* False where nothing new could be read without waiting. */
bool tl_heartbeats_get_status(const tl_heartbeats *beats, char text[TL_HEARTBEAT_STATUS]);

#endif
