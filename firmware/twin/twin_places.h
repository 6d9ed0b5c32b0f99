/* The places that the FMUs of a configuration may read besides what every program is made of.
 *
 * Purpose: a confined process reads no file that nobody has named. Named are: by the configuration the libraries, what a component `reads`, and
 *          texts in `set` that are the names of files; by the environment the folders in which loader, Python and locales look: absolute ones that are
 *          neither a home nor hold one; of an installation of Python what it loads.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_PLACES_H
#define TL_FIRMWARE_TWIN_TWIN_PLACES_H

#include <stddef.h>

#include "firmware/twin/assembly.h"

enum { TL_TWIN_PLACES = 256 }; /* further ones are left out */

/* A variable: the home of who has started all this, since HOME is another folder in a process with FMUs. */
#define TL_TWIN_PLACES_HOME "TWINLOCK_HOME"

/* Absolute paths of what exists. A zeroed one is empty. */
typedef struct tl_twin_places {
    char *path[TL_TWIN_PLACES];
    size_t count;
} tl_twin_places;

/* While everything can be looked at still; of an assembly whose libraries were looked for (tl_assembly_open()). */
void tl_twin_places_find(const tl_assembly *assembly, tl_twin_places *places);

void tl_twin_places_free(tl_twin_places *places);

#endif
