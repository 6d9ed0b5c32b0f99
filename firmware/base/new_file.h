/* A file that appears whole or not at all.
 *
 * Purpose: it is written as FILE.new- and numbers, and takes its name at the end. What had the name stays until then, and
 *          stays for good where the command is interrupted or the disk is full.
 * Rules:   those of `--db`: an ordinary file is replaced, a link to one is followed; a device, a FIFO, a folder and a link
 *          that leads nowhere are left as they are. A replaced file's permissions are kept.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_BASE_NEW_FILE_H
#define TL_FIRMWARE_BASE_NEW_FILE_H

#include <limits.h>
#include <stdbool.h>
#include <stdio.h>

#include "master/base/status.h"

typedef struct tl_new_file {
    FILE *file;          /* to write to */
    char path[PATH_MAX]; /* what it will be called */
    char name[PATH_MAX]; /* what it is called until then */
} tl_new_file;

/* Errors: TL_BAD_USAGE (no name), TL_BAD_DATA (there is something that must not be replaced), TL_TRY_AGAIN. */
tl_status tl_new_file_open(const char *path, tl_new_file *new_file, tl_error *error);

/* Gives it its name; content and name survive a power cut from here on. TL_TRY_AGAIN where not everything could be written; it is discarded then. */
tl_status tl_new_file_keep(tl_new_file *new_file, tl_error *error);

/* The same name, or one file by two names: what is made would take the other's place. */
bool tl_new_file_is(const char *path, const char *other);

/* A zeroed one is allowed. */
void tl_new_file_discard(tl_new_file *new_file);

#endif
