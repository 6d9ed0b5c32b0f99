/* The model description of an FMU: XML into what the master knows of a model.
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

/* ---- Texts of XML attributes to values: xs:double, xs:int, xs:unsignedInt, xs:boolean.
 *
 * Purpose: strict. White space around a value is allowed, as XML Schema says; anything else that is not part of it is not.
 * Errors:  false, and *value is unchanged.
 * Thread:  any that has a locale with a decimal point (os.h).
 */

/* Decimal or scientific notation, and INF, -INF, NaN. What is too large for a double becomes infinite (exporters
 * write a largest double that is none). */
bool tl_xml_double(const char *text, double *value);

bool tl_xml_integer(const char *text, int64_t lowest, int64_t highest, int64_t *value);

/* true, false, 1, 0. */
bool tl_xml_boolean(const char *text, bool *value);

/* ---- Reads modelDescription.xml of FMI 2.0 for Co-Simulation into a tl_model.
 *
 * Purpose: everything the twin needs, checked once: variables of all types with what they inherit from their declared
 *          type, units, capabilities. What the schema demands and the twin would rely on is enforced; what it does
 *          not know (annotations, later additions, ModelStructure) is passed over.
 * Limits:  TL_MODEL_DESCRIPTION_BYTES; elements nested TL_MODEL_DESCRIPTION_DEPTH deep; no DTD, so no entities.
 * Tolerated: a variable without variability (Real: continuous, parameters: fixed, all else: discrete); an `initial` where
 *          none is allowed; a unit that is not defined (it has no base then); nominal 0 (is 1) or negative.
 * Errors:  TL_BAD_DATA with the line, TL_TRY_AGAIN where memory is out. `label` names the FMU in the text.
 * Owner:   the arena holds all that the model points to, also after a failure.
 * Thread:  any.
 */

enum { TL_MODEL_DESCRIPTION_BYTES = 64 * 1024 * 1024, TL_MODEL_DESCRIPTION_DEPTH = 64 };

/* From memory. */
tl_status tl_model_description_parse(const char *xml, size_t size, const char *label, tl_arena *arena, tl_model *model,
                                     tl_error *error);

/* From a file. */
tl_status tl_model_description_read(const char *path, const char *label, tl_arena *arena, tl_model *model,
                                    tl_error *error);

#endif
