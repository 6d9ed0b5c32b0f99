/* stderr to a temporary file and back. */
#include "tests/support/stderr_capture.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static FILE *captured;
static int original = -1;

bool tl_stderr_capture_begin(void) {
    captured = tmpfile();
    if (captured == NULL) {
        return false;
    }
    (void)fflush(stderr);
    original = dup(STDERR_FILENO);
    return original >= 0 && dup2(fileno(captured), STDERR_FILENO) >= 0;
}

char *tl_stderr_capture_end(void) {
    if (captured == NULL || original < 0) {
        return NULL;
    }
    (void)fflush(stderr);
    (void)dup2(original, STDERR_FILENO);
    (void)close(original);
    original = -1;
    long length = fseek(captured, 0, SEEK_END) == 0 ? ftell(captured) : 0;
    size_t size = length > 0 ? (size_t)length : 0;
    char *text = calloc(1, size + 1);
    rewind(captured);
    if (text != NULL && fread(text, 1, size, captured) != size) {
        text[0] = '\0';
    }
    (void)fclose(captured);
    captured = NULL;
    return text;
}
