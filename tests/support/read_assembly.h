/* Reads the assembly of a configuration file, as the commands do. */
#ifndef TL_TESTS_SUPPORT_READ_ASSEMBLY_H
#define TL_TESTS_SUPPORT_READ_ASSEMBLY_H

#include "firmware/config/config.h"
#include "firmware/twin/assembly.h"

/* Reads only the configuration, so that a test can change it before tl_assembly_build(). Free the
 * assembly also after a failure. */
static inline tl_status tl_test_read_assembly(const char *path, tl_assembly *assembly) {
    *assembly = (tl_assembly){0};
    tl_problems_init(&assembly->problems, path);
    tl_status status = tl_config_read(path, &assembly->config, &assembly->problems.report);
    assembly->problems.config = status == TL_OK ? &assembly->config : NULL;
    return status;
}

/* Reads the configuration, loads the FMUs and builds the twin. */
static inline tl_status tl_test_load_assembly(const char *path, tl_assembly *assembly) {
    tl_status status = tl_test_read_assembly(path, assembly);
    return status == TL_OK ? tl_assembly_build(assembly) : status;
}

#endif
