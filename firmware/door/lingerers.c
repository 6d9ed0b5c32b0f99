/* Lingering: see lingerers.h. */
#include "firmware/door/lingerers.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>
#include <unistd.h>

enum { PIECE = 16 * 1024 };

void tl_lingerers_add(tl_lingerers *lingerers, int socket, tl_time now) {
    for (size_t i = 0; i < TL_LINGERERS; i++) {
        tl_lingerer *row = &lingerers->rows[i];
        if (row->socket > 0) {
            continue;
        }
        row->socket = fcntl(socket, F_DUPFD_CLOEXEC, 3);
        if (row->socket > 0) {
            (void)shutdown(row->socket, SHUT_WR);
            row->left = TL_LINGERER_BYTES;
            row->until = now + TL_SECOND;
        }
        return;
    }
}

/* False: it is done with. */
static bool throw_away(tl_lingerer *row) {
    char piece[PIECE];
    ssize_t got = 0;
    do {
        got = recv(row->socket, piece, sizeof piece, MSG_DONTWAIT);
        row->left -= got > 0 ? (int)got : 0;
    } while (got > 0 && row->left > 0);
    return got < 0 && (errno == EAGAIN || errno == EINTR) && row->left > 0;
}

void tl_lingerers_look(tl_lingerers *lingerers, tl_time now) {
    for (size_t i = 0; i < TL_LINGERERS; i++) {
        tl_lingerer *row = &lingerers->rows[i];
        if (row->socket > 0 && (!throw_away(row) || now >= row->until)) {
            (void)close(row->socket);
            row->socket = 0;
        }
    }
}
