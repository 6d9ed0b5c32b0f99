/* Chips and lines by libgpiod 2.x: see gpio_lines.h. */
#include "board/gpio/gpio_lines.h"

#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>

enum { EVENTS = 64, NO_SUPPORT = 524 }; /* NO_SUPPORT: the kernel's internal ENOTSUPP, which it sometimes returns */

/* ---- a chip ---- */

struct tl_gpio_chip {
    struct gpiod_chip *chip;
    struct gpiod_chip_info *info;
};

void tl_gpio_chip_close(tl_gpio_chip *chip) {
    if (chip->info != NULL) {
        gpiod_chip_info_free(chip->info);
    }
    if (chip->chip != NULL) {
        gpiod_chip_close(chip->chip);
    }
    free(chip);
}

tl_gpio_chip *tl_gpio_chip_open(const char *path) {
    tl_gpio_chip *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return NULL;
    }
    made->chip = gpiod_chip_open(path);
    made->info = made->chip != NULL ? gpiod_chip_get_info(made->chip) : NULL;
    if (made->info == NULL) {
        int failure = errno;
        tl_gpio_chip_close(made);
        errno = failure;
        return NULL;
    }
    return made;
}

const char *tl_gpio_chip_name(const tl_gpio_chip *chip) {
    return gpiod_chip_info_get_name(chip->info);
}

const char *tl_gpio_chip_label(const tl_gpio_chip *chip) {
    return gpiod_chip_info_get_label(chip->info);
}

unsigned tl_gpio_chip_lines(const tl_gpio_chip *chip) {
    return (unsigned)gpiod_chip_info_get_num_lines(chip->info);
}

int tl_gpio_chip_read_line(tl_gpio_chip *chip, unsigned offset, tl_gpio_line_state *state) {
    struct gpiod_line_info *info = gpiod_chip_get_line_info(chip->chip, offset);
    if (info == NULL) {
        return errno;
    }
    const char *name = gpiod_line_info_get_name(info);
    const char *consumer = gpiod_line_info_get_consumer(info);
    (void)snprintf(state->name, sizeof state->name, "%s", name != NULL ? name : "");
    (void)snprintf(state->consumer, sizeof state->consumer, "%s", consumer != NULL ? consumer : "");
    state->used = gpiod_line_info_is_used(info);
    state->output = gpiod_line_info_get_direction(info) == GPIOD_LINE_DIRECTION_OUTPUT;
    gpiod_line_info_free(info);
    return 0;
}

/* ---- a line ---- */

struct tl_gpio_line {
    struct gpiod_line_request *request;
    struct gpiod_edge_event_buffer *events;
    unsigned offset;
    bool has_edges;
};

static enum gpiod_line_bias bias_of(tl_gpio_bias bias) {
    switch (bias) {
    case TL_GPIO_PULL_UP:
        return GPIOD_LINE_BIAS_PULL_UP;
    case TL_GPIO_PULL_DOWN:
        return GPIOD_LINE_BIAS_PULL_DOWN;
    case TL_GPIO_NO_PULL:
        return GPIOD_LINE_BIAS_DISABLED;
    case TL_GPIO_AS_IS:
        break;
    }
    return GPIOD_LINE_BIAS_AS_IS;
}

/* NULL with errno on failure. */
static struct gpiod_line_request *request(struct gpiod_chip *chip, unsigned offset, const tl_gpio_channel *channel,
                                          bool with_edges) {
    struct gpiod_line_settings *settings = gpiod_line_settings_new();
    struct gpiod_line_config *lines = gpiod_line_config_new();
    struct gpiod_request_config *wanted = gpiod_request_config_new();
    struct gpiod_line_request *made = NULL;
    int failure = ENOMEM;
    if (settings != NULL && lines != NULL && wanted != NULL) {
        (void)gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_INPUT);
        (void)gpiod_line_settings_set_edge_detection(settings,
                                                     with_edges ? GPIOD_LINE_EDGE_BOTH : GPIOD_LINE_EDGE_NONE);
        (void)gpiod_line_settings_set_bias(settings, bias_of(channel->bias));
        (void)gpiod_line_settings_set_event_clock(settings, GPIOD_LINE_CLOCK_MONOTONIC);
        gpiod_line_settings_set_active_low(settings, channel->active_low);
        gpiod_request_config_set_consumer(wanted, "twinlock");
        gpiod_request_config_set_event_buffer_size(wanted, EVENTS);
        made = gpiod_line_config_add_line_settings(lines, &offset, 1, settings) == 0
                   ? gpiod_chip_request_lines(chip, wanted, lines)
                   : NULL;
        failure = errno;
    }
    gpiod_request_config_free(wanted);
    gpiod_line_config_free(lines);
    gpiod_line_settings_free(settings);
    errno = failure;
    return made;
}

/* True if the chip has no interrupt for the line. */
static bool is_without_edges(int failure) {
    return failure == ENODEV || failure == ENXIO || failure == EOPNOTSUPP || failure == NO_SUPPORT;
}

int tl_gpio_line_request(const char *path, unsigned offset, const tl_gpio_channel *channel, tl_gpio_line **line) {
    tl_gpio_line *made = calloc(1, sizeof *made);
    struct gpiod_edge_event_buffer *events = gpiod_edge_event_buffer_new(EVENTS);
    struct gpiod_chip *chip = made != NULL && events != NULL ? gpiod_chip_open(path) : NULL;
    int failure = errno;
    if (chip != NULL) {
        made->events = events;
        made->offset = offset;
        made->has_edges = true;
        made->request = request(chip, offset, channel, true);
        if (made->request == NULL && is_without_edges(errno)) {
            made->has_edges = false;
            made->request = request(chip, offset, channel, false);
        }
        failure = errno;
        gpiod_chip_close(chip);
    }
    if (made == NULL || made->request == NULL) {
        gpiod_edge_event_buffer_free(events);
        free(made);
        return failure;
    }
    *line = made;
    return 0;
}

int tl_gpio_line_descriptor(const tl_gpio_line *line) {
    return line->has_edges ? gpiod_line_request_get_fd(line->request) : -1;
}

int tl_gpio_line_level(tl_gpio_line *line, bool *level) {
    enum gpiod_line_value value = gpiod_line_request_get_value(line->request, line->offset);
    *level = value == GPIOD_LINE_VALUE_ACTIVE;
    return value != GPIOD_LINE_VALUE_ERROR ? 0 : errno;
}

int tl_gpio_line_edges(tl_gpio_line *line, tl_gpio_edge *edges, size_t room, size_t *count) {
    *count = 0;
    int ready = gpiod_line_request_wait_edge_events(line->request, 0);
    if (ready <= 0) {
        return ready == 0 ? EAGAIN : errno;
    }
    int read = gpiod_line_request_read_edge_events(line->request, line->events, room < EVENTS ? room : EVENTS);
    for (int i = 0; i < read; i++) {
        struct gpiod_edge_event *event = gpiod_edge_event_buffer_get_event(line->events, (unsigned long)i);
        edges[i] = (tl_gpio_edge){.level = gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_RISING_EDGE,
                                  .stamp = (tl_time)gpiod_edge_event_get_timestamp_ns(event)};
    }
    *count = read > 0 ? (size_t)read : 0;
    return read >= 0 ? 0 : errno;
}

void tl_gpio_line_release(tl_gpio_line *line) {
    if (line != NULL) {
        gpiod_line_request_release(line->request);
        gpiod_edge_event_buffer_free(line->events);
        free(line);
    }
}
