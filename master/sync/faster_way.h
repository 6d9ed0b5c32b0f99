/* Of two exact ways to lead a component back, the one that is faster on this machine.
 *
 * Purpose: an FMU may take far longer to save and restore its own state than a copy of its memory takes: some rebuild a solver each time. A search does hardly anything else, so
 *          what it costs is timed, and not guessed: saved, stepped and led back, again and again, by its own states and by copies.
 * Choice:  a copy, if by own states a round takes TL_FASTER_WAY_MARGIN times as long, and what is won is worth it. Else an FMU's own states are its own affair, and stay.
 * Exact:   by copies nothing is proved yet; who makes use of this proves all again. One that is not exact so goes back to its own states (tl_component_come_back()).
 * Bits:    no result depends on the choice, since both ways lead to where the component was. How many states find room may.
 * Thread:  the twin's. Takes no memory of the twin's.
 */
#ifndef TL_MASTER_SYNC_FASTER_WAY_H
#define TL_MASTER_SYNC_FASTER_WAY_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/graph/exchange.h"

/* Of each way at most that count; of one that takes very long three. One more comes before them. */
enum { TL_FASTER_WAY_ROUNDS = 15 };

#define TL_FASTER_WAY_MARGIN 1.5

/* While a proof goes on (tl_exchange_keep()), with all components where it began, at the beginning of step `first`, proved by their states, and none of these states but those of tl_exchange_save() there:
 * decides for each that has a choice. `now`: ns. *taken: for a copy, of one at least. Everything stands where it stood, and is saved. Errors: TL_FMU_FAILED, TL_FMU_FATAL: a component could not be led back there, and
 * exchange->failed is which. */
tl_status tl_faster_way_choose(tl_exchange *exchange, int64_t first, tl_time (*now)(void *clock), void *clock,
                               bool *taken, tl_error *error);

#endif
