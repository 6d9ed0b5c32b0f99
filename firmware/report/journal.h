/* Journal: accepts events from any thread and passes them to the log and the recorder.
 *
 * Purpose: the cycle and the drivers report events without waiting; the main thread writes them to
 *          stderr later.
 * Bound:   at most TL_JOURNAL_ENTRIES events wait for the log. Further ones are recorded but not
 *          logged; the log gets their number.
 * Memory:  all inside the struct.
 * Thread:  event() from any thread; it never blocks, and retries only if another thread adds an
 *          event at the same time. drain() from one thread.
 */
#ifndef TL_FIRMWARE_REPORT_JOURNAL_H
#define TL_FIRMWARE_REPORT_JOURNAL_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/log_repeats.h"
#include "firmware/store/recorder.h"
#include "master/base/status.h"

enum { TL_JOURNAL_ENTRIES = 256, TL_JOURNAL_TEXT = 224 }; /* texts: bytes, longer ones are truncated */

typedef struct tl_journal_entry {
    uint64_t turn; /* n: free for event number n; n + 1: contains event number n */
    tl_severity severity;
    bool apart; /* event of a shadow */
    char source[16];
    char text[TL_JOURNAL_TEXT];
} tl_journal_entry;

/* Called with an event, in the thread that reports it. The texts are valid during the call. */
typedef void tl_journal_listener(void *context, int64_t tick, tl_severity severity, const char *source,
                                 const char *text);

/* Fields are private. */
typedef struct tl_journal {
    tl_recorder *recorder;         /* NULL: events are only logged */
    tl_journal_listener *on_event; /* NULL: no listener */
    void *listener;                /* context of on_event */
    uint64_t head;                 /* number of the next event to write */
    uint64_t tail;                 /* number of the next event to read */
    uint64_t dropped;              /* events that were not logged since the last drain */
    bool apart;                    /* see tl_journal_set_apart() */
    tl_log_repeats repeats;        /* of the thread that drains */
    tl_journal_entry entries[TL_JOURNAL_ENTRIES];
} tl_journal;

/* `recorder` must outlive the journal. NULL: events are only logged. */
void tl_journal_init(tl_journal *journal, tl_recorder *recorder);

/* Sets the listener, before other threads report events. It is called with every event that is not
 * a shadow's, and must be safe to call from any thread. */
void tl_journal_listen(tl_journal *journal, tl_journal_listener *on_event, void *context);

/* Adds an event, as tl_recorder_event(), with a text as printf() makes it. `tick` −1: no tick. */
void tl_journal_event(tl_journal *journal, int64_t tick, tl_severity severity, const char *source, const char *format,
                      ...) TL_PRINTF(5, 6);

/* `apart` true: the twin is a shadow, so its events are only logged, with the prefix "shadow: ".
 * Any thread. */
void tl_journal_set_apart(tl_journal *journal, bool apart);
bool tl_journal_is_apart(const tl_journal *journal);

/* Writes the queued events to the log; counts repeated ones (log_repeats.h). */
void tl_journal_drain(tl_journal *journal);

/* Call it at the end: as tl_journal_drain(), and logs the counts of repeated events. */
void tl_journal_end(tl_journal *journal);

#endif
