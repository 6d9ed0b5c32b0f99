/* Where a verb prints its result: see output.h. */
#include "firmware/output.h"

#include <fcntl.h>
#include <unistd.h>

FILE *tl_output_claim(void) {
    int real = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
    FILE *output = real < 0 ? NULL : fdopen(real, "w");
    if (output == NULL) {
        return stdout;
    }
    (void)dup2(STDERR_FILENO, STDOUT_FILENO);
    return output;
}
