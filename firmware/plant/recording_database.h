/* The ticks of a run that was recorded into a database, for recording.h.
 *
 * Purpose: a run of the file, as it was seen. Where the configuration is the very one of the run, ticks it missed
 *          are made up again, searches it had no time for end where they ended, and the tunings that it took are taken at their ticks, so that the
 *          same u come out.
 * Delays:  with another configuration that has delays, signals are looked up anew, by the stamps of the readings that the run
 *          saw: at most one a tick of each. So a run that was recorded without delays can be replayed with them.
 * Errors:  TL_BAD_DATA where the signals or the step are not the configuration's, the run's beginning is gone, or what it took
 *          cannot be followed.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_PLANT_RECORDING_DATABASE_H
#define TL_FIRMWARE_PLANT_RECORDING_DATABASE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/plant/recording_tick.h"
#include "master/base/status.h"

typedef struct tl_recording_database tl_recording_database;

tl_status tl_recording_database_open(const char *path, const tl_config *config, tl_recording_database **database,
                                     int64_t *ticks, tl_error *error);

/* NULL: at tick 0, as any twin does. */
const tl_recording_beginning *tl_recording_database_beginning(const tl_recording_database *database);

tl_recording_tunings tl_recording_database_tunings(const tl_recording_database *database);

tl_status tl_recording_database_next(tl_recording_database *database, tl_recording_tick *tick, bool *end,
                                     tl_error *error);

/* As in recording.h. */
void tl_recording_database_listen(tl_recording_database *database, tl_recording_hear *hear, void *context);

void tl_recording_database_close(tl_recording_database *database);

#endif
