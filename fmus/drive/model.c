/* Drive: speed controller of the motor, a parallel PI(D) with a reference ramp and slip compensation.
 *
 *   f    ramps to ref, at `rise` at most
 *   e    = 2π·(f + Wgh·u_R)/Z_p − y              with the previous u_R
 *   u_R  = 10⁻³·(P·e + ∫I·e dt + D·de/dt)        the integral updated first; gains in mA
 *
 * y and ref are held over a macro step; all inner steps use them. I stands inside the integral, so that tuning
 * it causes no jump. It starts running: f at ref, and the integral carries u_R_start.
 */
#include "fmus/common/model.h"

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

static const drive defaults = {
    .ref = 10,
    .y = 62.852256877937684,
    .P = 51.7,
    .I = 309.7,
    .D = 0,
    .rise = 12,
    .Wgh = 0.01,
    .t_step = 0.001,
    .u_R_start = 0.32473666053601136,
    .Z_p = 1,
};

static const tl_fmu_variable variables[] = {
    {TL_FMU_REAL, 0, TL_FMU_INPUT, offsetof(drive, ref)},
    {TL_FMU_REAL, 1, TL_FMU_INPUT, offsetof(drive, y)},
    {TL_FMU_REAL, 2, TL_FMU_RESULT, offsetof(drive, u_R)},
    {TL_FMU_REAL, 3, TL_FMU_RESULT, offsetof(drive, e)},
    {TL_FMU_REAL, 4, TL_FMU_TUNABLE, offsetof(drive, P)},
    {TL_FMU_REAL, 5, TL_FMU_TUNABLE, offsetof(drive, I)},
    {TL_FMU_REAL, 6, TL_FMU_TUNABLE, offsetof(drive, D)},
    {TL_FMU_REAL, 7, TL_FMU_FIXED, offsetof(drive, rise)},
    {TL_FMU_REAL, 8, TL_FMU_FIXED, offsetof(drive, Wgh)},
    {TL_FMU_REAL, 9, TL_FMU_FIXED, offsetof(drive, t_step)},
    {TL_FMU_REAL, 10, TL_FMU_FIXED, offsetof(drive, u_R_start)},
    {TL_FMU_REAL, 11, TL_FMU_RESULT, offsetof(drive, f)},
    {TL_FMU_INTEGER, 0, TL_FMU_FIXED, offsetof(drive, Z_p)},
};

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

/* `from`, moved towards `to` by `reach` at most. */
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
