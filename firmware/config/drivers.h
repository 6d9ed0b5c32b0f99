/* The table of plant I/O drivers: one row for each kind of source, `sources.NAME.KIND`.
 *
 * Purpose: a row describes a driver completely: its keys, what a change of each key requires, how
 *          to open it, the rights of its process, and its behaviour. All other code iterates over
 *          the rows and names no driver.
 * New row: a driver has a folder in board/, a file config_DRIVER.c here with its row, and a line in
 *          drivers.c.
 * Owner:   all rows are constants. Thread: any.
 */
#ifndef TL_FIRMWARE_CONFIG_DRIVERS_H
#define TL_FIRMWARE_CONFIG_DRIVERS_H

#include "board/io/plant_access.h"
#include "board/io/plant_io.h"
#include "firmware/config/config.h"

struct tl_change_rule;   /* config_change.h */
struct tl_config_object; /* an object of the file (config_reader.h) */
struct cJSON;

/* Files, devices and connections that a source uses. */
typedef struct tl_source_reach {
    const char *read;  /* file that it reads, relative to the configuration's folder; NULL: none */
    const char *write; /* device that it opens for reading and writing, also relative; NULL: none */
    uint16_t port;     /* TCP port that it connects to; 0: none */
    bool names;        /* it resolves a host name */
    tl_time wait;      /* ns; longest time that a poll waits for its device if no reading comes; 0: one period */
} tl_source_reach;

typedef struct tl_driver {
    const char *name;                            /* key of a source: sources.NAME.KIND */
    const char *signal_key;                      /* key of a signal: plant.NAME.KEY; consecutive rows may share one */
    const char *source_example, *signal_example; /* examples of these objects for problem reports */
    bool source_is_optional;                     /* the signal's key `source` may be missing */
    double period_s; /* fixed period of all its sources, s; 0: key `period_s`, default step_s */
    size_t settings_bytes,
        channel_bytes; /* size of tl_config_source.settings and tl_config_signal.channel; both zeroed */

    /* Reads `source->settings`. The caller reads the keys `period_s` and `source`. */
    void (*read_source)(struct tl_config_object *object, tl_config_source *source);
    /* Reads `signal->channel`. `named`: JSON object of its source; NULL: not found. The function is
     * NULL if the row before reads such signals too. */
    void (*read_signal)(struct tl_config_object *object, const struct cJSON *named, tl_config_signal *signal);
    const struct tl_change_rule *rules; /* rules of all its keys; a rule without a pattern ends the list */

    bool is_polled;         /* the driver polls its device: it may read the same value several times */
    bool is_silent;         /* the driver cannot detect that a sender has stopped; only the age of values shows it */
    const char *not_played; /* "of GPIO lines": how a message names what `twinlock plant` cannot serve; NULL: it can */

    const tl_plant_io_driver *io;
    const tl_plant_access *access;
    void (*reach)(const tl_config_source *source,
                  tl_source_reach *reach); /* fills in a zeroed struct; NULL: it stays zeroed */
    /* Opens the source. `path`: reach.read or reach.write, joined with the configuration's folder,
     * or NULL. `channels`: `count` of them; they are copied. */
    tl_status (*open)(const tl_config_source *source, const char *path, const void *channels, size_t count,
                      tl_plant_io **io, tl_error *error);
} tl_driver;

enum { TL_MAX_DRIVERS = 31 };

/* All rows; NULL ends the table. */
extern const tl_driver *const tl_drivers[];

/* The bit of a row in a set of drivers: 1 << its index. */
unsigned tl_driver_bit(const tl_driver *driver);

/* Copies the channels of `count` signals into one array, for tl_driver.open(). `signals`: their
 * indices; all belong to one source of this driver. The caller frees the array. Returns NULL if
 * memory is out. */
void *tl_driver_gather(const tl_driver *driver, const tl_config *config, const size_t *signals, size_t count);

#endif
