/* The engine of the nonlinear EHSA hand-written in C, as a reference for the speed of the compiled one.
 *
 * Same algorithm as ehsa_ctrl/simulation/integrator.py, decision by decision: Dormand-Prince 5(4) with a restart at every
 * input sample, the same control of step length, the same short steps of a contact that creeps, the same mode machine for
 * the two dry contacts and the same search for its events. It is also compiled with -ffast-math, so no floating-point
 * test may meet NaN or infinity.
 *
 * Compile with -DCOUNT to fill `counts`; without it counting costs nothing.
 */

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

enum { OMEGA, P_1, P_2, V, X, STATES };
enum { DONE, FAILED, CHATTERS, STIFF };
enum { RATES, STEPS, REJECTED, SHORTENED, LOCATING, EVENTS, COUNTS };

#define MAX_EVENTS_PER_SAMPLE 1000
#define MAX_STEPS_PER_SAMPLE 20000
#define FAR 1e300 /* stands for infinity */

#ifdef COUNT
static long long counts[COUNTS];
#define TALLY(what) (counts[what]++)
void read_counts(long long *into) {
    for (int i = 0; i < COUNTS; i++) {
        into[i] = counts[i];
        counts[i] = 0;
    }
}
#else
#define TALLY(what) ((void)0)
#endif

/* The engine's own exponential, for the same reason as there: a call would save every variable around it. */
static inline double exponential(double x) {
    if (x < -700.0) return 0.0;
    if (x > 700.0) return FAR;
    double m = rint(x * 1.4426950408889634);
    double r = (x - m * 0.693147180369123816490) - m * 1.90821492927058770002e-10;
    double r2 = r * r, r4 = r2 * r2;
    double low = ((1.0 + r) + r2 * (1.0 / 2 + r * (1.0 / 6)))
                 + r4 * ((1.0 / 24 + r * (1.0 / 120)) + r2 * (1.0 / 720 + r * (1.0 / 5040)));
    double high = (1.0 / 40320 + r * (1.0 / 362880)) + r2 * (1.0 / 3628800 + r * (1.0 / 39916800))
                  + r4 * (1.0 / 479001600 + r * (1.0 / 6227020800.0));
    union { int64_t bits; double value; } power = {((int64_t)m + 1023) << 52};
    return (low + r4 * r4 * high) * power.value;
}

static inline double tenth_root(double x) {
    union { int64_t bits; double value; } number;
    number.value = x;
    const int64_t one = 4607182418800017408;
    number.bits = (int64_t)(one + 0.1 * (double)(number.bits - one));
    return number.value;
}

/* Symbols as in the paper; `parameters` of `run` has the same order. */
typedef struct {
    double J_M, K_T, D, K_L, V_10, V_20, beta, A, M, P_0, x_0, K_S, F_pre, k_3, F_0, m_L;
    double A_FM, B_FM, C_FM, tau_FM, A_FR, B_FR, C_FR, tau_FR;
} Parameters;

/* Parameters and what is worth computing once a run: a division costs as much as several products. */
typedef struct {
    Parameters p;
    double per_J_M, per_mass, per_tau_FM, per_tau_FR, preload;
} Plant;

/* Direction of each dry contact (0: it sticks), and whether it has only just begun to move. */
typedef struct {
    double d_M, d_R;
    bool fresh_M, fresh_R;
} Mode;

/* Inputs that run along straight lines from the start of a step. */
typedef struct {
    double current, force;
} Inputs;

/* What is handed from one sample to the next. */
typedef struct {
    double h, current, force, k1[STATES];
    bool first;
} Carry;

/* Units in which the error of each state counts, inverted: 100 rad/s, 5 bar, 5 bar, 50 mm/s, 20 mm. */
static const double PER_SCALE[STATES] = {1.0 / 100.0, 1.0 / 5e5, 1.0 / 5e5, 1.0 / 0.05, 1.0 / 0.02};

/* Dormand & Prince (1980). */
static const double C2 = 1.0 / 5, C3 = 3.0 / 10, C4 = 4.0 / 5, C5 = 8.0 / 9;
static const double A21 = 1.0 / 5;
static const double A31 = 3.0 / 40, A32 = 9.0 / 40;
static const double A41 = 44.0 / 45, A42 = -56.0 / 15, A43 = 32.0 / 9;
static const double A51 = 19372.0 / 6561, A52 = -25360.0 / 2187, A53 = 64448.0 / 6561, A54 = -212.0 / 729;
static const double A61 = 9017.0 / 3168, A62 = -355.0 / 33, A63 = 46732.0 / 5247, A64 = 49.0 / 176, A65 = -5103.0 / 18656;
static const double B1 = 35.0 / 384, B3 = 500.0 / 1113, B4 = 125.0 / 192, B5 = -2187.0 / 6784, B6 = 11.0 / 84;
static const double E1 = 71.0 / 57600, E3 = -71.0 / 16695, E4 = 71.0 / 1920, E5 = -17253.0 / 339200, E6 = 22.0 / 525,
                    E7 = -1.0 / 40;

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

/* a > b for a >= 0 that may be infinite or NaN, which then count as larger: bits sort as the numbers do. */
static inline bool exceeds(double a, double b) {
    uint64_t bits_a, bits_b;
    memcpy(&bits_a, &a, sizeof a);
    memcpy(&bits_b, &b, sizeof b);
    return bits_a > bits_b;
}

static inline double shaft_friction(double omega, double d, const Plant *c) {
    return d * (c->p.A_FM + c->p.C_FM * exponential(-d * omega * c->per_tau_FM)) + c->p.B_FM * omega;
}

static inline double rod_friction(double v, double d, const Plant *c) {
    return d * (c->p.A_FR + c->p.C_FR * exponential(-d * v * c->per_tau_FR)) + c->p.B_FR * v;
}

static inline double shaft_net(const double *y, Inputs in, const Plant *c) {
    return c->p.K_T * in.current - c->p.D * (y[P_1] - y[P_2]);
}

static inline double rod_net(const double *y, Inputs in, const Plant *c) {
    double x = y[X];
    return c->p.A * (y[P_1] - y[P_2]) - (x * (c->p.K_S + c->p.k_3 * x * x) + c->preload + in.force);
}

static inline void rates(const double *y, Inputs in, const Mode *m, const Plant *c, double *dy) {
    double into = c->p.D * y[OMEGA] - c->p.K_L * (y[P_1] - y[P_2]) - c->p.A * y[V];
    dy[OMEGA] = m->d_M == 0.0 ? 0.0 : (shaft_net(y, in, c) - shaft_friction(y[OMEGA], m->d_M, c)) * c->per_J_M;
    dy[P_1] = c->p.beta * into / (c->p.V_10 + c->p.A * y[X]);
    dy[P_2] = -c->p.beta * into / (c->p.V_20 - c->p.A * y[X]);
    dy[V] = m->d_R == 0.0 ? 0.0 : (rod_net(y, in, c) - rod_friction(y[V], m->d_R, c)) * c->per_mass;
    dy[X] = y[V];
    TALLY(RATES);
}

static inline Inputs along(Inputs start, Inputs change, double s) {
    return (Inputs){start.current + s * change.current, start.force + s * change.force};
}

/* One step from y with rates k1; gives the states and rates at its end and the squared norm of its error. */
static inline double step(const double *y, const double *k1, double h, Inputs in, Inputs change, const Mode *m,
                          const Plant *c, double *end, double *k7) {
    double k2[STATES], k3[STATES], k4[STATES], k5[STATES], k6[STATES], s[STATES];
    for (int i = 0; i < STATES; i++) s[i] = y[i] + h * (A21 * k1[i]);
    rates(s, along(in, change, C2), m, c, k2);
    for (int i = 0; i < STATES; i++) s[i] = y[i] + h * (A31 * k1[i] + A32 * k2[i]);
    rates(s, along(in, change, C3), m, c, k3);
    for (int i = 0; i < STATES; i++) s[i] = y[i] + h * (A41 * k1[i] + A42 * k2[i] + A43 * k3[i]);
    rates(s, along(in, change, C4), m, c, k4);
    for (int i = 0; i < STATES; i++) s[i] = y[i] + h * (A51 * k1[i] + A52 * k2[i] + A53 * k3[i] + A54 * k4[i]);
    rates(s, along(in, change, C5), m, c, k5);
    for (int i = 0; i < STATES; i++)
        s[i] = y[i] + h * (A61 * k1[i] + A62 * k2[i] + A63 * k3[i] + A64 * k4[i] + A65 * k5[i]);
    rates(s, along(in, change, 1.0), m, c, k6);
    for (int i = 0; i < STATES; i++)
        end[i] = y[i] + h * (B1 * k1[i] + B3 * k3[i] + B4 * k4[i] + B5 * k5[i] + B6 * k6[i]);
    rates(end, along(in, change, 1.0), m, c, k7);
    double error = 0.0;
    for (int i = 0; i < STATES; i++) {
        double part = E1 * k1[i] + E3 * k3[i] + E4 * k4[i] + E5 * k5[i] + E6 * k6[i] + E7 * k7[i];
        part *= PER_SCALE[i];
        error += part * part;
    }
    return error * h * h * (1.0 / STATES);
}

/* Force by which a sticking contact still holds. */
static inline double hold_shaft(const double *y, Inputs in, const Plant *c) {
    double net = shaft_net(y, in, c), d = net > 0.0 ? 1.0 : -1.0;
    return d * shaft_friction(y[OMEGA], d, c) - fabs(net);
}

static inline double hold_rod(const double *y, Inputs in, const Plant *c) {
    double net = rod_net(y, in, c), d = net > 0.0 ? 1.0 : -1.0;
    return d * rod_friction(y[V], d, c) - fabs(net);
}

/* Share of a step at which the parabola through three margins dips below zero though both ends are above; else 0. */
static inline double lowest(double start, double middle, double end) {
    double bend = start - 2.0 * middle + end, tilt = end - start;
    if (!(start > 0.0 && end > 0.0 && bend > 0.0)) return 0.0;
    double share = 0.5 - 0.25 * tilt / bend;
    return share > 0.0 && share < 1.0 && middle - 0.125 * tilt * tilt / bend < 0.0 ? share : 0.0;
}

/* Where within a step a contact breaks away, or stops, and comes back; 0 for a step without such a place. */
static inline double dip(const double *y, const double *k1, const double *end, const double *k7, double h, Inputs in,
                         Inputs change, const Mode *m, const Plant *c) {
    double half[STATES], share = 0.0;
    for (int i = 0; i < STATES; i++) half[i] = 0.5 * (y[i] + end[i]) + 0.125 * h * (k1[i] - k7[i]);
    Inputs middle = along(in, change, 0.5), then = along(in, change, 1.0);
    if (m->d_M == 0.0)
        share = lowest(hold_shaft(y, in, c), hold_shaft(half, middle, c), hold_shaft(end, then, c));
    else if (!m->fresh_M && m->d_M * k1[OMEGA] < 0.0 && 0.0 < m->d_M * k7[OMEGA])
        share = lowest(m->d_M * y[OMEGA], m->d_M * half[OMEGA], m->d_M * end[OMEGA]);
    if (0.02 < share && share < 0.98) return share;
    share = 0.0;
    if (m->d_R == 0.0)
        share = lowest(hold_rod(y, in, c), hold_rod(half, middle, c), hold_rod(end, then, c));
    else if (!m->fresh_R && m->d_R * k1[V] < 0.0 && 0.0 < m->d_R * k7[V])
        share = lowest(m->d_R * y[V], m->d_R * half[V], m->d_R * end[V]);
    return 0.02 < share && share < 0.98 ? share : 0.0;
}

/* Longest step of a contact that slides ever slower, from its acceleration now and at speed 0. */
static inline double longest(double speed, double acceleration, double at_rest) {
    double growth = (acceleration - at_rest) / speed;
    if (!(growth > 0.0)) return FAR;
    double folds = growth * fabs(speed / acceleration);
    return larger(0.12, smaller(0.3, 1.5 / folds)) / growth;
}

static inline double creep(const double *y, const double *k1, Inputs in, const Mode *m, const Plant *c, double h) {
    double still[STATES];
    if (m->d_M != 0.0 && y[OMEGA] != 0.0 && fabs(y[OMEGA]) < 100.0) {
        memcpy(still, y, sizeof still);
        still[OMEGA] = 0.0;
        double at_rest = (shaft_net(still, in, c) - shaft_friction(0.0, m->d_M, c)) * c->per_J_M;
        h = smaller(h, longest(y[OMEGA], k1[OMEGA], at_rest));
    }
    if (m->d_R != 0.0 && y[V] != 0.0 && fabs(y[V]) < 0.05) {
        memcpy(still, y, sizeof still);
        still[V] = 0.0;
        double at_rest = (rod_net(still, in, c) - rod_friction(0.0, m->d_R, c)) * c->per_mass;
        h = smaller(h, longest(y[V], k1[V], at_rest));
    }
    return h;
}

/* Distance to the nearest mode change in scaled units; negative: passed. */
static inline double margin(const double *y, Inputs in, const Mode *m, const Plant *c) {
    double least = FAR;
    if (m->d_M == 0.0)
        least = smaller(least, hold_shaft(y, in, c));
    else if (!m->fresh_M)
        least = smaller(least, m->d_M * y[OMEGA] * PER_SCALE[OMEGA]);
    if (m->d_R == 0.0)
        least = smaller(least, hold_rod(y, in, c) * 1e-3);
    else if (!m->fresh_R)
        least = smaller(least, m->d_R * y[V] * PER_SCALE[V]);
    return least;
}

/* Share of the step at which the margin, along the cubic through both ends of the step, reaches -aim. */
static inline double guess(const double *y, const double *k1, const double *end, const double *k7, double h, Inputs in,
                           Inputs change, const Mode *m, double at_a, double at_b, double aim, const Plant *c) {
    double a = 0.0, b = 1.0, s = 1.0, q[STATES];
    int side = 0;
    for (int trial = 0; trial < 12; trial++) {
        s = a + (b - a) * at_a / (at_a - at_b);
        double r = 1.0 - s;
        for (int i = 0; i < STATES; i++)
            q[i] = r * r * (1.0 + 2.0 * s) * y[i] + s * s * (3.0 - 2.0 * s) * end[i] + h * s * r * (r * k1[i] - s * k7[i]);
        double at_s = margin(q, along(in, change, s), m, c) + aim;
        if (fabs(at_s) < aim || b - a < 1e-6) break;
        if (at_s < 0.0) {
            b = s, at_b = at_s;
            if (side == -1) at_a *= 0.5;
            side = -1;
        } else {
            a = s, at_a = at_s;
            if (side == 1) at_b *= 0.5;
            side = 1;
        }
    }
    return s;
}

/* Length of the step that ends just past the first mode change; `end` and `k7` become states and rates there.
 * Newton along the trajectory, kept in its bracket, each trial a new step; aims at the middle of (-exact, 0). */
static inline double locate(const double *y, const double *k1, double h, Inputs in, Inputs change, const Mode *m,
                            double at_end, double exact, const Plant *c, double *end, double *k7) {
    double aim = 0.5 * exact, at_low = margin(y, in, m, c), low = 0.0, high = h, at_mid = at_end, q[STATES];
    if (at_low <= 0.0) at_low = exact;
    double mid = h * guess(y, k1, end, k7, h, in, change, m, at_low + aim, at_end + aim, aim, c);
    for (int trial = 0; trial < 60; trial++) {
        if (trial > 0) {
            for (int i = 0; i < STATES; i++) q[i] = end[i] - 1e-6 * h * k7[i];
            double before = margin(q, along(in, change, mid / h - 1e-6), m, c);
            double slope = at_mid - before;
            mid = slope < 0.0 ? mid - 1e-6 * h * (at_mid + aim) / slope : low;
        }
        if (!(low < mid && mid < high)) mid = 0.5 * (low + high);
        double s = mid / h;
        Inputs part = {change.current * s, change.force * s};
        step(y, k1, mid, in, part, m, c, end, k7);
        TALLY(LOCATING);
        at_mid = margin(end, along(in, part, 1.0), m, c);
        if (at_mid >= 0.0) {
            low = mid;
            continue;
        }
        high = mid;
        if (-at_mid <= exact || high - low <= 1e-15) break;
    }
    return mid;
}

/* Change the mode of every contact whose margin has run out: stop, break away, or reverse. */
static bool change_mode(double *y, Inputs in, Mode *m, const Plant *c) {
    double was_M = m->d_M, was_R = m->d_R;
    if (was_M == 0.0 || (was_M * y[OMEGA] <= 0.0 && !m->fresh_M)) {
        if (was_M != 0.0) y[OMEGA] = 0.0;
        m->fresh_M = hold_shaft(y, in, c) < 0.0;
        m->d_M = !m->fresh_M ? 0.0 : (shaft_net(y, in, c) > 0.0 ? 1.0 : -1.0);
    }
    if (was_R == 0.0 || (was_R * y[V] <= 0.0 && !m->fresh_R)) {
        if (was_R != 0.0) y[V] = 0.0;
        m->fresh_R = hold_rod(y, in, c) < 0.0;
        m->d_R = !m->fresh_R ? 0.0 : (rod_net(y, in, c) > 0.0 ? 1.0 : -1.0);
    }
    return m->d_M != was_M || m->d_R != was_R;
}

/* A contact stays fresh until it has left its switching surface. */
static inline void age(const double *y, Mode *m) {
    m->fresh_M = m->fresh_M && m->d_M * y[OMEGA] <= 0.0;
    m->fresh_R = m->fresh_R && m->d_R * y[V] <= 0.0;
}

/* Advance one sample; everything but the inputs is updated in place. */
static int advance(double *y, Mode *m, Carry *carry, Inputs from, Inputs to, double dt, double tol, const Plant *c,
                   double *low, double *high) {
    const double exact = 1e-3 * tol, inverse = 1.0 / (tol * tol), shortest = 1e-9 * dt;
    const Inputs slope = {(to.current - from.current) / dt, (to.force - from.force) / dt};
    double k1[STATES], k7[STATES], end[STATES];
    bool changed = false;
    bool jumped = carry->first || carry->current != from.current || carry->force != from.force;
    if (jumped) changed = change_mode(y, from, m, c);
    if (jumped || changed)
        rates(y, from, m, c, k1);
    else
        for (int i = 0; i < STATES; i++) k1[i] = carry->k1[i];
    double h = carry->h, t = 0.0;
    int events = 0, steps = 0;
    while (t < dt) {
        if (++steps > MAX_STEPS_PER_SAMPLE) return STIFF;
        double left = dt - t;
        bool last = h >= left;
        double tried = last ? left : (2.0 * h > left ? 0.5 * left : h);
        Inputs now = along(from, slope, t), change = {slope.current * tried, slope.force * tried};
        double error = step(y, k1, tried, now, change, m, c, end, k7) * inverse;
        TALLY(STEPS);
        if (exceeds(error, 1.0)) { /* a trial far past a stop overflows in the exponential of (8) */
            h = tried * (exceeds(error, 1e30) ? 0.1 : larger(0.2, 0.9 / tenth_root(error)));
            TALLY(REJECTED);
            if (tried < shortest) return FAILED;
            continue;
        }
        bool back_M = m->fresh_M && m->d_M * end[OMEGA] < 0.0, back_R = m->fresh_R && m->d_R * end[V] < 0.0;
        if (back_M || back_R) { /* it turned round before it was clear of its surface: look closer */
            if (tried > 1e-6 * dt) {
                h = 0.25 * tried;
                TALLY(SHORTENED);
                continue;
            }
            m->fresh_M = m->fresh_M && !back_M;
            m->fresh_R = m->fresh_R && !back_R;
        }
        double share = dip(y, k1, end, k7, tried, now, change, m, c);
        if (share > 0.0 && tried > 1e-6 * dt) {
            h = share * tried;
            TALLY(SHORTENED);
            continue;
        }
        Inputs then = along(now, change, 1.0);
        double at_end = margin(end, then, m, c);
        if (at_end < 0.0) {
            if (-at_end > exact) {
                tried = locate(y, k1, tried, now, change, m, at_end, exact, c, end, k7);
                then = along(now, slope, tried);
                last = false;
            }
            TALLY(EVENTS);
            if (++events > MAX_EVENTS_PER_SAMPLE) return CHATTERS;
            for (int i = 0; i < STATES; i++) y[i] = end[i];
            age(y, m);
            change_mode(y, then, m, c);
            rates(y, then, m, c, k1);
        } else {
            age(end, m);
            for (int i = 0; i < STATES; i++) {
                y[i] = end[i];
                k1[i] = k7[i];
            }
            double grown = tried * smaller(5.0, error > 1e-9 ? 0.9 / tenth_root(error) : 5.0);
            h = last && error <= 1e-7 ? larger(h, grown) : grown;
            h = creep(y, k1, then, m, c, h);
        }
        for (int i = 0; i < STATES; i++) {
            low[i] = smaller(low[i], y[i]);
            high[i] = larger(high[i], y[i]);
        }
        t = last ? dt : t + tried;
    }
    carry->h = h, carry->current = to.current, carry->force = to.force;
    for (int i = 0; i < STATES; i++) carry->k1[i] = k1[i];
    return DONE;
}

/* What a load cell between rod and load mass reads. */
static double cell_force(const double *y, Inputs in, const Mode *m, const Plant *c) {
    double x = y[X], load = x * (c->p.K_S + c->p.k_3 * x * x) + c->preload + in.force;
    double dv = m->d_R == 0.0 ? 0.0 : (rod_net(y, in, c) - rod_friction(y[V], m->d_R, c)) * c->per_mass;
    return load + c->p.m_L * dv;
}

/* Open loop over n samples; inputs are held over each, or joined by lines (first_order). */
int run(const double *parameters, double *y, double *mode, const double *current, const double *force, int n,
        int first_order, double dt, double tol, double *states_out, int8_t *modes_out, double *cell_out,
        double *extremes) {
    Plant c = {.p = *(const Parameters *)parameters};
    c.per_J_M = 1.0 / c.p.J_M, c.per_mass = 1.0 / (c.p.M + c.p.m_L);
    c.per_tau_FM = 1.0 / c.p.tau_FM, c.per_tau_FR = 1.0 / c.p.tau_FR;
    c.preload = c.p.F_pre + c.p.F_0;
    Mode m = {.d_M = mode[0], .d_R = mode[1]};
    Carry carry = {.h = dt, .first = true};
    double *low = extremes, *high = extremes + STATES;
    for (int i = 0; i < STATES; i++) low[i] = high[i] = y[i];
    int status = DONE;
    for (int k = 0; k < n && status == DONE; k++) {
        for (int i = 0; i < STATES; i++) states_out[k * STATES + i] = y[i];
        modes_out[2 * k] = (int8_t)m.d_M, modes_out[2 * k + 1] = (int8_t)m.d_R;
        cell_out[k] = cell_force(y, (Inputs){current[k], force[k]}, &m, &c);
        if (k + 1 == n) break;
        int to = first_order ? k + 1 : k;
        status = advance(y, &m, &carry, (Inputs){current[k], force[k]}, (Inputs){current[to], force[to]}, dt, tol, &c,
                         low, high);
        carry.first = false;
    }
    mode[0] = m.d_M, mode[1] = m.d_R;
    return status;
}
