/* Tennessee Eastman plant: reactor, condenser with separator, recycle compressor and stripper.
 *
 *   A + C + D → G     A + C + E → H     A + E → F     3 D → 2 F
 *
 * The heat of the first two reactions counts. All are irreversible.
 *
 *   feed gas zone   mixes the feeds A, D and E, the recycled gas and the gas out of the stripper
 *   reactor         two phases; A, B and C are gas only; cooled by water in its bundle
 *   separator       two phases behind the condenser; gas is recycled and purged
 *   stripper        liquid; the feed A and C strips D, E and F out of the separator's liquid
 *
 * Source: J. J. Downs and E. F. Vogel, A plant-wide industrial process control problem, Computers
 * Chem. Engng 17 (1993) 245–255. Equations, constants and the start state, the base case of mode 1,
 * are those of the authors' public program teprob.f, in its units: lb-mol, ft³, mmHg, °C,
 * 10⁶ Btu, hours. XMV, XMEAS and IDV, with their numbers, are its valves, measurements and
 * disturbances.
 *
 * Integrated by explicit Euler with all derivatives from the old state, as in the source. At the
 * source's step of 1 s it oscillates if the reactor is hotter than some 143 °C. Random
 * disturbances and noise have generators of their own, here and in the state, so that a restored
 * state repeats them to the bit.
 */
#include <math.h>
#include <string.h>

#include "description.h"
#include "fmus/common/model.h"

/* ---- The state and the FMI variables ---- */

enum { A, B, C, D, E, F, G, H, SUBSTANCES };
enum { VALVES = 12, MEASUREMENTS = 41, CONTINUOUS = 22, GAS_ANALYSES = 36, WALKS = 12 };

/* A vessel: what its balances integrate, and what follows from that. */
typedef struct vessel {
    double moles[SUBSTANCES];   /* lb-mol; of a two-phase vessel A to C as gas and D to H as liquid */
    double energy;              /* 10⁶ Btu; of a two-phase vessel that of the liquid */
    double x[SUBSTANCES];       /* mole fractions of the liquid, or of the only phase */
    double y[SUBSTANCES];       /* mole fractions of the gas of a two-phase vessel */
    double T;                   /* °C */
    double p;                   /* mmHg; not of the stripper */
    double density;             /* of the liquid, lb-mol/ft³ */
    double liquid, gas;         /* volumes, ft³ */
    double partial[SUBSTANCES]; /* pressures, mmHg */
} vessel;

/* A random disturbance: a cubic in the hours since `begin`, up to `end`; both in s. */
typedef struct walk {
    double a, b, c, d, begin, end;
} walk;

typedef struct tennessee {
    /* Inputs: XMV(1) to XMV(12) in %, IDV(1) to IDV(20) from 0 to 1, fault of one sensor */
    fmi2Real D_feed_valve, E_feed_valve, A_feed_valve, AC_feed_valve, recycle_valve, purge_valve;
    fmi2Real separator_valve, stripper_valve, steam_valve, reactor_cooling_valve, condenser_cooling_valve,
        agitator_speed;
    fmi2Real IDV1, IDV2, IDV3, IDV4, IDV5, IDV6, IDV7, IDV8, IDV9, IDV10;
    fmi2Real IDV11, IDV12, IDV13, IDV14, IDV15, IDV16, IDV17, IDV18, IDV19, IDV20;
    fmi2Integer faulty_sensor;
    fmi2Real fault_offset, fault_gain;
    fmi2Boolean fault_frozen;

    fmi2Real A_feed_T, D_feed_T, E_feed_T, AC_feed_T, AC_feed_A, AC_feed_B;           /* tunable */
    fmi2Real reactor_cooling_inlet_T, condenser_cooling_inlet_T;                      /* tunable */
    fmi2Real reaction_factor, outflow_factor, reactor_UA_factor, condenser_UA_factor; /* tunable */
    fmi2Real noise, t_step;                                                           /* fixed */
    fmi2Integer seed;                                                                 /* fixed */

    /* Results: XMEAS(1) to XMEAS(41) */
    fmi2Real A_feed, D_feed, E_feed, AC_feed, recycle_flow, reactor_feed, reactor_p, reactor_level, reactor_T,
        purge_flow;
    fmi2Real separator_T, separator_level, separator_p, separator_underflow, stripper_level, stripper_p, product_flow;
    fmi2Real stripper_T, steam_flow, compressor_work, reactor_cooling_outlet_T, condenser_cooling_outlet_T;
    fmi2Real feed_A, feed_B, feed_C, feed_D, feed_E, feed_F;
    fmi2Real purge_A, purge_B, purge_C, purge_D, purge_E, purge_F, purge_G, purge_H;
    fmi2Real product_D, product_E, product_F, product_G, product_H;
    fmi2Boolean shutdown; /* result */

    /* States; no FMI variables. The cooling outlet temperatures are states too. */
    vessel feed_zone, reactor, separator, stripper;
    double reactor_water_T, condenser_water_T; /* °C */
    double position[VALVES], held[VALVES];     /* %: of the stems; commands that have moved them */
    walk walks[WALKS];
    double analysed[MEASUREMENTS];                         /* samples in the analysers */
    double time, next_gas_analysis, next_product_analysis; /* s */
    uint64_t walk_generator, noise_generator;
} tennessee;

static const double HOUR = 3600;             /* s */
static const double KELVIN = 273.15;         /* at 0 °C */
static const double GAS_CONSTANT = 998.9;    /* mmHg·ft³/(lb-mol·K) */
static const double ATMOSPHERE = 760;        /* mmHg */
static const double KPA = 101.325 / 760;     /* in one mmHg */
static const double KSCMH = 0.359 / 35.3145; /* thousand standard m³ in one lb-mol */
static const double KG = 0.454;              /* in one lb */
static const double CUBIC_FEET = 35.3145;    /* in one m³ */

/* A valve or drive: its command, time constant, and position at the start. */
static const struct valve {
    size_t command;
    double lag;      /* s */
    double position; /* % */
} VALVE[VALVES] = {
    {offsetof(tennessee, D_feed_valve), 8, 63.05263039},
    {offsetof(tennessee, E_feed_valve), 8, 53.97970677},
    {offsetof(tennessee, A_feed_valve), 6, 24.64355755},
    {offsetof(tennessee, AC_feed_valve), 9, 61.30192144},
    {offsetof(tennessee, recycle_valve), 7, 22.21},
    {offsetof(tennessee, purge_valve), 5, 40.06374673},
    {offsetof(tennessee, separator_valve), 5, 38.10034370},
    {offsetof(tennessee, stripper_valve), 5, 46.53415582},
    {offsetof(tennessee, steam_valve), 120, 47.44573456},
    {offsetof(tennessee, reactor_cooling_valve), 5, 41.10581288},
    {offsetof(tennessee, condenser_cooling_valve), 5, 18.11349055},
    {offsetof(tennessee, agitator_speed), 5, 50},
};
enum {
    TO_D,
    TO_E,
    TO_A,
    TO_AC,
    TO_RECYCLE,
    TO_PURGE,
    TO_UNDERFLOW,
    TO_PRODUCT,
    TO_STEAM,
    TO_REACTOR,
    TO_CONDENSER,
    TO_AGITATOR
};
static const double STICTION = 2; /* %: change of the command that moves a sticking valve */

/* XMEAS(1) … XMEAS(41) and the standard deviations of their noise, in their units. */
static const struct sensor {
    size_t result;
    double noise;
} SENSOR[MEASUREMENTS] = {
    {offsetof(tennessee, A_feed), 0.0012},
    {offsetof(tennessee, D_feed), 18},
    {offsetof(tennessee, E_feed), 22},
    {offsetof(tennessee, AC_feed), 0.05},
    {offsetof(tennessee, recycle_flow), 0.2},
    {offsetof(tennessee, reactor_feed), 0.21},
    {offsetof(tennessee, reactor_p), 0.3},
    {offsetof(tennessee, reactor_level), 0.5},
    {offsetof(tennessee, reactor_T), 0.01},
    {offsetof(tennessee, purge_flow), 0.0017},
    {offsetof(tennessee, separator_T), 0.01},
    {offsetof(tennessee, separator_level), 1},
    {offsetof(tennessee, separator_p), 0.3},
    {offsetof(tennessee, separator_underflow), 0.125},
    {offsetof(tennessee, stripper_level), 1},
    {offsetof(tennessee, stripper_p), 0.3},
    {offsetof(tennessee, product_flow), 0.115},
    {offsetof(tennessee, stripper_T), 0.01},
    {offsetof(tennessee, steam_flow), 1.15},
    {offsetof(tennessee, compressor_work), 0.2},
    {offsetof(tennessee, reactor_cooling_outlet_T), 0.01},
    {offsetof(tennessee, condenser_cooling_outlet_T), 0.01},
    {offsetof(tennessee, feed_A), 0.25},
    {offsetof(tennessee, feed_B), 0.1},
    {offsetof(tennessee, feed_C), 0.25},
    {offsetof(tennessee, feed_D), 0.1},
    {offsetof(tennessee, feed_E), 0.25},
    {offsetof(tennessee, feed_F), 0.025},
    {offsetof(tennessee, purge_A), 0.25},
    {offsetof(tennessee, purge_B), 0.1},
    {offsetof(tennessee, purge_C), 0.25},
    {offsetof(tennessee, purge_D), 0.1},
    {offsetof(tennessee, purge_E), 0.25},
    {offsetof(tennessee, purge_F), 0.025},
    {offsetof(tennessee, purge_G), 0.05},
    {offsetof(tennessee, purge_H), 0.05},
    {offsetof(tennessee, product_D), 0.01},
    {offsetof(tennessee, product_E), 0.01},
    {offsetof(tennessee, product_F), 0.01},
    {offsetof(tennessee, product_G), 0.5},
    {offsetof(tennessee, product_H), 0.5},
};
static const double GAS_ANALYSIS = 360;     /* s: cycle and dead time of the gas analysers */
static const double PRODUCT_ANALYSIS = 900; /* s: of the product analyser */

/* ---- Functions that give the same bits on each machine, which those of libm do not ---- */

/* Returns e^x, from the Taylor series around the nearest multiple of ln 2. */
static double exponential(double x) {
    if (!(fabs(x) < 700)) {
        return x < 0 ? 0 : x * HUGE_VAL;
    }
    const double doublings = floor(x * 1.4426950408889634 + 0.5);
    const double rest = x - doublings * 6.93147180369123816490e-01 - doublings * 1.90821492927058770002e-10;
    double sum = 1;
    for (int i = 14; i > 0; i--) {
        sum = 1 + rest / i * sum;
    }
    return ldexp(sum, (int)doublings);
}

/* Returns ln x for x > 0: ln x = ln(3/4) + 2·artanh((x − 3/4)/(x + 3/4)), as a series. */
static double logarithm(double x) {
    int exponent;
    const double half = frexp(x, &exponent);
    const double s = (half - 0.75) / (half + 0.75);
    double sum = 0;
    for (int i = 25; i > 0; i -= 2) {
        sum = sum * s * s + 1.0 / i;
    }
    return 2 * s * sum - 0.2876820724517809 + exponent * 0.6931471805599453;
}

/* ---- Properties of the substances ---- */

/* Polynomials of the temperature in °C; a gas has no density here, and A to C are never liquid. */
static const struct substance {
    double mass;         /* lb/lb-mol */
    double antoine[3];   /* ln p = a + b/(T + c), p in mmHg */
    double density[3];   /* of the liquid, lb/ft³ */
    double liquid[3];    /* heat capacity, 10⁶ Btu/(lb·°F) */
    double gas[3];       /* heat capacity, as above */
    double vaporisation; /* heat at 0 °C, 10⁶ Btu/lb */
} SUBSTANCE[SUBSTANCES] = {
    {2, {0, 0, 0}, {1, 0, 0}, {1e-6, 0, 0}, {3.411e-6, 7.18e-10, 6e-13}, 1e-6},
    {25.4, {0, 0, 0}, {1, 0, 0}, {1e-6, 0, 0}, {0.3799e-6, 1.08e-9, -3.98e-13}, 1e-6},
    {28, {0, 0, 0}, {1, 0, 0}, {1e-6, 0, 0}, {0.2491e-6, 1.36e-11, -3.93e-14}, 1e-6},
    {32,
     {15.92, -1444, 259},
     {23.3, -0.07, -2e-4},
     {0.96e-6, 8.7e-9, 4.81e-11},
     {0.3567e-6, 8.51e-10, -3.12e-13},
     86.7e-6},
    {46,
     {16.35, -2114, 265.5},
     {33.9, -0.0957, -1.52e-4},
     {0.573e-6, 2.41e-9, 1.82e-11},
     {0.3463e-6, 8.96e-10, -3.27e-13},
     160e-6},
    {48,
     {16.35, -2114, 265.5},
     {32.8, -0.0995, -2.33e-4},
     {0.652e-6, 2.18e-9, 1.94e-11},
     {0.393e-6, 1.02e-9, -3.12e-13},
     160e-6},
    {62, {16.43, -2748, 232.9}, {49.9, -0.0191, -4.25e-4}, {0.515e-6, 5.65e-10, 3.82e-12}, {0.17e-6, 0, 0}, 225e-6},
    {76, {17.21, -3318, 249.6}, {50.5, -0.0541, -1.5e-4}, {0.471e-6, 8.7e-10, 2.62e-12}, {0.15e-6, 0, 0}, 209e-6},
};
static const double FAHRENHEIT = 1.8; /* degrees in one of Celsius */

typedef enum phase { LIQUID, GAS, CLOSED_GAS } phase; /* a closed gas has internal energy, others enthalpy */
static const double GAS_ENERGY = 3.57696e-6;          /* gas constant, 10⁶ Btu/(lb-mol·K) */

/* Returns enthalpy or internal energy of a mixture in 10⁶ Btu/lb-mol, and in `slope` its derivative
 * by the temperature. */
static double energy_of(const double fraction[SUBSTANCES], double T, phase state, double *slope) {
    double energy = 0;
    *slope = 0;
    for (int i = 0; i < SUBSTANCES; i++) {
        const struct substance *s = &SUBSTANCE[i];
        const double *heat = state == LIQUID ? s->liquid : s->gas;
        const double sensible = T * (heat[0] + heat[1] * T / 2 + heat[2] * T * T / 3) * FAHRENHEIT;
        const double latent = state == LIQUID ? 0 : s->vaporisation;
        energy += fraction[i] * s->mass * (sensible + latent);
        *slope += fraction[i] * s->mass * (heat[0] + heat[1] * T + heat[2] * T * T) * FAHRENHEIT;
    }
    if (state == CLOSED_GAS) {
        energy -= GAS_ENERGY * (T + KELVIN);
        *slope -= GAS_ENERGY;
    }
    return energy;
}

/* Returns the temperature at which a mixture has an energy in 10⁶ Btu/lb-mol: Newton's method from
 * the temperature `T`. */
static double temperature_of(const double fraction[SUBSTANCES], double energy, phase state, double T) {
    double change = 1;
    for (int i = 0; i < 100 && fabs(change) >= 1e-12; i++) {
        double slope;
        const double off = energy_of(fraction, T, state, &slope) - energy;
        change = -off / slope;
        T += change;
    }
    return T;
}

/* Returns the density of a liquid in lb-mol/ft³. */
static double density_of(const double fraction[SUBSTANCES], double T) {
    double volume = 0;
    for (int i = 0; i < SUBSTANCES; i++) {
        const struct substance *s = &SUBSTANCE[i];
        volume += fraction[i] * s->mass / (s->density[0] + (s->density[1] + s->density[2] * T) * T);
    }
    return 1 / volume;
}

static double mass_of(const double fraction[SUBSTANCES]) {
    double mass = 0;
    for (int i = 0; i < SUBSTANCES; i++) {
        mass += fraction[i] * SUBSTANCE[i].mass;
    }
    return mass;
}

/* ---- Vessels: from moles and energy to temperature, pressure and composition ---- */

static const double REACTOR_VOLUME = 1300, SEPARATOR_VOLUME = 3500, FEED_ZONE_VOLUME = 5000; /* ft³ */
static const double STRIPPER_VOLUME = 156.5;                                                 /* ft³, of the liquid */

/* Composition and temperature of the substances from `first` on: of the liquid, or of the only
 * phase. Returns their moles. */
static double find_temperature(vessel *v, int first, phase state) {
    double total = 0;
    for (int i = first; i < SUBSTANCES; i++) {
        total += v->moles[i];
    }
    for (int i = 0; i < SUBSTANCES; i++) {
        v->x[i] = i < first ? 0 : v->moles[i] / total;
    }
    v->T = temperature_of(v->x, v->energy / total, state, v->T);
    return total;
}

static void find_liquid(vessel *v, int first) {
    const double total = find_temperature(v, first, LIQUID);
    v->density = density_of(v->x, v->T);
    v->liquid = total / v->density;
}

/* Vapour-liquid equilibrium: ideal gas of A to C; D to H by Antoine and Raoult. */
static void find_equilibrium(vessel *v, double volume) {
    find_liquid(v, D);
    v->gas = volume - v->liquid;
    v->p = 0;
    for (int i = 0; i < SUBSTANCES; i++) {
        const double *antoine = SUBSTANCE[i].antoine;
        v->partial[i] = i < D ? v->moles[i] * GAS_CONSTANT * (v->T + KELVIN) / v->gas
                              : exponential(antoine[0] + antoine[1] / (v->T + antoine[2])) * v->x[i];
        v->p += v->partial[i];
    }
    for (int i = 0; i < SUBSTANCES; i++) {
        v->y[i] = v->partial[i] / v->p;
    }
}

static void find_vessels(tennessee *t) {
    const double gas = find_temperature(&t->feed_zone, A, CLOSED_GAS);
    t->feed_zone.p = gas * GAS_CONSTANT * (t->feed_zone.T + KELVIN) / FEED_ZONE_VOLUME;
    find_equilibrium(&t->reactor, REACTOR_VOLUME);
    find_equilibrium(&t->separator, SEPARATOR_VOLUME);
    find_liquid(&t->stripper, A);
}

/* ---- Random disturbances ---- */

/* Returns a random number, 0 ≤ r < 1: xorshift64*, of S. Vigna. */
static double draw(uint64_t *generator) {
    uint64_t bits = *generator;
    bits ^= bits >> 12;
    bits ^= bits << 25;
    bits ^= bits >> 27;
    *generator = bits;
    return (double)(bits * UINT64_C(2685821657736338717) >> 11) / 9007199254740992.0;
}

static double draw_around(uint64_t *generator, double middle, double span) {
    return middle + span * (2 * draw(generator) - 1);
}

/* What varies: the first nine wander by cubic splines around a mean, the last three come in bumps.
 * The cause of a bump is not in the paper. */
enum {
    AC_A,
    AC_B,
    D_T,
    AC_T,
    REACTOR_WATER,
    CONDENSER_WATER,
    RATE_G,
    RATE_H,
    STEAM,
    REACTOR_UA,
    CONDENSER_UA,
    OUTFLOW
};
static const struct wander {
    double hours, hours_span; /* time to the next knot */
    double span;              /* of the value at a knot; of a bump 1 */
} WANDER[WALKS] = {
    {0.5, 0.2, 0.03}, {1, 0.7, 0.003}, {0.5, 0.25, 10},  {1, 0.7, 10}, {0.25, 0.15, 10}, {0.25, 0.15, 10},
    {2, 1, 0.25},     {2, 1, 0.25},    {0.5, 0.4, 0.25}, {2, 1.5, 1},  {3, 2, 1},        {2, 1.5, 1},
};
static const double FIRST_KNOT = 360; /* s */
static const double BUMP_FALL = 0.1;  /* h: a bump falls from 1 to 0 */

static double walk_at(const walk *w, double time) {
    const double h = (time - w->begin) / HOUR;
    return w->a + h * (w->b + h * (w->c + h * w->d));
}

/* Continues a walk from its last knot; `on`: 0 … 1, size of the disturbance. */
static void draw_walk(walk *w, const struct wander *about, bool bump, double on, uint64_t *generator) {
    const double h = (w->end - w->begin) / HOUR;
    const double value = walk_at(w, w->end);
    const double slope = w->b + h * (2 * w->c + 3 * h * w->d);
    w->begin = w->end;
    if (bump && value > 0.1) {
        *w = (walk){value,
                    slope,
                    -(3 * value + 2 * BUMP_FALL * slope) / (BUMP_FALL * BUMP_FALL),
                    (2 * value + BUMP_FALL * slope) / (BUMP_FALL * BUMP_FALL * BUMP_FALL),
                    w->end,
                    w->end + BUMP_FALL * HOUR};
        return;
    }
    const double hours = draw_around(generator, about->hours, about->hours_span);
    w->end += hours * HOUR;
    if (bump) {
        *w = (walk){0, 0, on / (hours * hours), 0, w->begin, w->end};
        return;
    }
    const double target = draw_around(generator, 0, about->span) * on;
    *w = (walk){value,
                slope,
                (3 * (target - value) - 2 * hours * slope) / (hours * hours),
                (2 * (value - target) + hours * slope) / (hours * hours * hours),
                w->begin,
                w->end};
}

static void draw_walks(tennessee *t) {
    const double on[WALKS] = {t->IDV8,  t->IDV8,  t->IDV9,  t->IDV10, t->IDV11, t->IDV12,
                              t->IDV13, t->IDV13, t->IDV16, t->IDV17, t->IDV18, t->IDV20};
    for (int i = 0; i < WALKS; i++) {
        if (t->time >= t->walks[i].end) {
            draw_walk(&t->walks[i], &WANDER[i], i >= REACTOR_UA, on[i], &t->walk_generator);
        }
    }
}

static double walk_now(const tennessee *t, int which) {
    return walk_at(&t->walks[which], t->time);
}

/* ---- Streams ---- */

typedef struct stream {
    double flow;                 /* lb-mol/h */
    double fraction[SUBSTANCES]; /* mole fractions */
    double enthalpy;             /* 10⁶ Btu/lb-mol */
} stream;

/* All flows of the plant at one instant; the numbers are those of the flowsheet. */
typedef struct flowsheet {
    stream A_feed, D_feed, E_feed, AC_feed; /* 1 to 4 */
    stream stripper_gas;                    /* 5 */
    stream reactor_feed, reactor_outflow;   /* 6, 7 */
    stream recycle, purge;                  /* 8, 9 */
    stream underflow;                       /* 10: liquid of the separator */
    stream stripper_liquid;                 /* between the stages of the stripper and its sump */
    stream product;                         /* 11 */
    double compressor_work;                 /* 10⁶ Btu/h */
    double steam_heat;                      /* 10⁶ Btu/h */
    double reactor_water, condenser_water;  /* flows of cooling water, gal/min */
} flowsheet;

static stream make_stream(double flow, const double fraction[SUBSTANCES], double T, phase state) {
    stream made = {.flow = flow};
    double slope;
    memcpy(made.fraction, fraction, sizeof made.fraction);
    made.enthalpy = energy_of(fraction, T, state, &slope);
    return made;
}

/* Returns the root of a pressure difference; 0 against the flow, where check valves close. */
static double root_of(double difference) {
    return sqrt(fmax(difference, 0));
}

static void find_feeds(const tennessee *t, flowsheet *s) {
    const double A_fraction = t->AC_feed_A + walk_now(t, AC_A) - 0.03 * t->IDV1 - 2.43719e-3 * t->IDV2;
    const double B_fraction = t->AC_feed_B + walk_now(t, AC_B) + 0.005 * t->IDV2;
    const double pure_A[SUBSTANCES] = {[A] = 0.9999, [B] = 1e-4};
    const double pure_D[SUBSTANCES] = {[D] = 0.9999, [B] = 1e-4};
    const double pure_E[SUBSTANCES] = {[E] = 0.9999, [F] = 1e-4};
    const double mixture[SUBSTANCES] = {[A] = A_fraction, [B] = B_fraction, [C] = 1 - A_fraction - B_fraction};
    const double *position = t->position;
    s->A_feed = make_stream(position[TO_A] * (1 - t->IDV6), pure_A, t->A_feed_T, GAS);
    s->D_feed = make_stream(position[TO_D] * 4, pure_D, t->D_feed_T + walk_now(t, D_T) + 5 * t->IDV3, GAS);
    s->E_feed = make_stream(position[TO_E] * 4, pure_E, t->E_feed_T, GAS);
    s->AC_feed =
        make_stream(position[TO_AC] * 15 * (1 - 0.2 * t->IDV7) + 1e-10, mixture, t->AC_feed_T + walk_now(t, AC_T), GAS);
}

/* Recycle compressor with its bypass. Its characteristic is a cubic in the pressure ratio. */
static void compress(const tennessee *t, flowsheet *s) {
    static const double LARGEST_FLOW = 280275; /* lb/h */
    const vessel *from = &t->separator;
    const double rise = t->feed_zone.p - from->p;
    const double ratio = fmin(fmax(t->feed_zone.p / from->p, 1), 1.3);
    const double through = LARGEST_FLOW + LARGEST_FLOW / 1.197 * (1 - ratio * ratio * ratio);
    const double mass = mass_of(from->y);
    const double forward = fmax(through - t->position[TO_RECYCLE] * 53.349 * root_of(rise), 1e-3);
    s->compressor_work = through * (from->T + KELVIN) * 1.8e-6 * 1.9872 * rise / (mass * from->p);
    s->recycle = make_stream(forward / mass, from->y, from->T, GAS);
    s->recycle.enthalpy += s->compressor_work / s->recycle.flow;
}

static void find_gas_flows(const tennessee *t, flowsheet *s) {
    const vessel *zone = &t->feed_zone, *reactor = &t->reactor, *separator = &t->separator;
    const double outflow =
        4574.21 * t->outflow_factor * root_of(reactor->p - separator->p) * (1 - 0.25 * walk_now(t, OUTFLOW));
    const double purge = t->position[TO_PURGE] * 0.151169 * root_of(separator->p - ATMOSPHERE);
    s->reactor_feed = make_stream(1937.6 * root_of(zone->p - reactor->p) / mass_of(zone->x), zone->x, zone->T, GAS);
    s->reactor_outflow = make_stream(outflow / mass_of(reactor->y), reactor->y, reactor->T, GAS);
    s->purge = make_stream(purge / mass_of(separator->y), separator->y, separator->T, GAS);
    compress(t, s);
}

/* Splits the feed A and C and the separator's liquid between the stripper's gas and its sump. The
 * part of D to H that is stripped depends on temperature and on gas per liquid. */
static void strip(const tennessee *t, flowsheet *s) {
    static const double STRIPPABLE[SUBSTANCES] = {0, 0, 0, 8.501, 11.402, 11.795, 0.048, 0.0242};
    static const double WITHOUT_LIQUID[SUBSTANCES] = {0, 0, 0, 0.9999, 0.999, 0.999, 0.99, 0.98};
    static const double LIGHT[D] = {0.995, 0.991, 0.99};
    const double T = t->stripper.T;
    const bool wet = s->underflow.flow > 0.1;
    const double by_T = T > 170 ? T - 120.262 : T < 5.292 ? 0.1 : 363.744 / (177 - T) - 2.22579488;
    const double gas_per_liquid = wet ? s->AC_feed.flow / s->underflow.flow * by_T : 0;
    double up[SUBSTANCES], down[SUBSTANCES], up_flow = 0, down_flow = 0;
    for (int i = 0; i < SUBSTANCES; i++) {
        const double into = s->AC_feed.flow * s->AC_feed.fraction[i] + s->underflow.flow * s->underflow.fraction[i];
        const double load = STRIPPABLE[i] * gas_per_liquid;
        const double part = i < D ? LIGHT[i] : wet ? load / (1 + load) : WITHOUT_LIQUID[i];
        up[i] = part * into;
        down[i] = into - up[i];
        up_flow += up[i];
        down_flow += down[i];
    }
    for (int i = 0; i < SUBSTANCES; i++) {
        up[i] /= up_flow;
        down[i] /= down_flow;
    }
    s->stripper_gas = make_stream(up_flow, up, T, GAS);
    s->stripper_liquid = make_stream(down_flow, down, T, LIQUID);
}

static flowsheet find_flows(const tennessee *t) {
    flowsheet s;
    const double *position = t->position;
    find_feeds(t, &s);
    find_gas_flows(t, &s);
    s.underflow = make_stream(position[TO_UNDERFLOW] * 15, t->separator.x, t->separator.T, LIQUID);
    s.product = make_stream(position[TO_PRODUCT] * 10, t->stripper.x, t->stripper.T, LIQUID);
    strip(t, &s);
    s.reactor_water = position[TO_REACTOR] * 10;
    s.condenser_water = position[TO_CONDENSER] * 12;
    s.steam_heat = position[TO_STEAM] * 3e-4 * (1 + walk_now(t, STEAM)) * fmax(100 - t->stripper.T, 0);
    return s;
}

/* ---- Reactions and heat ---- */

/* Rates in lb-mol/h; returns the heat of the reactions in 10⁶ Btu/h. Arrhenius, with powers of the
 * partial pressures. */
static double react(const tennessee *t, double made[SUBSTANCES]) {
    const vessel *r = &t->reactor;
    const double RT = 1.987 * (r->T + KELVIN); /* cal/mol */
    const bool mixed = r->partial[A] > 0 && r->partial[C] > 0;
    const double of_AC = mixed ? exponential(1.1544 * logarithm(r->partial[A]) + 0.3735 * logarithm(r->partial[C])) : 0;
    const double volume = r->gas * t->reaction_factor;
    const double to_G =
        exponential(31.5859536 - 40000 / RT) * (1 + walk_now(t, RATE_G)) * of_AC * r->partial[D] * volume;
    const double to_H =
        exponential(3.00094014 - 20000 / RT) * (1 + walk_now(t, RATE_H)) * of_AC * r->partial[E] * volume;
    const double to_F = exponential(53.4060443 - 60000 / RT) * r->partial[A] * volume;
    const double E_to_F = to_F * r->partial[E];
    const double D_to_F = to_F * r->partial[D] * 0.767488334;
    made[A] = -to_G - to_H - E_to_F;
    made[B] = 0;
    made[C] = -to_G - to_H;
    made[D] = -to_G - 1.5 * D_to_F;
    made[E] = -to_H - E_to_F;
    made[F] = E_to_F + D_to_F;
    made[G] = to_G;
    made[H] = to_H;
    return to_G * 0.06899381054 + to_H * 0.05;
}

/* Heat from the cooling water into the reactor, 10⁶ Btu/h. The bundle is in use as far as the
 * liquid covers it. */
static double heat_reactor(const tennessee *t) {
    const double covered = fmin(fmax(0.025 * t->reactor.liquid / 7.8 - 0.25, 0), 1);
    const double speed = (t->position[TO_AGITATOR] + 150) / 100;
    const double UA = covered * (-0.5 * speed * speed + 2.75 * speed - 2.5) * 0.85549 * t->reactor_UA_factor;
    return UA * (t->reactor_water_T - t->reactor.T) * (1 - 0.35 * walk_now(t, REACTOR_UA));
}

/* Heat from the cooling water into the gas between reactor and separator, 10⁶ Btu/h. */
static double heat_condenser(const tennessee *t, const flowsheet *s) {
    const double flow = s->reactor_outflow.flow / 3528.73;
    const double UA = 0.404655 * (1 - 1 / (1 + flow * flow * flow * flow)) * t->condenser_UA_factor;
    return UA * (t->condenser_water_T - t->reactor.T) * (1 - 0.25 * walk_now(t, CONDENSER_UA));
}

/* Returns how fast cooling water in a bundle gets warmer, °C/h; `heat`: what it gives away. */
static double warm_water(double flow, double inlet_T, double T, double heat, double content) {
    return (flow * 500.53 * (inlet_T - T) - heat * 1e6 / 1.8) / content;
}

/* ---- Balances ---- */

typedef struct balance {
    double moles[SUBSTANCES]; /* lb-mol/h */
    double energy;            /* 10⁶ Btu/h */
} balance;

/* Adds a stream into a vessel to the vessel's balance: `sign` 1; out of it: −1. */
static void count(balance *b, const stream *s, double sign) {
    for (int i = 0; i < SUBSTANCES; i++) {
        b->moles[i] += sign * s->flow * s->fraction[i];
    }
    b->energy += sign * s->flow * s->enthalpy;
}

static void integrate(vessel *v, const balance *b, double hours) {
    for (int i = 0; i < SUBSTANCES; i++) {
        v->moles[i] += hours * b->moles[i];
    }
    v->energy += hours * b->energy;
}

/* Advances the vessels. The compressor's work is taken from the separator, as in the source. */
static void integrate_vessels(tennessee *t, const flowsheet *s, double reactor_heat, double condenser_heat,
                              double hours) {
    balance zone = {{0}, 0}, reactor = {{0}, 0}, separator = {{0}, condenser_heat}, stripper = {{0}, s->steam_heat};
    reactor.energy = react(t, reactor.moles) + reactor_heat;
    count(&zone, &s->A_feed, 1);
    count(&zone, &s->D_feed, 1);
    count(&zone, &s->E_feed, 1);
    count(&zone, &s->stripper_gas, 1);
    count(&zone, &s->recycle, 1);
    count(&zone, &s->reactor_feed, -1);
    count(&reactor, &s->reactor_feed, 1);
    count(&reactor, &s->reactor_outflow, -1);
    count(&separator, &s->reactor_outflow, 1);
    count(&separator, &s->recycle, -1);
    count(&separator, &s->purge, -1);
    count(&separator, &s->underflow, -1);
    count(&stripper, &s->stripper_liquid, 1);
    count(&stripper, &s->product, -1);
    stripper.energy += s->AC_feed.flow * s->AC_feed.enthalpy + s->underflow.flow * s->underflow.enthalpy -
                       s->stripper_gas.flow * s->stripper_gas.enthalpy -
                       s->stripper_liquid.flow * s->stripper_liquid.enthalpy;
    integrate(&t->feed_zone, &zone, hours);
    integrate(&t->reactor, &reactor, hours);
    integrate(&t->separator, &separator, hours);
    integrate(&t->stripper, &stripper, hours);
}

/* Valves follow their commands with a lag; those that stick, only after a large change. */
static void move_valves(tennessee *t, double hours) {
    const double sticks[VALVES] = {[TO_RECYCLE] = t->IDV19, [TO_UNDERFLOW] = t->IDV19, [TO_PRODUCT] = t->IDV19,
                                   [TO_STEAM] = t->IDV19,   [TO_REACTOR] = t->IDV14,   [TO_CONDENSER] = t->IDV15};
    for (int i = 0; i < VALVES; i++) {
        double command;
        memcpy(&command, (const char *)t + VALVE[i].command, sizeof command);
        command = fmin(fmax(command, 0), 100);
        if (fabs(t->held[i] - command) > STICTION * sticks[i]) {
            t->held[i] = command;
        }
        t->position[i] += hours * HOUR * (t->held[i] - t->position[i]) / VALVE[i].lag;
    }
}

/* ---- Measurements ---- */

/* The interlocks stop the plant, whose state then no longer changes. */
static bool is_beyond_limits(const tennessee *t) {
    const double reactor = t->reactor.liquid / CUBIC_FEET, separator = t->separator.liquid / CUBIC_FEET;
    const double stripper = t->stripper.liquid / CUBIC_FEET;
    return (t->reactor.p - ATMOSPHERE) * KPA > 3000 || t->reactor.T > 175 || reactor > 24 || reactor < 2 ||
           separator > 12 || separator < 1 || stripper > 8 || stripper < 1;
}

static void find_values(const tennessee *t, const flowsheet *s, double value[MEASUREMENTS]) {
    const double values[MEASUREMENTS] = {
        s->A_feed.flow * KSCMH,
        s->D_feed.flow * mass_of(s->D_feed.fraction) * KG,
        s->E_feed.flow * mass_of(s->E_feed.fraction) * KG,
        s->AC_feed.flow * KSCMH,
        s->recycle.flow * KSCMH,
        s->reactor_feed.flow * KSCMH,
        (t->reactor.p - ATMOSPHERE) * KPA,
        (t->reactor.liquid - 84.6) / 666.7 * 100,
        t->reactor.T,
        s->purge.flow * KSCMH,
        t->separator.T,
        (t->separator.liquid - 27.5) / 290 * 100,
        (t->separator.p - ATMOSPHERE) * KPA,
        s->underflow.flow / t->separator.density / CUBIC_FEET,
        (t->stripper.liquid - 78.25) / STRIPPER_VOLUME * 100,
        (t->feed_zone.p - ATMOSPHERE) * KPA,
        s->product.flow / t->stripper.density / CUBIC_FEET,
        t->stripper.T,
        s->steam_heat * 1040 * KG,
        s->compressor_work * 293.07,
        t->reactor_water_T,
        t->condenser_water_T,
    };
    memcpy(value, values, sizeof values);
    for (int i = 0; i < 6; i++) {
        value[CONTINUOUS + i] = t->feed_zone.x[i] * 100;
    }
    for (int i = 0; i < SUBSTANCES; i++) {
        value[CONTINUOUS + 6 + i] = t->separator.y[i] * 100;
    }
    for (int i = D; i < SUBSTANCES; i++) {
        value[GAS_ANALYSES + i - D] = t->stripper.x[i] * 100;
    }
}

/* Shows a value with noise, a sum of twelve uniform numbers, and with the fault of the sensor. */
static void show(tennessee *t, int which, double value) {
    void *result = (char *)t + SENSOR[which].result;
    const bool faulty = t->faulty_sensor == which + 1;
    if (t->noise > 0 && t->time > 0) {
        double sum = -6;
        for (int i = 0; i < 12; i++) {
            sum += draw(&t->noise_generator);
        }
        value += sum * SENSOR[which].noise * t->noise;
    }
    if (faulty && t->fault_frozen && t->time > 0) {
        return;
    }
    if (faulty) {
        value = value * t->fault_gain + t->fault_offset;
    }
    memcpy(result, &value, sizeof value);
}

/* Shows the sample that has been in an analyser for its dead time, and takes the next one. */
static void analyse(tennessee *t, const double value[MEASUREMENTS], int first, int end) {
    for (int i = first; i < end; i++) {
        show(t, i, t->analysed[i]);
        t->analysed[i] = value[i];
    }
}

static void measure(tennessee *t) {
    const flowsheet s = find_flows(t);
    double value[MEASUREMENTS];
    find_values(t, &s, value);
    t->shutdown = is_beyond_limits(t);
    for (int i = 0; i < CONTINUOUS; i++) {
        show(t, i, value[i]);
    }
    if (t->time == 0) {
        memcpy(t->analysed, value, sizeof value);
        analyse(t, value, CONTINUOUS, MEASUREMENTS);
    }
    if (t->time >= t->next_gas_analysis) {
        analyse(t, value, CONTINUOUS, GAS_ANALYSES);
        t->next_gas_analysis += GAS_ANALYSIS;
    }
    if (t->time >= t->next_product_analysis) {
        analyse(t, value, GAS_ANALYSES, MEASUREMENTS);
        t->next_product_analysis += PRODUCT_ANALYSIS;
    }
}

/* ---- Start and step ---- */

static void set_base_case(tennessee *t) {
    static const vessel REACTOR = {.moles = {10.40491389, 4.363996017, 7.570059737, 0.4230042431, 24.15513437,
                                             2.942597645, 154.3770655, 159.186596},
                                   .energy = 2.808522723};
    static const vessel SEPARATOR = {.moles = {63.75581199, 26.74026066, 46.38532432, 0.2464521543, 15.20484404,
                                               1.852266172, 52.44639459, 41.20394008},
                                     .energy = 0.569931776};
    static const vessel STRIPPER = {.moles = {0.4306056376, 7.9906200783e-3, 0.9056036089, 1.6054258216e-2,
                                              0.7509759687, 8.8582855955e-2, 48.27726193, 39.38459028},
                                    .energy = 0.3755297257};
    static const vessel FEED_ZONE = {.moles = {107.7562698, 29.77250546, 88.32481135, 23.03929507, 62.85848794,
                                               5.546318688, 11.92244772, 5.555448243},
                                     .energy = 0.9218489762};
    t->reactor = REACTOR;
    t->separator = SEPARATOR;
    t->stripper = STRIPPER;
    t->feed_zone = FEED_ZONE;
    t->reactor_water_T = 94.59927549;
    t->condenser_water_T = 77.29698353;
    for (int i = 0; i < VALVES; i++) {
        t->position[i] = t->held[i] = VALVE[i].position;
    }
}

static void start(void *model) {
    tennessee *t = model;
    set_base_case(t);
    for (int i = 0; i < WALKS; i++) {
        t->walks[i] = (walk){.end = FIRST_KNOT};
    }
    t->time = 0;
    t->next_gas_analysis = GAS_ANALYSIS;
    t->next_product_analysis = PRODUCT_ANALYSIS;
    t->walk_generator = UINT64_C(0x9E3779B97F4A7C15) * ((uint64_t)(uint32_t)t->seed + 1); /* never 0 */
    t->noise_generator = ~t->walk_generator;
    find_vessels(t);
    measure(t);
}

static void step(void *model, double h) {
    tennessee *t = model;
    const double hours = h / HOUR;
    if (!t->shutdown) {
        draw_walks(t);
        const flowsheet s = find_flows(t);
        const double reactor_heat = heat_reactor(t), condenser_heat = heat_condenser(t, &s);
        const double reactor_inlet_T = t->reactor_cooling_inlet_T + walk_now(t, REACTOR_WATER) + 5 * t->IDV4;
        const double condenser_inlet_T = t->condenser_cooling_inlet_T + walk_now(t, CONDENSER_WATER) + 5 * t->IDV5;
        integrate_vessels(t, &s, reactor_heat, condenser_heat, hours);
        t->reactor_water_T +=
            hours * warm_water(s.reactor_water, reactor_inlet_T, t->reactor_water_T, reactor_heat, 7060);
        t->condenser_water_T +=
            hours * warm_water(s.condenser_water, condenser_inlet_T, t->condenser_water_T, condenser_heat, 11138);
        move_valves(t, hours);
        find_vessels(t);
    }
    t->time += h;
    measure(t);
}

TL_FMU_MODEL(tennessee, .t_step = offsetof(tennessee, t_step), .start = start, .step = step);
