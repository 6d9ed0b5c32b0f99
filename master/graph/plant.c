/* The plant as a component: see plant.h. */
#include "master/graph/plant.h"

#include <math.h>

bool tl_plant_init(tl_plant *plant, tl_arena *arena, size_t signal_count, size_t window_size, int64_t shift) {
    plant->signal_count = signal_count;
    plant->shift = shift;
    size_t size = 1;
    while (size < window_size) {
        size *= 2;
    }
    plant->window_mask = size - 1;
    plant->newest = -1;
    plant->outputs = tl_arena_take(arena, signal_count, sizeof *plant->outputs);
    plant->window = tl_arena_take(arena, size, sizeof *plant->window);
    return plant->outputs != NULL && plant->window != NULL;
}

void tl_plant_set_initial(tl_plant *plant, size_t signal, double value) {
    plant->held[signal] = value;
}

/* A value marked as good must be a number that its type can hold. */
static tl_quality verify(const tl_plant_output *output, double value, tl_quality quality) {
    if (quality == TL_GOOD && !isfinite(value)) {
        return TL_NOT_A_NUMBER;
    }
    bool holds = output->integer == NULL || fabs(value) <= 2147483647.0;
    return quality == TL_GOOD && !holds ? TL_OUT_OF_RANGE : quality;
}

bool tl_plant_save_executions(tl_plant *plant, tl_arena *arena, size_t horizon) {
    plant->delivered_size = horizon + 1;
    plant->delivered = tl_arena_take(arena, plant->delivered_size, sizeof *plant->delivered);
    return plant->delivered != NULL;
}

void tl_plant_push(tl_plant *plant, const tl_sample *sample) {
    tl_sample *slot = &plant->window[(size_t)sample->tick & plant->window_mask];
    slot->tick = sample->tick;
    for (size_t i = 0; i < plant->signal_count; i++) {
        tl_quality quality = verify(&plant->outputs[i], sample->values[i], (tl_quality)sample->quality[i]);
        slot->quality[i] = (uint8_t)quality;
        if (quality == TL_GOOD) {
            plant->held[i] = sample->values[i];
        }
        slot->values[i] = plant->held[i];
    }
    plant->newest = sample->tick;
}

const tl_sample *tl_plant_sample(const tl_plant *plant, int64_t tick) {
    int64_t known = tick < plant->newest ? tick : plant->newest;
    return &plant->window[(size_t)(known < 0 ? 0 : known) & plant->window_mask];
}

/* A held value replaces one that is not good, so it must be as good. */
static void require_value(const tl_plant_output *output, double value, uint8_t quality, tl_archive *archive) {
    tl_archive_require(archive, verify(output, value, TL_GOOD) == TL_GOOD && quality <= TL_LAST_QUALITY);
}

void tl_plant_archive(tl_plant *plant, tl_archive *archive) {
    tl_archive_part(archive, &plant->newest, sizeof plant->newest);
    tl_archive_part(archive, plant->held, plant->signal_count * sizeof plant->held[0]);
    for (size_t i = 0; i < plant->signal_count; i++) {
        require_value(&plant->outputs[i], plant->held[i], TL_GOOD, archive);
    }
    for (size_t i = 0; i <= plant->window_mask; i++) {
        tl_sample *sample = &plant->window[i];
        tl_archive_part(archive, &sample->tick, sizeof sample->tick);
        tl_archive_part(archive, sample->values, plant->signal_count * sizeof sample->values[0]);
        tl_archive_part(archive, sample->quality, plant->signal_count * sizeof sample->quality[0]);
        for (size_t k = 0; k < plant->signal_count; k++) {
            require_value(&plant->outputs[k], sample->values[k], sample->quality[k], archive);
        }
    }
}

void tl_plant_placed(tl_plant *plant) {
    plant->delivered_signals = 0;
    for (size_t i = 0; i < plant->signal_count; i++) {
        const tl_plant_output *output = &plant->outputs[i];
        if (output->real != NULL || output->integer != NULL || output->boolean != NULL) {
            plant->delivered_signals = i + 1;
        }
    }
}

int64_t tl_plant_shown(const tl_plant *plant, int64_t i, int64_t newest) {
    int64_t tick = i + plant->shift < newest ? i + plant->shift : newest;
    return tick < 0 ? 0 : tick;
}

void tl_plant_deliver_values(const tl_plant *plant, const double *values) {
    for (size_t i = 0; i < plant->delivered_signals; i++) {
        const tl_plant_output *output = &plant->outputs[i];
        if (output->real != NULL) {
            *output->real = values[i];
        } else if (output->integer != NULL) {
            *output->integer = (fmi2Integer)values[i];
        } else if (output->boolean != NULL) {
            *output->boolean = values[i] != 0.0 ? fmi2True : fmi2False;
        }
    }
}

void tl_plant_deliver(tl_plant *plant, int64_t tick) {
    if (plant->delivered_signals != 0) {
        tl_plant_deliver_values(plant, tl_plant_sample(plant, tick)->values);
    }
}

/* Returns whether step `step` is known to deliver sample `number`; if not, it is known from now on,
 * and later steps are not. */
static bool is_known(tl_plant *plant, int64_t step, int64_t number) {
    int64_t *delivered = &plant->delivered[(size_t)step % plant->delivered_size];
    if (step < plant->known && *delivered == number) {
        return true;
    }
    *delivered = number;
    plant->known = step + 1;
    return false;
}

void tl_plant_forget(tl_plant *plant, int64_t step) {
    plant->known = plant->known < step ? plant->known : step;
}

void tl_plant_step(tl_plant *plant, int64_t step) {
    int64_t number = tl_plant_shown(plant, step + 1, plant->newest);
    if (plant->delivered == NULL || !is_known(plant, step, number)) {
        plant->executions++;
    }
    tl_plant_deliver(plant, number);
}
