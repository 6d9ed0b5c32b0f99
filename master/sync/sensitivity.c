/* Sensitivity: see sensitivity.h. */
#include "master/sync/sensitivity.h"

#include <math.h>
#include <string.h>

/* Cosine of the angle between two effects from which on they are parallel. */
static const double PARALLEL = 0.999;

/* Macro steps for which a measured column is used: fewer than TL_SENSITIVITY_TESTS, so that
 * variables that act one after the other are not parallel. */
enum { RECENT = 5 };

/* In steps. L-BFGS differentiates with a thousandth; rounding hides smaller moves. */
static const double LEAST_MOVE = 1e-4;

bool tl_sensitivity_init(tl_sensitivity *sensitivity, tl_arena *arena, const tl_horizon *horizon, const double *step,
                         size_t rows) {
    *sensitivity = (tl_sensitivity){.horizon = horizon, .step = step, .rows = rows};
    sensitivity->slope = tl_arena_take(arena, rows * horizon->count, sizeof *sensitivity->slope);
    sensitivity->probed = tl_arena_take(arena, horizon->count, sizeof *sensitivity->probed);
    sensitivity->effects = tl_arena_take(arena, rows * horizon->variables, sizeof *sensitivity->effects);
    bool taken = sensitivity->slope != NULL && sensitivity->probed != NULL && sensitivity->effects != NULL;
    if (taken) {
        tl_sensitivity_forget(sensitivity);
    }
    return taken;
}

void tl_sensitivity_forget(tl_sensitivity *sensitivity) {
    for (size_t k = 0; k < sensitivity->horizon->count; k++) {
        sensitivity->probed[k] = -RECENT;
    }
    memset(sensitivity->unseen, 0, sizeof sensitivity->unseen);
    memset(sensitivity->alike, 0, sizeof sensitivity->alike);
    sensitivity->group = 0;
    sensitivity->is_new = false;
}

/* The one unknown in which two candidates differ; else SIZE_MAX. */
static size_t find_moved(const tl_sensitivity *sensitivity, const double *u, const double *other) {
    size_t moved = SIZE_MAX;
    for (size_t k = 0; k < sensitivity->horizon->count; k++) {
        if (u[k] < other[k] || u[k] > other[k]) {
            if (moved != SIZE_MAX) {
                return SIZE_MAX;
            }
            moved = k;
        }
    }
    return moved;
}

void tl_sensitivity_probe(tl_sensitivity *sensitivity, int64_t i, const double *u, const double *other,
                          const double *residuals, const double *other_residuals) {
    size_t k = find_moved(sensitivity, u, other);
    double move = k == SIZE_MAX ? 0.0 : (u[k] - other[k]) / sensitivity->step[k];
    if (!(fabs(move) >= LEAST_MOVE)) {
        return;
    }
    for (size_t row = 0; row < sensitivity->rows; row++) {
        sensitivity->slope[row * sensitivity->horizon->count + k] = (residuals[row] - other_residuals[row]) / move;
    }
    sensitivity->probed[k] = i;
    sensitivity->is_new = true;
}

/* ---- test ---- */

/* Effects in one step: of variable v in effects[v · rows]. */
typedef struct tl_effects {
    uint32_t known;               /* bits: all columns of the variable are known */
    uint32_t seen;                /* bits of these: some output reacts */
    double square[TL_MAX_ADJUST]; /* sum of the squares of an effect */
} tl_effects;

/* A search that ends soon does not probe all unknowns of a dynamic horizon. */
static bool is_known(const tl_sensitivity *sensitivity, size_t v, int64_t i) {
    const tl_horizon *horizon = sensitivity->horizon;
    uint32_t m = 0;
    while (m < horizon->length[v] && sensitivity->probed[horizon->offset[v] + m] > i - RECENT) {
        m++;
    }
    return m == horizon->length[v];
}

static void add_effect(const tl_sensitivity *sensitivity, size_t v, const double *slope, double floor,
                       tl_effects *effects) {
    const tl_horizon *horizon = sensitivity->horizon;
    double *effect = &sensitivity->effects[v * sensitivity->rows];
    double largest = 0.0;
    effects->square[v] = 0.0;
    for (size_t row = 0; row < sensitivity->rows; row++) {
        effect[row] = 0.0;
        for (uint32_t m = 0; m < horizon->length[v]; m++) {
            effect[row] += slope[row * horizon->count + horizon->offset[v] + m];
        }
        largest = fmax(largest, fabs(effect[row]));
        effects->square[v] += effect[row] * effect[row];
    }
    effects->known |= (uint32_t)1 << v;
    effects->seen |= largest >= floor && largest > 0.0 && isfinite(effects->square[v]) ? (uint32_t)1 << v : 0;
}

static bool is_parallel(const tl_sensitivity *sensitivity, const tl_effects *effects, size_t v, size_t w) {
    const double *a = &sensitivity->effects[v * sensitivity->rows];
    const double *b = &sensitivity->effects[w * sensitivity->rows];
    double product = 0.0;
    for (size_t row = 0; row < sensitivity->rows; row++) {
        product += a[row] * b[row];
    }
    return fabs(product) >= PARALLEL * sqrt(effects->square[v]) * sqrt(effects->square[w]);
}

/* Bits of the other seen variables with an effect parallel to that of v. */
static uint32_t find_parallel(const tl_sensitivity *sensitivity, const tl_effects *effects, size_t v) {
    uint32_t found = 0;
    for (size_t w = 0; w < sensitivity->horizon->variables; w++) {
        bool is_other = w != v && (effects->seen >> w & 1U) != 0;
        found |= is_other && is_parallel(sensitivity, effects, v, w) ? (uint32_t)1 << w : 0;
    }
    return found;
}

static uint32_t count_test(uint32_t count, bool holds) {
    return !holds ? 0 : count < TL_SENSITIVITY_TESTS ? count + 1 : count;
}

static void test_variable(tl_sensitivity *sensitivity, int64_t i, size_t v, const tl_effects *effects) {
    uint32_t bit = (uint32_t)1 << v;
    bool is_seen = (effects->seen & bit) != 0;
    sensitivity->unseen[v] = count_test(sensitivity->unseen[v], !is_seen);
    if (is_seen && effects->seen == bit) {
        return; /* there is no other effect to compare with */
    }
    uint32_t others = is_seen ? find_parallel(sensitivity, effects, v) : 0;
    sensitivity->since[v] = sensitivity->alike[v] == 0 ? i : sensitivity->since[v];
    sensitivity->alike[v] = count_test(sensitivity->alike[v], others != 0);
    if (sensitivity->group == 0 && sensitivity->alike[v] == TL_SENSITIVITY_TESTS) {
        sensitivity->group = bit | others;
    }
}

void tl_sensitivity_test(tl_sensitivity *sensitivity, int64_t i, const double *slope, double floor) {
    tl_effects effects = {.known = 0};
    bool is_new = sensitivity->is_new;
    sensitivity->is_new = false;
    size_t variables = sensitivity->horizon->variables;
    for (size_t v = 0; v < variables; v++) {
        if (slope != NULL || (is_new && is_known(sensitivity, v, i))) {
            add_effect(sensitivity, v, slope != NULL ? slope : sensitivity->slope, floor, &effects);
        }
    }
    sensitivity->group = effects.known == 0 ? sensitivity->group : 0;
    for (size_t v = 0; v < variables; v++) {
        if ((effects.known >> v & 1U) != 0) {
            test_variable(sensitivity, i, v, &effects);
        }
    }
}

/* ---- results ---- */

uint32_t tl_sensitivity_unseen(const tl_sensitivity *sensitivity) {
    uint32_t unseen = 0;
    for (size_t v = 0; v < TL_MAX_ADJUST; v++) {
        unseen |= sensitivity->unseen[v] == TL_SENSITIVITY_TESTS ? (uint32_t)1 << v : 0;
    }
    return unseen;
}

uint32_t tl_sensitivity_alike(const tl_sensitivity *sensitivity, int64_t *since) {
    size_t first = 0;
    while (sensitivity->group != 0 && (sensitivity->group >> first & 1U) == 0) {
        first++;
    }
    *since = sensitivity->since[first];
    return sensitivity->group;
}
