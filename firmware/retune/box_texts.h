/* What files of the box itself say about names that a configuration may have.
 *
 * Purpose: the administrator's list, and the configuration's file as it is now, for who compares a candidate with them (config_change.h).
 * List:    nobody but root, or the user of the run, may be able to write it, or it counts as nothing.
 * Waiting: for the disk.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_RETUNE_BOX_TEXTS_H
#define TL_FIRMWARE_RETUNE_BOX_TEXTS_H

enum { TL_BOX_LIST_MOST = 65536, TL_BOX_FAULT = 512 };

/* To be freed; NULL: there is none, or (with a fault) none of it counts. */
char *tl_box_read_list(const char *path, char fault[TL_BOX_FAULT]);

/* To be freed; NULL: it cannot be read now, or is no configuration's. */
char *tl_box_read_file(const char *path);

#endif
