// Elementary functions that a compiler turns into vector instructions.
//
// Single precision: sin and cos within 1e-7 of the exact value while the angle is below 1e4 (the
// _d forms reduce a double first and stay as exact to 1e9); tanh within 3e-7; exp and log within
// 2e-7 of the result, log within 2e-7 where the result is below 1.
#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__clang__)
#define EVERY_LANE _Pragma("clang loop vectorize(enable)")
#else
#define EVERY_LANE _Pragma("GCC ivdep")
#endif
#define INLINE static inline __attribute__((always_inline, unused))

// Of numbers that are the same for all robots.
#define sin_u sin
#define cos_u cos
#define tan_u tan
#define tanh_u tanh
#define exp_u exp
#define log_u log
#define sqrt_u sqrt
#define abs_u fabs
#define floor_u floor
#define sqrt_d sqrt
#define abs_d fabs
#define floor_d floor
#define sqrt_f sqrtf
#define abs_f fabsf
#define floor_f floorf

#define PAIR(kind, type)                                                             \
    INLINE type min_##kind(type a, type b) { return a < b ? a : b; }                 \
    INLINE type max_##kind(type a, type b) { return a > b ? a : b; }                 \
    INLINE type sign_##kind(type a) { return (type)((a > 0) - (a < 0)); }
PAIR(f, float)
PAIR(d, double)
PAIR(u, double)

typedef union { float f; int32_t i; } Bits;

// r in [-pi/2, pi/2]
INLINE float sin_near(float r) {
    const float z = r * r;
    return r + r * z * (-0.16666666f + z * (0.00833324231f + z * (-0.000198227576f
        + z * 2.63480338e-06f)));
}
INLINE float cos_near(float r) {
    const float z = r * r;
    return 1.0f + z * (-0.5f + z * (0.0416666594f + z * (-0.00138886519f
        + z * (2.47745957e-05f + z * -2.62978233e-07f))));
}
// The angle less its whole half turns, and 1 or -1 for an even or odd number of these.
INLINE float near_f(float x, float *side) {
    const float n = rintf(x * 0.318309886f), half = 0.5f * n;
    *side = 1.0f - 4.0f * (half - floorf(half));
    return ((x - n * 3.140625f) - n * 9.67502593994140625e-4f) - n * 1.509957990978376e-7f;
}
INLINE float near_d(double x, float *side) {
    const double n = rint(x * 0.31830988618379067), half = 0.5 * n;
    *side = (float)(1.0 - 4.0 * (half - floor(half)));
    return (float)(x - n * 3.141592653589793);
}
INLINE float sin_f(float x) { float s, r = near_f(x, &s); return s * sin_near(r); }
INLINE float cos_f(float x) { float s, r = near_f(x, &s); return s * cos_near(r); }
INLINE float tan_f(float x) { float s, r = near_f(x, &s); return sin_near(r) / cos_near(r); }
INLINE float sin_d(double x) { float s, r = near_d(x, &s); return s * sin_near(r); }
INLINE float cos_d(double x) { float s, r = near_d(x, &s); return s * cos_near(r); }

// Rational approximation, coefficients as in Eigen.
INLINE float tanh_f(float a) {
    const float x = max_f(min_f(a, 7.90531111f), -7.90531111f), z = x * x;
    const float above = x * (4.89352455891786e-03f + z * (6.37261928875436e-04f
        + z * (1.48572235717979e-05f + z * (5.12229709037114e-08f + z * (-8.60467152213735e-11f
        + z * (2.00018790482477e-13f + z * -2.76076847742355e-16f))))));
    const float below = 4.89352518554385e-03f + z * (2.26843463243900e-03f
        + z * (1.18534705686654e-04f + z * 1.19825839466702e-06f));
    return above / below;
}
INLINE float exp_f(float a) {
    const float x = max_f(min_f(a, 88.0f), -87.0f), n = rintf(x * 1.44269504f);
    const float r = (x - n * 0.693359375f) + n * 2.12194440e-4f;
    Bits scale;
    scale.i = ((int32_t)n + 127) << 23;
    return scale.f * (1.0f + (r + r * r * (0.5f + r * (0.16666577f + r * (0.041666465f
        + r * (0.00836318012f + r * 0.00139336474f))))));
}
// Of positive normal numbers; coefficients of Cephes.
INLINE float log_f(float a) {
    Bits x;
    x.f = a;
    const int32_t e = (x.i - 0x3f3504f3) >> 23;  // so that the rest is in [sqrt(1/2), sqrt(2))
    x.i -= e << 23;
    const float n = (float)e, r = x.f - 1.0f, z = r * r;
    const float tail = r * z * (3.3333331174e-1f + r * (-2.4999993993e-1f + r * (2.0000714765e-1f
        + r * (-1.6668057665e-1f + r * (1.4249322787e-1f + r * (-1.2420140846e-1f
        + r * (1.1676998740e-1f + r * (-1.1514610310e-1f + r * 7.0376836292e-2f))))))));
    return n * 0.693359375f + (r + (tail - 0.5f * z - n * 2.12194440e-4f));
}

// Numbers in [0, 1) of one generator for each robot: NumPy's own, by its interface for C
// (numpy/random/bitgen.h).  Pointers: robots, generators, result (numbers, robots).
typedef struct {
    void *state;
    uint64_t (*next_uint64)(void *);
    uint32_t (*next_uint32)(void *);
    double (*next_double)(void *);
    uint64_t (*next_raw)(void *);
} Generator;

void draw(void *const *p, const double *u, const long *z) {
    const int32_t *chosen = p[0];
    Generator *const *generators = p[1];
    double *result = p[2];
    (void)u;
    for (long i = 0; i < z[0]; i++) {
        const Generator *source = generators[chosen[i]];
        for (long k = 0; k < z[1]; k++) result[k * z[0] + i] = source->next_double(source->state);
    }
}
