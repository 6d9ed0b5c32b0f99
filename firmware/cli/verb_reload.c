/* twinlock reload: sends a changed configuration to a running twin through its control socket. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/base/text.h"
#include "firmware/cli/options.h"
#include "firmware/retune/control.h"
#include "firmware/retune/control_client.h"

typedef struct reload {
    const tl_options *options;
    bool is_input; /* the configuration is read from standard input */
    tl_control_client_settings client;
    char path[PATH_MAX]; /* of the control socket */
    char text[TL_CONTROL_MOST + 1];
    size_t size;
    tl_control_request request;
} reload;

/* ---- the request ---- */

static tl_status read_subject(reload *self, tl_error *error) {
    if (self->is_input && isatty(STDIN_FILENO) == 1) {
        return tl_fail(error, TL_BAD_USAGE, "%s: is a terminal (expected a file or a pipe): add `< FILE`",
                       self->client.subject);
    }
    int file = self->is_input ? STDIN_FILENO : open(self->options->subject, O_RDONLY | O_CLOEXEC | O_NOCTTY);
    ssize_t size = file < 0 ? -1 : tl_file_bytes_read(file, self->text, sizeof self->text);
    int cause = errno;
    if (file > STDIN_FILENO) {
        (void)close(file);
    }
    if (size < 0) {
        return tl_fail(error, TL_BAD_DATA, "%s: %s", self->client.subject, strerror(cause));
    }
    if (size == 0 || size > TL_CONTROL_MOST) {
        return tl_fail(error, TL_BAD_DATA, "%s: %s (expected a configuration of 1 to %d bytes)", self->client.subject,
                       size == 0 ? "is empty" : "is too large", (int)TL_CONTROL_MOST);
    }
    self->size = (size_t)size;
    return TL_OK;
}

static tl_control_verb verb_of(const tl_options *options) {
    return options->confirm    ? TL_CONTROL_CONFIRM
           : options->rollback ? TL_CONTROL_ROLL_BACK
           : options->versions ? TL_CONTROL_VERSIONS
           : options->show     ? TL_CONTROL_SHOW
                               : TL_CONTROL_APPLY;
}

static void fill_request(reload *self) {
    const tl_options *options = self->options;
    tl_control_request *request = &self->request;
    memset(request, 0, sizeof *request);
    request->verb = (uint32_t)verb_of(options);
    /* Any right that is given is lower than the right of the box: see TL_RIGHT_BOX. */
    bool is_limited = options->right < TL_RIGHT_BOX;
    request->right = is_limited ? options->right : TL_RIGHT_COMMISSION;
    request->origin = is_limited ? TL_ORIGIN_LIMITED : TL_ORIGIN_RELOAD;
    request->flags = (options->only_check ? TL_CONTROL_ONLY_CHECK : 0U) |
                     (options->restart ? TL_CONTROL_MAY_RESTART : 0U) |
                     (options->accept_worse ? TL_CONTROL_ACCEPT_WORSE : 0U) |
                     (options->until_confirmed ? TL_CONTROL_MUST_CONFIRM : 0U) | (options->wait ? TL_CONTROL_WAIT : 0U);
    request->shadow_s = (uint32_t)options->shadow_s;
    request->probation_s = (uint32_t)options->probation_s;
    request->require_lock = options->keep_lock > 0.0 ? options->keep_lock : -1.0;
    request->version = options->version;
    tl_control_client_name(geteuid(), request->who);
    if (options->why != NULL) {
        (void)tl_clean_text(options->why, strlen(options->why), request->why, sizeof request->why);
    }
}

int tl_verb_reload(const tl_options *options) {
    static reload self; /* static, because it is too large for the stack */
    tl_control_result result = TL_CONTROL_FAILED;
    tl_error error;
    self = (reload){.options = options, .is_input = strcmp(options->subject, TL_CONTROL_CLIENT_INPUT) == 0};
    self.client = (tl_control_client_settings){
        .path = self.path, .output = tl_output_claim(), .subject = self.is_input ? "standard input" : options->subject};
    tl_status status = tl_control_client_find(options->subject, options->control, self.path, &error);
    fill_request(&self);
    bool sends = self.request.verb == TL_CONTROL_APPLY;
    if (status == TL_OK && sends) {
        status = read_subject(&self, &error);
    }
    if (status == TL_OK) {
        status =
            tl_control_client_run(&self.client, &self.request, sends ? self.text : NULL, self.size, &result, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    status = tl_output_finish(self.client.output, status);
    return status == TL_OK ? tl_control_exit_code(result) : tl_exit_code(status);
}
