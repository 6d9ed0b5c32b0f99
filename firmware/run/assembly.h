/* An assembly: a configuration, its FMUs, and the twin built from them.
 *
 * Purpose: what every verb that simulates starts from, put together and taken apart in one place.
 * Owner:   the assembly owns all of it until tl_assembly_free().
 * Thread:  one thread, that of the FMUs (fmu_thread.h), from load or build to free; read may come before, in another one.
 */
#ifndef TL_FIRMWARE_RUN_ASSEMBLY_H
#define TL_FIRMWARE_RUN_ASSEMBLY_H

#include "firmware/base/sha256.h"
#include "firmware/config/config.h"
#include "firmware/config/problems.h"
#include "firmware/fmu/fmu_store.h"
#include "firmware/record/recorder.h"
#include "master/twin/twin.h"

typedef struct tl_assembly {
    tl_config config;
    tl_problems problems;
    tl_fmu *fmus; /* each file once, however many components use it */
    size_t fmu_count;
    tl_plan plan;
    tl_plan_component *components; /* of the plan */
    tl_plan_signal *signals;
    tl_plan_match *match;
    tl_plan_output *outputs; /* what `emulate` reads */
    tl_twin *twin;
} tl_assembly;

/* Reads the configuration, loads the FMUs and builds the twin. On failure every problem was said on the log and the
 * status is that of the first; the assembly must be freed all the same. */
tl_status tl_assembly_load(const char *path, tl_assembly *assembly);

/* The same in two parts, for a verb whose options change something in assembly->config between them. */
tl_status tl_assembly_read(const char *path, tl_assembly *assembly);
tl_status tl_assembly_build(tl_assembly *assembly);

/* The twin anew, of an assembly that has had one. Problems are said on the log. */
tl_status tl_assembly_rebuild(tl_assembly *assembly);

/* What its FMUs are: tl_identity_files() of the components'. */
void tl_assembly_identify(const tl_assembly *assembly, char text[TL_SHA256_TEXT]);

/* Opens the recorder for this assembly; `path` is the database. wait_when_full and beats as in recorder.h. One that was not built
 * records samples and events only. */
tl_status tl_assembly_record(const tl_assembly *assembly, const char *verb, const char *path, bool wait_when_full,
                             tl_heartbeats *beats, tl_recorder **recorder, tl_error *error);

/* The matched and the adjusted variables as the recorder and the report name them; texts live as long as the assembly. */
void tl_assembly_signals(const tl_assembly *assembly, tl_recorder_signal match[TL_MAX_MATCH],
                         tl_recorder_signal adjust[TL_MAX_ADJUST]);

/* Puts a step with the twin's ledger as it stands. In mode ahead that is one step further than the record. */
void tl_assembly_put_step(const tl_assembly *assembly, tl_recorder *recorder, const tl_record *record);

/* Warns of components that were executed more often than their ledger predicts: in the log, and where there is a recorder
 * (NULL: none) as an event. For the end of a run, when nothing steps any more. */
void tl_assembly_check_ledger(const tl_assembly *assembly, tl_recorder *recorder);

/* A zeroed assembly is allowed. */
void tl_assembly_free(tl_assembly *assembly);

#endif
