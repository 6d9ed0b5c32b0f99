/* Ways of leading components back: see twin_ways.h. */
#include "firmware/twin/twin_ways.h"

#include <stdio.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/twin/far_look.h"
#include "master/twin/twin_timing.h"

/* Steps before the far look, besides those of the proof. */
enum { FIRST_STEPS = 10 };

/* Of the timing of one component. */
static const tl_time LONGEST = TL_SECOND / 10;

static void name(tl_twin_ways *ways, const char *component) {
    (void)snprintf(ways->component, sizeof ways->component, "%s", component);
}

static const tl_fmu *find_fmu(const tl_assembly *assembly, size_t component) {
    for (size_t i = 0; i < assembly->fmu_count; i++) {
        if (assembly->components != NULL && assembly->components[component].model == &assembly->fmus[i].model) {
            return &assembly->fmus[i];
        }
    }
    return NULL;
}

void tl_twin_ways_note(const tl_assembly *assembly, tl_twin_ways *ways) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    ways->cannot_return = facts.cannot_return ? 1 : 0;
    if (facts.astray != NULL) {
        name(ways, facts.astray);
    }
    for (size_t i = 0; i < assembly->config.component_count && (facts.returns || facts.cannot_return); i++) {
        const tl_fmu *fmu = find_fmu(assembly, i);
        if (fmu != NULL) {
            ways->of[i] = (tl_twin_way){.rollback = (uint32_t)tl_fmu_rollback(fmu),
                                        .is_given_again = tl_fmu_is_given_again(fmu) ? 1 : 0};
        }
    }
}

/* ---- a trial ---- */

/* Without any reading, so that u is nominal. */
static tl_status begin(const tl_assembly *assembly, int64_t *tick, tl_error *error) {
    const tl_budget budget = {.evaluations = 1, .time = INT64_MAX / 4};
    int64_t last = (int64_t)tl_twin_get_facts(assembly->twin).lead + FIRST_STEPS;
    tl_sample sample = {.tick = 0};
    tl_record record;
    bool ready = false;
    tl_status status = TL_OK;
    memset(sample.quality, TL_NO_LINK, assembly->config.signal_count);
    while (status == TL_OK && sample.tick < last) {
        status = tl_twin_step(assembly->twin, &sample, &budget, &record, &ready, error);
        sample.tick++;
    }
    *tick = sample.tick;
    return status;
}

/* What has failed in a process of its own has said more of it than who has asked it; true: something has. */
static bool tell_of_forks(const tl_assembly *assembly, tl_twin_ways *ways, tl_error *error) {
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        const tl_fmu *fmu = find_fmu(assembly, i);
        tl_fmu_fork fork;
        if (fmu != NULL && tl_fmu_look_at_fork(fmu, &fork) && fork.failure[0] != '\0') {
            name(ways, assembly->config.components[i].name);
            (void)tl_fail(error, TL_FMU_FAILED, "%s", fork.failure);
            return true;
        }
    }
    return false;
}

/* That a step cannot be made says nothing about ways back. */
static void blame(const tl_assembly *assembly, tl_twin_ways *ways, tl_error *error) {
    bool is_about_it = ways->cannot_return != 0 && ways->component[0] == '\0';
    if (!tell_of_forks(assembly, ways, error) && is_about_it) {
        tl_assembly_find_component(assembly, error->text, ways->component);
    }
}

/* True: all came back there, too. */
static bool look_far(const tl_assembly *assembly, int64_t tick, tl_twin_ways *ways, tl_error *error) {
    tl_far_look look;
    tl_far_look_take(assembly, tick, &look);
    if (tell_of_forks(assembly, ways, error)) {
        return false;
    }
    bool is_exact = !look.news.found || look.news.mended;
    if (!is_exact) {
        name(ways, look.news.component);
        (void)tl_fail(error, TL_FMU_FAILED, "%s", look.news.text);
    }
    return is_exact;
}

/* What replay takes depends on how far it has come. */
static void measure(const tl_assembly *assembly, size_t component, tl_twin_way *way) {
    const tl_fmu *fmu = find_fmu(assembly, component);
    tl_twin_timing timing;
    tl_fmu_fork fork;
    if (way->rollback == (uint32_t)TL_ROLLBACK_REPLAY) {
        return;
    }
    tl_twin_time_component(assembly->twin, component, tl_clock_now, NULL, LONGEST, &timing);
    if (timing.rounds != 0) {
        bool is_elsewhere = fmu != NULL && tl_fmu_look_at_fork(fmu, &fork);
        way->is_measured = 1;
        way->save = timing.save.median;
        way->restore = timing.restore.median;
        way->bytes = is_elsewhere ? fork.bytes : tl_twin_get_ledger(assembly->twin, component).state_size;
    }
}

tl_status tl_twin_ways_try(tl_assembly *assembly, tl_twin_ways *ways, tl_error *error) {
    int64_t tick = 0;
    tl_status status = tl_assembly_build_quietly(assembly, ways->component, error);
    if (status != TL_OK) {
        return status;
    }
    status = begin(assembly, &tick, error);
    tl_twin_ways_note(assembly, ways);
    if (status != TL_OK) {
        blame(assembly, ways, error);
        return status;
    }
    *error = (tl_error){TL_OK, ""};
    if (!look_far(assembly, tick, ways, error)) {
        return TL_OK;
    }
    tl_twin_ways_note(assembly, ways); /* what was mended there is led back in another way */
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        measure(assembly, i, &ways->of[i]);
    }
    return TL_OK;
}
