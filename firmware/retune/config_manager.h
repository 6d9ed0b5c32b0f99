/* Config manager: answers at a plant's control socket, and makes one configuration change after the
 * other.
 *
 * Purpose: the process runs on demand. The supervisor starts it at the start of a run and for a
 *          connection. It ends when it is idle for 10 s and no version is on probation.
 * Trust:   it parses no configuration and loads no FMU; workers do both (worker.h). It trusts the
 *          right that a client claims, because only root, the plant's own user and the socket's
 *          group can connect.
 * Waiting: for clients and workers together, at most TL_CONFIG_MANAGER_POLL.
 * Thread:  one, the main thread of its process.
 */
#ifndef TL_FIRMWARE_RETUNE_CONFIG_MANAGER_H
#define TL_FIRMWARE_RETUNE_CONFIG_MANAGER_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/retune/activation.h"
#include "firmware/retune/control.h"

#define TL_CONFIG_MANAGER_POLL (TL_SECOND / 20)

typedef struct tl_config_manager tl_config_manager;

/* Starts with a listening `socket` (control.h). `state`: the folder that contains versions/. This
 * function sets versions, refusals, say and its listener in `settings`. Errors: TL_TRY_AGAIN;
 * TL_BAD_DATA if the versions' folder is damaged. */
tl_status tl_config_manager_open(int socket, const char *state, const tl_activation_settings *settings,
                                 tl_config_manager **manager, tl_error *error);

/* Waits for work, at most TL_CONFIG_MANAGER_POLL, and does it. Returns false if there is no work,
 * and was none for some seconds. */
bool tl_config_manager_work(tl_config_manager *manager);

/* Closes all connections and ends a running worker. The next config manager continues from the
 * state on disk. NULL is allowed. */
void tl_config_manager_close(tl_config_manager *manager);

#endif
