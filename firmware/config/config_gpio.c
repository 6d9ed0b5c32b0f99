/* `sources.NAME.gpio` and `plant.NAME.gpio`: the row of the driver board/gpio. */
#include <stdio.h>
#include <string.h>

#include "board/gpio/gpio.h"
#include "firmware/config/config_change.h"
#include "firmware/config/config_reader.h"
#include "firmware/config/drivers.h"

static void read_source(tl_config_object *object, tl_config_source *source) {
    tl_gpio_settings *settings = source->settings;
    (void)tl_config_get_text(object, "chip", TL_CONFIG_OPTIONAL, "\"gpiochip0\"", &settings->chip);
}

/* A line is given by its name, or by its offset on the chip of the source. */
static void read_line(tl_config_object *object, const cJSON *source, tl_gpio_channel *channel) {
    static const tl_config_number rule = {.whole = true, .maximum = 65535, .example = "3"};
    double offset = 0;
    bool by_name = tl_config_get(object, "line", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    bool by_offset = tl_config_get(object, "offset", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    if (object->json != NULL && by_name == by_offset) {
        tl_config_problem(object->reader, object->path, tl_json_line(object->json),
                          by_name ? "both line and offset" : "neither line nor offset", "exactly one of them",
                          "{\"source\": \"box\", \"line\": \"START\"}");
    }
    (void)tl_config_get_text(object, "line", TL_CONFIG_OPTIONAL, "\"START\"", &channel->line);
    if (tl_config_get_number(object, "offset", &rule, &offset)) {
        const cJSON *chip = cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(source, "gpio"), "chip");
        channel->offset = (unsigned)offset;
        if (source != NULL && chip == NULL && !by_name) {
            tl_config_wrong(object, "offset", NULL, "\"line\", or a source with \"chip\"", NULL);
        }
    }
}

static void read_bias(tl_config_object *object, tl_gpio_channel *channel) {
    static const char *const biases[] = {"pull-up", "pull-down", "none", NULL};
    static const tl_gpio_bias bias_of[] = {TL_GPIO_PULL_UP, TL_GPIO_PULL_DOWN, TL_GPIO_NO_PULL};
    size_t index = 0;
    if (tl_config_get_choice(object, "bias", TL_CONFIG_OPTIONAL, biases, &index)) {
        channel->bias = bias_of[index];
    }
}

/* Returns true if both are NULL or equal. */
static bool same_text(const char *a, const char *b) {
    return a == NULL || b == NULL ? a == b : strcmp(a, b) == 0;
}

static const char *chip_of(const tl_config_source *source) {
    const tl_gpio_settings *settings = source->settings;
    return settings->chip;
}

/* The kernel allows only one request for a line. */
static void check_once(const tl_config_object *object, const tl_config_signal *signal) {
    const tl_config *config = object->reader->config;
    const tl_config_source *source = &config->sources[signal->source];
    const tl_gpio_channel *own = signal->channel;
    for (const tl_config_signal *other = config->signals; other < signal; other++) {
        const tl_gpio_channel *line = other->channel;
        if (other->source < config->source_count && config->sources[other->source].driver == source->driver &&
            same_text(chip_of(&config->sources[other->source]), chip_of(source)) && same_text(line->line, own->line) &&
            line->offset == own->offset) {
            char found[TL_JSON_PATH + 32];
            (void)snprintf(found, sizeof found, "the line of %s", other->plan.where);
            tl_config_wrong(object, own->line != NULL ? "line" : "offset", found,
                            "a line that no other signal uses (the kernel grants each line once)", NULL);
            return;
        }
    }
}

static void read_signal(tl_config_object *object, const cJSON *named, tl_config_signal *signal) {
    static const tl_config_number debounce = {.maximum = 60, .example = "0.01"};
    tl_gpio_channel *channel = signal->channel;
    read_line(object, named, channel);
    (void)tl_config_get_boolean(object, "active_low", &channel->active_low);
    read_bias(object, channel);
    (void)tl_config_get_number(object, "debounce_s", &debounce, &channel->debounce_s);
    if (named != NULL && signal->source < object->reader->config->source_count) {
        check_once(object, signal);
    }
}

static tl_status open_gpio(const tl_config_source *source, const char *path, const void *channels, size_t count,
                           tl_plant_io **io, tl_error *error) {
    tl_gpio_settings settings = *(const tl_gpio_settings *)source->settings;
    (void)path;
    settings.period_s = source->period_s;
    settings.channels = channels;
    settings.channel_count = count;
    return tl_gpio_open(&settings, io, error);
}

static const tl_change_rule RULES[] = {
    {"sources.*.gpio.period_s", TL_RULE_RETUNE, NULL},
    {"sources.*.gpio.**", TL_RULE_COMMISSION, NULL},
    {"plant.*.gpio.**", TL_RULE_COMMISSION, NULL},
    {NULL, TL_RULE_COMMISSION, NULL},
};

const tl_driver tl_driver_gpio = {
    .name = "gpio",
    .signal_key = "gpio",
    .source_example = "{\"chip\": \"gpiochip0\"}",
    .signal_example = "{\"source\": \"box\", \"line\": \"START\"}",
    .settings_bytes = sizeof(tl_gpio_settings),
    .channel_bytes = sizeof(tl_gpio_channel),
    .read_source = read_source,
    .read_signal = read_signal,
    .rules = RULES,
    .not_played = "of GPIO lines",
    .io = &tl_gpio_driver,
    .access = &tl_gpio_access,
    .open = open_gpio,
};
