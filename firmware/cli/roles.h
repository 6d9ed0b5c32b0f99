/* Roles of the processes that this program starts (role.h): twin (an FMU process), states (loads
 * only the FMU states that another process has saved), io, recorder, config manager, explainer,
 * worker.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_CLI_ROLES_H
#define TL_FIRMWARE_CLI_ROLES_H

#include "firmware/twin/twin_role.h"

/* Tasks of the FMU process that are implemented in folders above firmware/twin. */
extern const tl_twin_role_tasks tl_roles_twin_tasks;

/* Runs the role whose name is the beginning of `title`. Returns the exit code of the process; for
 * an unknown role, that of TL_BAD_USAGE. */
int tl_roles_run(const char *title);

#endif
