/* Loading an FMU in a process of its own: what tl_forked_service needs.
 *
 * Purpose: the FMU's folder was unpacked by the twin; its description is read once more here, since nothing that the twin has of it is in this memory, and the
 *          binary is opened behind a guard, as in a twin.
 * Thread:  the only one of its process.
 */
#ifndef TL_FIRMWARE_FMU_FMU_HOST_H
#define TL_FIRMWARE_FMU_FMU_HOST_H

#include "firmware/forked/forked_host.h"

/* Once in a process. Errors: as tl_model_description_read() and tl_fmu_binary_open(). */
tl_status tl_fmu_host_load(const char *folder, const char *label, tl_forked_fmu *fmu, tl_error *error);

#endif
