/* Writes CSV rows without ever waiting long.
 *
 * At most one text is on its way: the header, or a row of which the first bytes were taken. The next row waits for the
 * rest of it, within its 50 ms, so the reader sees whole rows or none.
 */
#include "firmware/cli/plant_stream.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"

#define PATIENCE (TL_SECOND / 20)

enum { NUMBER = 32 }; /* bytes of one cell and its comma */

struct tl_plant_stream {
    char *path;
    bool is_fifo;
    int file; /* −1: nobody reads */
    size_t column_count;
    char *header;
    char *text;  /* on its way; room for the header and for any row */
    size_t room; /* of it */
    size_t length;
    size_t sent;
    int failure; /* errno of a file that cannot be written; 0: none */
    tl_plant_stream_counts counts;
};

/* ---- texts ---- */

/* Writes a cell of the header, quoted where its name needs it, and what ends it. Returns where the next one goes. */
static char *put_name(char *to, const char *name, char end) {
    bool quoted = name[strcspn(name, "\",; \t")] != '\0';
    if (quoted) {
        *to++ = '"';
    }
    for (; *name != '\0'; name++) {
        if (*name == '"') {
            *to++ = '"';
        }
        *to++ = *name;
    }
    if (quoted) {
        *to++ = '"';
    }
    *to++ = end;
    return to;
}

/* The most that a name takes: each character doubled, two quotes, a comma, a zero byte. */
static size_t room_of(const char *name) {
    return 2 * strlen(name) + 4;
}

static bool make_texts(tl_plant_stream *stream, const tl_plant_stream_settings *settings) {
    size_t header_room = room_of(settings->time_column);
    for (size_t i = 0; i < settings->column_count; i++) {
        header_room += room_of(settings->columns[i]);
    }
    size_t row_room = NUMBER * (settings->column_count + 2);
    stream->room = header_room > row_room ? header_room : row_room;
    stream->header = malloc(header_room);
    stream->text = malloc(stream->room);
    if (stream->header == NULL || stream->text == NULL) {
        return false;
    }
    char *to = put_name(stream->header, settings->time_column, settings->column_count > 0 ? ',' : '\n');
    for (size_t i = 0; i < settings->column_count; i++) {
        to = put_name(to, settings->columns[i], i + 1 < settings->column_count ? ',' : '\n');
    }
    *to = '\0';
    return true;
}

static void put_header(tl_plant_stream *stream) {
    stream->length = strlen(stream->header);
    memcpy(stream->text, stream->header, stream->length);
    stream->sent = 0;
}

/* Numbers come back as the same bits; the time is exact to the nanosecond. */
static void put_row(tl_plant_stream *stream, tl_time time, const double *values, const bool *present) {
    uint64_t size = time < 0 ? 0 - (uint64_t)time : (uint64_t)time;
    int length = snprintf(stream->text, stream->room, "%s%" PRIu64 ".%09" PRIu64, time < 0 ? "-" : "",
                          size / (uint64_t)TL_SECOND, size % (uint64_t)TL_SECOND);
    for (size_t i = 0; i < stream->column_count; i++) {
        bool empty = (present != NULL && !present[i]) || !isfinite(values[i]);
        stream->text[length++] = ',';
        if (!empty) {
            length += snprintf(stream->text + length, stream->room - (size_t)length, "%.17g", values[i]);
        }
    }
    stream->text[length] = '\n';
    stream->length = (size_t)length + 1;
    stream->sent = 0;
}

/* ---- writing ---- */

/* Is there somebody to write to? A new one gets the header first. */
static bool has_reader(tl_plant_stream *stream) {
    if (stream->file < 0 && stream->is_fifo) {
        stream->file = open(stream->path, O_WRONLY | O_NONBLOCK | O_CLOEXEC);
        put_header(stream);
    }
    return stream->file >= 0;
}

static void lose_reader(tl_plant_stream *stream) {
    (void)close(stream->file);
    stream->file = -1;
    stream->length = 0;
    stream->sent = 0;
}

/* A FIFO loses its reader and may get another one; a file stays as it is. */
static void fail(tl_plant_stream *stream, int reason) {
    if (stream->is_fifo) {
        lose_reader(stream);
    } else {
        stream->failure = reason;
    }
}

/* Waits until more can be written. false where it is too late for that. */
static bool wait_for_room(const tl_plant_stream *stream, tl_time deadline) {
    tl_time left = deadline - tl_clock_now(NULL);
    struct pollfd room = {.fd = stream->file, .events = POLLOUT};
    return left > 0 && poll(&room, 1, (int)(left / 1000000) + 1) != 0;
}

/* Writes what is on its way. false where not all of it is gone by then. */
static bool flush(tl_plant_stream *stream, tl_time deadline) {
    while (stream->sent < stream->length) {
        ssize_t count = write(stream->file, stream->text + stream->sent, stream->length - stream->sent);
        if (count >= 0) {
            stream->sent += (size_t)count;
        } else if (errno == EAGAIN) {
            if (!wait_for_room(stream, deadline)) {
                return false;
            }
        } else if (errno != EINTR) {
            fail(stream, errno);
            return false;
        }
    }
    return true;
}

static bool write_row(tl_plant_stream *stream, tl_time time, const double *values, const bool *present) {
    tl_time deadline = tl_clock_now(NULL) + PATIENCE;
    if (!has_reader(stream) || !flush(stream, deadline)) {
        return false;
    }
    put_row(stream, time, values, present);
    if (!flush(stream, deadline) && (stream->sent == 0 || stream->failure != 0)) {
        stream->length = 0;
        return false;
    }
    return true; /* what is left of it goes before the next one */
}

bool tl_plant_stream_row(tl_plant_stream *stream, tl_time time, const double *values, const bool *present) {
    bool written = write_row(stream, time, values, present);
    stream->counts.written += written ? 1 : 0;
    stream->counts.dropped += written ? 0 : 1;
    return written;
}

tl_status tl_plant_stream_check(const tl_plant_stream *stream, tl_error *error) {
    return stream->failure == 0 ? TL_OK
                                : tl_fail(error, TL_TRY_AGAIN, "%s: cannot be written: %s (rows before: %" PRIu64 ")",
                                          stream->path, strerror(stream->failure), stream->counts.written);
}

tl_plant_stream_counts tl_plant_stream_count(const tl_plant_stream *stream) {
    return stream->counts;
}

/* ---- open and close ---- */

static tl_status open_path(tl_plant_stream *stream, const tl_plant_stream_settings *settings, tl_error *error) {
    struct stat what;
    if (settings->make_fifo && mkfifo(settings->path, 0666) != 0 && errno != EEXIST) {
        return tl_fail(error, TL_BAD_DATA, "%s: no FIFO can be made: %s", settings->path, strerror(errno));
    }
    bool is_there = stat(settings->path, &what) == 0;
    stream->is_fifo = is_there && S_ISFIFO(what.st_mode);
    if (stream->is_fifo) {
        return TL_OK; /* opened when a row is there and somebody reads */
    }
    stream->file = open(settings->path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (stream->file < 0) {
        return tl_fail(error, TL_BAD_DATA, "%s cannot be written: %s%s", settings->path, strerror(errno),
                       is_there && S_ISREG(what.st_mode) ? "; remove it, or make a FIFO of that name with mkfifo"
                       : is_there                        ? "; give the name of a file that is not there yet"
                                                         : "");
    }
    put_header(stream);
    (void)flush(stream, 0);
    return tl_plant_stream_check(stream, error);
}

tl_status tl_plant_stream_open(const tl_plant_stream_settings *settings, tl_plant_stream **stream, tl_error *error) {
    tl_plant_stream *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    (void)signal(SIGPIPE, SIG_IGN);
    made->file = -1;
    made->column_count = settings->column_count;
    made->path = strdup(settings->path);
    tl_status status = TL_OK;
    if (made->path == NULL || !make_texts(made, settings)) {
        status = tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    } else {
        status = open_path(made, settings, error);
    }
    if (status != TL_OK) {
        tl_plant_stream_close(made);
        return status;
    }
    *stream = made;
    return TL_OK;
}

void tl_plant_stream_close(tl_plant_stream *stream) {
    if (stream->file >= 0) {
        (void)close(stream->file);
    }
    free(stream->path);
    free(stream->header);
    free(stream->text);
    free(stream);
}
