/* GPIO driver: searches its lines, waits for edges, and reads levels.
 *
 * If a chip was removed, waiting for its lines returns at once, for ever. So each end of a wait
 * without an edge costs a part of the line's budget in this poll, as an edge does. The level, which
 * is read in each poll, shows that the chip is gone.
 */
#include "board/gpio/gpio.h"

#include <errno.h>
#include <linux/gpio.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>

#include "board/gpio/gpio_input.h"
#include "board/gpio/gpio_lines.h"
#include "board/io/link.h"
#include "board/io/monotonic.h"
#include "board/io/wake.h"

#define MILLISECOND (TL_SECOND / 1000)
#define DOUBT (2 * MILLISECOND) /* a queued edge has arrived by then */
#define MISSED_AGAIN (10 * TL_SECOND)

enum { TEXT = 384, NAME = 96, BATCH = 16 };

typedef struct input_line {
    tl_gpio_channel channel;
    size_t first; /* first channel of the same line; other channels use none of the fields below */
    char *name;   /* copy of channel.line */
    tl_gpio_line *line;
    tl_gpio_input input;
    size_t budget;      /* edges and reads of edges left in this poll */
    bool flooded;       /* there were too many edges: the time since the last one is not known */
    char trouble[TEXT]; /* last reported problem; empty: none */
    tl_backoff backoff; /* of tries to open it */
    tl_time recheck;    /* time of the second read of an unexpected level, if the input is in doubt */
    uint64_t reported;  /* reported part of input.missed */
    tl_time report_due; /* earliest next report */
} input_line;

struct tl_plant_io {
    char *chip;
    tl_time wait;  /* per poll */
    size_t budget; /* per poll and line */
    tl_wake wake;
    tl_link state;
    size_t count;
    struct pollfd *waits; /* wake-up call, then the lines that have a descriptor */
    size_t *waited;       /* the line of each */
    input_line lines[];
};

/* ---- reports and posts ---- */

static void report(const tl_plant_io *io, const tl_plant_io_sink *sink, const input_line *own, bool good,
                   const char *text) {
    char name[NAME];
    if (own->name != NULL) {
        (void)snprintf(name, sizeof name, "GPIO line %.48s", own->name);
    } else {
        (void)snprintf(name, sizeof name, "GPIO line %u of %.64s", own->channel.offset, io->chip);
    }
    tl_link_report(&io->state, sink, good, name, text);
}

/* Sets a line open or not; the link is up while any is open. Each problem is reported once. */
static void note_state(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own, const char *trouble,
                       const char *text) {
    bool any = false;
    for (size_t i = 0; i < io->count; i++) {
        any = any || io->lines[i].line != NULL;
    }
    bool has_changed = tl_link_change(&io->state, any);
    if (has_changed || trouble[0] == '\0' || strcmp(own->trouble, trouble) != 0) {
        report(io, sink, own, trouble[0] == '\0', text);
    }
    (void)snprintf(own->trouble, sizeof own->trouble, "%s", trouble);
}

static void note_missed(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own, tl_time at) {
    if (own->input.missed != own->reported && at >= own->report_due) {
        char text[TEXT];
        (void)snprintf(text, sizeof text,
                       "missed at least %llu edges, because they come faster than the box reads them: "
                       "the newest level is used",
                       (unsigned long long)(own->input.missed - own->reported));
        own->reported = own->input.missed;
        own->report_due = at + MISSED_AGAIN;
        report(io, sink, own, false, text);
    }
}

static void post(const tl_plant_io *io, const tl_plant_io_sink *sink, const input_line *own,
                 const tl_reading *reading) {
    for (size_t i = own->first; i < io->count; i++) {
        if (io->lines[i].first == own->first) {
            sink->post(sink->context, i, reading);
        }
    }
}

static void post_no_link(const tl_plant_io *io, const tl_plant_io_sink *sink, const input_line *own) {
    const tl_reading none = {.value = 0, .stamp = tl_monotonic_now(), .quality = TL_NO_LINK};
    post(io, sink, own, &none);
}

/* ---- finding and losing a line ---- */

static void drop_line(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own, int failure) {
    char text[TEXT];
    (void)snprintf(text, sizeof text, "%s",
                   failure == ENODEV ? "the chip is gone: plug it in, or load its driver" : strerror(failure));
    tl_gpio_line_release(own->line);
    own->line = NULL;
    tl_backoff_fail(&own->backoff, tl_monotonic_now());
    note_state(io, sink, own, text, text);
}

static void describe_failure(const tl_gpio_found *found, int failure, char *text, size_t size) {
    const char *chip = found->chip;
    if (failure == EBUSY && found->state.used) {
        (void)snprintf(text, size, "line %u of %s is in use by \"%s\": end that program", found->offset, chip,
                       found->state.consumer[0] != '\0' ? found->state.consumer : "?");
    } else {
        (void)snprintf(text, size, "line %u of %s cannot be requested: %s", found->offset, chip, strerror(failure));
    }
}

/* Finds and requests the line. Returns true, or false with the reason in `trouble`. */
static bool request(const tl_plant_io *io, input_line *own, tl_gpio_found *found, char *trouble, size_t size) {
    if (!tl_gpio_find(io->chip, &own->channel, found, trouble, size)) {
        return false;
    }
    if (found->state.output && !found->state.used) { /* making it an input would act on the plant */
        (void)snprintf(trouble, size, "line %u of %s is an output, twinlock reads inputs only: use another line",
                       found->offset, found->chip);
        return false;
    }
    int failure =
        found->state.used ? EBUSY : tl_gpio_line_request(found->path, found->offset, &own->channel, &own->line);
    if (failure != 0) {
        describe_failure(found, failure, trouble, size);
    }
    return failure == 0;
}

static void open_line(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own) {
    char text[TEXT] = "";
    tl_gpio_found found;
    bool level = false;
    if (!request(io, own, &found, text, sizeof text)) {
        tl_backoff_fail(&own->backoff, tl_monotonic_now());
        note_state(io, sink, own, text, text);
        return;
    }
    tl_time stamp = tl_monotonic_now();
    int failure = tl_gpio_line_level(own->line, &level);
    if (failure != 0) {
        drop_line(io, sink, own, failure);
        return;
    }
    tl_reading reading;
    const tl_gpio_input_settings settings = {.debounce = tl_time_of_seconds(own->channel.debounce_s),
                                             .level = level,
                                             .stamp = stamp,
                                             .missed = own->input.missed};
    tl_gpio_input_start(&own->input, &settings, &reading);
    tl_backoff_reset(&own->backoff);
    (void)snprintf(text, sizeof text, "connected: line %u of %s%s", found.offset, found.chip,
                   tl_gpio_line_descriptor(own->line) < 0 ? ", without edges: its level is read once per poll" : "");
    note_state(io, sink, own, "", text);
    post(io, sink, own, &reading);
}

/* ---- edges and levels ---- */

/* Reads queued edges within the budget. Returns 0 or errno. */
static int read_edges(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own) {
    tl_gpio_edge edges[BATCH];
    size_t taken = 0;
    int failure = 0;
    while (failure == 0 && own->budget > 0) {
        size_t count = 0;
        failure = tl_gpio_line_edges(own->line, edges, own->budget < BATCH ? own->budget : BATCH, &count);
        tl_time at = tl_monotonic_now();
        taken += count;
        own->budget -= count > 0 ? count : 1;
        for (size_t i = 0; i < count; i++) {
            tl_reading reading;
            if (tl_gpio_input_edge(&own->input, edges[i].level, edges[i].stamp, at, &reading)) {
                post(io, sink, own, &reading);
            }
        }
    }
    /* The kernel keeps at least sixteen edges of a line; if there are so many, it may have dropped
     * others. */
    own->flooded = own->flooded || taken >= BATCH || own->budget == 0;
    return failure == EAGAIN ? 0 : failure;
}

/* Reads the level. Returns 0 or errno. */
static int read_level(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own) {
    tl_reading reading;
    bool level = false;
    tl_time stamp = tl_monotonic_now();
    int failure = tl_gpio_line_level(own->line, &level);
    if (failure != 0) {
        return failure;
    }
    bool was_in_doubt = own->input.doubtful;
    bool some = false;
    if (own->flooded) {
        some = tl_gpio_input_resync(&own->input, level, stamp, &reading);
    } else if (tl_gpio_line_descriptor(own->line) < 0 && level != own->input.level) {
        some = tl_gpio_input_edge(&own->input, level, stamp, stamp, &reading); /* the best that is known */
    } else {
        some = tl_gpio_input_level(&own->input, level, stamp, &reading);
    }
    own->recheck = was_in_doubt ? own->recheck : stamp + DOUBT;
    own->flooded = false;
    if (some) {
        post(io, sink, own, &reading);
    }
    return 0;
}

/* Reads edges, and the level if it is due or if edges are not sufficient, of an open line. */
static void read_line(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own, bool and_level) {
    bool has_edges = tl_gpio_line_descriptor(own->line) >= 0;
    int failure = has_edges && own->budget > 0 ? read_edges(io, sink, own) : 0;
    bool used_up = has_edges && own->budget == 0;
    if (failure == 0 && (and_level || own->flooded)) {
        failure = read_level(io, sink, own);
    }
    if (failure != 0) {
        drop_line(io, sink, own, failure);
        post_no_link(io, sink, own);
        return;
    }
    own->input.missed += used_up && !own->flooded ? 1 : 0;
    own->flooded = used_up;
    note_missed(io, sink, own, tl_monotonic_now());
}

/* ---- waiting ---- */

/* Collects the descriptors; returns their number and the latest time of the next check. */
static nfds_t list_waits(tl_plant_io *io, tl_time *until) {
    nfds_t count = 1;
    io->waits[0] = (struct pollfd){.fd = io->wake.descriptor, .events = POLLIN};
    for (size_t i = 0; i < io->count; i++) {
        const input_line *own = &io->lines[i];
        if (own->line == NULL) {
            continue;
        }
        bool has_edges = tl_gpio_line_descriptor(own->line) >= 0;
        if (own->budget == 0 && has_edges) { /* the next poll continues */
            continue;
        }
        tl_time due = own->input.doubtful ? own->recheck : tl_gpio_input_due(&own->input);
        *until = due < *until ? due : *until;
        if (has_edges) {
            io->waits[count] = (struct pollfd){.fd = tl_gpio_line_descriptor(own->line), .events = POLLIN};
            io->waited[count] = i;
            count++;
        }
    }
    return count;
}

/* Updates a line after a time without edges. */
static void pass_time(tl_plant_io *io, const tl_plant_io_sink *sink, input_line *own) {
    tl_reading reading;
    if (own->input.doubtful && tl_monotonic_now() >= own->recheck) {
        read_line(io, sink, own, true);
        return;
    }
    tl_time at = tl_monotonic_now();
    if (tl_gpio_input_due(&own->input) > at) {
        return;
    }
    read_line(io, sink, own, false); /* an earlier edge may have come meanwhile */
    if (own->line != NULL && !own->flooded && tl_gpio_input_advance(&own->input, at, &reading)) {
        post(io, sink, own, &reading);
    }
}

static void pass_time_of_all(tl_plant_io *io, const tl_plant_io_sink *sink) {
    for (size_t i = 0; i < io->count; i++) {
        if (io->lines[i].line != NULL && io->lines[i].budget > 0) {
            pass_time(io, sink, &io->lines[i]);
        }
    }
}

/* Waits once. Returns false at the end of the poll or after an interruption. */
static bool wait_once(tl_plant_io *io, const tl_plant_io_sink *sink, tl_time end) {
    tl_time until = end;
    nfds_t count = list_waits(io, &until);
    tl_time left = until - tl_monotonic_now();
    const struct timespec longest = {.tv_sec = (time_t)(left > 0 ? left / TL_SECOND : 0),
                                     .tv_nsec = (long)(left > 0 ? left % TL_SECOND : 0)};
    int ready = ppoll(io->waits, count, &longest, NULL);
    if (ready > 0 && io->waits[0].revents != 0 && tl_wake_clear(&io->wake)) {
        return false;
    }
    for (nfds_t i = 1; i < count && ready > 0; i++) {
        if (io->waits[i].revents != 0) {
            read_line(io, sink, &io->lines[io->waited[i]], (io->waits[i].revents & POLLIN) == 0);
        }
    }
    pass_time_of_all(io, sink);
    return tl_monotonic_now() < end;
}

/* ---- the driver ---- */

static void gpio_poll(tl_plant_io *io, const tl_plant_io_sink *sink) {
    tl_time end = tl_monotonic_now() + io->wait;
    if (tl_wake_clear(&io->wake)) {
        return;
    }
    for (size_t i = 0; i < io->count; i++) {
        input_line *own = &io->lines[i];
        if (own->first != i) {
            continue;
        }
        own->budget = io->budget;
        if (own->line != NULL) {
            read_line(io, sink, own, true);
            continue;
        }
        if (tl_backoff_is_due(&own->backoff, tl_monotonic_now())) {
            open_line(io, sink, own);
        }
        if (own->line == NULL) {
            post_no_link(io, sink, own);
        }
    }
    while (wait_once(io, sink, end)) {
    }
}

static void gpio_interrupt(tl_plant_io *io) {
    tl_wake_call(&io->wake);
}

static void gpio_close(tl_plant_io *io) {
    for (size_t i = 0; i < io->count; i++) {
        tl_gpio_line_release(io->lines[i].line);
        free(io->lines[i].name);
    }
    tl_wake_release(&io->wake);
    free(io->waits);
    free(io->waited);
    free(io->chip);
    free(io);
}

const tl_plant_io_driver tl_gpio_driver = {
    .name = "gpio", .poll = gpio_poll, .interrupt = gpio_interrupt, .close = gpio_close};

/* ---- access ---- */

static const uint32_t commands[] = {
    GPIO_GET_CHIPINFO_IOCTL,  GPIO_GET_LINEINFO_IOCTL,          GPIO_GET_LINEHANDLE_IOCTL,
    GPIO_GET_LINEEVENT_IOCTL, GPIOHANDLE_GET_LINE_VALUES_IOCTL, GPIO_V2_GET_LINEINFO_IOCTL,
    GPIO_V2_GET_LINE_IOCTL,   GPIO_V2_LINE_GET_VALUES_IOCTL,
};

/* A filter does not see the flags of a request. libgpiod checks in /sys whether a device is a chip.
 */
const tl_plant_access tl_gpio_access = {
    .commands = commands, .command_count = sizeof commands / sizeof commands[0], .read = "/sys", .write = "/dev"};

/* ---- settings ---- */

static tl_status check_channel(const tl_gpio_settings *settings, size_t index, tl_error *error) {
    const tl_gpio_channel *channel = &settings->channels[index];
    if (channel->line != NULL && channel->line[0] == '\0') {
        return tl_fail(error, TL_BAD_DATA, "GPIO channel %zu: line is empty: write the name of the line", index);
    }
    if (channel->line == NULL && settings->chip == NULL) {
        return tl_fail(error, TL_BAD_DATA,
                       "GPIO channel %zu: chip is missing: an offset needs one, for example gpiochip0", index);
    }
    if (!(channel->debounce_s >= 0 && channel->debounce_s <= 60)) {
        return tl_fail(error, TL_BAD_DATA, "GPIO channel %zu: debounce_s is %g (expected 0 to 60)", index,
                       channel->debounce_s);
    }
    if (channel->bias < TL_GPIO_AS_IS || channel->bias > TL_GPIO_NO_PULL) {
        return tl_fail(error, TL_BAD_DATA, "GPIO channel %zu: bias is %d (expected 0 to 3)", index, (int)channel->bias);
    }
    return TL_OK;
}

static tl_status check(const tl_gpio_settings *settings, tl_error *error) {
    if (settings->chip != NULL && settings->chip[0] == '\0') {
        return tl_fail(error, TL_BAD_DATA, "GPIO: chip is empty: write its name, label or path, or remove it");
    }
    if (!(settings->period_s >= 1e-5 && settings->period_s <= 3600)) {
        return tl_fail(error, TL_BAD_DATA, "GPIO: period_s is %g (expected 1e-5 to 3600)", settings->period_s);
    }
    for (size_t i = 0; i < settings->channel_count; i++) {
        if (check_channel(settings, i, error) != TL_OK) {
            return TL_BAD_DATA;
        }
    }
    return TL_OK;
}

/* True if both are NULL or equal. */
static bool is_same_name(const char *a, const char *b) {
    return a == NULL || b == NULL ? a == b : strcmp(a, b) == 0;
}

/* First channel of the same line: a line can be requested only once. */
static size_t first_of(const tl_gpio_settings *settings, size_t index) {
    const tl_gpio_channel *channel = &settings->channels[index];
    size_t first = 0;
    while (!is_same_name(settings->channels[first].line, channel->line) ||
           (channel->line == NULL && settings->channels[first].offset != channel->offset)) {
        first++;
    }
    return first;
}

/* Returns false if memory is out. */
static bool copy(const tl_gpio_settings *settings, tl_plant_io *io) {
    bool whole = true;
    io->count = settings->channel_count;
    io->waits = calloc(io->count + 1, sizeof *io->waits);
    io->waited = calloc(io->count + 1, sizeof *io->waited);
    io->chip = settings->chip != NULL ? strdup(settings->chip) : NULL;
    for (size_t i = 0; i < io->count; i++) {
        input_line *own = &io->lines[i];
        own->channel = settings->channels[i];
        own->first = first_of(settings, i);
        own->name = own->channel.line != NULL ? strdup(own->channel.line) : NULL;
        whole = whole && (own->name != NULL) == (own->channel.line != NULL);
        own->channel.line = own->name;
    }
    return whole && io->waits != NULL && io->waited != NULL && (io->chip != NULL) == (settings->chip != NULL);
}

tl_status tl_gpio_open(const tl_gpio_settings *settings, tl_plant_io **io, tl_error *error) {
    tl_status status = check(settings, error);
    if (status != TL_OK) {
        return status;
    }
    tl_plant_io *made = calloc(1, sizeof *made + settings->channel_count * sizeof made->lines[0]);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "GPIO: not enough memory");
    }
    tl_time period = tl_time_of_seconds(settings->period_s);
    made->wait = period - (period / 10 < MILLISECOND ? period / 10 : MILLISECOND);
    made->budget = TL_GPIO_EDGES + (size_t)(period / MILLISECOND) * TL_GPIO_EDGES_PER_MS;
    if (!tl_wake_make(&made->wake) || !copy(settings, made)) {
        status = tl_fail(error, TL_TRY_AGAIN, "GPIO: %s", strerror(errno));
        gpio_close(made);
        return status;
    }
    *io = made;
    return TL_OK;
}
