/* Motor: induction machine with rotor-flux orientation, supplied by a converter, with inertia and
 *        viscous friction.
 *
 *   Tr·dψ/dt    = L_h·i_sd − ψ           Tr = L_r/R_r
 *   Ts·di_sd/dt = Ψ_ref/L_h − i_sd       Ts·di_sq/dt = I_in − i_sq
 *   J·dω/dt     = M_m − M_w − d·ω        M_m = 1.5·Z_p·(L_h/L_r)·ψ·i_sq
 *
 * Integrated by explicit Euler: all derivatives from the old states, then all states. The motor
 * starts at omega_start, in balance without load, so that i_sq only overcomes the friction.
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct motor {
    fmi2Real I_in, M_w;                                           /* inputs */
    fmi2Real d;                                                   /* tunable */
    fmi2Real L_h, L_r, R_r, T_s, J, Psi_ref, t_step, omega_start; /* fixed */
    fmi2Integer Z_p;                                              /* fixed */
    fmi2Real psi, i_sd, i_sq, omega;                              /* states */
    fmi2Real M_m;
} motor;

/* Returns the torque per ampere of i_sq, N.m/A. */
static double torque_constant(const motor *m) {
    return 1.5 * m->Z_p * (m->L_h / m->L_r) * m->psi;
}

static void start(void *model) {
    motor *m = model;
    m->psi = m->Psi_ref;
    m->i_sd = m->Psi_ref / m->L_h;
    m->omega = m->omega_start;
    m->i_sq = m->d * m->omega / torque_constant(m);
    m->M_m = torque_constant(m) * m->i_sq;
}

static void step(void *model, double h) {
    motor *m = model;
    const double T_r = m->L_r / m->R_r;
    const double psi_rate = (m->L_h * m->i_sd - m->psi) / T_r;
    const double i_sd_rate = (m->Psi_ref / m->L_h - m->i_sd) / m->T_s;
    const double i_sq_rate = (m->I_in - m->i_sq) / m->T_s;
    const double omega_rate = (m->M_m - m->M_w - m->d * m->omega) / m->J;

    m->psi += h * psi_rate;
    m->i_sd += h * i_sd_rate;
    m->i_sq += h * i_sq_rate;
    m->omega += h * omega_rate;
    m->M_m = torque_constant(m) * m->i_sq;
}

TL_FMU_MODEL(motor, .t_step = offsetof(motor, t_step), .start = start, .step = step);
