/* Log relay of a run: one thread that logs the output of the other processes and draws the status
 * line.
 *
 * Purpose:  io, recorder, config manager and explainer print into pipes; this thread logs each
 *           line. So only the supervisor uses the terminal, and the status line never mixes with
 *           other lines. The thread also writes the lines of `run --follow`, and closes ended
 *           processes of twins (tl_twin_process_close()), because that may block.
 * Repeats:  a restarted process may print the same lines as its predecessor. From the third process
 *           on, each such line is logged once a minute, with a count of the repeats.
 * Priority: the thread has ordinary priority, even if the supervisor has real-time priority.
 * Thread:   all functions: the supervisor's. Only tl_log_relay_stop() waits for the thread.
 */
#ifndef TL_FIRMWARE_LIVE_LOG_RELAY_H
#define TL_FIRMWARE_LIVE_LOG_RELAY_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/relay.h"
#include "firmware/live/follow.h"
#include "firmware/process/heartbeat.h"
#include "firmware/twin/twin_process.h"

enum { TL_LOG_RELAY_PIPES = 4, TL_LOG_RELAY_LINES = 16, TL_LOG_RELAY_DEAD = 8 };

/* A line that was logged. */
typedef struct tl_logged_line {
    uint64_t hash;
    unsigned process; /* number of the process that printed the line last */
    unsigned repeats; /* how often later processes have printed the line without its being logged */
    bool is_loop;     /* a later process has repeated the line within a minute */
    tl_time time;
} tl_logged_line;

/* Output of the processes of one kind. Only one of them runs at a time. */
typedef struct tl_log_source {
    tl_relay relay;
    int pipe;         /* write end of the pipe, which these processes inherit; 0: none */
    unsigned process; /* number of the process whose lines are read now; counts the processes of this kind */
    tl_logged_line lines[TL_LOG_RELAY_LINES];
} tl_log_source;

/* Fields are private. Zeroed: not started. */
typedef struct tl_log_relay {
    const tl_heartbeats *beats; /* of the twin whose status is drawn */
    bool status;
    bool terminal;
    bool runs; /* the thread exists */
    pthread_t thread;
    int wake; /* eventfd */
    bool stop;
    tl_log_source sources[TL_LOG_RELAY_PIPES];
    tl_twin_process *dead[TL_LOG_RELAY_DEAD]; /* the thread closes them */
    tl_time drawn;
    tl_follow *follow; /* NULL: none */
} tl_log_relay;

/* Opens the pipes and starts the thread. `beats`: of the first twin. `status`: draws a status line
 * also if standard error is no terminal. `follow` (follow.h): the thread polls it, and then draws
 * no status line on a terminal; NULL: none.
 * Errors: TL_TRY_AGAIN; then tl_log_relay_stop() is still allowed. */
tl_status tl_log_relay_start(tl_log_relay *self, const tl_heartbeats *beats, bool status, tl_follow *follow,
                             tl_error *error);

/* Returns the write end of the pipe for a process that is about to start. `which`: its kind, below
 * TL_LOG_RELAY_PIPES (tl_live_kind). The previous process of this kind must have ended. The relay
 * closes the pipe. Empty lines are not logged. */
int tl_log_relay_pipe(const tl_log_relay *self, unsigned which);

/* Changes the twin whose status is drawn. */
void tl_log_relay_watch(tl_log_relay *self, const tl_heartbeats *beats);

/* Closes a twin process that has ended; call tl_twin_process_let_go() before. The thread closes it
 * later. Only if TL_LOG_RELAY_DEAD processes wait already, this call closes it and may block. */
void tl_log_relay_close_process(tl_log_relay *self, tl_twin_process *process);

/* Ends the thread, logs the remaining output, removes the status line, and closes the pipes. Call
 * it after all processes have ended. Does nothing if the relay is not started. */
void tl_log_relay_stop(tl_log_relay *self);

#endif
