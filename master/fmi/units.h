/* Conversion between two units: equal, convertible, or wrong.
 *
 * Source:  FMI 2.0.4, section 2.2.2 (value in base units = factor·value + offset).
 * Thread:  any; pure.
 */
#ifndef TL_MASTER_FMI_UNITS_H
#define TL_MASTER_FMI_UNITS_H

#include <stdbool.h>

#include "master/fmi/model.h"

/* to_value = factor·from_value + offset. */
typedef struct tl_conversion {
    double factor;
    double offset;
} tl_conversion;

/* Computes the conversion from one unit to another. Returns false if the dimensions differ, or if
 * the names differ and a unit has no base unit. A unit that is NULL or has no name fits every
 * unit. */
bool tl_units_convert(const tl_unit *from, const tl_unit *to, tl_conversion *conversion);

bool tl_conversion_is_identity(const tl_conversion *conversion);

#endif
