/* What FMUs were refused: see fmu_refusals.h. */
#include "firmware/process/fmu_refusals.h"

#include <stdio.h>
#include <string.h>

/* NULL: it was said before, or there is no room to remember more. */
static tl_fmu_refused *note(tl_fmu_refusals *refusals, const tl_refusal *refusal, const tl_fmu_call *call) {
    for (size_t i = 0; i < refusals->count; i++) {
        const tl_fmu_refused *known = &refusals->entries[i];
        if (strcmp(known->call, refusal->name) == 0 && strcmp(known->fmu, call->fmu) == 0) {
            return NULL;
        }
    }
    if (refusals->count == TL_FMU_REFUSALS) {
        return NULL;
    }
    tl_fmu_refused *noted = &refusals->entries[refusals->count++];
    (void)snprintf(noted->call, sizeof noted->call, "%s", refusal->name);
    (void)snprintf(noted->fmu, sizeof noted->fmu, "%s", call->fmu);
    return noted;
}

/* `call`: without a name if no FMU was being called. */
static void say(tl_fmu_refused *noted, const tl_refusal *refusal, const tl_fmu_call *call) {
    if (call->function != NULL) {
        (void)snprintf(noted->said, sizeof noted->said, "FMU %s asked for %s in %s, which is refused; said once",
                       call->fmu, refusal->name, call->function);
    } else {
        (void)snprintf(noted->said, sizeof noted->said,
                       "a thread of an FMU asked for %s outside of its functions, which is refused; said once",
                       refusal->name);
    }
}

bool tl_fmu_refusals_note(tl_fmu_refusals *refusals, const tl_refusal *refusal, const tl_fmu_calls *calls) {
    tl_fmu_call call;
    if (!tl_fmu_calls_look(calls, &call)) {
        call = (tl_fmu_call){.fmu = ""};
    }
    tl_fmu_refused *noted = note(refusals, refusal, &call);
    if (noted != NULL) {
        say(noted, refusal, &call);
    }
    return noted != NULL;
}

const char *tl_fmu_refusals_next(const tl_fmu_refusals *refusals, size_t *told) {
    return *told < refusals->count ? refusals->entries[(*told)++].said : NULL;
}
