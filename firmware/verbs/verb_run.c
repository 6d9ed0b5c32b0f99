/* twinlock run: the appliance, supervised or not. */

#include "firmware/process/crash.h"
#include "firmware/process/process_end.h"
#include "firmware/run/appliance.h"
#include "firmware/supervise/supervisor.h"
#include "firmware/verbs/verb_job.h"
#include "firmware/verbs/verbs.h"

/* In a process of its own, or in the only one. */
static int run(void *context, const tl_start *start) {
    tl_process_begin();
    tl_crash_install();
    tl_process_end(tl_appliance_run(context, start));
}

int tl_verb_run(const tl_options *options) {
    tl_assembly assembly;
    tl_status status = tl_assembly_read(options->subject, &assembly);
    if (status != TL_OK) {
        tl_assembly_free(&assembly);
        return tl_exit_code(status);
    }
    if (options->duration_s > 0.0) {
        assembly.config.duration = tl_time_of_seconds(options->duration_s);
    }
    tl_appliance_settings appliance = {
        .assembly = &assembly,
        .database = options->database,
        .json = options->json,
        .status = options->status,
        .unconfined = tl_verb_is_unconfined(options, &assembly.config),
    };
    if (!options->supervise) {
        return run(&appliance, NULL);
    }
    /* Every child builds its twin from what was read here: a restart runs what ran before, whatever the file says by then. */
    const tl_supervisor_settings settings = {
        .state = options->state,
        .watchdog = options->watchdog,
        .watchdog_s = (int)options->watchdog_s,
        .run = run,
        .context = &appliance,
    };
    int code = tl_supervise(&settings);
    tl_assembly_free(&assembly);
    return code;
}
