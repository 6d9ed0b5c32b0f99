/* EMPS: the carriage of an electro-mechanical positioning system, a mass on a screw with Coulomb
 *       friction.
 *
 *   M·dv/dt = F − Fv·v − Fc·sgn(v) − offset       dq/dt = v
 *
 * Integrated by implicit Euler. sgn is evaluated at the end of the step. At zero it may have any
 * value within ±1, namely the one that stops the carriage. So an inner step has a closed solution.
 * Compute the momentum that the carriage would have without friction. Coulomb friction removes up
 * to Fc·h of it. The carriage moves with the remaining momentum; if there is none, v is exactly 0.
 * Explicit Euler would chatter about zero by ±Fc·h/M instead of sticking. A smoothed sgn would
 * creep and is stiff. The method is of first order and stable for any t_step.
 *
 * Start values of parameters were fitted to a record of the real plant by simulation error. The
 * carriage starts as in that record.
 */
#include <math.h>

#include "description.h"
#include "fmus/common/model.h"

typedef struct emps {
    fmi2Real F;                           /* input */
    fmi2Real Fv, Fc, offset;              /* tunable */
    fmi2Real M, q_start, v_start, t_step; /* fixed */
    fmi2Real q, v;                        /* states and outputs */
} emps;

static void start(void *model) {
    emps *c = model;
    c->q = c->q_start;
    c->v = c->v_start;
}

static void step(void *model, double h) {
    emps *c = model;
    const double momentum = c->M * c->v + h * (c->F - c->offset);
    const double friction = h * c->Fc;

    if (fabs(momentum) <= friction) {
        c->v = 0;
    } else {
        c->v = (momentum > 0 ? momentum - friction : momentum + friction) / (c->M + h * c->Fv);
    }
    c->q += h * c->v;
}

TL_FMU_MODEL(emps, .t_step = offsetof(emps, t_step), .start = start, .step = step);
