/* Results of `twinlock check --json`: the main facts of the page (check_page.h) as a JSON object.
 *
 * Thread:  the one that calls the FMUs.
 */
#ifndef TL_FIRMWARE_CLI_CHECK_JSON_H
#define TL_FIRMWARE_CLI_CHECK_JSON_H

#include <stdio.h>

#include "firmware/cli/advice.h"

typedef struct tl_check_facts {
    const tl_assembly *assembly;
    const tl_prognosis *prognosis;
    const tl_response *responses; /* by adjusted variable */
    const tl_late_verification *rollback;
    const tl_read_back_report *states;
} tl_check_facts;

/* Prints the object. Errors: TL_TRY_AGAIN if memory is out. */
tl_status tl_check_json_print(const tl_check_facts *facts, FILE *output, tl_error *error);

#endif
