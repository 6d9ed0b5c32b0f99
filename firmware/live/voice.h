/* The voice of a run: the one thread by which its processes reach standard error.
 *
 * Purpose: io, recorder and activator print into pipes; what comes out is logged here, line by line. So only the supervisor holds the terminal, and no line is
 *          smeared by the status line, which is drawn here as well. Processes of twins that are over are cleared away here, since that may wait.
 * Repeats: a process that is begun again prints the lines of the one before. From the third process on each such line is logged once a minute, with a
 *          count.
 * Priority: ordinary, whatever that of the supervisor is.
 * Thread:  all functions: the supervisor's. None waits for the voice, but for the end.
 */
#ifndef TL_FIRMWARE_LIVE_VOICE_H
#define TL_FIRMWARE_LIVE_VOICE_H

#include <stdbool.h>

#include "firmware/process/heartbeat.h"
#include "firmware/twin/twin_process.h"

enum { TL_VOICE_PIPES = 3 };

typedef struct tl_voice tl_voice;

/* `beats`: of the twin, at first. `status`: a status line also if standard error is no terminal. Errors: TL_TRY_AGAIN. */
tl_status tl_voice_start(const tl_heartbeats *beats, bool status, tl_voice **voice, tl_error *error);

/* The pipe for a process of a kind, below TL_VOICE_PIPES, that is about to begin after the one before has ended: what it prints there is logged. Empty lines
 * are dropped. The pipe stays the voice's. */
int tl_voice_pipe(tl_voice *voice, unsigned which);

/* From now on the status is that of another twin. */
void tl_voice_watch(tl_voice *voice, const tl_heartbeats *beats);

/* A process that is dead and let go of: clears it away. */
void tl_voice_clear(tl_voice *voice, tl_twin_process *process);

/* Passes on what is left, takes the status line away, and ends. NULL is allowed. */
void tl_voice_stop(tl_voice *voice);

#endif
