/* What a process does that this program has started with a role (role.h): twin, io, recorder, activator, validator or trial.
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_CLI_ROLES_H
#define TL_FIRMWARE_CLI_ROLES_H

#include "firmware/twin/twin_role.h"

/* Tasks of the process with the FMUs that belong to folders above firmware/twin. */
extern const tl_twin_role_tasks tl_roles_twin_tasks;

/* Runs the role that the process's title names. The exit code of the process. */
int tl_roles_run(const char *title);

#endif
