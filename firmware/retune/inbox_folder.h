/* The folder of an inbox: which of its files are complete by now.
 *
 * Purpose: a file is complete if it was renamed to its name, within the folder or into it, or linked, which is how many an SFTP server renames. One
 *          that is written under its name is not: nobody can know when its writer is done. That is told once, when the writer closes it.
 * Names:   *.json, but none that begins with a dot or is too long for what is made of it.
 * Start:   what is there then, and has been left alone for a second, counts as complete.
 * Bounds:  some files are remembered, and the folder is looked through again when these are done; so is it if the kernel has forgotten some.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_RETUNE_INBOX_FOLDER_H
#define TL_FIRMWARE_RETUNE_INBOX_FOLDER_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

#define TL_INBOX_TAKEN ".taken"
#define TL_INBOX_RESULT ".result.txt"

enum { TL_INBOX_WAITING = 64 };

typedef enum tl_inbox_news {
    TL_INBOX_NOTHING,
    TL_INBOX_COMPLETE, /* a file can be taken */
    TL_INBOX_IN_PLACE, /* one was written under its name */
    TL_INBOX_GONE      /* the folder itself */
} tl_inbox_news;

/* Private. */
typedef enum tl_inbox_state {
    TL_INBOX_RENAMED, /* complete */
    TL_INBOX_YOUNG,   /* complete if nobody writes to it until it is `ready` */
    TL_INBOX_WRITING, /* somebody writes to it under its name */
    TL_INBOX_WRITTEN  /* and has closed it */
} tl_inbox_state;

typedef struct tl_inbox_file {
    char name[NAME_MAX + 1];
    tl_inbox_state state;
    tl_time ready;
} tl_inbox_file;

/* Fields are private but for the descriptor of the folder. */
typedef struct tl_inbox_folder {
    int descriptor;
    int events;
    bool is_gone;
    bool is_incomplete; /* there is more than is remembered */
    size_t count;
    tl_inbox_file files[TL_INBOX_WAITING]; /* in the order in which they came */
} tl_inbox_folder;

/* Whether a file of this name is for the inbox. */
bool tl_inbox_folder_wants(const char *name);

/* Errors: TL_BAD_DATA: it is no folder that can be read; TL_TRY_AGAIN. */
tl_status tl_inbox_folder_open(const char *path, tl_inbox_folder *folder, tl_error *error);

/* Waits for at most `time` if there is nothing, which may be while a file is young. */
tl_inbox_news tl_inbox_folder_next(tl_inbox_folder *folder, tl_time time, char name[NAME_MAX + 1]);

/* What could not be taken is looked for again. */
void tl_inbox_folder_repeat(tl_inbox_folder *folder);

void tl_inbox_folder_close(tl_inbox_folder *folder);

#endif
