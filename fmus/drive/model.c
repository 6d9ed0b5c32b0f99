/* Drive: speed controller of the motor, a parallel PI(D) with a reference ramp and slip
 *        compensation.
 *
 *   f    ramps to ref, at `rise` at most
 *   e    = 2π·(f + Wgh·u_R)/Z_p − y              with the previous u_R
 *   u_R  = 10⁻³·(P·e + ∫I·e dt + D·de/dt)        the integral is updated first; gains in mA
 *
 * y and ref are constant over a macro step; all inner steps use them. I is inside the integral, so
 * that a change of I causes no jump. The drive starts in operation: f equals ref, and the integral
 * supplies u_R_start.
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct drive {
    fmi2Real ref, y;                       /* inputs */
    fmi2Real P, I, D;                      /* tunable */
    fmi2Real rise, Wgh, t_step, u_R_start; /* fixed */
    fmi2Integer Z_p;                       /* fixed */
    fmi2Real f, integral;                  /* states: Hz, A; so are u_R and e */
    fmi2Real u_R, e;                       /* outputs */
} drive;

static const double TWO_PI = 6.283185307179586;
static const double AMPERE_PER_MILLIAMPERE = 1e-3;

static double error_of(const drive *c) {
    return TWO_PI * (c->f + c->Wgh * c->u_R) / c->Z_p - c->y;
}

static void start(void *model) {
    drive *c = model;
    c->f = c->ref;
    c->u_R = c->u_R_start;
    c->integral = c->u_R_start;
    c->e = error_of(c);
}

/* Returns `from`, moved towards `to` by at most `reach`. */
static double towards(double from, double to, double reach) {
    if (to > from + reach) {
        return from + reach;
    }
    return to < from - reach ? from - reach : to;
}

static void step(void *model, double h) {
    drive *c = model;
    const double e_before = c->e;

    c->f = towards(c->f, c->ref, c->rise * h);
    c->e = error_of(c);
    c->integral += AMPERE_PER_MILLIAMPERE * c->I * c->e * h;
    c->u_R = AMPERE_PER_MILLIAMPERE * (c->P * c->e + c->D * (c->e - e_before) / h) + c->integral;
}

TL_FMU_MODEL(drive, .t_step = offsetof(drive, t_step), .start = start, .step = step);
