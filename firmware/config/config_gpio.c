/* `sources.NAME.gpio` and `plant.NAME.gpio`. */
#include <stdio.h>
#include <string.h>

#include "firmware/config/config_parts.h"
#include "firmware/config/config_reader.h"

void tl_config_read_gpio_source(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    tl_config_object object;
    (void)tl_config_member(entry, "gpio", TL_CONFIG_REQUIRED, "{\"chip\": \"gpiochip0\"}", &object);
    source->kind = TL_SOURCE_GPIO;
    (void)tl_config_get_text(&object, "chip", TL_CONFIG_OPTIONAL, "\"gpiochip0\"", &source->chip);
    tl_config_read_period(&object, source, config);
    tl_config_done(&object);
}

/* A line by its name, or by its offset on the chip of the source. */
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
            tl_config_wrong(object, "offset", NULL, "line, or a source with a chip", NULL);
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

/* Both NULL, or both the same text. */
static bool is_same(const char *a, const char *b) {
    return a == NULL || b == NULL ? a == b : strcmp(a, b) == 0;
}

/* A line can be requested once. */
static void check_once(const tl_config_object *object, const tl_config *config, const tl_config_signal *signal) {
    const char *chip = config->sources[signal->source].chip;
    for (const tl_config_signal *other = config->signals; other < signal; other++) {
        if (other->source < config->source_count && config->sources[other->source].kind == TL_SOURCE_GPIO &&
            is_same(config->sources[other->source].chip, chip) && is_same(other->gpio.line, signal->gpio.line) &&
            other->gpio.offset == signal->gpio.offset) {
            char found[TL_JSON_PATH + 32];
            (void)snprintf(found, sizeof found, "the line of %s", other->plan.where);
            tl_config_wrong(object, signal->gpio.line != NULL ? "line" : "offset", found,
                            "a line that no other signal has: it can be requested once", NULL);
            return;
        }
    }
}

void tl_config_read_gpio_signal(tl_config_object *entry, const tl_config *config, tl_config_signal *signal) {
    static const char *const kinds[] = {"gpio", NULL};
    static const tl_config_number debounce = {.maximum = 60, .example = "0.01"};
    tl_config_object object;
    if (!tl_config_member(entry, "gpio", TL_CONFIG_OPTIONAL, "{\"source\": \"box\", \"line\": \"START\"}", &object)) {
        return;
    }
    if (signal->source != SIZE_MAX) {
        tl_config_wrong(entry, "gpio", "gpio beside another live source", "at most one live source", NULL);
    }
    const cJSON *source =
        tl_config_read_source_name(&object, TL_CONFIG_REQUIRED, "the name of a gpio source", kinds, signal);
    read_line(&object, source, &signal->gpio);
    (void)tl_config_get_boolean(&object, "active_low", &signal->gpio.active_low);
    read_bias(&object, &signal->gpio);
    (void)tl_config_get_number(&object, "debounce_s", &debounce, &signal->gpio.debounce_s);
    if (source != NULL && signal->source < config->source_count) {
        check_once(&object, config, signal);
    }
    tl_config_done(&object);
}
