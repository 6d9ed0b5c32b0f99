/* The activator: answers at a plant's control socket, and sees to it that one change after the other is made.
 *
 * Purpose: the work of a process that is begun when somebody knocks, or a probation is under way, and ends when nothing is to be done.
 * Trust:   it parses no configuration and no FMU: a validator and a trial do (worker.h). A right that is claimed is believed: only root, the plant's own
 *          user and the socket's group can ask.
 * Waiting: for clients and workers at once, at most `TL_CONFIG_MANAGER_LOOK`.
 * Thread:  one, the main thread of its process.
 */
#ifndef TL_FIRMWARE_RETUNE_CONFIG_MANAGER_H
#define TL_FIRMWARE_RETUNE_CONFIG_MANAGER_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/retune/activation.h"
#include "firmware/retune/control.h"

#define TL_CONFIG_MANAGER_LOOK (TL_SECOND / 20)

typedef struct tl_config_manager tl_config_manager;

/* `socket`: listens (control.h). `state`: the folder in which versions/ is. `settings`: versions, refusals, say and its listener are set here.
 * Errors: TL_TRY_AGAIN, TL_BAD_DATA of the versions' folder. */
tl_status tl_config_manager_open(int socket, const char *state, const tl_activation_settings *settings,
                                 tl_config_manager **activator, tl_error *error);

/* Waits for something to do, at most TL_CONFIG_MANAGER_LOOK, and does it. False: nothing has been to do for some seconds, and nothing is. */
bool tl_config_manager_work(tl_config_manager *activator);

/* Hangs up, and ends what is under way; the next one goes on with it. NULL is allowed. */
void tl_config_manager_close(tl_config_manager *activator);

#endif
