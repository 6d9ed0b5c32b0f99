/* Evidence of a value for its mapping: how much likelier the value is if the mapping is right.
 *
 * Method:  log of the ratio of two densities (Bayes factor). Right: mostly within min … max, near
 *          the start value if the plant is at its start, seldom of a faulty sensor. Wrong: any
 *          register content, each order of magnitude as likely as another.
 * Thread:  any; pure.
 */
#ifndef TL_FIRMWARE_CONFIG_PROBE_EVIDENCE_H
#define TL_FIRMWARE_CONFIG_PROBE_EVIDENCE_H

#include <stdbool.h>
#include <stdint.h>

#include "board/modbus/modbus.h"
#include "firmware/config/config.h"

/* Of a value that no sensor gives. */
#define TL_PROBE_ABSURD (-6.0)

/* Of NaN, or another content by which a device says that it has no value. */
#define TL_PROBE_NO_VALUE (-0.5)

/* Returns the evidence of these registers, decoded by `channel`. 0: they prove nothing; lowest for
 * values far outside their limits. `at_start`: all signals of the plant are near their start
 * values. */
double tl_probe_evidence(const tl_config_signal *signal, const tl_modbus_channel *channel, const uint16_t *registers,
                         bool at_start);

#endif
