/* Trials of `check`: runs FMUs in separate processes, so that a crash of an FMU is a finding and
 * does not end the check.
 *
 * Bound:   the call timeout of a check applies to each FMU call (twin_child.h).
 * Thread:  one, as for twin_child.h.
 * Errors:  only TL_INTERRUPTED; any other failure is part of the result.
 */
#ifndef TL_FIRMWARE_TWIN_CHECK_TRIALS_H
#define TL_FIRMWARE_TWIN_CHECK_TRIALS_H

#include <stdbool.h>

#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_trial.h"

/* ---- Search for another rollback method, if a component's rollback by the configured method is
 * not exact.
 *
 * Purpose: for `check`. If the configuration names a method that is wrong for an FMU, tries whether
 *          "rollback": "auto" finds another one that is exact.
 * Trials:  each tests all components (twin_trial.h). Their number is at most that of components.
 */

typedef enum tl_other_method_kind {
    TL_OTHER_METHOD_NOT_SOUGHT, /* nothing to report */
    TL_OTHER_METHOD_UNKNOWN,    /* the trial failed; `text` gives the reason */
    TL_OTHER_METHOD_NONE,       /* `auto` finds no exact method either */
    TL_OTHER_METHOD_FOUND       /* `auto` finds the exact method in `way` */
} tl_other_method_kind;

/* Result for one component. */
typedef struct tl_other_method {
    tl_other_method_kind kind;
    tl_component_method way;  /* only for TL_OTHER_METHOD_FOUND */
    uint32_t replay_steps;    /* configured limit: replay works only so many steps after the start */
    char text[TL_ERROR_TEXT]; /* only for TL_OTHER_METHOD_UNKNOWN */
} tl_other_method;

enum { TL_OTHER_METHOD_TEXT = TL_ERROR_TEXT + 400 };

/* Fills one entry per component. `checked`: result of the check with the configuration of
 * `settings`. Errors: TL_INTERRUPTED. */
tl_status tl_other_method_find(const tl_twin_child_settings *settings, const tl_component_methods *checked,
                               tl_other_method found[TL_RECORDER_COMPONENTS], tl_error *error);

/* Writes a sentence that is printed after the component's name. Not for TL_OTHER_METHOD_NOT_SOUGHT.
 */
void tl_other_method_describe(const tl_other_method *other, char text[TL_OTHER_METHOD_TEXT]);

/* ---- Comparison of two twins of one configuration: finds FMUs that are not deterministic or need
 * a process of their own.
 *
 * Purpose: one process runs both twins (twin_trial.h). If they differ, another process repeats the
 *          first twin alone. An FMU whose values differ when the first twin is repeated is *not
 *          deterministic*, and so is an FMU that fails in the first twin, because it did not fail
 *          in the check before. An FMU is *one per process* if its values differ only beside
 *          another instance, or if its second instance crashes, never returns or is rejected. This
 *          holds even if its modelDescription.xml permits several instances.
 * Bound:   TL_PAIR_STEPS and TL_PAIR_LONGEST (twin_trial.h).
 */

typedef enum tl_pair_kind {
    TL_PAIR_UNKNOWN, /* the FMUs cannot step, or the machine cannot run two twins; `text` gives the reason */
    TL_PAIR_SAME,
    TL_PAIR_NOT_DETERMINISTIC,
    TL_PAIR_ONE_PER_PROCESS
} tl_pair_kind;

typedef struct tl_pair_verdict {
    tl_pair_kind kind;
    uint32_t steps;               /* number of compared steps */
    char component[TL_PAIR_NAME]; /* "": unknown */
    char text[TL_ERROR_TEXT];     /* what went wrong; "": nothing */
} tl_pair_verdict;

/* Runs the comparison, after a check with these settings that found no problem. Errors:
 * TL_INTERRUPTED. */
tl_status tl_pair_verdict_find(const tl_twin_child_settings *settings, tl_pair_verdict *verdict, tl_error *error);

#endif
