/* Stands for Python's shared library in test_library.c: it has a version, a symbol that an FMU
 * lacks, and a destructor. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Python's names, not ours. */
// NOLINTBEGIN(readability-identifier-naming)
const char *Py_GetVersion(void);
int Py_cmp(const char *a, const char *b);

const char *Py_GetVersion(void) {
    return TL_VERSION " (of a test) [C]";
}

int Py_cmp(const char *a, const char *b) {
    return strcmp(a, b);
}
// NOLINTEND(readability-identifier-naming)

__attribute__((destructor)) static void be_ended(void) {
    const char *path = getenv("TL_TEST_ENDED");
    FILE *file = path == NULL ? NULL : fopen(path, "w");
    if (file != NULL) {
        (void)fclose(file);
    }
}
