/* twinlock finding, twinlock learn: what a user does with findings. */
#include <string.h>
#include <unistd.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/cli/options.h"
#include "firmware/retune/control_client.h"
#include "firmware/store/finding_notes.h"

enum { LONGEST_NOTE = 1000 }; /* bytes; the history refuses texts above 4096 */

static int end_with(tl_status status, const tl_error *error) {
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error->text);
    }
    return tl_exit_code(status);
}

int tl_verb_finding(const tl_options *options) {
    tl_error error;
    char who[TL_CONTROL_NAME];
    if ((options->acknowledge == 0) == (options->normal == 0)) {
        return end_with(tl_fail(&error, TL_BAD_USAGE,
                                "finding: give the number of a finding, either with --acknowledge N or --normal N"),
                        &error);
    }
    if (options->note != NULL && (strlen(options->note) > LONGEST_NOTE || !tl_text_is_plain(options->note))) {
        return end_with(tl_fail(&error, TL_BAD_USAGE,
                                "finding: --note has more than %d bytes, a control character, or is not UTF-8",
                                LONGEST_NOTE),
                        &error);
    }
    tl_control_client_name(getuid(), who);
    const bool accepts = options->normal != 0;
    const int64_t number = (int64_t)(accepts ? options->normal : options->acknowledge);
    return end_with(tl_finding_notes_write(options->subject, number, who, options->note, accepts, &error), &error);
}

int tl_verb_learn(const tl_options *options) {
    tl_error error;
    return end_with(tl_finding_notes_forget(options->subject, &error), &error);
}
