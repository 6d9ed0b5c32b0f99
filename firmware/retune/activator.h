/* The activator: answers at a plant's control socket, and sees to it that one change after the other is made.
 *
 * Purpose: the work of a process that is begun when somebody knocks, or a probation is under way, and ends when nothing is to be done.
 * Trust:   it parses no configuration and no FMU: a validator and a trial do (worker.h). Who asks is known from the kernel; a right that is more than
 *          reading is believed of the plant's own user, of root, and of whom the socket's group lets in, who has checked it.
 * Waiting: for clients and workers at once, at most `TL_ACTIVATOR_LOOK`.
 * Thread:  one, the main thread of its process.
 */
#ifndef TL_FIRMWARE_RETUNE_ACTIVATOR_H
#define TL_FIRMWARE_RETUNE_ACTIVATOR_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/retune/activation.h"
#include "firmware/retune/control.h"

#define TL_ACTIVATOR_LOOK (TL_SECOND / 20)

typedef struct tl_activator_settings {
    int listener;      /* control.h */
    const char *state; /* the folder in which versions/ is */
    const char *plant; /* the rest as in activation.h */
    const char *path;
    const char *allowed; /* as in activation.h */
    uint64_t memory_limit;
    bool unconfined;
    const tl_activation_host *host;
    int (*be)(const char *title, void *context);
    void *context;
} tl_activator_settings;

typedef struct tl_activator tl_activator;

/* Errors: TL_TRY_AGAIN, TL_BAD_DATA of the versions' folder. */
tl_status tl_activator_open(const tl_activator_settings *settings, tl_activator **activator, tl_error *error);

/* Waits for something to do, at most TL_ACTIVATOR_LOOK, and does it. False: nothing has been to do for some seconds, and nothing is. */
bool tl_activator_work(tl_activator *activator);

/* Hangs up, and ends what is under way; the next one goes on with it. NULL is allowed. */
void tl_activator_close(tl_activator *activator);

#endif
