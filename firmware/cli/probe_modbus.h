/* Modbus in a probe: reads the raw registers of each signal, and decodes them as configured.
 *
 * Purpose: `twinlock probe` shows the registers from which a value was decoded. So it reads them as
 *          unsigned integers, by a changed configuration, and decodes them itself as the driver
 *          would.
 * Limits:  a float64 that is not finite is reported by the driver, without registers.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CLI_PROBE_MODBUS_H
#define TL_FIRMWARE_CLI_PROBE_MODBUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/modbus/modbus.h"
#include "firmware/config/config.h"
#include "master/base/signal.h"

enum { TL_PROBE_REGISTERS = 4 }; /* most registers of a value */

/* The caller sets `config` and zeroes the rest. */
typedef struct tl_probe_modbus {
    const tl_config *config;
    bool has_registers[TL_MAX_SIGNALS];                     /* by signal: `registers` is valid */
    uint16_t registers[TL_MAX_SIGNALS][TL_PROBE_REGISTERS]; /* as received, of the newest reading */
} tl_probe_modbus;

/* Returns the channel of a signal; NULL if it has another driver. */
const tl_modbus_channel *tl_probe_modbus_channel(const tl_config *config, size_t signal);

/* Returns the text of the configuration that reads registers. The caller frees it. Returns NULL if
 * memory is out. */
char *tl_probe_modbus_text(const tl_config *config);

/* As tl_plant_probe_settings.convert and .concerns; `context` is a tl_probe_modbus. */
void tl_probe_modbus_convert(void *context, size_t signal, tl_reading *reading);
bool tl_probe_modbus_concerns(void *context, size_t signal, const char *message);

#endif
