/* Which signals of one configuration are those of another: read from the same place, by the same rules.
 *
 * Purpose: a twin of another configuration runs beside a plant that is read by that of the run (live_stage.h). It can see what both read alike; all else only
 *          once the plant is read by its own.
 * Alike:   the same name, the same value type and the same entry of `modbus`, `can`, `gpio` or `csv`, of a source with the same name and definition. How a
 *          reading is judged (`min`, `max`, `stale_s`) and what it is when there is none is the reader's affair, and not compared. What is written out in
 *          one of them and left out in the other counts as different. Which polls are readings (`every_s`, tl_config_repeats()) is the driver's affair: what
 *          the run's has read is seen all the same, but the plant is to be read anew.
 * Second look-ups of a signal (tl_config_use_lookups()) are alike if the signal is, also those of which the run has none: they are other looks at the same
 *          readings.
 * Thread:  pure functions.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_SAME_SIGNALS_H
#define TL_FIRMWARE_CONFIG_CONFIG_SAME_SIGNALS_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/config.h"
#include "master/base/signal.h"
#include "master/base/status.h"

/* Of a signal that the run does not have. */
#define TL_NO_SUCH_SIGNAL SIZE_MAX

typedef struct tl_same_signals {
    size_t count;              /* of the candidate's signals */
    size_t of[TL_MAX_SIGNALS]; /* of each: the index of the run's that is the same, or TL_NO_SUCH_SIGNAL */
    size_t unseen;             /* how many have none */
    bool is_each;              /* both have the same ones, in the same places, and read them alike */
} tl_same_signals;

/* Look-ups are in use in both, or in neither. Errors: TL_TRY_AGAIN. */
tl_status tl_config_same_signals(const tl_config *run, const tl_config *candidate, tl_same_signals *same,
                                 tl_error *error);

/* One that the run does not have feeds an input of an FMU, or begins a stroke. */
bool tl_same_signals_lack_input(const tl_same_signals *same, const tl_config *candidate);

/* A sample of the run's signals, as who has the candidate's sees it: of the others there was no reading. */
void tl_same_signals_sample(const tl_same_signals *same, const tl_sample *of_run, tl_sample *sample);

#endif
