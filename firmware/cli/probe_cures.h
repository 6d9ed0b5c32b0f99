/* Cures of a Modbus source: finds a mapping that makes the values of a bad source plausible.
 *
 * Purpose: manuals count addresses from 1, and say little about word order. If a source has absurd
 *          values, or the device has no such registers, other mappings of all its signals are
 *          tried: word order, table, address ±1, then two of these. If nothing answers: port 502
 *          and a few unit ids.
 * Rule:    a right mapping with a faulty sensor must get no proposal. So a mapping is proposed only
 *          if it is the only plausible one: no value is out of range, NaN or denormal, and at
 *          least one would hardly be in its range by chance. Under the present mapping, no value
 *          that would change may be so; one must be absurd or its address illegal, or two out of
 *          range. Another table or address needs two such values, unless the present one is
 *          illegal.
 * Load:    reads each mapping only until each signal has a value or a problem, for two seconds at
 *          most. A silent device is asked with the pauses of the driver.
 * Thread:  the main thread, as for plant_probe.h.
 */
#ifndef TL_FIRMWARE_CLI_PROBE_CURES_H
#define TL_FIRMWARE_CLI_PROBE_CURES_H

#include "firmware/cli/probe_modbus.h"
#include "firmware/live/plant_probe.h"
#include "master/base/status.h"

enum { TL_PROBE_CURE = 128 }; /* bytes of a text */

/* Tries other mappings of each bad Modbus source. `found`, `present`: result of the probe.
 * `run_role`: as in tl_plant_probe_settings. Sets the text of each signal: the keys to change, or
 * that several mappings may be right; "": nothing to propose, or interrupted. Errors: those of
 * tl_plant_probe_run(). */
tl_status tl_probe_cures_find(const tl_plant_probe *found, const tl_probe_modbus *present,
                              int (*run_role)(const char *role, void *context),
                              char cures[TL_MAX_SIGNALS][TL_PROBE_CURE], tl_error *error);

#endif
