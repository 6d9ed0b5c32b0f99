/* Texts of XML attributes to values: xs:double, xs:int, xs:unsignedInt, xs:boolean.
 *
 * Purpose: strict. White space around a value is allowed, as XML Schema says; anything else that is not part of it is not.
 * Errors:  false, and *value is unchanged.
 * Thread:  any that has a locale with a decimal point (c_locale.h).
 */
#ifndef TL_FIRMWARE_FMU_XML_VALUE_H
#define TL_FIRMWARE_FMU_XML_VALUE_H

#include <stdbool.h>
#include <stdint.h>

/* Decimal or scientific notation, and INF, -INF, NaN. What is too large for a double becomes infinite (exporters
 * write a largest double that is none). */
bool tl_xml_double(const char *text, double *value);

bool tl_xml_int(const char *text, int32_t *value);
bool tl_xml_unsigned(const char *text, uint32_t *value);

/* true, false, 1, 0. */
bool tl_xml_boolean(const char *text, bool *value);

#endif
