/* Cylinder: a double-acting pneumatic cylinder with meter-out throttles, its valve and its end
 *           switches.
 *
 *   dp1/dt = (q1·p0 − p1·A1·v)/(V01 + A1·x)       dp2/dt = (q2·p0 + p2·A2·v)/(V02 + A2·(L − x))
 *   m·dv/dt = F_pneu − F_ext − visc·v − fc·tanh(v/v_fc)    F_pneu = p1·A1 − p2·A2 − p0·(A1 − A2)
 *
 * q is a flow of air at p0, m³/s, through a nozzle according to ISO 6358: sonic conductance C,
 * critical pressure ratio b. The chambers are isothermal. The valve supplies one chamber through
 * C_s and vents the other one through the throttle of that stroke. `move_out` extends; else
 * `move_in` retracts; with neither, both chambers are closed. For a valve with spring return, set
 * `move_in` to true always.
 *
 * Integrated by semi-implicit Euler: the pressures from the old states, then v, then x. Both ends
 * are hard stops. The cylinder starts retracted and at rest, and the pressure keeps it there:
 * chamber 1 is vented, chamber 2 is at supply pressure.
 */
#include <math.h>

#include "description.h"
#include "fmus/common/model.h"

static const double P0 = 1e5;      /* Pa: ambient pressure, and reference pressure of the flows */
static const double BAR = 1e5;     /* Pa */
static const double LITRES = 1000; /* in one cubic metre */

typedef struct cylinder {
    fmi2Real F_ext;                                 /* input */
    fmi2Boolean move_out, move_in;                  /* inputs */
    fmi2Real throttle_extend, throttle_retract;     /* tunable */
    fmi2Real power_supply;                          /* tunable */
    fmi2Real A1, A2, L, m, C_s, C_max, b, V01, V02; /* fixed */
    fmi2Real visc, fc, v_fc, end_width, t_step;     /* fixed */
    fmi2Real pos, v, F_pneu, airflow;               /* results */
    fmi2Boolean extend_signal, retract_signal;      /* results */
    fmi2Real p1, p2;                                /* states; no FMI variables */
} cylinder;

/* Flows into the chambers, and out through the throttle, m³/s. */
typedef struct flows {
    double q1, q2, exhaust;
} flows;

/* Returns the flow through a nozzle from the side at `p_from` to that at `p_to`, m³/s; negative if
 * `p_to` is higher. */
static double flow(double conductance, double b, double p_from, double p_to) {
    const double sign = p_from >= p_to ? 1 : -1;
    const double p_up = p_from >= p_to ? p_from : p_to;
    const double ratio = (p_from >= p_to ? p_to : p_from) / p_up;
    const double beyond = ratio <= b ? 0 : (ratio - b) / (1 - b);
    return sign * conductance * p_up * sqrt(fmax(0, 1 - beyond * beyond));
}

static double supply(const cylinder *c) {
    return P0 + c->power_supply * BAR;
}

static flows flows_of(const cylinder *c) {
    if (c->move_out) {
        const double exhaust = flow(c->throttle_extend * c->C_max, c->b, c->p2, P0);
        return (flows){flow(c->C_s, c->b, supply(c), c->p1), -exhaust, exhaust};
    }
    if (c->move_in) {
        const double exhaust = flow(c->throttle_retract * c->C_max, c->b, c->p1, P0);
        return (flows){-exhaust, flow(c->C_s, c->b, supply(c), c->p2), exhaust};
    }
    return (flows){0, 0, 0};
}

static void compute_results(cylinder *c) {
    c->F_pneu = c->p1 * c->A1 - c->p2 * c->A2 - P0 * (c->A1 - c->A2);
    c->airflow = flows_of(c).exhaust * LITRES;
    c->extend_signal = c->pos >= c->L - c->end_width;
    c->retract_signal = c->pos <= c->end_width;
}

static void start(void *model) {
    cylinder *c = model;
    c->pos = 0;
    c->v = 0;
    c->p1 = P0;
    c->p2 = supply(c);
    compute_results(c);
}

static void stop_at(cylinder *c, double end) {
    c->pos = end;
    c->v = 0;
}

static void move(cylinder *c, double h) {
    const double friction = c->visc * c->v + c->fc * tanh(c->v / c->v_fc);
    c->v += h * (c->F_pneu - c->F_ext - friction) / c->m;
    c->pos += h * c->v;
    if (c->pos <= 0) {
        stop_at(c, 0);
    } else if (c->pos >= c->L) {
        stop_at(c, c->L);
    }
}

static void step(void *model, double h) {
    cylinder *c = model;
    const flows in = flows_of(c);
    const double p1_rate = (in.q1 * P0 - c->p1 * c->A1 * c->v) / (c->V01 + c->A1 * c->pos);
    const double p2_rate = (in.q2 * P0 + c->p2 * c->A2 * c->v) / (c->V02 + c->A2 * (c->L - c->pos));

    c->p1 += h * p1_rate;
    c->p2 += h * p2_rate;
    c->F_pneu = c->p1 * c->A1 - c->p2 * c->A2 - P0 * (c->A1 - c->A2);
    move(c, h);
    compute_results(c);
}

TL_FMU_MODEL(cylinder, .t_step = offsetof(cylinder, t_step), .start = start, .step = step);
