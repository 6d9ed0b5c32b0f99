/* An FMU that sets the global locale of C++ in its first step; if this locale is not the global one
 * in a later step, y is wrong. The functions are those of libstdc++, by their names in the library. Its
 * variables and its other functions are those of fmus/lag. */
#include <stdbool.h>

#include "description.h"
#include "fmus/common/model.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
} lag;

/* std::locale */
typedef struct cpp_locale {
    void *data;
} cpp_locale;

void copy_global(cpp_locale *self) __asm__("_ZNSt6localeC1Ev");
void open_locale(cpp_locale *self, const char *name) __asm__("_ZNSt6localeC1EPKc");
void close_locale(cpp_locale *self) __asm__("_ZNSt6localeD1Ev");
void set_global(cpp_locale *before, const cpp_locale *now) __asm__("_ZNSt6locale6globalERKS_");
bool are_equal(const cpp_locale *self, const cpp_locale *other) __asm__("_ZNKSt6localeeqERKS_");

static cpp_locale own; /* data NULL: not opened yet */

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
    own.data = NULL;
}

static void set_own(void) {
    cpp_locale before;
    open_locale(&own, "C.UTF-8");
    set_global(&before, &own);
    close_locale(&before);
}

static bool is_global(void) {
    cpp_locale now;
    copy_global(&now);
    bool is_own = are_equal(&now, &own);
    close_locale(&now);
    return is_own;
}

static void step(void *model, double h) {
    lag *m = model;
    if (own.data == NULL) {
        set_own();
    }
    m->y += h * (m->u - m->y) / m->T + (is_global() ? 0.0 : 1.0);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
