/* How far a low-pass takes readings from what was true, as these tell themselves.
 *
 * Idea:    Stein's estimate. What a low-pass makes of the reading of an instant differs from that reading by d; it is off what was true by
 *          E d² − σ² + 2 σ² w in the mean square, if w is the weight with which the reading is in it and the noise is white with deviation σ. So noise that is
 *          taken away and motion that is flattened are weighed without knowing the motion.
 * Purpose: done by the plant's own low-pass (plant/conditioner.h), looked up τ later, as it is when it is matched.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_MONITOR_SMOOTHING_H
#define TL_FIRMWARE_MONITOR_SMOOTHING_H

#include <stddef.h>

#include "firmware/monitor/noise_meter.h"
#include "master/base/simtime.h"

/* The mean square error at the readings' own instants, through a low-pass of τ > 0 ns. Without one it is σ². Fewer than three readings: σ². */
double tl_smoothing_error(const tl_noise_point *points, size_t count, double sigma, tl_time low_pass);

#endif
