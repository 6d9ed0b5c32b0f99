/* A run that nobody ran: settings, samples and records with known values, for what writes and reads databases.
 *
 * Values:  a function of tick and signal alone, in all bits; among them -0.0, the smallest and the largest numbers.
 * Thread:  pure, but for the settings' static texts.
 */
#ifndef TL_TESTS_SUPPORT_MADE_RUN_H
#define TL_TESTS_SUPPORT_MADE_RUN_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/record_queue.h"
#include "firmware/store/recorder.h"

enum { TL_MADE_PLANT = 3, TL_MADE_MATCH = 2, TL_MADE_ADJUST = 2, TL_MADE_COMPONENTS = 3, TL_MADE_PREDICTION = 2 };

/* 10 ms steps, T_P = 2, lag, commits every 20 ms, no bound; plant.torque, plant.omega, plant.door; motor.omega and motor.i
 * matched; motor.d and drive.u adjusted; components drive, motor and plant. */
tl_recorder_settings tl_made_settings(const char *path);

/* That of the newest settings, for a test that changes it. */
tl_account *tl_made_account(void);

/* Never zeroed beyond what the run has: it is filled with rubbish first, as a caller's would be. */
void tl_made_sample(int64_t tick, tl_sample *sample);
void tl_made_record(int64_t step, tl_record *record);

/* As of that step, for each component; grows with every step. */
void tl_made_ledger(int64_t step, tl_recorder_component *ledger);

/* As replay does in mode lag: samples 0 … ticks−1, each followed by the step it makes possible. */
void tl_made_put(tl_recorder *recorder, int64_t first, int64_t ticks);

/* Its beginning in an outbox, and some ticks, a step for each: the test writes in between what the ring has no room for. False: it has none. */
void tl_made_beginning(tl_time start, tl_record_queue_start *beginning);
bool tl_made_put_out(tl_record_queue *queue, int64_t first, int64_t ticks);

#endif
