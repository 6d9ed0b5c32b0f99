/* A thread beside the cycle: it runs under ordinary scheduling, and takes no signals, whoever starts it.
 *
 * Purpose: the one way to start a thread that only reads, writes or waits. A thread inherits priority and signal mask from
 *          its starter, which may be the real-time cycle; this one does not.
 * Stack:   in bytes; with mlockall() all of it is real memory. 0: as the system has it.
 * Thread:  any. Errors: 0, or errno: EAGAIN if a resource is missing.
 */
#ifndef TL_FIRMWARE_BASE_SIDE_THREAD_H
#define TL_FIRMWARE_BASE_SIDE_THREAD_H

#include <pthread.h>
#include <stddef.h>

/* Runs `run` with `context`; the caller joins *thread. */
int tl_side_thread_start(pthread_t *thread, size_t stack, void *(*run)(void *context), void *context);

#endif
