/* The mails of a run: see live_mails.h. */
#include "firmware/tree/live_mails.h"

#include "firmware/live/live_wire.h"

static void close_one(tl_live_mail *mail) {
    if (mail->number != 0) {
        tl_block_close(&mail->block);
    }
    *mail = (tl_live_mail){.block = {.descriptor = -1}};
}

tl_status tl_live_mails_make(tl_live_mails *mails, uint32_t which, size_t plant_bytes, tl_error *error) {
    tl_live_mail *mail = &mails->mail[which];
    close_one(mail);
    tl_status status = tl_block_make_sparse("twinlock mail", tl_live_mail_bytes_of(plant_bytes), &mail->block, error);
    mail->number = status == TL_OK ? ++mails->made : 0;
    return status;
}

void tl_live_mails_close(tl_live_mails *mails) {
    for (size_t i = 0; i < TL_LIVE_PLACES; i++) {
        close_one(&mails->mail[i]);
    }
}
