/* The rows that say what a run is: its own, its configuration, signals and components.
 *
 * Purpose: what is written once, when a run begins, within a transaction of the caller's.
 * Trust:   the account may be that of a hostile twin: its texts are repaired, its counts bounded by the settings.
 * Errors:  SQLite's result codes; the connection has the words.
 * Thread:  the connection's.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_BEGINNING_H
#define TL_FIRMWARE_STORE_RECORDER_BEGINNING_H

#include <sqlite3.h>
#include <stdint.h>

#include "firmware/store/outbox.h"
#include "firmware/store/recorder_settings.h"

/* Ends what was left open in the file, and begins this one. `began`: UTC, ms. Gives its row's id. The text of another configuration than that of the
 * settings, which a twin was built with, is "" until somebody knows it. */
int tl_recorder_beginning_write(sqlite3 *connection, const tl_recorder_settings *settings, const tl_outbox_start *start,
                                int64_t began, int64_t *run);

/* Runs without an end were not ended cleanly, unless we record them: they get that end. */
int tl_recorder_beginning_end_killed(sqlite3 *connection);

/* What is no character becomes "?". */
void tl_recorder_beginning_repair(char *text);

#endif
