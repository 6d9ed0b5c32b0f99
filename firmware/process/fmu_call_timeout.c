/* Call timeout: see fmu_call_timeout.h. */
#include "firmware/process/fmu_call_timeout.h"

#include <stdio.h>

#include "firmware/base/os.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"

/* Signals within this time count as one request, because a terminal and a supervisor may both send
 * one. */
static const tl_time AGAIN = TL_SECOND;

static void note_time(tl_fmu_call_timeout *patience, const tl_fmu_call_timeout_view *view) {
    tl_time passed = patience->checked_at == 0 ? 0 : view->now - patience->checked_at;
    bool same = view->call != NULL && view->call->begun == patience->begun;
    passed = passed > TL_SECOND ? TL_SECOND : passed;
    patience->checked_at = view->now;
    patience->lasted = same ? patience->lasted + passed : 0;
    patience->begun = view->call != NULL ? view->call->begun : patience->begun;
    patience->times = patience->asked < AGAIN ? view->times : patience->times;
    patience->asked = view->asked != NULL ? patience->asked + passed : 0;
}

bool tl_fmu_call_timeout_is_over(tl_fmu_call_timeout *patience, const tl_fmu_call_timeout_view *view, char *text,
                                 size_t size) {
    const tl_fmu_call *call = view->call;
    note_time(patience, view);
    if (view->times > patience->times && (call != NULL || view->whatever)) {
        int length = snprintf(text, size, "%s received twice: ended at once", view->asked);
        if (call != NULL && length > 0 && (size_t)length < size) {
            (void)snprintf(text + length, size - (size_t)length, ", while FMU %s was in %s", call->fmu, call->function);
        }
        return true;
    }
    if (call == NULL) {
        return false;
    }
    if (patience->asked >= TL_FMU_CALL_TIMEOUT_END && patience->lasted >= TL_FMU_CALL_TIMEOUT_END) {
        (void)snprintf(text, size, "%s received, but FMU %s has not returned from %s for %.0f s: ended without waiting",
                       view->asked, call->fmu, call->function, tl_seconds(patience->lasted));
        return true;
    }
    if (patience->limit > 0 && patience->lasted >= patience->limit) {
        (void)snprintf(text, size,
                       "FMU %s has not returned from %s for %g s: it hangs, or needs more time (raise --call-limit)",
                       call->fmu, call->function, tl_seconds(patience->limit));
        return true;
    }
    return false;
}

void tl_fmu_call_timeout_poll(tl_fmu_call_timeout *patience) {
    char text[256];
    tl_fmu_call call;
    bool is_called = tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call);
    const tl_fmu_call_timeout_view view = {
        .now = tl_clock_now(NULL),
        .call = is_called ? &call : NULL,
        .asked = tl_interrupt_requested(),
        .times = tl_interrupt_times(),
    };
    if (view.asked != NULL) {
        tl_fmu_calls_note_end_request();
    }
    if (tl_fmu_call_timeout_is_over(patience, &view, text, sizeof text)) {
        tl_process_give_up(text);
    }
    if (patience->lasted > 0) {
        tl_interrupt_reclaim();
    }
}
