/* Three-dimensional vectors, matrices and rotations: row-major, double precision, arithmetic only. */
#ifndef SPIDAR_MATH_H
#define SPIDAR_MATH_H

#include <math.h>
#include <string.h>

#include "spidar_constants.h"

/* A shared library links to the old symbols of exp, log and hypot, in every glibc since 2.17, with the same values. */
#if defined(SPIDAR_SHARED) && defined(__GLIBC__) && defined(__x86_64__)
__asm__(".symver exp,exp@GLIBC_2.2.5");
__asm__(".symver log,log@GLIBC_2.2.5");
__asm__(".symver hypot,hypot@GLIBC_2.2.5");
#elif defined(SPIDAR_SHARED) && defined(__GLIBC__) && defined(__aarch64__)
__asm__(".symver exp,exp@GLIBC_2.17");
__asm__(".symver log,log@GLIBC_2.17");
__asm__(".symver hypot,hypot@GLIBC_2.17");
#endif

#define SP_PI 3.14159265358979323846
#define SP_HALF_PI 1.57079632679489661923
#define SP_TWO_PI 6.28318530717958647692

static inline double sp_min(double a, double b) { return a < b ? a : b; }
static inline double sp_max(double a, double b) { return a > b ? a : b; }
/* `x` clipped to low … high. */
static inline double sp_clip(double x, double low, double high) { return x < low ? low : x > high ? high : x; }
/* 1 if every number is finite, else 0: infinities and NaN propagate through the sum. */
static inline int sp_finite(const double *x, int n)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++) sum += x[i] - x[i];
    return sum == 0.0;
}
static inline double sp_dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
/* Dot product a x of n numbers. */
static inline double sp_row(const double *a, const double *x, int n)
{
    double sum = 0.0;
    for (int k = 0; k < n; k++) sum += a[k] * x[k];
    return sum;
}
/* Largest absolute value of n numbers. */
static inline double sp_largest(const double *x, int n)
{
    double most = 0.0;
    for (int k = 0; k < n; k++) most = sp_max(most, fabs(x[k]));
    return most;
}
static inline double sp_norm(const double *a) { return sqrt(sp_dot(a, a)); }
static inline void sp_copy(double *to, const double *from, int n) { memcpy(to, from, (size_t)n * sizeof(double)); }
static inline void sp_zero(double *to, int n) { for (int i = 0; i < n; i++) to[i] = 0.0; }
static inline void sp_cross(const double *a, const double *b, double *c)
{
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    c[0] = x, c[1] = y, c[2] = z;
}
/* y = M x. */
static inline void sp_apply(const double *M, const double *x, double *y)
{
    double a = sp_dot(M, x), b = sp_dot(M + 3, x), c = sp_dot(M + 6, x);
    y[0] = a, y[1] = b, y[2] = c;
}
/* y = Mᵀ x. */
static inline void sp_apply_t(const double *M, const double *x, double *y)
{
    double a = M[0] * x[0] + M[3] * x[1] + M[6] * x[2];
    double b = M[1] * x[0] + M[4] * x[1] + M[7] * x[2];
    double c = M[2] * x[0] + M[5] * x[1] + M[8] * x[2];
    y[0] = a, y[1] = b, y[2] = c;
}
/* C = A B. */
static inline void sp_product(const double *A, const double *B, double *C)
{
    double D[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) D[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
    sp_copy(C, D, 9);
}
/* C = Aᵀ B. */
static inline void sp_product_t(const double *A, const double *B, double *C)
{
    double D[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) D[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
    sp_copy(C, D, 9);
}
static inline void sp_identity(double *R)
{
    sp_zero(R, 9);
    R[0] = R[4] = R[8] = 1.0;
}
/* Rotation by |v| about v (Rodrigues). */
static inline void sp_exp(const double *v, double *R)
{
    double angle = sp_norm(v), s = 1.0, c = 0.5, K[9] = {0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0}, KK[9];
    if (angle >= SP_SMALL_ANGLE) {
        s = sin(angle) / angle;
        c = (1.0 - cos(angle)) / (angle * angle);
    }
    sp_product(K, K, KK);
    sp_identity(R);
    for (int i = 0; i < 9; i++) R[i] += s * K[i] + c * KK[i];
}
/* Rotation vector of R, of length 0 … π; at π its first nonzero entry is positive. */
static inline void sp_log(const double *R, double *v)
{
    double x = 0.5 * (R[7] - R[5]), y = 0.5 * (R[2] - R[6]), z = 0.5 * (R[3] - R[1]);
    double sine = sqrt(x * x + y * y + z * z), cosine = 0.5 * (R[0] + R[4] + R[8] - 1.0), angle = atan2(sine, cosine);
    if (sine > SP_SMALL_SINE || cosine > 0.0) {
        double stretch = sine > SP_SMALL_SINE ? angle / sine : 1.0;
        v[0] = stretch * x, v[1] = stretch * y, v[2] = stretch * z;
        return;
    }
    /* Close to a half turn the skew part vanishes, and the symmetric part is 2 n nᵀ − 1. */
    int k = 0;
    for (int i = 1; i < 3; i++)
        if (R[4 * i] > R[4 * k]) k = i;
    double n[3], sign = 1.0;
    for (int i = 0; i < 3; i++) n[i] = 0.25 * (R[3 * i + k] + R[3 * k + i]) + (i == k ? 0.5 : 0.0);
    double length = sp_norm(n);
    for (int i = 0; i < 3; i++) n[i] /= length;
    if (sine > 0.0) {
        sign = n[0] * x + n[1] * y + n[2] * z < 0.0 ? -1.0 : 1.0;
    } else {
        for (int i = 0; i < 3; i++)
            if (n[i] != 0.0) {
                sign = n[i] < 0.0 ? -1.0 : 1.0;
                break;
            }
    }
    for (int i = 0; i < 3; i++) v[i] = sign * angle * n[i];
}
/* Rotation matrix of the quaternion (w, x, y, z); it need not be normalised. */
static inline void sp_from_quat(const double *quat, double *R)
{
    double w = quat[0], x = quat[1], y = quat[2], z = quat[3], s = 2.0 / (w * w + x * x + y * y + z * z);
    R[0] = 1.0 - s * (y * y + z * z), R[1] = s * (x * y - w * z), R[2] = s * (x * z + w * y);
    R[3] = s * (x * y + w * z), R[4] = 1.0 - s * (x * x + z * z), R[5] = s * (y * z - w * x);
    R[6] = s * (x * z - w * y), R[7] = s * (y * z + w * x), R[8] = 1.0 - s * (x * x + y * y);
}
/* Unit quaternion (w, x, y, z) with w ≥ 0. */
static inline void sp_to_quat(const double *R, double *quat)
{
    double a = R[0], b = R[1], c = R[2], d = R[3], e = R[4], f = R[5], g = R[6], h = R[7], i = R[8];
    double rows[4][4] = {
        {1.0 + a + e + i, h - f, c - g, d - b},
        {h - f, 1.0 + a - e - i, d + b, c + g},
        {c - g, d + b, 1.0 - a + e - i, h + f},
        {d - b, c + g, h + f, 1.0 - a - e + i},
    };
    int k = 0;
    for (int j = 1; j < 4; j++)
        if (rows[j][j] > rows[k][k]) k = j;
    double *q = rows[k], length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double sign = q[0] < 0.0 ? -1.0 : 1.0;
    for (int j = 0; j < 4; j++) quat[j] = sign * q[j] / length;
}

#endif
