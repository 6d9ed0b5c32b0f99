/* The table of plant I/O drivers: one row for each kind of source, `sources.NAME.KIND`.
 *
 * Purpose: a row describes a driver: its keys, what a change of each key requires, how to open it,
 *          the rights of its process, and its behaviour. Other code iterates over the rows. Only
 *          `twinlock plant` compares names of drivers, because it serves Modbus TCP and CAN itself.
 * New row: a driver has a folder in board/, its row in a file config_*.c here, and a line in
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
    const char *read;  /* file that it reads, as written in the configuration; NULL: none */
    const char *write; /* device that it opens for reading and writing, as written; NULL: none */
    uint16_t port;     /* TCP port that it connects to; 0: none */
    bool names;        /* it resolves a host name */
    tl_time wait;      /* ns; longest wait of a poll for its device; 0: always shorter than realtime.hang_s */
} tl_source_reach;

typedef struct tl_driver {
    const char *name;                            /* key of a source: sources.NAME.KIND */
    const char *signal_key;                      /* key of a signal: plant.NAME.KEY; consecutive rows may share one */
    const char *source_example, *signal_example; /* examples of these objects for problem reports */
    bool source_is_optional;                     /* plant.NAME.KEY may have no `source` */
    double period_s; /* fixed period of all its sources, s; 0: key `period_s`, default step_s */
    size_t settings_bytes,
        channel_bytes; /* size of tl_config_source.settings and tl_config_signal.channel; both zeroed */

    /* Fills `source->settings`. The caller reads `period_s`. */
    void (*read_source)(struct tl_config_object *object, tl_config_source *source);
    /* Fills `signal->channel`. The caller reads `source`. `named`: JSON object of that source, or
     * NULL. The function is NULL if an earlier row has the same signal_key. */
    void (*read_signal)(struct tl_config_object *object, const struct cJSON *named, tl_config_signal *signal);
    const struct tl_change_rule *rules; /* rules of all its keys; a rule without a pattern ends the list */

    bool is_polled;         /* the driver polls its device; two polls can read the same reading */
    bool is_silent;         /* the driver cannot detect a stopped sender; only stale_s can */
    const char *not_played; /* "of GPIO lines": `twinlock plant` does not play these; else NULL */

    const tl_plant_io_driver *io;
    const tl_plant_access *access;
    void (*reach)(const tl_config_source *source,
                  tl_source_reach *reach); /* fills in a zeroed struct; NULL: it stays zeroed */
    /* Opens the source (plant_io.h). `path`: full path of reach.read or reach.write, or NULL.
     * `channels`: `count` of them, copied. Sets *io; its owner closes it with io->close(). */
    tl_status (*open)(const tl_config_source *source, const char *path, const void *channels, size_t count,
                      tl_plant_io **io, tl_error *error);
} tl_driver;

enum { TL_MAX_DRIVERS = 31 }; /* a set of drivers is an unsigned */

/* All rows; NULL ends the table. */
extern const tl_driver *const tl_drivers[];

/* The bit of a row of tl_drivers in a set of drivers: 1 << its index. */
unsigned tl_driver_bit(const tl_driver *driver);

/* Copies the channels of `count` signals into one array, for tl_driver.open(). `signals`: their
 * indices; all belong to one source of this driver. Release the array with free(). Returns NULL if
 * memory is out. */
void *tl_driver_gather(const tl_driver *driver, const tl_config *config, const size_t *signals, size_t count);

#endif
