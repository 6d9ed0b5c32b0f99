/* What the processes of a run share: see live_blocks.h. */
#include "firmware/live/live_blocks.h"

#include "firmware/live/live_wire.h"
#include "firmware/twin/checkpointer.h"

static size_t outbox_with(const tl_config *config, size_t checkpoint) {
    tl_outbox_settings settings = tl_live_twin_outbox(config);
    settings.checkpoint_bytes = checkpoint;
    return tl_outbox_bytes(&settings);
}

void tl_live_blocks_of(const tl_config *config, size_t checkpoint, tl_live_blocks *blocks) {
    const tl_outbox_settings events = tl_live_event_outbox();
    const tl_past_shape ticks = tl_past_shape_of(config);
    size_t room = tl_checkpointer_room(checkpoint);
    tl_plant_mail_shape mail;
    tl_plant_mail_shape_of(config, &mail);
    *blocks = (tl_live_blocks){
        .mail = tl_live_mail_bytes(&mail),
        .outbox = outbox_with(config, 0) + tl_live_io_bytes() + tl_outbox_bytes(&events) + sizeof(tl_live_twin_pulse) +
                  sizeof(tl_live_recorder_pulse),
    };
    if (room <= TL_LIVE_CHECKPOINT_BYTES) {
        blocks->checkpoints = outbox_with(config, room) - outbox_with(config, 0);
    }
    if (config->record_resume != 0) {
        blocks->past = tl_past_image_bytes(&ticks, TL_PAST_TICKS, checkpoint, 0);
    }
    blocks->shadow = outbox_with(config, 0) + sizeof(tl_live_twin_pulse) + blocks->checkpoints + blocks->past;
}
