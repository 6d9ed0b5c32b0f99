/* TCLab: two heaters close to each other on a board, each with a sensor; a heat balance.
 *
 *   mCp·dH1/dt = U·A·(Ta − H1) + ε·σ·A·(Ta⁴ − H1⁴)
 *                + U_s·A_s·(H2 − H1) + ε·σ·A_s·(H2⁴ − H1⁴) + alpha1·Q1
 *   tau·dT1/dt = H1 − T1
 *
 * The equations of the other heater are the same. H is the temperature of a heater, T the one that
 * its sensor shows. Integrated by explicit Euler: all derivatives from the old states, then all
 * states.
 *
 * Start values of parameters were fitted to a record of a real board by simulation error. The model
 * starts long after the board was switched off, so that heaters and sensors have the same
 * temperature.
 */
#include "fmus/common/model.h"
#include "description.h"

static const double STEFAN_BOLTZMANN = 5.67e-8; /* W/(m²·K⁴) */

typedef struct tclab {
    fmi2Real Q1, Q2, Ta;                                       /* inputs */
    fmi2Real U, U_s, alpha1, alpha2, mCp;                      /* tunable */
    fmi2Real A, A_s, epsilon, tau, T1_start, T2_start, t_step; /* fixed */
    fmi2Real T1, T2, H1, H2;                                   /* states and results */
} tclab;

static void start(void *model) {
    tclab *b = model;
    b->H1 = b->T1 = b->T1_start;
    b->H2 = b->T2 = b->T2_start;
}

/* Returns the heat flow between two surfaces by convection and radiation, W; positive from `from`
 * to `to`. */
static double exchanged(const tclab *b, double coefficient, double area, double from, double to) {
    const double radiation = b->epsilon * STEFAN_BOLTZMANN * (from * from * from * from - to * to * to * to);
    return area * (coefficient * (from - to) + radiation);
}

static void step(void *model, double h) {
    tclab *b = model;
    const double across = exchanged(b, b->U_s, b->A_s, b->H2, b->H1);
    const double heat1 = exchanged(b, b->U, b->A, b->Ta, b->H1) + across + b->alpha1 * b->Q1;
    const double heat2 = exchanged(b, b->U, b->A, b->Ta, b->H2) - across + b->alpha2 * b->Q2;
    const double T1_rate = (b->H1 - b->T1) / b->tau;
    const double T2_rate = (b->H2 - b->T2) / b->tau;

    b->H1 += h * heat1 / b->mCp;
    b->H2 += h * heat2 / b->mCp;
    b->T1 += h * T1_rate;
    b->T2 += h * T2_rate;
}

TL_FMU_MODEL(tclab, .t_step = offsetof(tclab, t_step), .start = start, .step = step);
