/* Modbus in a probe: reads the raw registers of each signal, and decodes them.
 *
 * Purpose: `twinlock probe` shows the registers from which a value was decoded, and tries other
 *          mappings (probe_cures.h). So it reads them as unsigned integers, by a changed
 *          configuration, and decodes them itself as the driver would.
 * Limits:  a double cannot carry any content of four registers. They are read as float64, which is
 *          exact but for NaN, or as int64, which is exact up to 2^53.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_PROBE_MODBUS_H
#define TL_FIRMWARE_CONFIG_PROBE_MODBUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/modbus/modbus.h"
#include "firmware/config/config.h"
#include "master/base/signal.h"

enum { TL_PROBE_REGISTERS = 4 }; /* most registers of a value */

/* Names of the tables in a configuration, by tl_modbus_table. */
extern const char *const tl_probe_modbus_tables[];

/* Names of the types without parts of registers and BCD, by tl_modbus_type. */
extern const char *const tl_probe_modbus_types[];

/* Changed keys of a source. */
typedef struct tl_probe_link {
    uint16_t port;          /* 0: as configured */
    bool other_framing;     /* rtu for tcp, or the reverse */
    double pause_s;         /* 0: as configured */
    uint8_t most_registers; /* most_registers; 0: as configured */
} tl_probe_link;

/* A mapping of signals to registers, and what was read with it. */
typedef struct tl_probe_modbus {
    const tl_config *config;
    tl_modbus_channel channels[TL_MAX_SIGNALS];             /* of each signal with Modbus */
    size_t source;                                          /* index of the source whose keys are changed */
    tl_probe_link link;                                     /* its changed keys */
    size_t width[TL_MAX_SIGNALS];                           /* registers that are read; 0: as the type has */
    bool is_int64[TL_MAX_SIGNALS];                          /* read as int64, not float64, if it has 64 bits */
    unsigned moved[TL_MAX_SIGNALS];                         /* bit k: register k has changed while it was read */
    bool has_registers[TL_MAX_SIGNALS];                     /* `registers` is valid */
    uint16_t registers[TL_MAX_SIGNALS][TL_PROBE_REGISTERS]; /* as received, of the newest reading; a bit: 0 or 1 */
} tl_probe_modbus;

/* Sets the configured mapping, with nothing read. */
void tl_probe_modbus_begin(tl_probe_modbus *self, const tl_config *config);

/* Returns true if the source, or the source of the signal, is read by Modbus. */
bool tl_probe_modbus_has_source(const tl_config *config, size_t source);
bool tl_probe_modbus_has(const tl_config *config, size_t signal);

/* Returns the number of registers that are read for a signal. */
size_t tl_probe_modbus_width(const tl_probe_modbus *self, size_t signal);

/* Returns the framing of the changed source, as in a configuration. */
const char *tl_probe_modbus_framing(const tl_probe_modbus *self);

/* Returns the text of the configuration that reads the registers of this mapping. The caller frees
 * it. Returns NULL if memory is out. */
char *tl_probe_modbus_text(const tl_probe_modbus *self);

/* As tl_plant_probe_settings.convert and .concerns; `context` is a tl_probe_modbus. */
void tl_probe_modbus_convert(void *context, size_t signal, tl_reading *reading);
bool tl_probe_modbus_concerns(void *context, size_t signal, const char *message);

#endif
