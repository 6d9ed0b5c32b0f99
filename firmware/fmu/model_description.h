/* Reads the model description of an FMU, and converts it from XML to a tl_model.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_FMU_MODEL_DESCRIPTION_H
#define TL_FIRMWARE_FMU_MODEL_DESCRIPTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/fmi/model.h"

/* ---- Converts texts of XML attributes to values: xs:double, xs:int, xs:unsignedInt, xs:boolean.
 *
 * Purpose: converts strictly. White space around a value is allowed, as XML Schema says; any other
 *          extra character is an error.
 * Errors:  the functions return false and leave *value unchanged.
 * Thread:  any, after tl_locale_use() (os.h), because the decimal separator must be a point.
 */

/* Accepts decimal and scientific notation, INF, +INF, -INF and NaN. A number that is too large for
 * a double becomes infinite, because some exporters write a maximum that is too large. */
bool tl_xml_double(const char *text, double *value);

/* Accepts decimal digits with an optional sign, from `lowest` to `highest`. */
bool tl_xml_integer(const char *text, int64_t lowest, int64_t highest, int64_t *value);

/* Accepts true, false, 1 and 0. */
bool tl_xml_boolean(const char *text, bool *value);

/* ---- Reads modelDescription.xml of FMI 2.0 for Co-Simulation into a tl_model.
 *
 * Purpose: reads and validates all that the twin needs: variables of all types with the attributes
 *          inherited from their declared type, units, and capabilities. The parser enforces the
 *          parts of the schema that the twin relies on. It skips all other elements, for example
 *          annotations, later additions and ModelStructure.
 * Limits:  TL_MODEL_DESCRIPTION_BYTES (a file is read in parts); TL_MODEL_DESCRIPTION_VARIABLES;
 *          TL_MODEL_DESCRIPTION_DEPTH nested elements. A DTD is rejected, so no entities can
 *          expand.
 * Encodings: UTF-8, UTF-16, ISO-8859-1, and encodings of iconv that contain ASCII, such as
 *            windows-1252, windows-1251, GBK and Shift_JIS.
 * Tolerated: a variable without variability (default: fixed for parameters, else continuous for
 *            Real, else discrete); an `initial` of an input or independent variable (ignored); an
 *            undefined unit (it then has no base unit); nominal 0 (read as 1) or negative (read as
 *            its absolute value); start "nan" of a Real (no start value); a variable declared again
 *            with the same type, causality and value reference (only the first one is used);
 *            several different variables of one name (the name is ambiguous).
 * Errors:  TL_BAD_DATA with the line; TL_TRY_AGAIN if memory is out or the file cannot be read.
 *          `label` names the FMU in the text.
 * Owner:   the arena owns all data that the model points to, also after a failure.
 * Thread:  any.
 */

enum {
    TL_MODEL_DESCRIPTION_BYTES = 512 * 1024 * 1024,
    TL_MODEL_DESCRIPTION_VARIABLES = 2000000,
    TL_MODEL_DESCRIPTION_DEPTH = 64
};

/* Parses a description in memory. */
tl_status tl_model_description_parse(const char *xml, size_t size, const char *label, tl_arena *arena, tl_model *model,
                                     tl_error *error);

/* Reads and parses a file. */
tl_status tl_model_description_read(const char *path, const char *label, tl_arena *arena, tl_model *model,
                                    tl_error *error);

#endif
