/* stderr to a temporary file and back. */
#include "tests/support/stderr_capture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "tests/support/message.h"

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

void tl_stderr_expect(const char *expected) {
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_EQUAL_STRING(expected, text);
    free(text);
}

size_t tl_test_count_lines(const char *text) {
    size_t count = 0;
    for (const char *c = strchr(text, '\n'); c != NULL; c = strchr(c + 1, '\n')) {
        count++;
    }
    return count;
}

void tl_stderr_expect_lines(const char *const *parts, size_t count) {
    char *rest = NULL;
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, tl_test_count_lines(text), text);
    for (size_t i = 0; i < count; i++) {
        const char *line = strtok_r(i == 0 ? text : NULL, "\n", &rest);
        TL_EXPECT_PARTS(parts[i], line);
    }
    free(text);
}
