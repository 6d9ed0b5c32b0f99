/* An FMU with SIZE bytes on the heap. A step changes the first ones and some in PAGES - 1 other places: at most PAGES
 * pages. `work`: operations of a step, about 2 ns each. */
#include "fmi2Functions.h"
#include "tests/bench/fmus/frame.h"

enum { COUNT = SIZE / sizeof(fmi2Real), U = 0, Y = 1, WORK = 2, DONE = 3 };

const bench_model model = {"{1b0f7f0e-6f0c-4a6e-9d0b-2f6a3c1d5e77}", SIZE, NULL};

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    fmi2Real *all = component;
    for (size_t i = 0; i < count; i++) {
        if (references[i] != U && references[i] != WORK) {
            return fmi2Error;
        }
        all[references[i]] = values[i];
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    const fmi2Real *all = component;
    for (size_t i = 0; i < count; i++) {
        if (references[i] > Y) {
            return fmi2Error;
        }
        values[i] = all[references[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean is_final) {
    fmi2Real *all = component;
    (void)now;
    (void)is_final;
    for (fmi2Real done = 0.0; done < all[WORK]; done += 1.0) {
        all[DONE] = 0.5 * all[DONE] + all[U];
    }
    for (size_t page = 1; page < PAGES; page++) {
        all[COUNT / PAGES * page] += step * (all[U] + 1.0);
    }
    all[Y] = 0.5 * all[Y] + all[U];
    return fmi2OK;
}
