/* Two twins of one configuration in one process: see twin_pair.h. */
#include "firmware/twin/twin_pair.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/twin/far_look.h"

/* A twin on its way. */
typedef struct walker {
    const tl_assembly *assembly;
    tl_sample sample;
    double nominal[TL_MAX_ADJUST]; /* of what is adjusted */
    int64_t steps;
} walker;

/* Without any reading. */
static void begin(walker *self, const tl_assembly *assembly) {
    *self = (walker){.assembly = assembly};
    memset(self->sample.quality, TL_NO_LINK, assembly->config.signal_count);
}

/* A tick in which u is nominal, or moved. */
static tl_status step_once(walker *self, bool is_free, bool *ready, tl_error *error) {
    const tl_budget budget = {.evaluations = 1, .time = INT64_MAX / 4};
    const tl_assembly *assembly = self->assembly;
    double u[TL_MAX_ADJUST] = {0.0};
    tl_record record;
    if (!is_free) {
        tl_far_look_excite(assembly, self->nominal, self->steps, u);
    }
    tl_status status = is_free ? tl_twin_step(assembly->twin, &self->sample, &budget, &record, ready, error)
                               : tl_twin_follow(assembly->twin, &self->sample,
                                                assembly->config.adjust_count != 0 ? u : NULL, &record, ready, error);
    if (is_free && status == TL_OK && *ready) {
        memcpy(self->nominal, record.u_hat, sizeof self->nominal);
    }
    self->sample.tick++;
    return status;
}

/* The next one; the first ones take as many ticks as a twin waits for its measurements. */
static tl_status step(walker *self, tl_error *error) {
    bool is_free = self->steps == 0 || self->assembly->config.event.start.signal != NULL;
    int64_t last = self->sample.tick + (int64_t)tl_twin_get_facts(self->assembly->twin).lead + 1;
    bool ready = false;
    tl_status status = TL_OK;
    while (status == TL_OK && !ready && self->sample.tick <= last) {
        status = step_once(self, is_free, &ready, error);
    }
    self->steps++;
    return status == TL_OK && !ready ? tl_fail(error, TL_FMU_FAILED, "no step was made") : status;
}

/* ---- values ---- */

/* FNV-1a, of a value's bytes. */
static uint64_t mark_of(uint64_t mark, double value) {
    unsigned char bytes[sizeof value];
    memcpy(bytes, &value, sizeof value);
    for (size_t i = 0; i < sizeof bytes; i++) {
        mark = (mark ^ bytes[i]) * 1099511628211U;
    }
    return mark;
}

/* One for each of tl_twin_value_count(), 0 for those that no FMU gives. */
static uint64_t read_values(const tl_twin *twin, double *values) {
    uint64_t mark = 14695981039346656037U;
    for (size_t i = 0; i < tl_twin_value_count(twin); i++) {
        tl_twin_value value = {.value = 0.0};
        (void)tl_twin_get_value(twin, i, &value);
        values[i] = value.value;
        mark = mark_of(mark, value.value);
    }
    return mark;
}

static void name(tl_twin_pair_account *account, const char *component) {
    (void)snprintf(account->component, sizeof account->component, "%s", component);
}

/* The first value that is another one. */
static bool find_difference(const tl_twin *twin, const double *first, const double *second, int64_t number,
                            tl_twin_pair_account *account, tl_error *error) {
    for (size_t i = 0; i < tl_twin_value_count(twin); i++) {
        tl_twin_value value;
        if (tl_twin_get_value(twin, i, &value) && memcmp(&first[i], &second[i], sizeof *first) != 0) {
            name(account, value.component);
            (void)tl_fail(error, TL_OK, "in step %lld its %s is %.9g, and %.9g in a second instance", (long long)number,
                          value.variable, first[i], second[i]);
            return true;
        }
    }
    return false;
}

/* ---- both ---- */

/* As many steps as there are in the time for it. An FMU may refuse one for a reason of its own, such as its end: then these are all. */
static void lead_first(const tl_assembly *first, double *values, size_t width, tl_twin_pair_account *account) {
    tl_time begun = tl_clock_now(NULL);
    tl_error error;
    walker walk;
    begin(&walk, first);
    while (account->steps < TL_PAIR_STEPS &&
           (account->steps < TL_PAIR_LEAST || tl_clock_now(NULL) - begun < TL_PAIR_LONGEST) &&
           step(&walk, &error) == TL_OK) {
        account->marks[account->steps] = read_values(first->twin, values + account->steps * width);
        account->steps++;
    }
}

/* Behind the values of all steps there is room for those of one. */
static tl_status lead_second(const tl_assembly *second, double *values, size_t width, tl_twin_pair_account *account,
                             bool *differs, tl_error *error) {
    double *own = values + TL_PAIR_STEPS * width;
    walker walk;
    tl_status status = TL_OK;
    begin(&walk, second);
    for (uint32_t i = 0; i < account->steps && status == TL_OK && !*differs; i++) {
        status = step(&walk, error);
        if (status == TL_OK && read_values(second->twin, own) != account->marks[i]) {
            *differs = find_difference(second->twin, values + i * width, own, i, account, error);
        }
    }
    return status;
}

tl_status tl_twin_pair_compare(const tl_assembly *first, tl_assembly *second, bool alone, tl_twin_pair_account *account,
                               tl_error *error) {
    bool differs = false;
    size_t width = tl_twin_value_count(first->twin);
    double *values = calloc(width * (TL_PAIR_STEPS + 1) + 1, sizeof *values);
    if (values == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    lead_first(first, values, width, account);
    tl_status status = TL_OK;
    if (!alone && account->steps > 0) {
        __atomic_store_n(&account->has_second, 1, __ATOMIC_RELEASE);
        status = tl_assembly_build_quietly(second, account->component, error);
        if (status == TL_OK) {
            status = lead_second(second, values, width, account, &differs, error);
            tl_assembly_find_component(second, error->text, account->component);
        }
    }
    if (status == TL_OK && !differs) { /* what was mended on the way, such as a state that is wrong, is no difference */
        *error = (tl_error){TL_OK, ""};
    }
    free(values);
    return status;
}
