/* Config manager: the process that changes the configuration of the run. It has no plant, FMU,
 * network or database. See live_role.h. */
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/live/live_host.h"
#include "firmware/live/live_role.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/role.h"
#include "firmware/retune/config_manager.h"

/* Heartbeat timeout: writing one version to a worn memory card may take long. */
static const tl_time PATIENCE = 60 * TL_SECOND;

typedef struct activator_process {
    tl_live_given given;
    tl_live_host host;
    tl_activation_host functions;
    tl_config_manager *activator;
} activator_process;

static void open_host(activator_process *self) {
    tl_live_given *given = &self->given;
    tl_live_host *host = &self->host;
    *host = (tl_live_host){.pulse = given->blocks[TL_LIVE_CONFIG_MANAGER_PULSE].bytes,
                           .recorder = given->blocks[TL_LIVE_RECORDER_PULSE].bytes,
                           .stage = given->blocks[TL_HANDOVER].bytes,
                           .candidate = given->blocks[TL_LIVE_CANDIDATE].bytes,
                           .path = given->config.path,
                           .text = given->config.text,
                           .text_hash = given->config.hash,
                           .step = given->config.step,
                           .journal = &given->journal};
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
        host->twins[i] = given->blocks[TL_LIVE_TWIN_PULSE + i].bytes;
        host->tunings[i] = given->blocks[TL_LIVE_TUNING + i].bytes;
        memcpy(host->hash[i], given->job.hash[i], sizeof host->hash[i]);
    }
}

static tl_status open_activator(activator_process *self, tl_error *error) {
    self->functions = tl_live_host_functions(&self->host);
    const tl_activation_settings settings = {.plant = self->given.config.name,
                                             .path = self->given.config.path,
                                             .allowed = self->given.job.allowed,
                                             .memory_limit = self->given.job.memory_limit,
                                             .unconfined = self->given.job.unconfined,
                                             .host = &self->functions};
    return tl_config_manager_open(TL_LIVE_KNOCKER, self->given.job.state, &settings, &self->activator, error);
}

int tl_config_manager_role_run(void) {
    static activator_process self; /* one per process */
    tl_error error;
    tl_role_open_program();
    tl_status status = tl_live_role_begin(TL_LIVE_IS_ACTIVATOR, &self.given);
    if (status != TL_OK) {
        return tl_exit_code(status);
    }
    open_host(&self);
    tl_thread_heartbeat *heartbeat = tl_thread_heartbeat_start(&self.host.pulse->beats, "activator", PATIENCE);
    status = open_activator(&self, &error);
    bool was_ready = status == TL_OK;
    if (was_ready) {
        tl_heartbeats_set_ready(&self.host.pulse->beats);
        for (bool goes_on = true; goes_on && tl_interrupt_requested() == NULL;) {
            goes_on = tl_config_manager_work(self.activator);
            tl_live_host_look(&self.host);
            tl_thread_heartbeat_beat(heartbeat);
            tl_journal_drain(&self.given.journal);
        }
        tl_config_manager_close(self.activator);
    } else {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    tl_journal_drain(&self.given.journal);
    return tl_live_role_end(&self.host.pulse->beats, was_ready, tl_exit_code(status));
}
