/* The sections of a configuration: each function reads some keys of the root into the configuration.
 *
 * Purpose: private to config.c, which calls them in the order of this file; what a section needs of another has been
 *          read before it, or is looked up in the JSON tree.
 * Errors:  reported; what could not be read keeps its default.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_PARTS_H
#define TL_FIRMWARE_CONFIG_CONFIG_PARTS_H

#include "firmware/config/config.h"
#include "firmware/config/config_reader.h"

/* The longest duration, in seconds. Any number > 0 is one; less than a nanosecond counts as one. */
#define TL_CONFIG_LONGEST_S 1e9
#define TL_CONFIG_DURATION "a number > 0 (at most 1e9)"

/* A duration that passed the range check. */
static inline tl_time tl_config_duration(double seconds) {
    tl_time duration = tl_time_of_seconds(seconds);
    return duration > 0 ? duration : 1;
}

/* components, connect */
void tl_config_read_components(tl_config_object *root, tl_config *config);
void tl_config_read_connections(tl_config_object *root, tl_config *config);

/* compare, synchronise */
void tl_config_read_compare(tl_config_object *root, tl_config *config);
void tl_config_read_synchronise(tl_config_object *root, tl_config *config);

/* sources, plant */
void tl_config_read_sources(tl_config_object *root, tl_config *config);
void tl_config_read_signals(tl_config_object *root, tl_config *config);

/* delays */
void tl_config_read_delays(tl_config_object *root, tl_config *config);

/* Where they make each signal to be looked up: once all of the above is read. */
void tl_config_place_lookups(tl_config_object *root, tl_config *config);

/* recording, record, realtime, emulate */
void tl_config_read_recording(tl_config_object *root, tl_config *config);
void tl_config_read_record(tl_config_object *root, tl_config *config);
void tl_config_read_realtime(tl_config_object *root, tl_config *config);
void tl_config_read_emulate(tl_config_object *root, tl_config *config);

/* `horizon`, of the object `synchronise`. */
void tl_config_read_horizon(tl_config_object *object, tl_config *config);

#endif
