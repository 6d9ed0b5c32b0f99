/* State of the writer for its successor: see recorder_state.h.
 *
 * A killed process has executed all its stores up to one instant, in program order if the compiler
 * keeps that order.
 */
#include "firmware/store/recorder_state.h"

#include <string.h>

#define LOST_MOST (UINT64_C(1) << 60) /* limit of the count, below TL_ROW_NUMBER_MAX */

static uint64_t more_of(uint64_t now, uint64_t before) {
    return now > before ? now - before : 0;
}

uint64_t tl_recorder_mark_entries(const tl_recorder_mark *mark) {
    return mark->totals.samples + mark->totals.steps + more_of(mark->totals.events, mark->own);
}

void tl_recorder_mark_lose(tl_recorder_mark *mark, uint64_t more) {
    uint64_t lost = mark->totals.lost;
    mark->totals.lost = more > LOST_MOST - lost ? LOST_MOST : lost + more;
}

const tl_recorder_mark *tl_recorder_state_mark(const tl_recorder_writer_state *state) {
    return &state->marks[state->current & 1];
}

const tl_recorder_mark *tl_recorder_state_tried(const tl_recorder_writer_state *state) {
    const tl_recorder_mark *tried = &state->marks[~state->current & 1];
    return tried->number == tl_recorder_state_mark(state)->number + 1 ? tried : NULL;
}

void tl_recorder_state_try(tl_recorder_writer_state *state, const tl_recorder_mark *mark) {
    tl_recorder_mark *tried = &state->marks[~state->current & 1];
    uint64_t number = mark->number;
    __atomic_store_n(&tried->number, 0, __ATOMIC_RELAXED); /* no valid mark until it is complete */
    __atomic_signal_fence(__ATOMIC_SEQ_CST);
    memcpy((char *)tried + sizeof tried->number, (const char *)mark + sizeof mark->number,
           sizeof *mark - sizeof mark->number);
    __atomic_store_n(&tried->number, number, __ATOMIC_SEQ_CST);
}

void tl_recorder_state_publish(tl_recorder_writer_state *state) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(state);
    for (int i = 0; i < TL_WRITER_QUEUES; i++) {
        __atomic_store_n(&state->taken[i].events, mark->taken[i].events, __ATOMIC_RELEASE);
        __atomic_store_n(&state->taken[i].checkpoint, mark->taken[i].checkpoint, __ATOMIC_RELEASE);
        __atomic_store_n(&state->taken[i].ring, mark->taken[i].ring, __ATOMIC_RELEASE);
    }
    __atomic_store_n(&state->written, mark->written, __ATOMIC_RELAXED);
    __atomic_store_n(&state->dropped, mark->dropped, __ATOMIC_RELAXED);
    __atomic_store_n(&state->tuning, mark->tuning.number, __ATOMIC_RELAXED);
    if (mark->run != 0) {
        __atomic_store_n(&state->run, mark->run, __ATOMIC_RELAXED);
    }
}

void tl_recorder_state_commit(tl_recorder_writer_state *state) {
    if (tl_recorder_state_tried(state) != NULL) {
        __atomic_store_n(&state->current, ~state->current & 1, __ATOMIC_SEQ_CST);
    }
    tl_recorder_state_publish(state);
}

void tl_recorder_state_leave_file(tl_recorder_writer_state *state, bool gone) {
    tl_recorder_mark next = *tl_recorder_state_mark(state);
    next.number++;
    if (gone) {
        uint64_t entries = tl_recorder_mark_entries(&next);
        next.dropped += entries;
        next.written = more_of(next.written, entries);
        tl_recorder_mark_lose(&next, entries);
    }
    next.is_again = next.is_again || next.totals.samples > 0;
    next.has_begun = next.has_begun && !next.has_ended;
    next.has_ended = false;
    next.run = 0;
    next.own = 0;
    next.totals = (tl_recorder_totals){.lost = next.has_begun ? next.totals.lost : 0};
    tl_recorder_state_try(state, &next);
    tl_recorder_state_commit(state);
}

void tl_recorder_state_add_event(tl_recorder_writer_state *state, int64_t tick, tl_severity severity,
                                 const char *source, const char *text) {
    bool is_full = state->own_next - tl_recorder_state_mark(state)->said >= TL_WRITER_OWN_EVENTS;
    uint64_t number = is_full ? state->own_next - 1 : state->own_next;
    tl_recorder_event_fill(&state->own[number % TL_WRITER_OWN_EVENTS], tick, severity, source, text);
    __atomic_store_n(&state->own_next, number + 1, __ATOMIC_SEQ_CST);
}

tl_recorder_state_counts tl_recorder_state_get(const tl_recorder_writer_state *state) {
    tl_recorder_state_counts counts = {
        .written = __atomic_load_n(&state->written, __ATOMIC_RELAXED),
        .dropped = __atomic_load_n(&state->dropped, __ATOMIC_RELAXED),
        .run = __atomic_load_n(&state->run, __ATOMIC_RELAXED),
        .tuning = __atomic_load_n(&state->tuning, __ATOMIC_RELAXED),
        .refused_since = __atomic_load_n(&state->refused_since, __ATOMIC_RELAXED),
    };
    return counts;
}
