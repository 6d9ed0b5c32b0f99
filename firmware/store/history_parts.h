/* What the files of the history share: its connection, and how a table is read along its key.
 *
 * Thread: the history's.
 */
#ifndef TL_FIRMWARE_STORE_HISTORY_PARTS_H
#define TL_FIRMWARE_STORE_HISTORY_PARTS_H

#include <sqlite3.h>
#include <stdint.h>

#include "firmware/store/database_row.h"
#include "firmware/store/history.h"

/* SELECT only. */
sqlite3 *tl_history_database(tl_history *history);

/* Of the row before, and what the next one may be. */
typedef struct tl_history_key {
    int64_t number;  /* tick or step; the next is not before it, */
    int64_t last;    /* nor after this one */
    int64_t signal;  /* of the same number, the next one's is larger; −1 at the beginning */
    int64_t signals; /* that there are */
} tl_history_key;

/* Reads the key of the next row, its first two columns. A row that does not come in the order of the key is not right. */
void tl_history_key_take(tl_history_key *key, tl_row *row);

#endif
