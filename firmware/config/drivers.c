/* The table of plant I/O drivers: see drivers.h. */
#include "firmware/config/drivers.h"

#include <stdlib.h>
#include <string.h>

extern const tl_driver tl_driver_csv, tl_driver_modbus_tcp, tl_driver_modbus_rtu, tl_driver_can, tl_driver_gpio;

/* CSV must be the first row, because plant.NAME.csv is allowed together with a live source of a
 * later row. */
const tl_driver *const tl_drivers[] = {
    &tl_driver_csv, &tl_driver_modbus_tcp, &tl_driver_modbus_rtu, &tl_driver_can, &tl_driver_gpio, NULL,
};

_Static_assert(sizeof tl_drivers / sizeof tl_drivers[0] <= TL_MAX_DRIVERS + 1, "a set of drivers is an unsigned");

unsigned tl_driver_bit(const tl_driver *driver) {
    unsigned bit = 1;
    for (size_t i = 0; tl_drivers[i] != driver; i++) {
        bit <<= 1;
    }
    return bit;
}

void *tl_driver_gather(const tl_driver *driver, const tl_config *config, const size_t *signals, size_t count) {
    char *channels = calloc(count, driver->channel_bytes);
    for (size_t i = 0; channels != NULL && i < count; i++) {
        memcpy(channels + i * driver->channel_bytes, config->signals[signals[i]].channel, driver->channel_bytes);
    }
    return channels;
}
