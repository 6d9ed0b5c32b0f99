/* twinlock inbox: configurations that are put into a folder, for a running plant's twin. */
#include "firmware/base/log.h"
#include "firmware/process/interrupt.h"
#include "firmware/retune/inbox.h"
#include "firmware/retune/talk.h"
#include "firmware/verbs/verbs.h"

int tl_verb_inbox(const tl_options *options) {
    char socket[PATH_MAX];
    tl_error error;
    tl_interrupt_install();
    tl_status status = tl_talk_find(options->subject, options->control, socket, &error);
    if (status == TL_OK) {
        status = tl_inbox_run(options->subject, socket, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}
