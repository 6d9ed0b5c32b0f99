/* Units that recordings often have, for `init`.
 *
 * Thread:  any; pure.
 */
#ifndef TL_FIRMWARE_FMU_COMMON_UNITS_H
#define TL_FIRMWARE_FMU_COMMON_UNITS_H

#include <stdbool.h>

#include "master/fmi/model.h"
#include "master/fmi/units.h"

/* Computes the conversion from a unit's name to a unit of the model. The definitions of the model
 * come before those of a table of common units, in which an angle is in rad, also per minute.
 * Returns false if neither knows both units, or if their dimensions differ. */
bool tl_common_units_convert(const tl_model *model, const char *from, const tl_unit *to, tl_conversion *conversion);

#endif
