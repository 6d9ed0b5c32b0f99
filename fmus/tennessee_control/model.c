/* Tennessee Eastman control: the decentralised loops of the plant in fmus/tennessee.
 *
 *   e = 100 %·(set point − measurement)/span     Δu = K·(e − e_before + e·period/T_i)
 *
 * An inner loop moves a valve by Δu. An outer loop moves the set point of an inner loop by Δu of
 * that loop's span. The purge valve opens if the separator's pressure is too high, and closes if it
 * is too low.
 *
 * Source: E. L. Russell, L. H. Chiang, R. D. Braatz, Data-driven Methods for Fault Detection and
 * Diagnosis in Chemical Processes, Springer 2000, and the authors' public program temain_mod.f:
 * structure, gains, spans, periods and set points. A command answers measurements one step later,
 * as there.
 */
#include <string.h>

#include "description.h"
#include "fmus/common/model.h"

/* Loops, in their order of execution. The first eleven move the valves. */
enum {
    D_FEED,
    E_FEED,
    A_FEED,
    AC_FEED,
    RECYCLE,
    PURGE,
    SEPARATOR_LEVEL,
    STRIPPER_LEVEL,
    STEAM,
    REACTOR_COOLING,
    PRODUCT,
    VALVES,
    STRIPPER_T = VALVES,
    REACTOR_LEVEL,
    REACTOR_T,
    FEED_A,
    FEED_D,
    FEED_E,
    PURGE_B,
    PRODUCT_E,
    LOOPS
};

typedef struct tennessee_control {
    fmi2Real A_feed, D_feed, E_feed, AC_feed, recycle_flow, reactor_level, reactor_T, purge_flow;          /* inputs */
    fmi2Real separator_level, separator_p, stripper_level, product_flow, stripper_T, steam_flow;           /* inputs */
    fmi2Real reactor_cooling_outlet_T, feed_A, feed_D, feed_E, purge_B, product_E;                         /* inputs */
    fmi2Real t_step;                                                                                       /* fixed */
    fmi2Real D_feed_valve, E_feed_valve, A_feed_valve, AC_feed_valve, recycle_valve, purge_valve;          /* results */
    fmi2Real separator_valve, stripper_valve, steam_valve, reactor_cooling_valve, condenser_cooling_valve; /* results */

    /* States; no FMI variables. */
    double set_point[LOOPS], error[LOOPS];
    int64_t tick;   /* inner steps since the start, plus one */
    int64_t forced; /* purge valve: 1 open, −1 closed, 0 controlled */
} tennessee_control;

#define AT(member) offsetof(tennessee_control, member)

static const struct loop {
    size_t measurement;
    size_t valve;     /* of an inner loop */
    int inner;        /* of an outer loop: the loop whose set point it moves */
    int period;       /* ticks */
    double set_point; /* at the start */
    double span;      /* in the unit of the measurement */
    double gain;      /* %/% */
    double reset;     /* T_i in ticks; 0: proportional only */
    double position;  /* of the valve at the start, % */
} LOOP[LOOPS] = {
    [D_FEED] = {AT(D_feed), AT(D_feed_valve), -1, 3, 3664, 5811, 1, 0, 63.053},
    [E_FEED] = {AT(E_feed), AT(E_feed_valve), -1, 3, 4509.3, 8354, 1, 0, 53.98},
    [A_FEED] = {AT(A_feed), AT(A_feed_valve), -1, 3, 0.25052, 1.017, 1, 0, 24.644},
    [AC_FEED] = {AT(AC_feed), AT(AC_feed_valve), -1, 3, 9.3477, 15.25, 1, 0, 61.302},
    [RECYCLE] = {AT(recycle_flow), AT(recycle_valve), -1, 3, 26.902, 53, -0.083, 1, 22.21},
    [PURGE] = {AT(purge_flow), AT(purge_valve), -1, 3, 0.33712, 1, 1.22, 0, 40.064},
    [SEPARATOR_LEVEL] = {AT(separator_level), AT(separator_valve), -1, 3, 50, 70, -2.06, 0, 38.1},
    [STRIPPER_LEVEL] = {AT(stripper_level), AT(stripper_valve), -1, 3, 50, 70, -1.62, 0, 46.534},
    [STEAM] = {AT(steam_flow), AT(steam_valve), -1, 3, 230.31, 460, 0.41, 0, 47.446},
    [REACTOR_COOLING] = {AT(reactor_cooling_outlet_T), AT(reactor_cooling_valve), -1, 3, 94.599, 150, -1.56, 1452,
                         41.106},
    [PRODUCT] = {AT(product_flow), AT(condenser_cooling_valve), -1, 3, 22.949, 46, 1.09, 2600, 18.114},
    [STRIPPER_T] = {AT(stripper_T), 0, STEAM, 3, 65.731, 130, 0.169, 236, 0},
    [REACTOR_LEVEL] = {AT(reactor_level), 0, AC_FEED, 3, 75, 50, 1.11, 3168, 0},
    [REACTOR_T] = {AT(reactor_T), 0, REACTOR_COOLING, 3, 120.4, 150, 28.3, 982, 0},
    [FEED_A] = {AT(feed_A), 0, A_FEED, 360, 32.188, 100, 18, 3168, 0},
    [FEED_D] = {AT(feed_D), 0, D_FEED, 360, 6.882, 100, 8.3, 3168, 0},
    [FEED_E] = {AT(feed_E), 0, E_FEED, 360, 18.776, 100, 2.37, 5069, 0},
    [PURGE_B] = {AT(purge_B), 0, PURGE, 360, 13.823, 26, -83.2 / 15, 6336, 0},
    [PRODUCT_E] = {AT(product_E), 0, STRIPPER_T, 900, 0.8357, 1.6, -16.3 / 5, 12408, 0},
};

static const double P_OPEN = 2950, P_CLOSE = 2300, P_RELEASE = 2633.7; /* of the separator, kPa */
static const double PURGE_AFTER = 40.06;                               /* %: valve after it was forced */

static double value_at(const tennessee_control *c, size_t offset) {
    double value;
    memcpy(&value, (const char *)c + offset, sizeof value);
    return value;
}

static void set_valve(tennessee_control *c, int which, double position) {
    const double limited = position < 0 ? 0 : position > 100 ? 100 : position;
    memcpy((char *)c + LOOP[which].valve, &limited, sizeof limited);
}

static void control(tennessee_control *c, int which) {
    const struct loop *loop = &LOOP[which];
    const double error = (c->set_point[which] - value_at(c, loop->measurement)) * 100 / loop->span;
    const double integral = loop->reset > 0 ? error * loop->period / loop->reset : 0;
    const double change = loop->gain * (error - c->error[which] + integral);
    c->error[which] = error;
    if (loop->inner < 0) {
        set_valve(c, which, value_at(c, loop->valve) + change);
    } else {
        c->set_point[loop->inner] += change * LOOP[loop->inner].span / 100;
    }
}

/* Pressure override of the purge valve: forced until the pressure is normal again. */
static void control_purge(tennessee_control *c) {
    const double p = c->separator_p;
    const int64_t before = c->forced;
    if (p >= P_OPEN || (before > 0 && p > P_RELEASE)) {
        c->forced = 1;
        set_valve(c, PURGE, 100);
    } else if (before <= 0 && (p <= P_CLOSE || (before < 0 && p < P_RELEASE))) {
        c->forced = -1;
        set_valve(c, PURGE, 0);
    } else if (before != 0) {
        c->forced = 0;
        c->set_point[PURGE] = LOOP[PURGE].set_point;
        c->error[PURGE] = 0;
        set_valve(c, PURGE, PURGE_AFTER);
    } else {
        control(c, PURGE);
    }
}

static void start(void *model) {
    tennessee_control *c = model;
    for (int i = 0; i < LOOPS; i++) {
        c->set_point[i] = LOOP[i].set_point;
        c->error[i] = 0;
    }
    for (int i = 0; i < VALVES; i++) {
        set_valve(c, i, LOOP[i].position);
    }
    c->tick = 1;
    c->forced = 0;
}

static void step(void *model, double h) {
    tennessee_control *c = model;
    (void)h;
    c->tick++;
    for (int i = 0; i < LOOPS; i++) {
        if (c->tick % LOOP[i].period == 0) {
            if (i == PURGE) {
                control_purge(c);
            } else {
                control(c, i);
            }
        }
    }
}

TL_FMU_MODEL(tennessee_control, .t_step = offsetof(tennessee_control, t_step), .start = start, .step = step);
