/* A library with a variable: see table.h. */
#include "tests/unit/firmware/fmu/table.h"

static int count;

__attribute__((visibility("default"))) int table_count(void) {
    return ++count;
}
