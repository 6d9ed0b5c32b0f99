/* Debouncing: see gpio_debounce.h. */
#include "board/gpio/gpio_debounce.h"

void tl_gpio_debounce_start(tl_gpio_debounce *debounce, tl_time time, bool level) {
    *debounce = (tl_gpio_debounce){.time = time, .level = level, .newest = level};
}

bool tl_gpio_debounce_pass(tl_gpio_debounce *debounce, tl_time now, tl_time *since) {
    if (!debounce->pending || now - debounce->since < debounce->time) {
        return false;
    }
    debounce->pending = false;
    bool changed = debounce->level != debounce->newest;
    debounce->level = debounce->newest;
    *since = debounce->since;
    return changed;
}

bool tl_gpio_debounce_edge(tl_gpio_debounce *debounce, bool level, tl_time stamp, tl_time *since) {
    bool changed = tl_gpio_debounce_pass(debounce, stamp, since);
    debounce->newest = level;
    debounce->since = stamp;
    debounce->pending = true;
    return debounce->time == 0 ? tl_gpio_debounce_pass(debounce, stamp, since) : changed;
}
