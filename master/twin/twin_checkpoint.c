/* Serialising a twin, and starting where an earlier run ended: see twin.h.
 *
 * Format: a head that identifies the twin, our data, then the FMUs' states and all port values
 *         (snapshot.h). Caches and the solver's memory are not included: caches start at the root,
 *         and the solver costs one search. So the format depends on no solver.
 * Trust:  none in the bytes: loaded values are checked before use. Only an FMU can check its own
 *         state.
 */
#include <string.h>

#include "master/base/archive.h"
#include "master/twin/twin_parts.h"

/* ns; sums and differences of a few times below it cannot overflow. */
static const tl_time FAR = INT64_MAX / 4;

/* Identifies the twin and the tick. All must be equal except `first`, which is loaded. */
typedef struct head {
    char magic[8]; /* its last character changes with the layout */
    uint64_t components, signals, matches, adjusted, values, window, guard;
    int64_t tick;
    int64_t first;
} head;

static head head_of(const tl_twin *twin, int64_t tick) {
    return (head){
        .magic = {'t', 'w', 'l', 'k', 't', 'w', 'n', '6'},
        .components = twin->graph.component_count,
        .signals = twin->exchange.plant.signal_count,
        .matches = twin->synchroniser.objective.term_count,
        .adjusted = twin->synchroniser.horizon.variables,
        .values = twin->exchange.values_size,
        .window = twin->exchange.plant.window_mask + 1,
        .guard = twin->free_twin.free_run_check.guard,
        .tick = tick,
        .first = twin->first,
    };
}

/* Whether a shift of look-ups is possible for a delay in the measured range. */
static bool is_shift(const tl_twin *twin, int32_t shift, int32_t configured) {
    if (twin->measure.lags == 0 || twin->measure.is_unused || twin->delay.state == TL_DELAY_UNKNOWN) {
        return shift == configured;
    }
    int32_t least = tl_delay_ticks(twin->measure.look_back, twin->measure.range, twin->step);
    int32_t most = tl_delay_ticks(twin->measure.look_back, -twin->measure.range, twin->step);
    return shift == configured || (shift >= (least < most ? least : most) && shift <= (least < most ? most : least));
}

/* Mode ahead: the step that waits for its measurement. */
static bool is_pending(const tl_twin *twin) {
    const tl_record *pending = &twin->pending;
    return !twin->has_pending ||
           (twin->measurements == TL_AHEAD && pending->step == twin->exchange.plant.newest - (int64_t)twin->lead);
}

/* When loading: `configured` are the shifts that the twin was built with. */
static void require_sound(const tl_twin *twin, const int32_t configured[TL_MAX_MATCH], tl_archive *archive) {
    const tl_twin_delay *delay = &twin->delay;
    tl_archive_require(archive, delay->state >= TL_DELAY_UNKNOWN && delay->state <= TL_DELAY_LOST);
    tl_archive_require(archive, delay->delay >= -FAR && delay->delay <= FAR);
    tl_archive_require_finite(archive, &delay->confidence, 1);
    tl_archive_require(archive, is_pending(twin));
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        tl_archive_require(archive, is_shift(twin, twin->terms[i].shift, configured[i]));
        tl_archive_require(archive, twin->offsets[i] >= -FAR && twin->offsets[i] <= FAR);
    }
    if (twin->has_pending) {
        tl_archive_require_finite(archive, twin->pending.u, twin->synchroniser.horizon.variables);
        tl_archive_require_finite(archive, twin->pending.nominal, twin->synchroniser.horizon.variables);
    }
}

/* All our data except port values. */
static void archive_ours(tl_twin *twin, tl_archive *archive) {
    int32_t configured[TL_MAX_MATCH] = {0};
    tl_plant_archive(&twin->exchange.plant, archive);
    if (twin->synchroniser.horizon.variables != 0) {
        tl_synchroniser_archive(&twin->synchroniser, archive);
    }
    if (twin->event != NULL) {
        tl_event_horizon_archive(twin->event, archive);
    }
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        if (twin->readers[i] != NULL) {
            tl_reading_meter_archive(twin->readers[i], archive);
        }
        if (twin->meters[i] != NULL && !twin->measure.is_unused) {
            tl_delay_meter_archive(twin->meters[i], archive);
            tl_archive_flag(archive, &twin->has_offset[i]);
            tl_archive_part(archive, &twin->offsets[i], sizeof twin->offsets[i]);
        }
        configured[i] = twin->terms[i].shift;
        tl_archive_part(archive, &twin->terms[i].shift, sizeof twin->terms[i].shift);
    }
    if (!twin->measure.is_unused) {
        tl_archive_part(archive, &twin->delay, sizeof twin->delay);
    }
    tl_archive_flag(archive, &twin->starts.waits);
    tl_archive_flag(archive, &twin->has_pending);
    if (twin->has_pending) {
        tl_archive_part(archive, &twin->pending, sizeof twin->pending);
    }
    if (tl_archive_is_loading(archive) && tl_archive_is_whole(archive)) {
        require_sound(twin, configured, archive);
    }
}

void tl_twin_begin_at(tl_twin *twin, int64_t tick) {
    if (tick > 0) {
        twin->first = tick + twin->age;
        twin->begin += twin->first;
        twin->exchange.plant.newest = tick - 1;
        twin->synchroniser.ledger.step = twin->first;
    }
}

bool tl_twin_can_save(const tl_twin *twin) {
    bool can = true;
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        can = can && tl_component_can_serialize(&twin->graph.components[i]);
    }
    return can;
}

/* A component whose own states were found to be wrong uses another method, and its bytes are
 * useless. */
static tl_status require_bytes(const tl_twin *twin, tl_error *error) {
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        if (!tl_component_can_serialize(&twin->graph.components[i])) {
            return tl_fail(error, TL_FMU_FAILED,
                           "%s: its state cannot be serialised, because it is not rolled back by its own states",
                           twin->graph.components[i].name);
        }
    }
    return TL_OK;
}

/* An FMU that has returned an error can be restored to the state that was to be serialised. */
static tl_status refused(tl_twin *twin, tl_status status) {
    tl_error ignored;
    twin->ended = status == TL_FMU_FATAL ? status : tl_exchange_return(&twin->exchange, &ignored);
    return status;
}

tl_status tl_twin_save(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_error *error) {
    int64_t newest = twin->exchange.plant.newest;
    *size = 0;
    if (twin->ended != TL_OK || newest < twin->begin || (twin->starts.searches && !twin->starts.waits) ||
        !tl_exchange_can_take(&twin->exchange)) {
        return TL_OK;
    }
    tl_status status = require_bytes(twin, error);
    status = status == TL_OK ? tl_exchange_take(&twin->exchange, newest, error) : status;
    if (status != TL_OK) {
        return status;
    }
    tl_archive archive = tl_archive_saving(bytes, capacity);
    head own = head_of(twin, twin->exchange.plant.newest);
    tl_archive_part(&archive, &own, sizeof own);
    archive_ours(twin, &archive);
    status = tl_snapshot_archive(&twin->exchange.home, &archive, error);
    status = status == TL_OK ? tl_free_twin_archive(&twin->free_twin, &archive, error) : status;
    if (status != TL_OK) {
        return refused(twin, status);
    }
    *size = archive.at;
    return TL_OK;
}

static tl_status load_head(tl_twin *twin, int64_t tick, tl_archive *archive, tl_error *error) {
    head own = head_of(twin, tick);
    head found = {.tick = -1};
    tl_archive_part(archive, &found, sizeof found);
    int64_t first = found.first;
    found.first = own.first;
    if (!tl_archive_is_whole(archive) || memcmp(&found, &own, sizeof own) != 0 || first < 0 || first > tick ||
        tick > FAR / twin->step) {
        return tl_fail(error, TL_BAD_DATA, "the checkpoint belongs to another twin, or not to tick %lld",
                       (long long)tick);
    }
    twin->first = first;
    return TL_OK;
}

/* All values except outputs, which may be NaN. */
static void require_finite_inputs(const tl_exchange *exchange, tl_archive *archive) {
    const double *values = (const double *)(const void *)exchange->home.values;
    size_t before = (size_t)(exchange->outputs - (const double *)(const void *)exchange->values);
    size_t after = before + exchange->output_count;
    tl_archive_require_finite(archive, values, before);
    tl_archive_require_finite(archive, values + after, exchange->real_count - after);
}

/* Initialises the FMUs at their first instant with the present plant; then they get their states.
 */
static tl_status load_components(tl_twin *twin, tl_archive *archive, tl_error *error) {
    bool waits = twin->starts.waits;
    tl_status status = tl_twin_start(twin, tl_plant_sample(&twin->exchange.plant, twin->exchange.plant.newest), error);
    tl_start_values_loaded(twin, waits);
    status = status == TL_OK ? require_bytes(twin, error) : status;
    status = status == TL_OK ? tl_free_twin_begin(&twin->free_twin, error) : status;
    if (status == TL_OK) {
        status = tl_snapshot_archive(&twin->exchange.home, archive, error);
    }
    status = status == TL_OK ? tl_free_twin_archive(&twin->free_twin, archive, error) : status;
    twin->synchroniser.rests = tl_free_twin_rests(&twin->free_twin);
    if (status == TL_OK) {
        require_finite_inputs(&twin->exchange, archive);
    }
    if (status == TL_OK && archive->at == SIZE_MAX) {
        status = tl_fail(error, TL_BAD_DATA, "the checkpoint is damaged: a value in it is not finite");
    } else if (status == TL_OK && archive->at != archive->size) {
        status = tl_fail(error, TL_BAD_DATA, "the checkpoint has %zu bytes, expected %zu", archive->size, archive->at);
    }
    if (status == TL_OK) {
        status = tl_exchange_return(&twin->exchange, error);
    }
    status = status == TL_OK ? tl_exchange_start(&twin->exchange, twin->state_bytes, twin->heap, error) : status;
    tl_proof_end(&twin->proof);
    status = status == TL_OK ? tl_released_twin_begin(&twin->released_twin, error) : status;
    return status == TL_OK ? tl_verifier_start(&twin->verifier, NULL, error) : status;
}

/* The step that is computed after `tick`, or the first one. */
static int64_t next_step(const tl_twin *twin, int64_t tick) {
    int64_t next = tick + 1 - (int64_t)twin->lead;
    return next > twin->first ? next : twin->first;
}

/* Mode ahead: the waiting step and its cost belong to the earlier run. */
static void disown_pending(tl_twin *twin) {
    tl_record *pending = &twin->pending;
    pending->outcome = TL_RESUMED;
    pending->stop = TL_STOP_NONE;
    pending->evaluations = 0;
    pending->executions = 0;
    pending->predicted = 0;
    pending->flags = 0;
    pending->used = 0;
}

tl_status tl_twin_forget(tl_twin *twin, bool *done, tl_error *error) {
    *done = false;
    if (twin->ended != TL_OK || twin->exchange.plant.newest < twin->begin) {
        return TL_OK;
    }
    tl_status status = tl_exchange_forget(&twin->exchange, next_step(twin, twin->exchange.plant.newest), done, error);
    if (status != TL_OK || !*done) {
        twin->ended = status;
        return status;
    }
    tl_synchroniser_forget(&twin->synchroniser);
    if (twin->event != NULL) {
        tl_event_horizon_abandon(twin->event);
    }
    memset(twin->metrics, 0, sizeof twin->metrics);
    memset(twin->released, 0, sizeof twin->released);
    memset(twin->readings, 0, sizeof twin->readings);
    memset(twin->due, 0, sizeof twin->due);
    twin->free_twin.counts = (tl_free_twin_counts){0};
    twin->released_twin.counts = (tl_released_counts){0};
    twin->resets = false;
    disown_pending(twin);
    if (twin->measure.lags != 0 &&
        !twin->measure.is_unused) { /* the delay depends on the released twins: a loaded twin starts new ones */
        twin->measured_age = 0;
        status = tl_released_twin_begin(&twin->released_twin, error);
        twin->ended = status;
    }
    return status;
}

tl_status tl_twin_load(tl_twin *twin, int64_t tick, const unsigned char *bytes, size_t size, tl_error *error) {
    tl_archive archive = tl_archive_loading(bytes, size);
    tl_status status = load_head(twin, tick, &archive, error);
    if (status == TL_OK) {
        archive_ours(twin, &archive);
        bool same = tl_archive_is_whole(&archive) && twin->exchange.plant.newest == tick;
        status =
            same ? load_components(twin, &archive, error)
                 : tl_fail(error, TL_BAD_DATA, "the checkpoint of tick %lld is truncated or damaged", (long long)tick);
    }
    twin->synchroniser.ledger.step = next_step(twin, tick); /* whatever the bytes say */
    disown_pending(twin);
    twin->begin = -1;
    twin->ended = status;
    return status;
}
