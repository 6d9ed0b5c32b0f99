/* Where a verb prints its result: see output.h. */
#include "firmware/base/output.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"

FILE *tl_output_claim(void) {
    int real = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
    FILE *output = real < 0 ? NULL : fdopen(real, "w");
    if (output == NULL) {
        return stdout;
    }
    (void)dup2(STDERR_FILENO, STDOUT_FILENO);
    return output;
}

tl_status tl_output_finish(FILE *output, tl_status status) {
    bool failed = ferror(output) != 0;
    failed = fflush(output) != 0 || failed;
    if (!failed || (status != TL_OK && status != TL_NOT_LOCKED)) {
        return status;
    }
    tl_log(TL_LOG_ERROR, "the result could not be written to standard output: %s", strerror(errno));
    return TL_TRY_AGAIN;
}
