/* A file in one piece of memory. */
#include "tests/support/kept_file.h"

#include <stdio.h>
#include <stdlib.h>

#include <unity.h>

void tl_kept_file_read(tl_kept_file *kept, const char *path) {
    tl_kept_file_free(kept);
    FILE *file = fopen(path, "rb");
    TEST_ASSERT_NOT_NULL_MESSAGE(file, path);
    (void)fseek(file, 0, SEEK_END);
    kept->size = (size_t)ftell(file);
    rewind(file);
    kept->bytes = malloc(kept->size);
    TEST_ASSERT_NOT_NULL(kept->bytes);
    TEST_ASSERT_EQUAL_size_t(kept->size, fread(kept->bytes, 1, kept->size, file));
    (void)fclose(file);
}

void tl_kept_file_write(const tl_kept_file *kept, const char *path) {
    FILE *file = fopen(path, "wb");
    TEST_ASSERT_NOT_NULL_MESSAGE(file, path);
    TEST_ASSERT_EQUAL_size_t(kept->size, fwrite(kept->bytes, 1, kept->size, file));
    (void)fclose(file);
}

void tl_kept_file_free(tl_kept_file *kept) {
    free(kept->bytes);
    *kept = (tl_kept_file){NULL, 0};
}
