/* Reads the texts on the box that decide which names a configuration may contain.
 *
 * Purpose: reads the administrator's list of allowed names and the current configuration file. A
 *          candidate may use the names in both (config_change.h).
 * Trust:   the list is used only if its owner is root or the user of the run, and no other user can
 *          write it.
 * Waiting: for the disk.
 * Memory:  the caller frees the texts.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_RETUNE_BOX_TEXTS_H
#define TL_FIRMWARE_RETUNE_BOX_TEXTS_H

/* Maximum number of bytes of the list; size of `fault`. */
enum { TL_BOX_LIST_MOST = 65536, TL_BOX_FAULT = 512 };

/* Returns the text of the list; the caller calls free(). Returns NULL if there is no list, or if it
 * is ignored. `fault`: why it is ignored; else "". */
char *tl_box_read_list(const char *path, char fault[TL_BOX_FAULT]);

/* Returns the text of the configuration file; the caller calls free(). Returns NULL if it cannot be
 * read, contains a NUL, or is longer than TL_CONTROL_MOST (control.h). */
char *tl_box_read_file(const char *path);

#endif
