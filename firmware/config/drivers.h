/* The table of plant I/O drivers: one row for each kind of source, `sources.NAME.KIND`.
 *
 * Purpose: all that the firmware knows of a driver: its keys, what a change of each needs, how it is opened, what its process
 *          may, and how it behaves. Everybody else walks the rows and names no driver.
 * New row: a driver has a folder in board/, a file config_DRIVER.c here with its row, and a line in drivers.c.
 * Owner:   constants. Thread: any.
 */
#ifndef TL_FIRMWARE_CONFIG_DRIVERS_H
#define TL_FIRMWARE_CONFIG_DRIVERS_H

#include "board/io/plant_access.h"
#include "board/io/plant_io.h"
#include "firmware/config/config.h"

struct tl_change_rule;   /* config_change.h */
struct tl_config_object; /* an object of the file (config_reader.h) */
struct cJSON;

/* What a source reaches. */
typedef struct tl_source_reach {
    const char *read;  /* a file that it reads, relative to the configuration's folder; NULL: none */
    const char *write; /* a device that it opens for reading and writing, likewise */
    uint16_t port;     /* it connects to by TCP; 0: none */
    bool names;        /* it looks up the name of a host */
    tl_time wait;      /* a poll waits so long at most for its device without a reading; 0: for a period; ns */
} tl_source_reach;

typedef struct tl_driver {
    const char *name;       /* key of a source: sources.NAME.KIND */
    const char *signal_key; /* key of a signal: plant.NAME.KEY; rows beside each other may share one */
    const char *source_example, *signal_example; /* of these objects, in problems */
    bool source_is_optional;                     /* the signal's key `source` may be missing */
    double period_s;                             /* of all its sources; 0: key `period_s`, by default step_s */
    size_t settings_bytes, channel_bytes;        /* of tl_config_source.settings, tl_config_signal.channel; zeroed */

    /* Read `source->settings`. Keys `period_s` and `source` are read by the caller. */
    void (*read_source)(struct tl_config_object *object, tl_config_source *source);
    /* Reads `signal->channel`; `named`: its source in the file, NULL: none. NULL: the row before reads it. */
    void (*read_signal)(struct tl_config_object *object, const struct cJSON *named, tl_config_signal *signal);
    const struct tl_change_rule *rules; /* of all keys, ended by one without a pattern */

    bool is_polled;         /* a value may be read several times */
    bool is_silent;         /* a sender that falls silent is noticed by the age of its values only */
    const char *not_played; /* "of GPIO lines": `twinlock plant` says that it cannot play such signals; NULL: it can */

    const tl_plant_io_driver *io;
    const tl_plant_access *access;
    void (*reach)(const tl_config_source *source, tl_source_reach *reach); /* of a zeroed one; NULL: nothing */
    /* `path`: of reach.read or reach.write, from the configuration's folder, or NULL. `channels`: `count` of them, copied. */
    tl_status (*open)(const tl_config_source *source, const char *path, const void *channels, size_t count,
                      tl_plant_io **io, tl_error *error);
} tl_driver;

enum { TL_MAX_DRIVERS = 31 };

/* Ended by NULL. */
extern const tl_driver *const tl_drivers[];

/* A row as one of a set: 1 << its place. */
unsigned tl_driver_bit(const tl_driver *driver);

/* The channels of `count` signals of a source of this driver, side by side, as tl_driver.open() takes them. Freed by the
 * caller; NULL: memory is out. */
void *tl_driver_gather(const tl_driver *driver, const tl_config *config, const size_t *signals, size_t count);

#endif
