/* Heartbeats: see heartbeat.h. */
#include "firmware/process/heartbeat.h"

#include <stdio.h>

enum { END_CAUSE_BITS = 8 };

/* ---- in the monitored process ---- */

tl_thread_heartbeat *tl_thread_heartbeat_start(tl_heartbeats *beats, const char *name, tl_time patience) {
    if (beats == NULL) {
        return NULL;
    }
    size_t index = __atomic_fetch_add(&beats->count, 1, __ATOMIC_RELAXED);
    if (index >= TL_HEARTBEATS) {
        return NULL;
    }
    tl_thread_heartbeat *heartbeat = &beats->hearts[index];
    (void)snprintf(heartbeat->name, sizeof heartbeat->name, "%s", name);
    __atomic_store_n(&heartbeat->patience, patience, __ATOMIC_RELEASE);
    return heartbeat;
}

void tl_thread_heartbeat_beat(tl_thread_heartbeat *heartbeat) {
    if (heartbeat != NULL) {
        (void)__atomic_add_fetch(&heartbeat->beats, 1, __ATOMIC_RELAXED);
    }
}

void tl_thread_heartbeat_set_timeout(tl_thread_heartbeat *heartbeat, tl_time patience) {
    if (heartbeat != NULL) {
        __atomic_store_n(&heartbeat->patience, patience, __ATOMIC_RELAXED);
        tl_thread_heartbeat_beat(heartbeat);
    }
}

void tl_thread_heartbeat_stop(tl_thread_heartbeat *heartbeat) {
    if (heartbeat != NULL) {
        __atomic_store_n(&heartbeat->patience, 0, __ATOMIC_RELAXED);
    }
}

void tl_heartbeats_set_ready(tl_heartbeats *beats) {
    __atomic_store_n(&beats->ready, true, __ATOMIC_RELAXED);
}

void tl_heartbeats_set_status(tl_heartbeats *beats, const char *text) {
    char line[TL_HEARTBEAT_STATUS] = "";
    (void)snprintf(line, sizeof line, "%s", text);
    tl_latest_publish(&beats->status, line, sizeof line);
}

void tl_heartbeats_announce(tl_heartbeats *beats, tl_end_cause why, int code) {
    __atomic_store_n(&beats->announced_cause, (uint32_t)code << END_CAUSE_BITS | (uint32_t)why, __ATOMIC_RELAXED);
}

/* ---- in the supervisor ---- */

const char *tl_heartbeats_read(const tl_heartbeats *beats, tl_heartbeats_seen *seen, tl_time now, tl_time *silence) {
    tl_time passed = seen->polled_at == 0 ? 0 : now - seen->polled_at;
    tl_fmu_call call;
    const char *silent = NULL;
    bool has_heartbeat = false;
    passed = passed > TL_HEARTBEAT_POLL ? TL_HEARTBEAT_POLL : passed;
    seen->polled_at = now;
    bool same = tl_fmu_calls_poll(&beats->calls, &call) && call.begun == seen->call;
    seen->lasted = same ? seen->lasted + passed : 0;
    seen->call = call.begun;
    for (size_t i = 0; i < TL_HEARTBEATS; i++) {
        const tl_thread_heartbeat *heartbeat = &beats->hearts[i];
        tl_time patience = __atomic_load_n(&heartbeat->patience, __ATOMIC_ACQUIRE);
        uint64_t count = __atomic_load_n(&heartbeat->beats, __ATOMIC_RELAXED);
        bool is_active = patience > 0; /* a heartbeat that was not started, or was stopped, is not silent */
        seen->silence[i] = is_active && count == seen->beats[i] ? seen->silence[i] + passed : 0;
        seen->beats[i] = count;
        has_heartbeat = has_heartbeat || is_active;
        if (is_active && seen->silence[i] > patience && silent == NULL) {
            silent = heartbeat->name;
            *silence = seen->silence[i];
        }
    }
    seen->had = seen->had || has_heartbeat;
    seen->no_heart = seen->had && !has_heartbeat ? seen->no_heart + passed : 0;
    if (seen->no_heart > TL_HEARTBEAT_NONE) {
        silent = "every thread";
        *silence = seen->no_heart;
    }
    return silent;
}

bool tl_heartbeats_get_call(const tl_heartbeats *beats, const tl_heartbeats_seen *seen, tl_time least,
                            tl_fmu_call *call) {
    bool is_running = tl_fmu_calls_poll(&beats->calls, call);
    return is_running && (least == 0 || (call->begun == seen->call && seen->lasted >= least));
}

tl_end_cause tl_heartbeats_get_end_cause(const tl_heartbeats *beats, int *code) {
    uint32_t announced_cause = __atomic_load_n(&beats->announced_cause, __ATOMIC_RELAXED);
    uint32_t why = announced_cause & ((1U << END_CAUSE_BITS) - 1);
    *code = (int)(announced_cause >> END_CAUSE_BITS & 0xFFU);
    return why <= TL_END_CAUSE_FAILED ? (tl_end_cause)why : TL_END_CAUSE_NONE;
}

bool tl_heartbeats_is_ready(const tl_heartbeats *beats) {
    return __atomic_load_n(&beats->ready, __ATOMIC_RELAXED);
}

bool tl_heartbeats_get_status(const tl_heartbeats *beats, char text[TL_HEARTBEAT_STATUS]) {
    return tl_latest_read(&beats->status, text, TL_HEARTBEAT_STATUS);
}
