/* Beam: a beam hinged at O with a mass that slides on it, lifted by a cylinder.
 *
 * The lower end of the cylinder is at the height h below O. The cylinder acts on the beam at the
 * radius r from O; its length is l = l_0 + pos. Gravity's torque about O is g·(m_beam·s_beam +
 * m_mass·s_mass)·cos φ, with φ the beam's angle to the horizontal. The lever arm of the cylinder is
 * h·r·cos φ/l. So the angle cancels out, and the static force along the cylinder is
 *
 *   F = g·(m_beam·s_beam + m_mass·s_mass)·l/(h·r)
 *
 * The inertia of the beam is part of the cylinder's mass. There is nothing to integrate: a step
 * uses the present position.
 */
#include "fmus/common/model.h"
#include "description.h"

static const double G = 9.81; /* m/s² */

typedef struct beam {
    fmi2Real pos;                                                 /* input */
    fmi2Real s_mass;                                              /* tunable */
    fmi2Real m_beam, s_beam, m_mass, height, radius, l_0, t_step; /* fixed */
    fmi2Real F;                                                   /* result */
} beam;

static void start(void *model) {
    beam *b = model;
    const double weights = G * (b->m_beam * b->s_beam + b->m_mass * b->s_mass);
    b->F = weights * (b->l_0 + b->pos) / (b->height * b->radius);
}

static void step(void *model, double h) {
    (void)h;
    start(model);
}

TL_FMU_MODEL(beam, .t_step = offsetof(beam, t_step), .start = start, .step = step);
