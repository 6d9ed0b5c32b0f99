/* The modes of `synchronise.horizon.measurements`: their names.
 *
 * Purpose: the one list that the configuration, the database and the pages for people share. At which tick a step is
 *          computed, the twin says: see tl_twin_facts.lead.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_CONFIG_MEASUREMENTS_H
#define TL_FIRMWARE_CONFIG_MEASUREMENTS_H

#include "master/plan/plan.h"

/* The names by tl_measurements, then NULL: "lag", "ahead", "hold". */
extern const char *const tl_measurements_names[];

const char *tl_measurements_name(tl_measurements measurements);

/* The mode of that name; TL_LAG where there is none. NULL is allowed. */
tl_measurements tl_measurements_named(const char *name);

#endif
