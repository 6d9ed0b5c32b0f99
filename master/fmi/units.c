/* Conversion between two units: see units.h. */
#include "master/fmi/units.h"

#include <string.h>

bool tl_units_convert(const tl_unit *from, const tl_unit *to, tl_conversion *conversion) {
    conversion->factor = 1.0;
    conversion->offset = 0.0;
    if (from == NULL || to == NULL || from->name[0] == '\0' || to->name[0] == '\0') {
        return true;
    }
    if (!from->has_base || !to->has_base) {
        return strcmp(from->name, to->name) == 0;
    }
    if (memcmp(from->exponents, to->exponents, sizeof from->exponents) != 0) {
        return false;
    }
    conversion->factor = from->factor / to->factor;
    conversion->offset = (from->offset - to->offset) / to->factor;
    return true;
}

bool tl_conversion_is_identity(const tl_conversion *conversion) {
    const double identity[2] = {1.0, 0.0};
    const double actual[2] = {conversion->factor, conversion->offset + 0.0};
    return memcmp(identity, actual, sizeof identity) == 0;
}
