// Elementary functions that a compiler turns into vector instructions.
//
// Single precision: sin and cos within 1e-7 of the exact value while the angle is below 1e4 (the
// _d forms reduce a double first and stay as exact to 1e9); tanh within 4e-7; tan within
// 1e-6 of the result where that is below 15; exp and log within
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
// The angle less its whole half turns, and the sign bit of these where they are odd.  A number added
// that leaves no digits behind the point rounds, and shows in its last bit what is odd.
INLINE float near_f(float x, int32_t *odd) {
    Bits turned;
    turned.f = x * 0.318309886f + 12582912.0f;
    const float n = turned.f - 12582912.0f;
    *odd = (int32_t)((uint32_t)turned.i << 31);
    return ((x - n * 3.140625f) - n * 9.67502593994140625e-4f) - n * 1.509957990978376e-7f;
}
INLINE float near_d(double x, int32_t *odd) {
    const double n = (x * 0.31830988618379067 + 6755399441055744.0) - 6755399441055744.0;
    *odd = (int32_t)((uint32_t)(int32_t)n << 31);
    return (float)(x - n * 3.141592653589793);
}
INLINE float turned(float value, int32_t odd) {
    Bits x;
    x.f = value;
    x.i ^= odd;
    return x.f;
}
INLINE float sin_f(float x) { int32_t o; float r = near_f(x, &o); return turned(sin_near(r), o); }
INLINE float cos_f(float x) { int32_t o; float r = near_f(x, &o); return turned(cos_near(r), o); }
INLINE float tan_f(float x) { int32_t o; float r = near_f(x, &o); return sin_near(r) / cos_near(r); }
INLINE float sin_d(double x) { int32_t o; float r = near_d(x, &o); return turned(sin_near(r), o); }
INLINE float cos_d(double x) { int32_t o; float r = near_d(x, &o); return turned(cos_near(r), o); }

// Rational approximation by weighted least squares, terms in pairs: they are waited for less.
INLINE float tanh_f(float a) {
    const float x = max_f(min_f(a, 8.4f), -8.4f), z = x * x, w = z * z;
    const float above = x * ((0.999999952f + z * 0.13412701f) + w * ((0.0035335779f
        + z * 2.12520535e-05f) + w * 1.42882167e-08f));
    const float below = (1.0f + z * 0.467460146f) + w * ((0.0260205264f
        + z * 0.000334848471f) + w * 8.14905189e-07f);
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
