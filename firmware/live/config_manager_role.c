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

typedef struct manager_process {
    tl_live_setup setup;
    tl_live_host host;
    tl_activation_host functions;
    tl_config_manager *manager;
} manager_process;

static void open_host(manager_process *self) {
    tl_live_setup *setup = &self->setup;
    tl_live_host *host = &self->host;
    *host = (tl_live_host){.live_status = setup->blocks[TL_LIVE_CONFIG_MANAGER_STATUS].bytes,
                           .recorder = setup->blocks[TL_LIVE_RECORDER_STATUS].bytes,
                           .handover_block = setup->blocks[TL_HANDOVER].bytes,
                           .candidate = setup->blocks[TL_LIVE_CANDIDATE].bytes,
                           .path = setup->config.path,
                           .text = setup->config.text,
                           .text_hash = setup->config.hash,
                           .step = setup->config.step,
                           .journal = &setup->journal};
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
        host->twins[i] = setup->blocks[TL_LIVE_TWIN_STATUS + i].bytes;
        host->tunings[i] = setup->blocks[TL_LIVE_TUNING + i].bytes;
        memcpy(host->hash[i], setup->job.hash[i], sizeof host->hash[i]);
    }
}

static tl_status open_manager(manager_process *self, tl_error *error) {
    self->functions = tl_live_host_functions(&self->host);
    const tl_activation_settings settings = {.plant = self->setup.config.name,
                                             .path = self->setup.config.path,
                                             .allowed = self->setup.job.allowed,
                                             .memory_limit = self->setup.job.memory_limit,
                                             .unconfined = self->setup.job.unconfined,
                                             .host = &self->functions};
    return tl_config_manager_open(TL_LIVE_CLIENT, self->setup.job.state, &settings, &self->manager, error);
}

int tl_config_manager_role_run(void) {
    static manager_process self; /* one per process */
    tl_error error;
    tl_role_open_program();
    tl_status status = tl_live_role_begin(TL_LIVE_IS_CONFIG_MANAGER, &self.setup);
    if (status != TL_OK) {
        return tl_exit_code(status);
    }
    open_host(&self);
    tl_thread_heartbeat *heartbeat =
        tl_thread_heartbeat_start(&self.host.live_status->beats, "config manager", PATIENCE);
    status = open_manager(&self, &error);
    bool was_ready = status == TL_OK;
    if (was_ready) {
        tl_heartbeats_set_ready(&self.host.live_status->beats);
        for (bool continues = true; continues && tl_interrupt_requested() == NULL;) {
            continues = tl_config_manager_work(self.manager);
            tl_live_host_poll(&self.host);
            tl_thread_heartbeat_beat(heartbeat);
            tl_journal_drain(&self.setup.journal);
        }
        tl_config_manager_close(self.manager);
    } else {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    tl_journal_end(&self.setup.journal);
    return tl_live_role_end(&self.host.live_status->beats, was_ready, tl_exit_code(status));
}
