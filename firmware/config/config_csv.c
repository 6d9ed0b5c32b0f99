/* `sources.NAME.csv` and `plant.NAME.csv`: the row of the driver board/csv. */
#include "board/csv/csv.h"
#include "firmware/config/config_change.h"
#include "firmware/config/config_reader.h"
#include "firmware/config/drivers.h"

/* The path is kept as written. */
static void read_source(tl_config_object *object, tl_config_source *source) {
    tl_csv_settings *settings = source->settings;
    settings->path = "";
    settings->time_column = "time";
    (void)tl_config_get_text(object, "file", TL_CONFIG_REQUIRED, "\"plant.fifo\"", &settings->path);
    (void)tl_config_get_text(object, "time_column", TL_CONFIG_OPTIONAL, "\"time\"", &settings->time_column);
}

static void refuse_scale(tl_config_object *object, const char *key) {
    if (tl_config_get(object, key, TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
        tl_config_wrong(object, key, NULL, "none, because the signal is a boolean", NULL);
    }
}

/* Recordings use the same column and scale. */
static void read_signal(tl_config_object *object, const cJSON *named, tl_config_signal *signal) {
    tl_csv_column *column = signal->channel;
    (void)named;
    (void)tl_config_get_text(object, "column", TL_CONFIG_OPTIONAL, "\"omega\"", &signal->column);
    if (signal->plan.type == TL_BOOLEAN) {
        refuse_scale(object, "scale");
        refuse_scale(object, "offset");
    } else {
        tl_config_get_scale(object, &signal->scale, &signal->offset);
    }
    *column = (tl_csv_column){.name = signal->column, .scale = signal->scale, .offset = signal->offset};
}

static void reach(const tl_config_source *source, tl_source_reach *reach) {
    const tl_csv_settings *settings = source->settings;
    reach->read = settings->path;
}

static tl_status open_csv(const tl_config_source *source, const char *path, const void *channels, size_t count,
                          tl_plant_io **io, tl_error *error) {
    tl_csv_settings settings = *(const tl_csv_settings *)source->settings;
    settings.path = path;
    settings.columns = channels;
    settings.column_count = count;
    return tl_csv_open_live(&settings, io, error);
}

static const tl_change_rule RULES[] = {
    {"sources.*.csv.file", TL_RULE_FILE, NULL},       {"sources.*.csv.time_column", TL_RULE_RETUNE, NULL},
    {"sources.*.csv.period_s", TL_RULE_RETUNE, NULL}, {"sources.*.csv.**", TL_RULE_COMMISSION, NULL},
    {"plant.*.csv.**", TL_RULE_COMMISSION, NULL},     {NULL, TL_RULE_COMMISSION, NULL},
};

const tl_driver tl_driver_csv = {
    .name = "csv",
    .signal_key = "csv",
    .source_example = "{\"file\": \"plant.fifo\"}",
    .signal_example = "{\"column\": \"omega\"}",
    .source_is_optional = true,
    .settings_bytes = sizeof(tl_csv_settings),
    .channel_bytes = sizeof(tl_csv_column),
    .read_source = read_source,
    .read_signal = read_signal,
    .rules = RULES,
    .io = &tl_csv_driver,
    .access = &tl_csv_access,
    .reach = reach,
    .open = open_csv,
};
