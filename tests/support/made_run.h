/* Synthetic run for tests of the database: settings, samples and records with known values.
 *
 * Values:  a function of tick and signal; among them -0.0, the smallest and the largest numbers.
 * Thread:  any, except tl_made_settings(), which uses a static account.
 */
#ifndef TL_TESTS_SUPPORT_MADE_RUN_H
#define TL_TESTS_SUPPORT_MADE_RUN_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/record_queue.h"
#include "firmware/store/recorder.h"

enum { TL_MADE_PLANT = 3, TL_MADE_MATCH = 2, TL_MADE_ADJUST = 2, TL_MADE_COMPONENTS = 3, TL_MADE_PREDICTION = 2 };

/* 10 ms steps, T_P = 2, lag, commits every 20 ms, no bound; plant.torque, plant.omega,
 * plant.door; motor.omega and motor.i matched; motor.d and drive.u adjusted; components drive,
 * motor and plant. */
tl_recorder_settings tl_made_settings(const char *path);

/* Returns the account of the newest settings, so that a test can change it. */
tl_account *tl_made_account(void);

/* Fill a sample or a record. Members that the run does not use contain garbage, as in real use. */
void tl_made_sample(int64_t tick, tl_sample *sample);
void tl_made_record(int64_t step, tl_record *record);

/* Fills the ledger after this step for each component. The counts grow with each step. */
void tl_made_ledger(int64_t step, tl_execution_counts *ledger);

/* Puts samples as a replay in mode lag does: each sample is followed by the step that it
 * enables. */
void tl_made_put(tl_recorder *recorder, int64_t first, int64_t ticks);

/* Fill a run's start, and put ticks with one step each into a record queue. The second one
 * returns false if the queue is full: then the test must write in between. */
void tl_made_beginning(tl_time start, tl_record_queue_start *beginning);
bool tl_made_put_out(tl_record_queue *queue, int64_t first, int64_t ticks);

#endif
