/* Chips and lines by libgpiod 1.6: see gpio_lines.h. */
#include "board/gpio/gpio_lines.h"

#include <errno.h>
#include <fcntl.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>

enum { NO_SUPPORT = 524 }; /* the kernel's internal ENOTSUPP, which it sometimes returns */

/* ---- a chip ---- */

struct tl_gpio_chip {
    struct gpiod_chip *chip;
};

tl_gpio_chip *tl_gpio_chip_open(const char *path) {
    tl_gpio_chip *made = calloc(1, sizeof *made);
    if (made != NULL) {
        made->chip = gpiod_chip_open(path);
        if (made->chip == NULL) {
            int failure = errno;
            free(made);
            errno = failure;
            return NULL;
        }
    }
    return made;
}

const char *tl_gpio_chip_name(const tl_gpio_chip *chip) {
    return gpiod_chip_name(chip->chip);
}

const char *tl_gpio_chip_label(const tl_gpio_chip *chip) {
    return gpiod_chip_label(chip->chip);
}

unsigned tl_gpio_chip_lines(const tl_gpio_chip *chip) {
    return gpiod_chip_num_lines(chip->chip);
}

int tl_gpio_chip_read_line(tl_gpio_chip *chip, unsigned offset, tl_gpio_line_state *state) {
    struct gpiod_line *line = gpiod_chip_get_line(chip->chip, offset);
    if (line == NULL) {
        return errno;
    }
    const char *name = gpiod_line_name(line);
    const char *consumer = gpiod_line_consumer(line);
    (void)snprintf(state->name, sizeof state->name, "%s", name != NULL ? name : "");
    (void)snprintf(state->consumer, sizeof state->consumer, "%s", consumer != NULL ? consumer : "");
    state->used = gpiod_line_is_used(line);
    state->output = gpiod_line_direction(line) == GPIOD_LINE_DIRECTION_OUTPUT;
    return 0;
}

void tl_gpio_chip_close(tl_gpio_chip *chip) {
    gpiod_chip_close(chip->chip);
    free(chip);
}

/* ---- a line ---- */

struct tl_gpio_line {
    struct gpiod_chip *chip; /* its own, because a line of libgpiod 1 lives as long as its chip */
    struct gpiod_line *line;
    int descriptor;
};

static int flags_of(const tl_gpio_channel *channel) {
    int flags = channel->active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0;
    switch (channel->bias) {
    case TL_GPIO_AS_IS:
        break;
    case TL_GPIO_PULL_UP:
        flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
        break;
    case TL_GPIO_PULL_DOWN:
        flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
        break;
    case TL_GPIO_NO_PULL:
        flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE;
        break;
    }
    return flags;
}

/* True if the chip has no interrupt for the line. */
static bool is_without_edges(int failure) {
    return failure == ENODEV || failure == ENXIO || failure == EOPNOTSUPP || failure == NO_SUPPORT;
}

/* Returns 0 or errno. */
static int request(tl_gpio_line *own, const tl_gpio_channel *channel) {
    struct gpiod_line_request_config wanted = {
        .consumer = "twinlock", .request_type = GPIOD_LINE_REQUEST_EVENT_BOTH_EDGES, .flags = flags_of(channel)};
    if (gpiod_line_request(own->line, &wanted, 0) == 0) {
        own->descriptor = gpiod_line_event_get_fd(own->line);
        /* Non-blocking, so that reading ends if there is nothing. */
        return fcntl(own->descriptor, F_SETFL, O_NONBLOCK) == 0 ? 0 : errno;
    }
    if (!is_without_edges(errno)) {
        return errno;
    }
    wanted.request_type = GPIOD_LINE_REQUEST_DIRECTION_INPUT;
    return gpiod_line_request(own->line, &wanted, 0) == 0 ? 0 : errno;
}

int tl_gpio_line_request(const char *path, unsigned offset, const tl_gpio_channel *channel, tl_gpio_line **line) {
    tl_gpio_line *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return ENOMEM;
    }
    made->descriptor = -1;
    made->chip = gpiod_chip_open(path);
    made->line = made->chip != NULL ? gpiod_chip_get_line(made->chip, offset) : NULL;
    int failure = made->line != NULL ? request(made, channel) : errno;
    if (failure != 0) {
        tl_gpio_line_release(made);
        return failure;
    }
    *line = made;
    return 0;
}

int tl_gpio_line_descriptor(const tl_gpio_line *line) {
    return line->descriptor;
}

int tl_gpio_line_level(tl_gpio_line *line, bool *level) {
    int value = gpiod_line_get_value(line->line);
    *level = value > 0;
    return value >= 0 ? 0 : errno;
}

int tl_gpio_line_edges(tl_gpio_line *line, tl_gpio_edge *edges, size_t room, size_t *count) {
    struct gpiod_line_event events[16];
    size_t most = sizeof events / sizeof events[0];
    int read = gpiod_line_event_read_multiple(line->line, events, (unsigned)(room < most ? room : most));
    *count = read > 0 ? (size_t)read : 0;
    for (size_t i = 0; i < *count; i++) {
        edges[i] = (tl_gpio_edge){.level = events[i].event_type == GPIOD_LINE_EVENT_RISING_EDGE,
                                  .stamp = (tl_time)events[i].ts.tv_sec * TL_SECOND + events[i].ts.tv_nsec};
    }
    return read >= 0 ? 0 : errno;
}

void tl_gpio_line_release(tl_gpio_line *line) {
    if (line != NULL && line->chip != NULL) {
        gpiod_chip_close(line->chip); /* frees its line too */
    }
    free(line);
}
