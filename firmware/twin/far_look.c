/* A look far from the start: see far_look.h. */
#include "firmware/twin/far_look.h"

#include <math.h>
#include <string.h>

#include "firmware/base/os.h"

/* Steps for which inputs stay: longer than a look at one component, so that a change of theirs falls now into one and now between two. */
enum { STAY = 7 };

/* Up and down by the first step of its search, each variable at another pace; what is Boolean, off and on. */
static double excited(const tl_twin_adjusted *adjusted, double nominal, int64_t step, size_t variable) {
    int64_t turn = step / (STAY + (int64_t)variable) % 3;
    if (!adjusted->is_real) {
        return turn == 1 ? 1.0 - nominal : nominal;
    }
    double value = nominal + (double)(turn - 1) * adjusted->step;
    return fmin(fmax(value, adjusted->lower), adjusted->upper);
}

void tl_far_look_excite(const tl_assembly *assembly, const double nominal[TL_MAX_ADJUST], int64_t step,
                        double u[TL_MAX_ADJUST]) {
    for (size_t v = 0; v < assembly->config.adjust_count; v++) {
        const tl_twin_adjusted adjusted = tl_twin_get_adjusted(assembly->twin, v);
        u[v] = excited(&adjusted, nominal[v], step, v);
    }
}

/* What the plant's missing readings lead to is a free step, whose u is nominal. */
static tl_status begin(const tl_assembly *assembly, tl_sample *sample, tl_record *record, tl_error *error) {
    const tl_budget budget = {.evaluations = 1, .time = INT64_MAX / 4};
    bool ready = false;
    tl_status status = tl_twin_step(assembly->twin, sample, &budget, record, &ready, error);
    sample->tick++;
    return status == TL_OK && !ready ? tl_fail(error, TL_FMU_FAILED, "no step was made") : status;
}

static tl_status take_step(const tl_assembly *assembly, tl_sample *sample, const tl_record *nominal,
                           tl_far_look *look) {
    double u[TL_MAX_ADJUST] = {0.0};
    tl_record record;
    bool ready = false;
    tl_far_look_excite(assembly, nominal->u_hat, look->steps, u);
    tl_status status = tl_twin_follow(assembly->twin, sample, u, &record, &ready, &look->error);
    sample->tick++;
    return status;
}

/* True: there is more to be seen. */
static bool look_once(const tl_assembly *assembly, tl_far_look *look) {
    tl_twin_look_news news = {.found = false};
    look->status = tl_twin_look(assembly->twin, TL_TIME_NEVER, &news, &look->error);
    look->news = news.found ? news : look->news;
    return look->status == TL_OK && (!news.found || news.mended);
}

void tl_far_look_take(const tl_assembly *assembly, int64_t tick, tl_far_look *look) {
    tl_sample sample = {.tick = tick};
    tl_record nominal;
    *look = (tl_far_look){.first = tick, .status = TL_OK};
    memset(sample.quality, TL_NO_LINK, assembly->config.signal_count);
    if (assembly->config.verify_every == 0 || assembly->config.adjust_count == 0 ||
        assembly->config.event.start.signal != NULL) {
        return;
    }
    tl_time begun = tl_clock_now(NULL);
    look->status = begin(assembly, &sample, &nominal, &look->error);
    bool goes_on = look->status == TL_OK;
    while (goes_on && look->steps < TL_FAR_STEPS && tl_clock_now(NULL) - begun < TL_FAR_LONGEST) {
        look->status = take_step(assembly, &sample, &nominal, look);
        look->steps += look->status == TL_OK ? 1 : 0;
        goes_on = look->status == TL_OK && look_once(assembly, look);
    }
    look->times = tl_twin_get_facts(assembly->twin).verified;
}
