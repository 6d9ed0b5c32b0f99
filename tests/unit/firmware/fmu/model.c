/* A library that needs another one: see table.h. */
#include "tests/unit/firmware/fmu/table.h"

__attribute__((visibility("default"))) int model_count(void) {
    return table_count();
}
