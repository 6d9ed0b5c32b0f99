/* Writes CSV rows with a bounded delay.
 *
 * A row is shorter than PIPE_BUF, so a FIFO accepts all of it or nothing, and the reader gets only
 * whole rows.
 */
#include "firmware/cli/plant_stream.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "master/base/signal.h"

#define TIMEOUT (TL_SECOND / 20)

enum { NUMBER = 32, ROW = NUMBER * (TL_MAX_SIGNALS + 2) }; /* bytes of a cell with its comma, and of a row */

_Static_assert(ROW <= PIPE_BUF, "a FIFO takes a row as a whole");

struct tl_plant_stream {
    char *path;
    bool is_fifo;
    int file; /* −1: there is no reader */
    size_t column_count;
    char *header;
    size_t header_size;
    int failure; /* errno of a failed write to a file; 0: none */
    tl_plant_stream_counts counts;
};

/* ---- texts ---- */

/* Writes a cell of the header, in quotes if its name needs them. */
static void put_name(FILE *file, const char *name) {
    const char *quote = name[strcspn(name, "\",; \t")] != '\0' ? "\"" : "";
    (void)fputs(quote, file);
    for (; *name != '\0'; name++) {
        (void)fputs(*name == '"' ? "\"" : "", file);
        (void)fputc(*name, file);
    }
    (void)fputs(quote, file);
}

static bool make_header(tl_plant_stream *stream, const tl_plant_stream_settings *settings) {
    FILE *file = open_memstream(&stream->header, &stream->header_size);
    if (file == NULL) {
        return false;
    }
    put_name(file, settings->time_column);
    for (size_t i = 0; i < settings->column_count; i++) {
        (void)fputc(',', file);
        put_name(file, settings->columns[i]);
    }
    (void)fputc('\n', file);
    return fclose(file) == 0;
}

/* The 17 digits are read back to the same bits; the time is exact to 1 ns. */
static size_t format_row(const tl_plant_stream *stream, tl_time time, const double *values, const bool *present,
                         char text[ROW]) {
    uint64_t size = time < 0 ? 0 - (uint64_t)time : (uint64_t)time;
    int length = snprintf(text, ROW, "%s%" PRIu64 ".%09" PRIu64, time < 0 ? "-" : "", size / (uint64_t)TL_SECOND,
                          size % (uint64_t)TL_SECOND);
    for (size_t i = 0; i < stream->column_count; i++) {
        bool empty = (present != NULL && !present[i]) || !isfinite(values[i]);
        text[length++] = ',';
        if (!empty) {
            length += snprintf(text + length, ROW - (size_t)length, "%.17g", values[i]);
        }
    }
    text[length] = '\n';
    return (size_t)length + 1;
}

/* ---- writing ---- */

static void close_fifo(tl_plant_stream *stream) {
    (void)close(stream->file);
    stream->file = -1;
}

/* Waits until more can be written. Returns false if the deadline is reached. */
static bool wait_writable(const tl_plant_stream *stream, tl_time deadline) {
    tl_time remaining = deadline - tl_clock_now(NULL);
    struct pollfd writable = {.fd = stream->file, .events = POLLOUT};
    return remaining > 0 && poll(&writable, 1, (int)(remaining / 1000000) + 1) != 0;
}

/* Returns false if not everything could be written before the deadline. If the write fails, a FIFO
 * is closed until there is a new reader; a file stays open. */
static bool write_text(tl_plant_stream *stream, const char *text, size_t size, tl_time deadline) {
    for (size_t sent = 0; sent < size;) {
        ssize_t count = write(stream->file, text + sent, size - sent);
        if (count >= 0) {
            sent += (size_t)count;
        } else if (errno == EAGAIN) {
            if (!wait_writable(stream, deadline)) {
                return false;
            }
        } else if (errno != EINTR) {
            stream->failure = stream->is_fifo ? 0 : errno;
            if (stream->is_fifo) {
                close_fifo(stream);
            }
            return false;
        }
    }
    return true;
}

/* Each new reader first gets the header. */
static bool open_reader(tl_plant_stream *stream, tl_time deadline) {
    if (stream->file < 0 && stream->is_fifo) {
        stream->file = open(stream->path, O_WRONLY | O_NONBLOCK | O_CLOEXEC);
        if (stream->file >= 0 && !write_text(stream, stream->header, stream->header_size, deadline) &&
            stream->file >= 0) {
            close_fifo(stream);
        }
    }
    return stream->file >= 0;
}

bool tl_plant_stream_row(tl_plant_stream *stream, tl_time time, const double *values, const bool *present) {
    char text[ROW];
    tl_time deadline = tl_clock_now(NULL) + TIMEOUT;
    bool written = open_reader(stream, deadline) &&
                   write_text(stream, text, format_row(stream, time, values, present, text), deadline);
    stream->counts.written += written ? 1 : 0;
    stream->counts.dropped += written ? 0 : 1;
    return written;
}

tl_status tl_plant_stream_check(const tl_plant_stream *stream, tl_error *error) {
    return stream->failure == 0 ? TL_OK
                                : tl_fail(error, TL_TRY_AGAIN, "%s: cannot be written: %s (after %" PRIu64 " rows)",
                                          stream->path, strerror(stream->failure), stream->counts.written);
}

tl_plant_stream_counts tl_plant_stream_count(const tl_plant_stream *stream) {
    return stream->counts;
}

/* ---- open and close ---- */

static tl_status open_path(tl_plant_stream *stream, const tl_plant_stream_settings *settings, tl_error *error) {
    struct stat about;
    if (settings->make_fifo && mkfifo(settings->path, 0666) != 0 && errno != EEXIST) {
        return tl_fail(error, TL_BAD_DATA, "%s: cannot create the FIFO: %s", settings->path, strerror(errno));
    }
    bool exists = stat(settings->path, &about) == 0;
    stream->is_fifo = exists && S_ISFIFO(about.st_mode);
    if (stream->is_fifo) {
        return TL_OK; /* opened with the first row for which there is a reader */
    }
    stream->file = open(settings->path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (stream->file < 0) {
        return tl_fail(error, TL_BAD_DATA, "%s cannot be written: %s%s", settings->path, strerror(errno),
                       exists && S_ISREG(about.st_mode) ? "; remove it, or create a FIFO of this name with mkfifo"
                       : exists                         ? "; give the name of a file that does not exist yet"
                                                        : "");
    }
    (void)write_text(stream, stream->header, stream->header_size, 0);
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
    if (made->path == NULL || !make_header(made, settings)) {
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
    free(stream);
}
