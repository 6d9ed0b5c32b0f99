/* Which file is written: the one that was asked for, or what there is instead of it.
 *
 * Purpose: a plant is kept in step whether it can be recorded or not; so who records copes with nearly everything that can be wrong
 *          with a file, and only says so. What was never ours is never touched, and nothing is ever deleted.
 * Rules:   by fault (database_sql.h). Damaged: put aside as FILE.damaged-1, -2, … and made anew. Denied, other, foreign: FILE.beside
 *          is written (if need be FILE.beside-2, …), which is a database like any other. Later, taken: it is waited for; and so is a folder
 *          that denies everything.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_INSTEAD_H
#define TL_FIRMWARE_STORE_DATABASE_INSTEAD_H

#include <stdbool.h>

#include "firmware/store/database_file.h"

/* FILE.beside, FILE.beside-2, … up to this one. */
enum { TL_DATABASE_BESIDE_MOST = 9 };

/* What is an error all the same: who asked for this file is there to be told. */
typedef enum tl_database_insistence {
    TL_DATABASE_ALL_OR_NOTHING, /* every fault is */
    TL_DATABASE_IF_OURS,        /* foreign, other, taken; and if there is nothing instead */
    TL_DATABASE_ANYHOW          /* none is */
} tl_database_insistence;

/* What to say about it. */
typedef struct tl_database_news {
    tl_database_aside aside;
    char beside[TL_ERROR_TEXT]; /* why the file is another one than was asked for; "": it is not */
} tl_database_news;

typedef struct tl_database_wanted {
    const char *path;
    tl_time patience; /* with locks */
    tl_database_insistence insistence;
    const tl_database_user *user;
} tl_database_wanted;

/* Opens one. If none is open then: *waits, trying again may help; else it is an error. */
tl_status tl_database_instead_open(const tl_database_wanted *wanted, tl_database_file *file, tl_database_news *news,
                                   bool *waits, tl_error *error);

/* Opens one beside it at once; `why` goes into the news. */
tl_status tl_database_instead_beside(const char *given, const char *why, const tl_database_user *user,
                                     tl_database_file *file, tl_database_news *news, tl_error *error);

#endif
