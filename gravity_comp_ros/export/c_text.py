"""Templates of the exported C header and source; `@NAME@` are the places of a model's texts."""

HEADER = """\
/*
 * Gravity torque of a robot arm, written by gravity_comp_ros @VERSION@.
 *
 * A wrong torque accelerates an arm, and zero torque drops it. Limit the torque and its rate of
 * change in the controller, and do not send the torque of a pose far outside the trained range
 * (gc_distance). This code is not a safety function.
 *
 * Formulation: @FORMULATION@.  SHA-256 of the model: @SHA256@
 *
 * Joints, in the order of all arrays, with their trained range:
@JOINT_LIST@
 *
 * Effects in gc_static and gc_friction:
@EFFECT_LIST@
 * Effects of the model that are left out:
@LEFT_OUT@
 *
 * Units: angles in rad, speeds in rad/s, torques in N m. A pose that is not finite gives a torque
 * that is not finite. The functions allocate nothing and use no lock. gc_set_parameters writes
 * the numbers that the others read: call it from the same thread.
 *
 * C99 and C++. Define GC_REAL=float for single precision, in this file's users too.
 */
#ifndef GC_GRAVITY_H
#define GC_GRAVITY_H

#ifdef __cplusplus
extern "C" {
#endif

#define GC_VERSION "@VERSION@"
#define GC_MODEL_SHA256 "@SHA256@"
/* Number of joints; number of parameters, and checksum of their labels. */
#define GC_N @N@
#define GC_N_PARAMETERS @COUNT@
#define GC_LAYOUT @LAYOUT@u

#ifndef GC_REAL
#define GC_REAL double
#endif
typedef GC_REAL gc_real;

/* Results of gc_set_parameters. */
enum gc_result {
    GC_OK = 0,
    GC_WRONG_COUNT = 1,
    GC_WRONG_LAYOUT = 2,
    GC_NOT_FINITE = 3,
    GC_EMPTY_RANGE = 4,
    GC_NOT_POSITIVE = 5,
    GC_NOT_A_ROTATION = 6
};

/* Names of the joints. */
extern const char *const gc_joints[GC_N];

/* Set tau (N m) to the gravity torque at the pose q (rad). */
void gc_gravity(const gc_real q[GC_N], gc_real tau[GC_N]);

/* Set tau (N m) to gravity and the static effects of the model at the pose q (rad). */
void gc_static(const gc_real q[GC_N], gc_real tau[GC_N]);

/*
 * Set tau (N m) to the friction at the pose q (rad) and the speeds qd (rad/s); 0 if the model has
 * none. The pose matters for friction that depends on the load. The direction of motion follows
 * the speed alone. The sign of a noisy speed can make an arm vibrate: send a part of it.
 */
void gc_friction(const gc_real q[GC_N], const gc_real qd[GC_N], gc_real tau[GC_N]);

/* Return the largest distance (rad) of a joint from its trained range; NaN for a NaN in q. */
gc_real gc_distance(const gc_real q[GC_N]);

/*
 * Replace all numbers of the model, in the order of the source file, and return GC_OK. Refused
 * numbers change nothing. `layout` is that of the sender and must be GC_LAYOUT.
 */
enum gc_result gc_set_parameters(const double *values, unsigned int count, unsigned int layout);

#ifdef __cplusplus
}
#endif

#endif
"""

SOURCE = """\
/* Written by gravity_comp_ros @VERSION@; see the header. */
#include "@HEADER@"

#include <math.h>

#if GC_LAYOUT != @LAYOUT@u || GC_N_PARAMETERS != @COUNT@
#error "header and source are of different models"
#endif

#define GC_C(x) ((gc_real)(x))
/* A function of the C library in the precision of gc_real; the size is a constant. */
#define GC_CALL(single, f, x) (sizeof(gc_real) == sizeof(float) ? (gc_real)single((float)(x)) \\
                               : (gc_real)f((double)(x)))
#define GC_SIN(x) GC_CALL(sinf, sin, x)
#define GC_COS(x) GC_CALL(cosf, cos, x)
#define GC_TANH(x) GC_CALL(tanhf, tanh, x)
#define GC_EXP(x) GC_CALL(expf, exp, x)
#define GC_FABS(x) GC_CALL(fabsf, fabs, x)
#define GC_POW(x, y) (sizeof(gc_real) == sizeof(float) \\
                      ? (gc_real)powf((float)(x), (float)(y)) \\
                      : (gc_real)pow((double)(x), (double)(y)))

const char *const gc_joints[GC_N] = {@NAMES@};

/* The numbers of the model, with index and meaning. */
static gc_real gc_p[GC_N_PARAMETERS] = {
@VALUES@
};

@HELPERS@
/* Set s, c and tau to sines and cosines of the pose and to the gravity torque. */
static void gc_at(const gc_real q[GC_N], gc_real s[GC_N], gc_real c[GC_N], gc_real tau[GC_N])
{
    int k;
    for (k = 0; k < GC_N; ++k) {
        s[k] = GC_SIN(q[k]);
        c[k] = GC_COS(q[k]);
        tau[k] = GC_C(0.0);
    }
    {
@GRAVITY@
    }
}

void gc_gravity(const gc_real q[GC_N], gc_real tau[GC_N])
{
    gc_real s[GC_N], c[GC_N];
    gc_at(q, s, c, tau);
}

void gc_static(const gc_real q[GC_N], gc_real tau[GC_N])
{
    gc_real s[GC_N], c[GC_N], g[GC_N];
    int i;
    gc_at(q, s, c, g);
    for (i = 0; i < GC_N; ++i) tau[i] = g[i];
@STATIC@
}

void gc_friction(const gc_real q[GC_N], const gc_real qd[GC_N], gc_real tau[GC_N])
{
    gc_real g[GC_N];
    int i;
    for (i = 0; i < GC_N; ++i) tau[i] = g[i] = GC_C(0.0);
    (void)q;
    (void)qd;
    (void)g;
@FRICTION@
}

gc_real gc_distance(const gc_real q[GC_N])
{
    gc_real largest = GC_C(0.0);
    int i;
    for (i = 0; i < GC_N; ++i) {
        const gc_real below = gc_p[i] - q[i];
        const gc_real above = q[i] - gc_p[GC_N + i];
        if (below != below) return below;
        if (below > largest) largest = below;
        if (above > largest) largest = above;
    }
    return largest;
}

enum gc_result gc_set_parameters(const double *values, unsigned int count, unsigned int layout)
{
    unsigned int i;
    if (count != GC_N_PARAMETERS) return GC_WRONG_COUNT;
    if (layout != GC_LAYOUT) return GC_WRONG_LAYOUT;
    for (i = 0; i < GC_N_PARAMETERS; ++i) {
        const double zero = values[i] - values[i];
        if (!(zero >= 0.0)) return GC_NOT_FINITE;
    }
    for (i = 0; i < GC_N; ++i)
        if (values[i] > values[GC_N + i]) return GC_EMPTY_RANGE;
@CHECKS@
    for (i = 0; i < GC_N_PARAMETERS; ++i) gc_p[i] = (gc_real)values[i];
    return GC_OK;
}
"""

CHECK_ROTATIONS = """\
    for (i = 0; i < GC_N; ++i) {
        const double *r = values + @A@ + 9 * i;
        int j, k;
        /* Each row has length 1, and the rows are a right-handed system. */
        for (j = 0; j < 3; ++j) {
            const double *a = r + 3 * j, *b = r + 3 * ((j + 1) % 3), *d = r + 3 * ((j + 2) % 3);
            for (k = 0; k < 3; ++k) {
                const int m = (k + 1) % 3, n = (k + 2) % 3;
                const double error = a[m] * b[n] - a[n] * b[m] - d[k];
                if (error > 1e-6 || error < -1e-6) return GC_NOT_A_ROTATION;
            }
            {
                const double length = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
                if (length > 1.0 + 1e-6 || length < 1.0 - 1e-6) return GC_NOT_A_ROTATION;
            }
        }
    }"""

# Functions of the effects, by name; only those that are called are written.
FUNCTIONS = {
    'gc_ramp': """\
static gc_real gc_ramp(gc_real x)
{
    return x > GC_C(1.0) ? GC_C(1.0) : x < GC_C(-1.0) ? GC_C(-1.0) : x;
}
""",
    'gc_beyond': """\
static gc_real gc_beyond(gc_real q, gc_real start, gc_real side)
{
    const gc_real beyond = side * (q - start);
    return beyond <= GC_C(0.0) ? GC_C(0.0) : side * beyond;
}
""",
    'gc_hardening': """\
static gc_real gc_hardening(gc_real stretch, gc_real half, gc_real order, gc_real part)
{
    const gc_real one = GC_C(1.0);

    return stretch * (one - part + part * GC_POW(GC_FABS(stretch) / half, order - one));
}
""",
    'gc_square': """\
static gc_real gc_square(gc_real x)
{
    return x * x;
}
"""}
