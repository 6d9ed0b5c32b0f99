/* The recorder of an assembly, for tests that drive the twin themselves. */
#ifndef TL_TESTS_SUPPORT_ASSEMBLY_RECORDER_H
#define TL_TESTS_SUPPORT_ASSEMBLY_RECORDER_H

#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_recorder.h"

/* Opens a recorder as a run does. Its texts are valid until the next call. */
static inline tl_status tl_test_record(const tl_assembly *assembly, const char *verb, const char *path,
                                       tl_recorder **recorder, tl_error *error) {
    static tl_account account;
    static tl_twin_record record;
    tl_twin_recorder_describe(&assembly->config, path, &record);
    record.settings.verb = verb;
    tl_account_take(assembly->twin, &account);
    return tl_twin_recorder_open(&assembly->config, &account, &record, recorder, error);
}

/* Puts a step with the twin's present ledger. */
static inline void tl_test_put_step(tl_recorder *recorder, const tl_record *record, const tl_twin *twin) {
    tl_execution_counts counts[TL_RECORDER_COMPONENTS];
    (void)tl_twin_recorder_count(twin, counts);
    tl_recorder_put_step(recorder, record, counts);
}

#endif
