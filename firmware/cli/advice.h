/* Advice: what is right in a configuration, and perhaps not meant.
 *
 * Purpose: the warnings of `check`. None of them is an error: everything they warn of is defined and works.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CLI_ADVICE_H
#define TL_FIRMWARE_CLI_ADVICE_H

#include <stddef.h>
#include <stdio.h>

#include "firmware/cli/prognosis.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/far_look.h"
#include "firmware/twin/read_back.h"

/* A paragraph each, of 79 columns at most, with the JSON path in front; how many there are. */
size_t tl_advice_print(const tl_assembly *assembly, const tl_prognosis *prognosis, const tl_far_look *look,
                       const tl_read_back_report *states, FILE *file);

#endif
