/* What came of one Modbus request, and how that is said. Private to the Modbus driver.
 *
 * Purpose: one answer is right, or says no, or is wrong, or there is none. The driver decides by the kind what that means for
 *          the link; people read the sentence.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_OUTCOME_H
#define TL_BOARD_MODBUS_MODBUS_OUTCOME_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/simtime.h"

typedef enum tl_modbus_kind {
    TL_MODBUS_VALUES,    /* the answer to what was asked, right in every byte that can be checked */
    TL_MODBUS_EXCEPTION, /* the device says no; found: its reason, 0 to 255 */
    /* no whole answer; found: errno, also libmodbus's. ETIMEDOUT: none in time, EPROTO: it breaks off, EBUSY: the line is never
     * quiet, EINTR: interrupted */
    TL_MODBUS_FAILED,
    /* Wrong, so nothing of it is used; found and wanted: the number that is wrong, and what it must be. */
    TL_MODBUS_WRONG_TRANSACTION,
    TL_MODBUS_WRONG_PROTOCOL,
    TL_MODBUS_WRONG_LENGTH, /* as the header gives it */
    TL_MODBUS_WRONG_UNIT,
    TL_MODBUS_WRONG_FUNCTION,
    TL_MODBUS_WRONG_BYTES /* how many there are of values */
} tl_modbus_kind;

/* Zeroed: TL_MODBUS_VALUES. */
typedef struct tl_modbus_outcome {
    tl_modbus_kind kind;
    int found;
    int wanted;
} tl_modbus_outcome;

/* Is the second one no news after the first? Answers that are wrong, in whatever way, are one thing, as are exceptions: who
 * tells another lie each time is told of once. */
bool tl_modbus_outcome_is_same(const tl_modbus_outcome *a, const tl_modbus_outcome *b);

/* In words: what was wrong and what to do about it. Not for TL_MODBUS_VALUES. */
void tl_modbus_outcome_text(const tl_modbus_outcome *outcome, bool on_a_line, tl_time timeout, char *text, size_t size);

#endif
