/* CSV rows from a FIFO or a growing file: see csv_live.h. */
#include "board/csv/csv_live.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "board/csv/csv.h"
#include "board/csv/csv_table.h"
#include "board/io/link.h"
#include "board/io/monotonic.h"
#include "board/io/wake.h"

/* ---- Maps row times to our clock. */

static void open_window(tl_csv_anchor *anchor, tl_time arrival) {
    anchor->quickest = INT64_MAX;
    anchor->window = arrival + TL_CSV_DRIFT_WINDOW;
}

void tl_csv_anchor_set(tl_csv_anchor *anchor, tl_time time, tl_time arrival) {
    anchor->set = true;
    anchor->base = arrival - time;
    open_window(anchor, arrival);
}

tl_time tl_csv_anchor_stamp(tl_csv_anchor *anchor, tl_time time, tl_time arrival) {
    tl_time delay = arrival - (anchor->base + time);
    if (delay < 0) {
        anchor->base += delay;
        delay = 0;
    }
    anchor->quickest = delay < anchor->quickest ? delay : anchor->quickest;
    if (arrival >= anchor->window) {
        anchor->base += anchor->quickest;
        open_window(anchor, arrival);
    }
    return anchor->base + time;
}

/* ---- Live CSV driver: a file played in its own time, or a FIFO. */

enum {
    WAIT_MS = 50,
    READS = 16,      /* most per poll, however fast the writer is */
    TEXT = 512 + 96, /* an error and its context */
};

struct tl_plant_io {
    tl_csv_table table;
    tl_csv_row row;
    int file; /* −1: not open */
    tl_wake wake;
    bool is_file;
    bool at_end;    /* of a regular file */
    bool row_waits; /* `row` of a regular file is not due yet */
    bool went_back; /* the time of the row before did not increase */
    tl_csv_anchor anchor;
    tl_time time; /* of the row before, if the anchor is set */
    tl_link state;
    tl_time report_due; /* earliest time of the next report about a row */
    uint64_t skipped;   /* rows since the last report */
    tl_csv_lines lines;
    char copy[TL_CSV_LINE + 1];
};

/* ---- reports and posts ---- */

static void set_link(tl_plant_io *io, const tl_plant_io_sink *sink, bool up, const char *text) {
    (void)tl_link_set(&io->state, sink, up, io->table.path, text);
}

static void post_no_link(const tl_plant_io *io, const tl_plant_io_sink *sink) {
    tl_reading reading = {.value = 0, .stamp = tl_monotonic_now(), .quality = TL_NO_LINK};
    for (size_t i = 0; i < io->table.column_count; i++) {
        sink->post(sink->context, i, &reading);
    }
}

static void post_row(const tl_plant_io *io, const tl_plant_io_sink *sink, tl_time stamp) {
    for (size_t i = 0; i < io->table.column_count; i++) {
        if (io->row.present[i]) {
            tl_reading reading = {.value = io->row.values[i], .stamp = stamp, .quality = io->row.quality[i]};
            sink->post(sink->context, i, &reading);
        }
    }
}

/* Reports a malformed row of a FIFO, at most once per second. */
static void report_skipped(tl_plant_io *io, const tl_plant_io_sink *sink, const char *text) {
    io->skipped++;
    if (tl_monotonic_now() >= io->report_due) {
        char whole[TEXT];
        (void)snprintf(whole, sizeof whole, "%s; skipped (%llu since the last report)", text,
                       (unsigned long long)io->skipped);
        io->report_due = tl_monotonic_now() + TL_SECOND;
        io->skipped = 0;
        tl_link_report(&io->state, sink, false, NULL, whole);
    }
}

/* ---- reading ---- */

/* Opens the present file, then closes the old one, so that a writer always finds a reader. */
static bool open_path(tl_plant_io *io, const tl_plant_io_sink *sink) {
    bool is_device = tl_csv_is_device(io->table.path);
    int file = is_device ? -1 : open(io->table.path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    int failure = errno;
    struct stat what;
    if (file >= 0 && (fstat(file, &what) != 0 || S_ISDIR(what.st_mode))) {
        (void)close(file);
        file = -1;
        failure = EISDIR;
    }
    if (io->file >= 0) {
        (void)close(io->file);
    }
    io->file = file;
    if (file < 0) {
        char cause[TEXT];
        (void)snprintf(cause, sizeof cause, "cannot be opened: %s: check the path, or start the writer",
                       strerror(failure));
        set_link(io, sink, false, is_device ? "this is a device (expected a file or a FIFO)" : cause);
        return false;
    }
    io->is_file = S_ISREG(what.st_mode) != 0;
    return true;
}

/* Reads available bytes. 0: the end; −1: none now. */
static ssize_t read_some(tl_plant_io *io) {
    size_t room = 0;
    char *bytes = tl_csv_lines_room(&io->lines, &room);
    ssize_t count = read(io->file, bytes, room);
    if (count > 0) {
        tl_csv_lines_added(&io->lines, (size_t)count);
    }
    return count;
}

/* ---- a regular file ---- */

/* Reads the next row into io->row; sets io->at_end if there is none. */
static tl_status next_row(tl_plant_io *io, tl_error *error) {
    char *line = NULL;
    for (;;) {
        bool drained = io->at_end;
        tl_csv_found found = tl_csv_lines_take(&io->lines, drained, &line);
        if (found == TL_CSV_TOO_LONG) {
            return tl_csv_table_too_long(&io->table, io->lines.number, error);
        }
        if (found == TL_CSV_A_LINE && io->table.cell_count > 0) {
            tl_status status = tl_csv_table_row(&io->table, line, io->lines.number, &io->row, error);
            io->row_waits = status == TL_OK;
            return status;
        }
        if (found == TL_CSV_A_LINE) {
            tl_status status = tl_csv_table_header(&io->table, line, io->lines.number, error);
            if (status != TL_OK) {
                return status;
            }
        } else if (drained) {
            return TL_OK;
        } else {
            ssize_t count = read_some(io);
            if (count < 0 && errno != EINTR && errno != EAGAIN) {
                return tl_fail(error, TL_BAD_DATA, "%s: cannot be read: %s", io->table.path, strerror(errno));
            }
            io->at_end = count == 0;
        }
    }
}

static tl_status check_order(const tl_plant_io *io, tl_error *error) {
    if (io->anchor.set && io->row.time <= io->time) {
        return tl_fail(
            error, TL_BAD_DATA,
            "%s, line %lld: the time %.9f s is not after %.9f s in the row before: remove the row, or correct its time",
            io->table.path, (long long)io->lines.number, tl_seconds(io->row.time), tl_seconds(io->time));
    }
    return TL_OK;
}

/* Posts every row that is due. */
static tl_status play_file(tl_plant_io *io, const tl_plant_io_sink *sink, bool *finished, tl_error *error) {
    for (;;) {
        if (!io->row_waits) {
            tl_status status = next_row(io, error);
            if (status == TL_OK && io->table.cell_count == 0) {
                status =
                    tl_fail(error, TL_BAD_DATA,
                            "%s: the file is empty (expected a header with the names of its columns)", io->table.path);
            }
            if (status == TL_OK && io->row_waits) {
                status = check_order(io, error);
            }
            if (status != TL_OK) {
                return status;
            }
            set_link(io, sink, true, "open");
            if (!io->row_waits) {
                *finished = true;
                return TL_OK;
            }
            if (!io->anchor.set) {
                tl_csv_anchor_set(&io->anchor, io->row.time, tl_monotonic_now());
            }
            io->time = io->row.time;
        }
        tl_time due = io->anchor.base + io->row.time;
        if (due > tl_monotonic_now()) {
            return TL_OK;
        }
        io->row_waits = false;
        post_row(io, sink, due);
    }
}

/* ---- a FIFO ---- */

/* Checks that the time of a row increases. Returns false for the first row whose time does not. If
 * the next row's time does not increase either, the writer has restarted. */
static bool in_time(tl_plant_io *io, tl_time at) {
    bool back = io->anchor.set && io->row.time <= io->time;
    if (back && !io->went_back) {
        io->went_back = true;
        return false;
    }
    if (back || !io->anchor.set) {
        tl_csv_anchor_set(&io->anchor, io->row.time, at);
    }
    io->went_back = false;
    io->time = io->row.time;
    return true;
}

static void take_line(tl_plant_io *io, const tl_plant_io_sink *sink, char *line) {
    tl_error why_no_row = {.status = TL_OK};
    tl_error why_no_header = {.status = TL_OK};
    bool had_header = io->table.cell_count > 0;
    memcpy(io->copy, line, strlen(line) + 1);
    if (had_header && tl_csv_table_row(&io->table, io->copy, io->lines.number, &io->row, &why_no_row) == TL_OK) {
        tl_time at = tl_monotonic_now();
        if (in_time(io, at)) {
            set_link(io, sink, true, "rows arrive");
            post_row(io, sink, tl_csv_anchor_stamp(&io->anchor, io->row.time, at));
        } else {
            (void)tl_fail(&why_no_row, TL_BAD_DATA, "%s, line %lld: the time goes back from %.9f s to %.9f s",
                          io->table.path, (long long)io->lines.number, tl_seconds(io->time), tl_seconds(io->row.time));
            report_skipped(io, sink, why_no_row.text);
        }
    } else if (tl_csv_table_header(&io->table, line, io->lines.number, &why_no_header) == TL_OK) {
        io->anchor.set = false; /* the writer has restarted */
    } else {
        report_skipped(io, sink, had_header ? why_no_row.text : why_no_header.text);
    }
}

static void take_lines(tl_plant_io *io, const tl_plant_io_sink *sink) {
    for (;;) {
        char *line = NULL;
        tl_csv_found found = tl_csv_lines_take(&io->lines, false, &line);
        if (found == TL_CSV_NOTHING) {
            return;
        }
        if (found == TL_CSV_A_LINE) {
            take_line(io, sink, line);
        } else {
            tl_error error;
            (void)tl_csv_table_too_long(&io->table, io->lines.number, &error);
            report_skipped(io, sink, error.text);
        }
    }
}

/* Handles a missing writer. */
static void lose_writer(tl_plant_io *io, const tl_plant_io_sink *sink) {
    bool had_one = tl_link_is_up(&io->state);
    tl_csv_lines_drop(&io->lines);
    io->anchor.set = false;
    io->went_back = false;
    set_link(io, sink, false,
             had_one ? "the writer closed it: restart the writer" : "no program writes to it: start the writer");
}

/* Waits for bytes or an interruption. Returns false if there is nothing to read. */
static bool await(tl_plant_io *io) {
    struct pollfd both[2] = {{.fd = io->file, .events = POLLIN}, {.fd = io->wake.descriptor, .events = POLLIN}};
    return poll(both, 2, WAIT_MS) > 0 && !tl_wake_clear(&io->wake) && (both[0].revents & POLLIN) != 0;
}

typedef enum drained { DRAINED_NOTHING, DRAINED_SOME, DRAINED_END } drained;

/* Reads all available bytes. */
static drained drain(tl_plant_io *io, const tl_plant_io_sink *sink) {
    drained result = DRAINED_NOTHING;
    for (int i = 0; i < READS; i++) {
        ssize_t count = read_some(io);
        if (count == 0) {
            return DRAINED_END;
        }
        if (count < 0) {
            break;
        }
        result = DRAINED_SOME;
        take_lines(io, sink);
    }
    return result;
}

static void read_stream(tl_plant_io *io, const tl_plant_io_sink *sink) {
    drained result = drain(io, sink);
    if (result == DRAINED_END) {
        lose_writer(io, sink);
        post_no_link(io, sink);
        if (!open_path(io, sink)) { /* clears the hang-up, and finds a FIFO that was created again */
            return;
        }
    }
    if (result != DRAINED_SOME && await(io)) {
        (void)drain(io, sink); /* if the end follows, the next poll finds it again */
    }
}

/* ---- the driver ---- */

static tl_status csv_poll(tl_plant_io *io, const tl_plant_io_sink *sink, bool *finished, tl_error *error) {
    *finished = false;
    if (tl_wake_clear(&io->wake)) {
        return TL_OK;
    }
    if (io->file < 0 && !open_path(io, sink)) {
        post_no_link(io, sink);
        return TL_OK;
    }
    if (io->is_file) {
        return play_file(io, sink, finished, error);
    }
    read_stream(io, sink);
    return TL_OK;
}

static void csv_interrupt(tl_plant_io *io) {
    tl_wake_call(&io->wake);
}

static void csv_close(tl_plant_io *io) {
    if (io->file >= 0) {
        (void)close(io->file);
    }
    tl_wake_release(&io->wake);
    tl_csv_table_release(&io->table);
    free(io);
}

const tl_plant_access tl_csv_access = {.tcp = false};

const tl_plant_io_driver tl_csv_driver = {
    .name = "csv", .poll = csv_poll, .interrupt = csv_interrupt, .close = csv_close};

tl_status tl_csv_open_live(const tl_csv_settings *settings, tl_plant_io **io, tl_error *error) {
    tl_plant_io *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", settings->path);
    }
    tl_status status = tl_csv_table_make(&made->table, settings, error);
    if (status != TL_OK) {
        free(made);
        return status;
    }
    made->file = -1;
    if (!tl_wake_make(&made->wake)) {
        status =
            tl_fail(error, TL_TRY_AGAIN, "%s: cannot create an event descriptor: %s", settings->path, strerror(errno));
        tl_csv_table_release(&made->table);
        free(made);
        return status;
    }
    *io = made;
    return TL_OK;
}
