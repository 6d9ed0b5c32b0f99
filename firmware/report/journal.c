/* Journal: a bounded queue with a sequence number per entry; see journal.h. */
#include "firmware/report/journal.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/os.h"

void tl_journal_init(tl_journal *journal, tl_recorder *recorder) {
    memset(journal, 0, sizeof *journal);
    journal->recorder = recorder;
    for (uint64_t i = 0; i < TL_JOURNAL_ENTRIES; i++) {
        journal->entries[i].turn = i;
    }
}

void tl_journal_listen(tl_journal *journal, tl_journal_listener *on_event, void *context) {
    journal->on_event = on_event;
    journal->listener = context;
}

void tl_journal_set_apart(tl_journal *journal, bool apart) {
    __atomic_store_n(&journal->apart, apart, __ATOMIC_RELAXED);
}

bool tl_journal_is_apart(const tl_journal *journal) {
    return __atomic_load_n(&journal->apart, __ATOMIC_RELAXED);
}

/* Reserves an entry to write to; NULL if the queue is full. An entry is free for the writer of
 * number n when its `turn` is n. */
static tl_journal_entry *claim_entry(tl_journal *journal, uint64_t *number) {
    *number = __atomic_load_n(&journal->head, __ATOMIC_RELAXED);
    for (;;) {
        tl_journal_entry *entry = &journal->entries[*number % TL_JOURNAL_ENTRIES];
        uint64_t turn = __atomic_load_n(&entry->turn, __ATOMIC_ACQUIRE);
        if (turn < *number) {
            return NULL;
        }
        if (turn > *number) {
            *number = __atomic_load_n(&journal->head, __ATOMIC_RELAXED);
        } else if (__atomic_compare_exchange_n(&journal->head, number, *number + 1, false, __ATOMIC_RELAXED,
                                               __ATOMIC_RELAXED)) {
            return entry;
        }
    }
}

void tl_journal_event(tl_journal *journal, int64_t tick, tl_severity severity, const char *source, const char *format,
                      ...) {
    char text[TL_JOURNAL_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    bool apart = tl_journal_is_apart(journal);
    if (journal->recorder != NULL && !apart) {
        tl_recorder_event(journal->recorder, tick, severity, source, text);
    }
    if (journal->on_event != NULL && !apart) {
        journal->on_event(journal->listener, tick, severity, source, text);
    }
    uint64_t number;
    tl_journal_entry *entry = claim_entry(journal, &number);
    if (entry == NULL) {
        (void)__atomic_add_fetch(&journal->dropped, 1, __ATOMIC_RELAXED);
        return;
    }
    entry->severity = severity;
    entry->apart = apart;
    (void)snprintf(entry->source, sizeof entry->source, "%s", source);
    memcpy(entry->text, text, sizeof text);
    __atomic_store_n(&entry->turn, number + 1, __ATOMIC_RELEASE);
}

void tl_journal_drain(tl_journal *journal) {
    static const tl_log_level levels[] = {
        [TL_EVENT_INFO] = TL_LOG_NOTICE, [TL_EVENT_WARNING] = TL_LOG_WARNING, [TL_EVENT_ERROR] = TL_LOG_ERROR};
    const tl_time now = tl_clock_now(NULL);
    for (;;) {
        tl_journal_entry *entry = &journal->entries[journal->tail % TL_JOURNAL_ENTRIES];
        if (__atomic_load_n(&entry->turn, __ATOMIC_ACQUIRE) != journal->tail + 1) {
            break;
        }
        char line[TL_LOG_REPEATS_LINE];
        (void)snprintf(line, sizeof line, "%s%s: %s", entry->apart ? "shadow: " : "", entry->source, entry->text);
        tl_log_repeats_add(&journal->repeats, levels[entry->severity], line, now);
        __atomic_store_n(&entry->turn, journal->tail + TL_JOURNAL_ENTRIES, __ATOMIC_RELEASE);
        journal->tail++;
    }
    tl_log_repeats_poll(&journal->repeats, now);
    uint64_t dropped = __atomic_exchange_n(&journal->dropped, 0, __ATOMIC_RELAXED);
    if (dropped != 0) {
        tl_log(TL_LOG_WARNING,
               "journal: %llu events were not logged, because they came too fast; the database, if any, has them",
               (unsigned long long)dropped);
    }
}

void tl_journal_end(tl_journal *journal) {
    tl_journal_drain(journal);
    tl_log_repeats_end(&journal->repeats);
}
