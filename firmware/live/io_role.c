/* io: the process that reads the plant: drivers, sockets, devices; no FMU, no database. See
 *     live_role.h.
 *
 * Each kind of source has its own process: the first process forks one for each further kind. So a
 * vulnerability in the parser of one network or bus gives no access to the sockets and devices of
 * another. All share the memory of the first process; each sample buffer and each heartbeat has one
 * writer.
 */
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/config/drivers.h"
#include "firmware/live/live_role.h"
#include "firmware/live/twin_slots.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"

enum { POLL_MS = 50, KINDS = TL_MAX_DRIVERS };

/* A process that reads one kind of source. */
typedef struct reader {
    pid_t process;
    int line; /* closes when that process ends; it sends a byte when its sources are open */
} reader;

/* Heartbeat timeout of the main thread while it opens or closes the sources. */
static const tl_time PATIENCE = 30 * TL_SECOND;

typedef struct io {
    tl_live_setup setup;
    tl_heartbeats *beats;
    tl_live_plant *plant;
    unsigned kinds; /* kinds of sources that this process reads */
    reader readers[KINDS];
    size_t reader_count;
    int first; /* reader: socket to the first process, closed at its end; else -1 */
} io;

static void on_link(void *context, const char *source, bool up, const char *text) {
    io *self = context;
    tl_journal_event(&self->setup.journal, -1, up ? TL_EVENT_INFO : TL_EVENT_WARNING, "plant", "%s: %s", source, text);
}

/* t_start of the live twin. If a twin in the other slot has another one, it is the older one. The
 * value is untrusted; it only sets the phase of polls. */
static tl_time run_start(void *context) {
    const io *self = context;
    tl_time newest = 0;
    for (int i = 0; i < TL_TWIN_SLOTS; i++) {
        const tl_live_twin_status *twin = self->setup.blocks[TL_LIVE_TWIN_STATUS + i].bytes;
        tl_time start = __atomic_load_n(&twin->start, __ATOMIC_RELAXED);
        newest = start > newest ? start : newest;
    }
    return newest;
}

static tl_status open_plant(io *self, tl_error *error) {
    tl_sample_buffer buffers[TL_MAX_SIGNALS];
    tl_sample_buffers_shape shape;
    tl_sample_buffers_shape_of(&self->setup.config, &shape);
    tl_sample_buffers_open(&shape, self->setup.blocks[TL_LIVE_SAMPLES].bytes, buffers);
    const tl_live_plant_settings settings = {.config = &self->setup.config,
                                             .kinds = self->kinds,
                                             .buffers = buffers,
                                             .beats = self->beats,
                                             .on_link = on_link,
                                             .run_start = run_start,
                                             .context = self};
    return tl_live_plant_open(&settings, &self->plant, error);
}

/* ---- one process for each kind of source ---- */

/* Called in a new reader. It ends when its socket closes; it ignores group signals. */
static void become_reader(io *self, pid_t first, int line, unsigned kind) {
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != first) {
        _exit(tl_exit_code(TL_TRY_AGAIN));
    }
    const struct sigaction ignored = {.sa_handler = SIG_IGN};
    (void)sigaction(SIGINT, &ignored, NULL);
    (void)sigaction(SIGTERM, &ignored, NULL);
    (void)sigaction(SIGHUP, &ignored, NULL);
    for (size_t i = 0; i < self->reader_count; i++) {
        (void)close(self->readers[i].line);
    }
    self->reader_count = 0;
    self->first = line;
    self->kinds = kind;
}

static tl_status start_reader(io *self, unsigned kind, tl_error *error) {
    int line[2];
    const pid_t first = getpid();
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, line) != 0) {
        return tl_fail(error, TL_TRY_AGAIN, "no socket for a process that reads sources: %s", strerror(errno));
    }
    pid_t process = fork();
    if (process == 0) {
        (void)close(line[0]);
        become_reader(self, first, line[1], kind);
        return TL_OK;
    }
    (void)close(line[1]);
    if (process < 0) {
        (void)close(line[0]);
        return tl_fail(error, TL_TRY_AGAIN, "no process to read sources: %s", strerror(errno));
    }
    self->readers[self->reader_count++] = (reader){.process = process, .line = line[0]};
    return TL_OK;
}

/* Returns in each of the processes, with its kind of source. */
static tl_status start_readers(io *self, tl_error *error) {
    tl_status status = TL_OK;
    self->first = -1;
    for (size_t i = 0; i < self->setup.config.source_count; i++) {
        self->kinds |= tl_driver_bit(self->setup.config.sources[i].driver);
    }
    for (unsigned kind = 1; self->first < 0 && kind < self->kinds && status == TL_OK; kind <<= 1) {
        if ((self->kinds & kind) != 0) {
            self->kinds &= ~kind;
            status = start_reader(self, kind, error);
        }
    }
    return status;
}

static tl_status reap_reader(reader *one, tl_error *error) {
    int how = 0;
    (void)close(one->line);
    one->line = -1;
    (void)waitpid(one->process, &how, 0);
    if (WIFSIGNALED(how)) {
        return tl_fail(error, TL_TRY_AGAIN, "process %ld, which reads sources, was ended by signal %d",
                       (long)one->process, WTERMSIG(how));
    }
    const int code = WEXITSTATUS(how);
    tl_status status = code == tl_exit_code(TL_PLANT_DOWN) ? TL_PLANT_DOWN : TL_TRY_AGAIN;
    status = code == tl_exit_code(TL_BAD_DATA) ? TL_BAD_DATA : status;
    return tl_fail(error, status, "process %ld, which reads sources, ended with exit code %d", (long)one->process,
                   code);
}

/* Called in the first process: waits until all others have opened their sources. */
static tl_status await_readers(io *self, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < self->reader_count && status == TL_OK; i++) {
        char opened = 0;
        status =
            tl_file_bytes_read(self->readers[i].line, &opened, 1) == 1 ? TL_OK : reap_reader(&self->readers[i], error);
    }
    return status;
}

static void end_readers(io *self) {
    for (size_t i = 0; i < self->reader_count; i++) {
        if (self->readers[i].line >= 0) {
            tl_error unused;
            (void)reap_reader(&self->readers[i], &unused);
        }
    }
}

/* Reports that all sources are open: a reader to the first process, the first process to the
 * supervisor. */
static tl_status announce_open(io *self, tl_error *error) {
    if (self->first >= 0) {
        return write(self->first, "", 1) == 1 ? TL_OK
                                              : tl_fail(error, TL_TRY_AGAIN, "the first process of io has ended");
    }
    tl_status status = await_readers(self, error);
    if (status == TL_OK) {
        tl_heartbeats_set_ready(self->beats);
    }
    return status;
}

/* Waits up to POLL_MS (50 ms), or until one of the other processes ends. */
static bool is_over(io *self, tl_error *error, tl_status *status) {
    struct pollfd lines[KINDS];
    const size_t count = self->first >= 0 ? 1 : self->reader_count;
    lines[0] = (struct pollfd){.fd = self->first};
    for (size_t i = 0; i < self->reader_count; i++) {
        lines[i] = (struct pollfd){.fd = self->readers[i].line};
    }
    if (poll(lines, count, POLL_MS) <= 0) {
        return tl_interrupt_requested() != NULL;
    }
    for (size_t i = 0; i < self->reader_count && *status == TL_OK; i++) {
        *status = lines[i].revents != 0 ? reap_reader(&self->readers[i], error) : TL_OK;
    }
    return true;
}

static tl_status read_sources(io *self, tl_thread_heartbeat *heartbeat, tl_error *error) {
    tl_status status = TL_OK;
    while (!is_over(self, error, &status)) {
        tl_thread_heartbeat_beat(heartbeat);
        tl_journal_drain(&self->setup.journal);
    }
    return status;
}

int tl_io_role_run(void) {
    static io self; /* one per process */
    tl_error error;
    tl_status status = tl_live_role_begin(TL_LIVE_IS_IO, &self.setup);
    if (status != TL_OK) {
        return tl_exit_code(status);
    }
    self.beats = self.setup.blocks[TL_LIVE_IO_BEATS].bytes;
    status = start_readers(&self, &error);
    tl_thread_heartbeat *heartbeat = tl_thread_heartbeat_start(self.beats, "io", PATIENCE);
    if (status == TL_OK) {
        status = tl_twin_slots_confine_io(&self.setup.config, self.kinds, &error);
    }
    if (status == TL_OK) {
        status = open_plant(&self, &error);
    }
    if (status == TL_OK) {
        status = announce_open(&self, &error);
    }
    const bool was_ready = status == TL_OK;
    if (status == TL_OK) {
        tl_thread_heartbeat_set_timeout(heartbeat, self.setup.config.realtime_hang + TL_SECOND / 1000 * 2 * POLL_MS);
        status = read_sources(&self, heartbeat, &error);
        tl_thread_heartbeat_set_timeout(heartbeat, PATIENCE);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    tl_live_plant_close(self.plant);
    end_readers(&self);
    tl_journal_end(&self.setup.journal);
    const int code = tl_exit_code(status);
    return self.first >= 0 ? code : tl_live_role_end(self.beats, was_ready, code);
}
