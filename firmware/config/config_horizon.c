/* `synchronise.horizon`: T_P steps, or a stroke around an event. */
#include <math.h>
#include <string.h>

#include "firmware/config/config_names.h"
#include "firmware/config/config_parts.h"
#include "firmware/config/json_document.h"
#include "firmware/config/measurements.h"

/* "plant.signal", or "not plant.signal" for the instant at which it becomes false. */
static void read_edge(tl_config_object *object, const char *key, const char *example, tl_plan_edge *edge) {
    static const char *const negation = "not ";
    const char *text = NULL;
    char path[TL_JSON_PATH];
    if (!tl_config_get_text(object, key, TL_CONFIG_REQUIRED, example, &text)) {
        return;
    }
    edge->falls = strncmp(text, negation, strlen(negation)) == 0;
    edge->signal = edge->falls ? text + strlen(negation) : text;
    tl_json_member_path(path, object->path, key);
    tl_config_check_reference(object->reader, path, tl_json_line(cJSON_GetObjectItemCaseSensitive(object->json, key)),
                              edge->signal, TL_CONFIG_SIGNAL);
}

static void read_time(tl_config_object *object, const char *key, const char *example, tl_time *time) {
    const tl_config_number rule = {.need = TL_CONFIG_REQUIRED,
                                   .above = true,
                                   .maximum = TL_CONFIG_LONGEST_S,
                                   .expected = TL_CONFIG_DURATION,
                                   .example = example};
    double seconds = 0;
    if (tl_config_get_number(object, key, &rule, &seconds)) {
        *time = tl_config_duration(seconds);
    }
}

static void read_event(tl_config_object *horizon, tl_config *config) {
    tl_config_object event;
    if (!tl_config_member(horizon, "event", TL_CONFIG_OPTIONAL,
                          "{\"start\": \"plant.move_out\", \"end\": \"plant.extended\", \"window_s\": 0.08, "
                          "\"longest_s\": 2}",
                          &event)) {
        return;
    }
    config->event.where = tl_config_keep(horizon->reader, event.path);
    read_edge(&event, "start", "\"plant.move_out\"", &config->event.start);
    read_edge(&event, "end", "\"plant.extended\"", &config->event.end);
    read_time(&event, "window_s", "0.08", &config->event.window);
    read_time(&event, "longest_s", "2", &config->event.longest);
    tl_config_done(&event);
}

void tl_config_read_horizon(tl_config_object *object, tl_config *config) {
    static const tl_config_number rule = {.whole = true, .minimum = 1, .maximum = 1000, .example = "2"};
    static const char *const shapes[] = {[TL_STATIC] = "static", [TL_DYNAMIC] = "dynamic", NULL};
    tl_config_object horizon;
    double prediction = 0;
    size_t shape = TL_STATIC;
    size_t measurements = TL_LAG;
    (void)tl_config_member(object, "horizon", TL_CONFIG_OPTIONAL, "{\"prediction\": 2}", &horizon);
    (void)tl_config_get_number(&horizon, "prediction", &rule, &prediction);
    (void)tl_config_get_choice(&horizon, "shape", TL_CONFIG_OPTIONAL, shapes, &shape);
    (void)tl_config_get_choice(&horizon, "measurements", TL_CONFIG_OPTIONAL, tl_measurements_names, &measurements);
    config->prediction = (uint32_t)prediction;
    config->shape = (tl_shape)shape;
    config->measurements = (tl_measurements)measurements;
    read_event(&horizon, config);
    tl_config_done(&horizon);
}
