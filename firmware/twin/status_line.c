/* The status line: see status_line.h. */
#include "firmware/twin/status_line.h"

#include <stdio.h>

/* Nominal by a choice that lasts, and not because no correction was found. */
static const char *outcome_of(const tl_record *record) {
    return (record->flags & TL_FLAG_RESTS) != 0 ? "rests" : tl_outcome_name(record->outcome);
}

void tl_status_line_write(const tl_config *config, const tl_cycle_status *status, char line[TL_STATUS_LINE]) {
    const tl_record *record = &status->record;
    int length =
        snprintf(line, TL_STATUS_LINE, "%8.2f s", tl_seconds(tl_time_of_step(0, config->step, record->step + 1)));
    for (size_t i = 0; i < config->adjust_count && i < 2; i++) {
        length += snprintf(line + length, TL_STATUS_LINE - (size_t)length, "  \316\224%.63s %+.4g",
                           config->adjust[i].variable, record->u[i] - record->u_hat[i]);
    }
    length += snprintf(line + length, TL_STATUS_LINE - (size_t)length, "  %-12s", outcome_of(record));
    if (config->adjust_count != 0) {
        length +=
            snprintf(line + length, TL_STATUS_LINE - (size_t)length, "  %-8s", tl_lock_state_name(status->lock.state));
    }
    for (size_t i = 0; i < config->match_count && i < 2; i++) {
        length += snprintf(line + length, TL_STATUS_LINE - (size_t)length,
                           record->y_hat_quality[i] == TL_GOOD ? "  %.63s %.4g (plant %.4g)"
                                                               : "  %.63s %.4g (plant %.4g, %s)",
                           config->match[i].variable, record->y[i], record->y_hat[i],
                           tl_quality_name((tl_quality)record->y_hat_quality[i]));
    }
    (void)snprintf(line + length, TL_STATUS_LINE - (size_t)length, "  %.2f ms  skipped %llu",
                   tl_seconds(record->used) * 1e3, (unsigned long long)status->skipped);
}
