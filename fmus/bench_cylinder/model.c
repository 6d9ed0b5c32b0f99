/* Bench cylinder: a test bench moves a pneumatic cylinder out and in at a set speed, against air of
 * a set pressure.
 *
 *   dx/dt = v_out when it moves out, else −v_in        tau·dp/dt = p_set + R·A·dx/dt − p
 *   F = p·A + friction_out when it moves out, else p·A − friction_in
 *
 * x is the stroke by which the bench has pressed the air, p the pressure above ambient, F the force
 * of the bench. R is the resistance of the line to the pressure regulator. The cylinder presses air
 * out through it, so p is above p_set on the way out and below on the way in. Friction acts against
 * the motion. It shows the condition of the seal and differs by direction.
 *
 * Integrated by explicit Euler. There are no end stops: the bench decides where to reverse.
 */
#include "fmus/common/model.h"
#include "description.h"

static const double PI = 3.14159265358979323846;

typedef struct bench_cylinder {
    fmi2Boolean dir_out;                             /* input */
    fmi2Real friction_out, friction_in;              /* tunable */
    fmi2Real v_out, v_in, p_set;                     /* tunable */
    fmi2Real bore, R, tau, x_start, p_start, t_step; /* fixed */
    fmi2Real x, p, F;                                /* states x, p; result F */
} bench_cylinder;

static double area(const bench_cylinder *c) {
    return PI / 4 * c->bore * c->bore;
}

static void compute_force(bench_cylinder *c) {
    c->F = c->p * area(c) + (c->dir_out ? c->friction_out : -c->friction_in);
}

static void start(void *model) {
    bench_cylinder *c = model;
    c->x = c->x_start;
    c->p = c->p_start;
    compute_force(c);
}

static void step(void *model, double h) {
    bench_cylinder *c = model;
    const double v = c->dir_out ? c->v_out : -c->v_in;

    c->p += h * (c->p_set + c->R * area(c) * v - c->p) / c->tau;
    c->x += h * v;
    compute_force(c);
}

TL_FMU_MODEL(bench_cylinder, .t_step = offsetof(bench_cylinder, t_step), .start = start, .step = step);
