/* The audit: see server_parts.h. One line for each request that may change something, once its end is known. */
#include <stdio.h>

#include "firmware/retune/control_words.h"
#include "firmware/serve/server_parts.h"

static const char *verb_of(const tl_control_request *control) {
    switch ((tl_control_verb)control->verb) {
    case TL_CONTROL_TAKE:
        return (control->flags & TL_CONTROL_ONLY_CHECK) != 0 ? "check" : "change";
    case TL_CONTROL_CONFIRM:
        return "confirm";
    case TL_CONTROL_RETURN:
        return "return";
    case TL_CONTROL_SHOW:
    case TL_CONTROL_READ:
    case TL_CONTROL_VERSIONS:
    case TL_CONTROL_VERBS:
        break;
    }
    return "ask";
}

void tl_visit_audit(const tl_visit *visit) {
    const tl_http_request *request = &visit->dialogue.request;
    const tl_control_request *control = &request->control;
    if (!request->is_change || visit->token[0] == '\0') {
        return;
    }
    const char *result = visit->dialogue.result;
    tl_log(TL_LOG_NOTICE, "audit: token=%s role=%s from=%s verb=%s plant=%s result=%s version=%llu%s%s", visit->token,
           tl_control_right_name((tl_control_right)control->right), visit->from, verb_of(control), request->plant,
           result != NULL ? result : "not known: who asked has left", (unsigned long long)visit->dialogue.version,
           control->why[0] != '\0' ? " why=" : "", control->why);
}
