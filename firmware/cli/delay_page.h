/* The delays of a configuration, for people: chains, modes, densities drawn as text.
 *
 * Purpose: what `check` tells of `delays`. At most 79 columns, unless a participant's name alone is longer; the drawing is ASCII.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CLI_DELAY_PAGE_H
#define TL_FIRMWARE_CLI_DELAY_PAGE_H

#include <stdio.h>

#include "firmware/config/config.h"

/* Nothing where the configuration has none. */
void tl_delay_page_print(const tl_config *config, FILE *file);

#endif
