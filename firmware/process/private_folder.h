/* provisional */
#ifndef TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H
#define TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H
#include <limits.h>
#include <stdint.h>
#include "master/base/status.h"
typedef struct tl_private_folder { char path[PATH_MAX]; uint32_t user; } tl_private_folder;
tl_status tl_private_folder_make(const char *kind, uint32_t user, tl_private_folder *folder, tl_error *error);
void tl_private_folder_remove(tl_private_folder *folder);
#endif
