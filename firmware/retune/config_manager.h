/* Config manager: answers requests at the control socket of a run, and executes configuration
 *                 changes, one at a time.
 *
 * Lifetime: the process runs on demand. The supervisor starts it at the start of a run, and again
 *           when a client connects. It ends after 10 s without a client and without a change in
 *           progress, unless a version is on probation.
 * Trust:   it parses no candidate and loads no FMU; workers do both (worker.h). It accepts the
 *          right that a client claims (`--right`), because only root, the user of the run and
 *          members of the socket's group can connect.
 * Waiting: tl_config_manager_work() waits at most TL_CONFIG_MANAGER_POLL (50 ms).
 * Thread:  one, the main thread of its process.
 */
#ifndef TL_FIRMWARE_RETUNE_CONFIG_MANAGER_H
#define TL_FIRMWARE_RETUNE_CONFIG_MANAGER_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/retune/activation.h"
#include "firmware/retune/control.h"

/* Longest wait of tl_config_manager_work(), ns: 50 ms. */
#define TL_CONFIG_MANAGER_POLL (TL_SECOND / 20)

typedef struct tl_config_manager tl_config_manager;

/* Starts the config manager. `socket`: see tl_control_listen(); the caller owns it. `state`: the
 * folder that contains versions/. Copies `settings`; its fields versions, refusals, reply and
 * listener are ignored. Errors: TL_TRY_AGAIN; TL_BAD_DATA if the path of the folder is too long. */
tl_status tl_config_manager_open(int socket, const char *state, const tl_activation_settings *settings,
                                 tl_config_manager **manager, tl_error *error);

/* Waits for a client's message, at most TL_CONFIG_MANAGER_POLL, answers requests, and polls the
 * change in progress. Returns false if the process should end, after 10 s without work. */
bool tl_config_manager_work(tl_config_manager *manager);

/* Closes all connections (not `socket`), ends a running worker and frees the manager. The next
 * config manager continues from the state on disk. NULL is allowed. */
void tl_config_manager_close(tl_config_manager *manager);

#endif
