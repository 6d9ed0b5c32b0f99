/* A library that needs another one: see table.h. */
#include "tests/unit/firmware/copies/table.h"

__attribute__((visibility("default"))) int model_count(void) {
    return table_count();
}
