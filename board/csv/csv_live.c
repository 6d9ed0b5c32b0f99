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

/* ---- Live CSV driver: a file that is played and then followed, or a FIFO. */

enum {
    WAIT_MS = 50,
    READS = 16,      /* most per poll, however fast the writer is */
    TEXT = 512 + 96, /* an error and its context */
    GAPS = 10,       /* a file is silent after this many times the distance of its last two rows */
};

/* A file whose rows are closer together is silent after this time. */
static const tl_time SILENCE = 2 * TL_SECOND;

struct tl_plant_io {
    tl_csv_table table;
    tl_csv_row row;
    int file; /* −1: not open */
    tl_wake wake;
    tl_csv_anchor anchor;
    tl_time time; /* of the row before, if the anchor is set */
    tl_link state;
    tl_time report_due; /* earliest time of the next report about a row */
    uint64_t skipped;   /* rows since the last report */
    /* a row whose time did not increase; the next row decides whether it is used */
    tl_csv_row held;
    tl_time held_at; /* its arrival */
    bool has_held;
    /* of a regular file: */
    bool is_file;
    bool was_opened;
    bool plays;     /* its rows are posted when they are due; false: as they arrive */
    bool row_waits; /* `row` is not due yet */
    bool repeats;   /* rows that are not after `time` may be those of the file before */
    bool is_silent; /* it was reported that no row comes */
    off_t offset;   /* bytes read */
    off_t old;      /* bytes when it was opened; their rows are only played */
    tl_time gap;    /* between the times of the last two rows */
    tl_time posted; /* last row, CLOCK_MONOTONIC */
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

static void post_row(tl_plant_io *io, const tl_plant_io_sink *sink, const tl_csv_row *row, tl_time stamp) {
    for (size_t i = 0; i < io->table.column_count; i++) {
        if (row->present[i]) {
            tl_reading reading = {.value = row->values[i], .stamp = stamp, .quality = row->quality[i]};
            sink->post(sink->context, i, &reading);
        }
    }
    io->posted = tl_monotonic_now();
    if (io->is_silent) {
        io->is_silent = false;
        tl_link_report(&io->state, sink, true, io->table.path, "new rows arrive again");
    }
}

/* Reports a row that is not used, at most once per second. */
static void report_skipped(tl_plant_io *io, const tl_plant_io_sink *sink, const char *text) {
    io->skipped++;
    if (tl_monotonic_now() >= io->report_due) {
        char whole[TEXT];
        (void)snprintf(whole, sizeof whole, "%s; skipped (%llu since the last report)", text,
                       (unsigned long long)io->skipped);
        io->report_due = tl_monotonic_now() + TL_SECOND;
        io->skipped = 0;
        (void)tl_link_change(&io->state, tl_link_is_up(&io->state)); /* unknown: down */
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
    io->plays = io->is_file && !io->was_opened;
    io->old = io->plays ? what.st_size : 0;
    io->repeats = io->is_file && !io->plays;
    io->was_opened = true;
    io->offset = 0;
    return true;
}

/* Reads available bytes. 0: the end; −1: none now. */
static ssize_t read_some(tl_plant_io *io) {
    size_t room = 0;
    char *bytes = tl_csv_lines_room(&io->lines, &room);
    ssize_t count = read(io->file, bytes, room);
    if (count > 0) {
        tl_csv_lines_added(&io->lines, (size_t)count);
        io->offset += count;
    }
    return count;
}

/* ---- rows ---- */

static void hold_row(tl_plant_io *io, tl_time at) {
    io->held = io->row;
    io->held_at = at;
    io->has_held = true;
}

/* The time was set back: the held row is the first one of the new time. */
static void begin_at_held(tl_plant_io *io, const tl_plant_io_sink *sink) {
    char text[TEXT];
    (void)snprintf(text, sizeof text, "the time goes back from %.9f s to %.9f s: its rows are used from there on",
                   tl_seconds(io->time), tl_seconds(io->held.time));
    io->has_held = false;
    io->time = io->held.time;
    tl_csv_anchor_set(&io->anchor, io->held.time, io->held_at);
    tl_link_report(&io->state, sink, true, io->table.path, text);
    post_row(io, sink, &io->held, io->held_at);
}

static void skip_held(tl_plant_io *io, const tl_plant_io_sink *sink) {
    tl_error error;
    io->has_held = false;
    (void)tl_fail(&error, TL_BAD_DATA, "%s, before line %lld: the time goes back from %.9f s to %.9f s once",
                  io->table.path, (long long)io->lines.number, tl_seconds(io->time), tl_seconds(io->held.time));
    report_skipped(io, sink, error.text);
}

/* Returns whether the row is used. The first row whose time does not increase is held. If the time
 * of the next one does not increase either, the time was set back, and both are used. */
static bool is_in_time(tl_plant_io *io, const tl_plant_io_sink *sink, tl_time at) {
    while (io->anchor.set && io->row.time <= io->time) {
        if (!io->has_held || io->repeats) {
            hold_row(io, at);
            return false;
        }
        begin_at_held(io, sink);
    }
    if (io->has_held && !io->repeats) {
        skip_held(io, sink);
    }
    io->has_held = false;
    io->repeats = false;
    io->gap = io->anchor.set ? io->row.time - io->time : 0;
    io->time = io->row.time;
    if (!io->anchor.set) {
        tl_csv_anchor_set(&io->anchor, io->row.time, at);
    }
    return true;
}

static void report_rows(tl_plant_io *io, const tl_plant_io_sink *sink) {
    char form[TL_CSV_FORM];
    char text[TEXT];
    if (!tl_link_is_up(&io->state)) {
        tl_csv_table_describe(&io->table, form);
        (void)snprintf(text, sizeof text, "%s%s%s", io->is_file ? "open" : "rows arrive",
                       form[0] != '\0' ? ", read with " : "", form);
        set_link(io, sink, true, text);
    }
}

static void take_row(tl_plant_io *io, const tl_plant_io_sink *sink) {
    tl_time at = tl_monotonic_now();
    if (io->is_file && !io->plays && io->offset - (off_t)(io->lines.end - io->lines.begin) <= io->old) {
        return; /* older than the file's growth */
    }
    if (is_in_time(io, sink, at)) {
        report_rows(io, sink);
        io->row_waits = io->plays;
        if (!io->plays) {
            post_row(io, sink, &io->row, tl_csv_anchor_stamp(&io->anchor, io->row.time, at));
        }
    }
}

static void take_line(tl_plant_io *io, const tl_plant_io_sink *sink, char *line) {
    tl_error why_no_row = {.status = TL_OK};
    tl_error why_no_header = {.status = TL_OK};
    bool had_header = io->table.cell_count > 0;
    bool is_units = false;
    memcpy(io->copy, line, strlen(line) + 1);
    if (had_header &&
        tl_csv_table_row(&io->table, io->copy, io->lines.number, &io->row, &is_units, &why_no_row) == TL_OK) {
        if (!is_units) {
            take_row(io, sink);
        }
    } else if (tl_csv_table_header(&io->table, line, io->lines.number, &why_no_header) == TL_OK) {
        io->anchor.set = io->anchor.set && io->repeats; /* else the writer has restarted */
        io->has_held = false;
    } else {
        report_skipped(io, sink, had_header ? why_no_row.text : why_no_header.text);
    }
}

/* Takes all lines that were read. Returns false if a row of a played file is not due yet. */
static bool take_lines(tl_plant_io *io, const tl_plant_io_sink *sink) {
    for (;;) {
        char *line = NULL;
        if (io->row_waits) {
            tl_time due = io->anchor.base + io->row.time;
            if (due > tl_monotonic_now()) {
                return false;
            }
            io->row_waits = false;
            post_row(io, sink, &io->row, due);
        }
        tl_csv_found found = tl_csv_lines_take(&io->lines, false, &line);
        if (found == TL_CSV_NOTHING) {
            return true;
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

typedef enum drained { DRAINED_NOTHING, DRAINED_SOME, DRAINED_END, DRAINED_FAILED } drained;

/* Reads all available bytes, of a played file up to a row that is not due yet. */
static drained drain(tl_plant_io *io, const tl_plant_io_sink *sink) {
    drained result = DRAINED_NOTHING;
    for (int i = 0; i < READS && take_lines(io, sink); i++) {
        ssize_t count = read_some(io);
        if (count == 0) {
            return DRAINED_END;
        }
        if (count < 0) {
            return errno == EAGAIN || errno == EINTR ? result : DRAINED_FAILED;
        }
        result = DRAINED_SOME;
    }
    return DRAINED_SOME;
}

/* ---- a regular file ---- */

/* The file has changed since it was opened: a program writes it. Its newest row is the present. */
static void begin_to_follow(tl_plant_io *io, const tl_plant_io_sink *sink) {
    io->plays = false;
    io->row_waits = false;
    io->has_held = false;
    io->anchor.set = false;
    if (tl_link_is_up(&io->state)) {
        tl_link_report(&io->state, sink, true, io->table.path,
                       "a program writes it: only new rows are used, as they arrive");
    }
}

/* Reads the file from its start again, after a writer has truncated it. */
static void rewind_file(tl_plant_io *io) {
    (void)lseek(io->file, 0, SEEK_SET);
    tl_csv_lines_drop(&io->lines);
    io->offset = 0;
    io->old = 0;
    io->repeats = true;
}

/* All rows of the file were used. */
static void note_end(tl_plant_io *io, const tl_plant_io_sink *sink) {
    tl_time silence = GAPS * io->gap > SILENCE ? GAPS * io->gap : SILENCE;
    if (io->repeats && io->has_held && io->held.time < io->time) {
        begin_at_held(io, sink); /* the writer has restarted */
    }
    io->has_held = io->has_held && !io->repeats;
    if (!tl_link_is_up(&io->state)) {
        set_link(io, sink, false, "it has no row yet: start the writer");
        post_no_link(io, sink);
    } else if (!io->is_silent && tl_monotonic_now() - io->posted > silence) {
        io->is_silent = true;
        tl_link_report(&io->state, sink, false, io->table.path,
                       "all its rows were used, and no new one arrives: check the writer; set stale_s, so that old "
                       "values are not used");
    }
}

static void read_file(tl_plant_io *io, const tl_plant_io_sink *sink) {
    struct stat own = {.st_size = io->offset};
    struct stat named;
    (void)fstat(io->file, &own);
    const bool is_replaced =
        stat(io->table.path, &named) == 0 && (named.st_ino != own.st_ino || named.st_dev != own.st_dev);
    if (io->plays && (is_replaced || own.st_size != io->old)) {
        begin_to_follow(io, sink);
    }
    if (own.st_size < io->offset || own.st_size < io->old) {
        rewind_file(io);
    }
    switch (drain(io, sink)) {
    case DRAINED_END:
        note_end(io, sink);
        if (is_replaced) {
            tl_csv_lines_drop(&io->lines);
            (void)open_path(io, sink);
        }
        break;
    case DRAINED_FAILED: {
        char cause[TEXT];
        (void)snprintf(cause, sizeof cause, "cannot be read: %s", strerror(errno));
        set_link(io, sink, false, cause);
        post_no_link(io, sink);
        (void)open_path(io, sink);
        break;
    }
    case DRAINED_NOTHING:
    case DRAINED_SOME:
        break;
    }
}

/* ---- a FIFO ---- */

/* Handles a missing writer. */
static void lose_writer(tl_plant_io *io, const tl_plant_io_sink *sink) {
    bool had_one = tl_link_is_up(&io->state);
    tl_csv_lines_drop(&io->lines);
    io->anchor.set = false;
    io->has_held = false;
    set_link(io, sink, false,
             had_one ? "the writer closed it: restart the writer" : "no program writes to it: start the writer");
}

/* Waits for bytes or an interruption. Returns false if there is nothing to read. */
static bool await(tl_plant_io *io) {
    struct pollfd both[2] = {{.fd = io->file, .events = POLLIN}, {.fd = io->wake.descriptor, .events = POLLIN}};
    return poll(both, 2, WAIT_MS) > 0 && !tl_wake_clear(&io->wake) && (both[0].revents & POLLIN) != 0;
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

static void csv_poll(tl_plant_io *io, const tl_plant_io_sink *sink) {
    if (tl_wake_clear(&io->wake)) {
        return;
    }
    if (io->file < 0 && !open_path(io, sink)) {
        post_no_link(io, sink);
    } else if (io->is_file) {
        read_file(io, sink);
    } else {
        read_stream(io, sink);
    }
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
