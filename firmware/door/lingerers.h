/* Connections that were answered before all they send was read.
 *
 * Purpose: closing one at once would have the kernel tell the other end that it broke, and the answer is lost on the way. So what comes is thrown away for a
 *          moment, unread, until the other end closes.
 * Bound:   TL_LINGERERS of them, each for a second and so many bytes.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_DOOR_LINGERERS_H
#define TL_FIRMWARE_DOOR_LINGERERS_H

#include "master/base/simtime.h"

enum { TL_LINGERERS = 8, TL_LINGERER_BYTES = 1024 * 1024 };

typedef struct tl_lingerer {
    int socket; /* 0: none */
    int left;   /* bytes */
    tl_time until;
} tl_lingerer;

/* Begins as zeros. */
typedef struct tl_lingerers {
    tl_lingerer rows[TL_LINGERERS];
} tl_lingerers;

/* Takes a duplicate of the socket, if there is room. */
void tl_lingerers_add(tl_lingerers *lingerers, int socket, tl_time now);

/* Throws away what has come, and closes what is done. */
void tl_lingerers_look(tl_lingerers *lingerers, tl_time now);

#endif
