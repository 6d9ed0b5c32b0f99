/* Summaries of the minutes and hours of recorded runs.
 *
 * Purpose: rows of ticks and steps fill a file within hours or days. The recorder removes the
 *          oldest ones, and these summaries remain, so that a file of bounded size spans years.
 * Minutes: made from the rows of a minute as soon as the minute is complete. Minute k of a run
 *          covers the seconds 60 k to 60 (k + 1) since t_start. Hours are made from minutes.
 * Series:  good values of each plant signal, y − ŷ of each match with a good ŷ, Δu of each adjusted
 *          variable, and how many steps had each outcome.
 * Values:  number of values, mean, minimum, maximum, and standard deviation (`spread`).
 * Shares:  if the file is full, minutes may use an eighth of its bound, and hours another eighth.
 *          The oldest ones above this share are removed.
 * Again:   a second summary of the same period replaces the first.
 * Errors:  functions return SQLite's result code.
 * Thread:  the recorder's.
 */
#ifndef TL_FIRMWARE_STORE_PERIODS_H
#define TL_FIRMWARE_STORE_PERIODS_H

#include <sqlite3.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/run_types.h"

/* Creates the table; see docs/reference/database.md. */
#define TL_PERIODS_TABLE                                                                                               \
    "CREATE TABLE periods ("                                                                                           \
    "  length_s INTEGER NOT NULL,"                                                                                     \
    "  run INTEGER NOT NULL,"                                                                                          \
    "  period INTEGER NOT NULL,"                                                                                       \
    "  kind TEXT NOT NULL,"                                                                                            \
    "  signal INTEGER NOT NULL,"                                                                                       \
    "  count INTEGER NOT NULL,"                                                                                        \
    "  mean,"                                                                                                          \
    "  least,"                                                                                                         \
    "  largest,"                                                                                                       \
    "  spread,"                                                                                                        \
    "  PRIMARY KEY (length_s, run, period, kind, signal)) WITHOUT ROWID"

enum { TL_PERIODS_SHARE = 8 }; /* minutes may fill 1/8 of the file, and hours another 1/8 */

/* Returns how many minutes, or hours, have room in their share, at least 120. `series`: number of
 * plant signals, matched outputs and adjusted variables. */
int64_t tl_periods_room(int64_t max_bytes, int64_t series);

typedef struct tl_periods tl_periods;

/* Prepares the statements and allocates `periods`. Close it also after a failure. */
int tl_periods_open(sqlite3 *connection, tl_periods **periods);

/* NULL is allowed. */
void tl_periods_close(tl_periods *periods);

/* Summarises the minutes of the run that are complete, and the hours. Call it within a transaction.
 * `step`, `sample`: numbers of the newest written ones; −1: none. A minute is complete when the
 * newest step is behind it. If steps are missing, it is complete 300 s later, by the newest sample.
 * In safe hold, a run has only samples, and the newest sample decides. */
int tl_periods_until(tl_periods *periods, int64_t run, int64_t step, int64_t sample);

/* Summarises the rest of a run that has ended. Call it within a transaction. */
int tl_periods_end(tl_periods *periods, int64_t run);

/* Drops the cached progress of the run. Call it after a transaction was rolled back. */
void tl_periods_forget(tl_periods *periods);

/* Removes about `rows` old rows above the shares; within a transaction. *removed: there were any.
 */
int tl_periods_remove(tl_periods *periods, int64_t max_bytes, int64_t series, int64_t rows, bool *removed);

#endif
