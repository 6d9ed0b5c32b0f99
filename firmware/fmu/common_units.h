/* Units that plants often have.
 *
 * Thread:  any; pure.
 */
#ifndef TL_FIRMWARE_FMU_COMMON_UNITS_H
#define TL_FIRMWARE_FMU_COMMON_UNITS_H

#include <stdbool.h>

#include "master/fmi/model.h"
#include "master/fmi/units.h"

/* Computes the conversion between two units that tl_units_convert() does not convert. A missing
 * definition is taken from a table of common units, in which an angle is in rad, also per minute.
 * Returns false if a unit is not known, or if the dimensions differ. */
bool tl_common_units_convert(const tl_unit *from, const tl_unit *to, tl_conversion *conversion);

#endif
