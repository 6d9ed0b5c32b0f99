/* Names that files on the box allow in a configuration.
 *
 * Purpose: reads the administrator's list of allowed names and the current configuration file. A
 *          candidate is compared with both (config_change.h).
 * Trust:   the list is ignored if a user other than root or the user of the run can write it.
 * Waiting: for the disk.
 * Memory:  the caller frees the texts.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_RETUNE_BOX_TEXTS_H
#define TL_FIRMWARE_RETUNE_BOX_TEXTS_H

enum { TL_BOX_LIST_MOST = 65536, TL_BOX_FAULT = 512 };

/* Returns the text of the list, or NULL if there is no list, or if it is ignored; then `fault` says
 * why. The caller calls free(). */
char *tl_box_read_list(const char *path, char fault[TL_BOX_FAULT]);

/* Returns the text of the configuration file, or NULL if it cannot be read, or is no text of a
 * valid size. The caller calls free(). */
char *tl_box_read_file(const char *path);

#endif
