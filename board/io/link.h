/* The link to a device as a driver tells it: up, down, or not known yet.
 *
 * Purpose: a change is told once, in a sentence, by the sink's link(); trouble of a part is told with the link as it is.
 *          What "up" means, and whether a part's trouble is news, is each driver's own business.
 * Texts:   "WHO: TEXT", cut after TL_LINK_TEXT − 1 bytes. Who: the device, for people ("CAN interface can0"). Text: what
 *          happened and what to do about it.
 * Owner:   placed by its owner; no allocation. Thread: that of the driver's poll. Errors: none.
 */
#ifndef TL_BOARD_IO_LINK_H
#define TL_BOARD_IO_LINK_H

#include <stdbool.h>

#include "board/io/plant_io.h"

enum { TL_LINK_TEXT = 608 }; /* bytes: an error's text, the device's name, and the end */

typedef enum tl_link_state { TL_LINK_UNKNOWN, TL_LINK_DOWN, TL_LINK_UP } tl_link_state;

/* Zeroed: not known, so that the first state is told whichever it is. */
typedef struct tl_link {
    tl_link_state state;
} tl_link;

/* false also where it is not known yet. */
bool tl_link_is_up(const tl_link *link);

/* The link is up, or down, and nothing is told. true if that is news. */
bool tl_link_change(tl_link *link, bool up);

/* Tells a text, with the link as it is. */
void tl_link_tell(const tl_link *link, const tl_plant_io_sink *sink, const char *who, const char *text);

/* Both: the link is up, or down, and if that is news, it is told. true if it is. */
bool tl_link_set(tl_link *link, const tl_plant_io_sink *sink, bool up, const char *who, const char *text);

#endif
