/* Cures of a Modbus source: finds the mapping that explains what the device answers.
 *
 * Purpose: manuals count addresses from 1, and say little about word order. If a source has absurd
 *          values, or the device has no such registers, other mappings of all its signals are
 *          read: table, address ±1, 40001 notation; each decoded with all word and byte orders. If
 *          nothing answers: other ports, unit ids, framing, pauses, and shorter requests.
 * Method:  each mapping has a score: the evidence of all values (probe_evidence.h) less a cost for
 *          each mistake. Each signal may also have another type, scale or sign. A mapping is
 *          proposed only if it is far better than the present one and than the next one. So a
 *          right mapping with a faulty sensor gets no proposal.
 * Load:    reads each mapping only until each signal has a value or a problem. A silent device is
 *          asked with the pauses of the driver.
 * Thread:  the main thread, as for plant_probe.h.
 */
#ifndef TL_FIRMWARE_CLI_PROBE_CURES_H
#define TL_FIRMWARE_CLI_PROBE_CURES_H

#include "firmware/config/probe_modbus.h"
#include "firmware/live/plant_probe.h"
#include "master/base/status.h"

enum { TL_PROBE_CURE = 256 }; /* bytes of a text */

/* Tries other mappings of each bad Modbus source. `found`, `present`: result of the probe.
 * `run_role`: as in tl_plant_probe_settings. Sets the text of each signal: the keys to change, or
 * that the mapping cannot be told; "": nothing to propose, or interrupted. Errors: those of
 * tl_plant_probe_run(). */
tl_status tl_probe_cures_find(const tl_plant_probe *found, const tl_probe_modbus *present,
                              int (*run_role)(const char *role, void *context),
                              char cures[TL_MAX_SIGNALS][TL_PROBE_CURE], tl_error *error);

#endif
