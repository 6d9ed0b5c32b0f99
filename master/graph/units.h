/* Units of two connected values: are they the same, convertible, or wrong?
 *
 * Source: FMI 2.0.4, section 2.2.2 (value in base units = factor·value + offset).
 */
#ifndef TL_MASTER_GRAPH_UNITS_H
#define TL_MASTER_GRAPH_UNITS_H

#include <stdbool.h>

#include "master/fmi/model.h"

/* to_value = factor·from_value + offset. */
typedef struct tl_conversion {
    double factor;
    double offset;
} tl_conversion;

/* false where the dimensions differ, or the names do and no base units tell how to convert. A unit that is NULL or
 * has an empty name fits everything. */
bool tl_units_convert(const tl_unit *from, const tl_unit *to, tl_conversion *conversion);

bool tl_conversion_is_identity(const tl_conversion *conversion);

#endif
