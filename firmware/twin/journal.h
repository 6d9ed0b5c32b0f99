/* The journal: events from any thread, to the log and to the recorder.
 *
 * Purpose: the cycle and the drivers say what happened without waiting; the main thread writes it to stderr later.
 * Bound:   TL_JOURNAL_ENTRIES events wait at most; more are counted and said as one.
 * Thread:  event() from any thread, wait-free but for a compare-and-swap loop among writers; drain() from one.
 */
#ifndef TL_FIRMWARE_TWIN_JOURNAL_H
#define TL_FIRMWARE_TWIN_JOURNAL_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/recorder.h"
#include "master/base/status.h"

enum { TL_JOURNAL_ENTRIES = 256, TL_JOURNAL_TEXT = 224 };

typedef struct tl_journal_entry {
    uint64_t turn; /* whose turn the slot is */
    tl_severity severity;
    bool apart;
    char source[16];
    char text[TL_JOURNAL_TEXT];
} tl_journal_entry;

typedef void tl_journal_listener(void *context, int64_t tick, tl_severity severity, const char *source,
                                 const char *text);

/* Fields are private. */
typedef struct tl_journal {
    tl_recorder *recorder;     /* NULL: events are only logged */
    tl_journal_listener *hear; /* NULL: nobody does */
    void *listener;
    uint64_t head; /* next to write */
    uint64_t tail; /* next to read */
    uint64_t dropped;
    bool apart; /* as tl_journal_set_apart() */
    tl_journal_entry entries[TL_JOURNAL_ENTRIES];
} tl_journal;

/* `recorder` may be NULL: events are only logged. */
void tl_journal_init(tl_journal *journal, tl_recorder *recorder);

/* From now on `hear` is called with every event, in the thread that tells it. Any thread may tell: `hear` bears that. */
void tl_journal_listen(tl_journal *journal, tl_journal_listener *hear, void *context);

/* As tl_recorder_event(); `tick` −1 where it belongs to none. */
void tl_journal_event(tl_journal *journal, int64_t tick, tl_severity severity, const char *source, const char *format,
                      ...) TL_PRINTF(5, 6);

/* From now on, until it is told otherwise: what happens is a shadow's. It goes to the log only, as "shadow: …". Any thread. */
void tl_journal_set_apart(tl_journal *journal, bool apart);
bool tl_journal_is_apart(const tl_journal *journal);

/* Writes what waits to the log. */
void tl_journal_drain(tl_journal *journal);

#endif
