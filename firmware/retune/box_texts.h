/* Reads two files on the box: the administrator's list of allowed names, and the configuration
 * file.
 *
 * Purpose: a candidate (control.h) may name files and libraries that these files name
 *          (config_change.h).
 * Trust:   the list is used only if its owner is root or the user of the run, and no other user can
 *          write it.
 * Waiting: for the disk.
 * Memory:  the caller frees the texts.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_RETUNE_BOX_TEXTS_H
#define TL_FIRMWARE_RETUNE_BOX_TEXTS_H

/* Maximum number of bytes of the list; size of `fault`, bytes. */
enum { TL_BOX_LIST_MOST = 65536, TL_BOX_FAULT = 512 };

/* Returns the text of the list; the caller calls free(). Returns NULL if there is no list, or if it
 * is ignored because it is not trusted, too long or invalid. Sets `fault` to why the list is
 * ignored, else to "". */
char *tl_box_read_list(const char *path, char fault[TL_BOX_FAULT]);

/* Returns the text of the configuration file; the caller calls free(). Returns NULL if it is not an
 * ordinary file, cannot be read, contains a NUL, or is longer than TL_CONTROL_MOST (control.h). */
char *tl_box_read_file(const char *path);

#endif
