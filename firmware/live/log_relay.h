/* Log relay of a run: one thread that logs the output of the other processes and draws the status
 * line.
 *
 * Purpose:  io, recorder and config manager print into pipes; this thread logs each line. So only
 *           the supervisor uses the terminal, and the status line never mixes with other lines. The
 *           thread also closes ended processes of twins, because that may block.
 * Repeats:  a restarted process prints the lines of the one before. From the third process on, each
 *           such line is logged once a minute, with a count.
 * Priority: ordinary, whatever that of the supervisor is.
 * Thread:   all functions: the supervisor's. Only tl_log_relay_stop() waits for the thread.
 */
#ifndef TL_FIRMWARE_LIVE_LOG_RELAY_H
#define TL_FIRMWARE_LIVE_LOG_RELAY_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/relay.h"
#include "firmware/process/heartbeat.h"
#include "firmware/twin/twin_process.h"

enum { TL_LOG_RELAY_PIPES = 3, TL_LOG_RELAY_LINES = 16, TL_LOG_RELAY_DEAD = 8 };

/* A line that was logged. */
typedef struct tl_logged_line {
    uint64_t hash;
    unsigned process; /* that printed it last */
    unsigned repeats; /* by later processes, not logged */
    bool is_loop;     /* a later process has repeated it within a minute */
    tl_time time;
} tl_logged_line;

/* The output of processes of one kind, one after the other. */
typedef struct tl_log_source {
    tl_relay relay;
    int pipe;         /* the end that they write; 0: none */
    unsigned process; /* number of the process whose lines are read */
    tl_logged_line lines[TL_LOG_RELAY_LINES];
} tl_log_source;

/* Fields are private. Zeroed: not started. */
typedef struct tl_log_relay {
    const tl_heartbeats *beats; /* of the twin: its status */
    bool status;
    bool terminal;
    bool runs; /* there is a thread */
    pthread_t thread;
    int wake; /* eventfd */
    bool stop;
    tl_log_source sources[TL_LOG_RELAY_PIPES];
    tl_twin_process *dead[TL_LOG_RELAY_DEAD]; /* to be closed by the thread */
    tl_time drawn;
} tl_log_relay;

/* `beats`: of the first twin. `status`: draws a status line also if standard error is no terminal.
 * Errors: TL_TRY_AGAIN; then tl_log_relay_stop() is still allowed. */
tl_status tl_log_relay_start(tl_log_relay *self, const tl_heartbeats *beats, bool status, tl_error *error);

/* The pipe for a process of kind `which`, below TL_LOG_RELAY_PIPES, that is about to start after
 * the one before has ended. Empty lines are dropped. The pipe stays open here. */
int tl_log_relay_pipe(const tl_log_relay *self, unsigned which);

/* From now on the status is that of another twin. */
void tl_log_relay_watch(tl_log_relay *self, const tl_heartbeats *beats);

/* Closes a process that has ended, after tl_twin_process_let_go(). */
void tl_log_relay_close_process(tl_log_relay *self, tl_twin_process *process);

/* Logs the remaining output, removes the status line, and ends the thread. Does nothing if it is
 * not started. */
void tl_log_relay_stop(tl_log_relay *self);

#endif
