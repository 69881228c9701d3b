/* Arithmetic on W doubles side by side, in GCC's and clang's vector types: any width on any processor.
   Sine and cosine are fdlibm's polynomials after a reduction by pi/2 in three parts, exact for angles below 1e6 rad, NaN beyond;
   v_exp, v_log and v_atan2 are good to 3 units of the last place, v_tanh to 14; v_exp is 0 below -708. What else libm has is called lane by lane. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if W == 1
typedef double V;
typedef int64_t I;
#define v_bits(x) ((union { V v; I i; }){.v = (x)}.i)
#define v_value(x) ((union { V v; I i; }){.i = (x)}.v)
#define v_mask(x) (-(I)(x))
#define v_lane(x, k) (x)
#define v_all(x) (x)
#define v_i(x) ((I)(x))
#else
typedef double V __attribute__((vector_size(8 * W), aligned(8)));
typedef int64_t I __attribute__((vector_size(8 * W), aligned(8)));
#define v_bits(x) ((I)(x))
#define v_value(x) ((V)(x))
#define v_mask(x) (x)
#define v_lane(x, k) ((x)[k])
#define v_all(x) ((V){} + (x))
#define v_i(x) ((I){} + (x))
#endif

/* 1 or 0; b or 0; a or b */
#define v_if(condition) v_value(v_mask(condition) & v_bits(v_all(1.0)))
#define v_where(condition, b) v_value(v_mask(condition) & v_bits(b))
static inline V v_select(I mask, V a, V b) { return v_value((mask & v_bits(a)) | (~mask & v_bits(b))); }

static inline V v_fabs(V x) { return v_value(v_bits(x) & v_i(INT64_MAX)); }
static inline V v_copysign(V x, V s) { return v_value((v_bits(x) & v_i(INT64_MAX)) | (v_bits(s) & v_i(INT64_MIN))); }
/* NaN where one is NaN, as NumPy's minimum and maximum, and unlike C's fmin and fmax */
static inline V v_fmin(V a, V b) { return v_select(v_mask(a < b) | v_mask(a != a), a, b); }
static inline V v_fmax(V a, V b) { return v_select(v_mask(a > b) | v_mask(a != a), a, b); }
static inline V v_sign(V x) { return v_select(v_mask(x == x), v_if(x > v_all(0.0)) - v_if(x < v_all(0.0)), x); }

#if W == 1
static inline V v_sqrt(V x) { return sqrt(x); }
#else
static inline V v_sqrt(V x) { V r; for (int k = 0; k < W; k++) r[k] = sqrt(x[k]); return r; }
#endif

#define ROUND 6755399441055744.0 /* 1.5 * 2^52: adding it leaves a whole number in the last bits */

static inline void v_sincos(V x, V *s, V *c)
{
  const V t = x * 0.63661977236758134308 + ROUND, k = t - ROUND;
  const I quadrant = v_bits(t);
  V r = x - k * 1.57079632673412561417e+00;
  r = r - k * 6.07710050630396597660e-11;
  r = r - k * 2.02226624879595063154e-21;
  const V z = r * r;
  const V sine = r + r * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04
    + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))));
  const V cosine = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03
    + z * (2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09
    + z * -1.13596475577881948265e-11))))));
  const I odd = -(quadrant & v_i(1));
  const I minus_s = (quadrant & v_i(2)) << 62, minus_c = ((quadrant + v_i(1)) & v_i(2)) << 62;
  const I near = v_mask(v_fabs(x) < v_all(1e6)); /* beyond, it would be wild: better none */
  *s = v_select(near, v_value(v_bits(v_select(odd, cosine, sine)) ^ minus_s), v_all(NAN));
  *c = v_select(near, v_value(v_bits(v_select(odd, sine, cosine)) ^ minus_c), v_all(NAN));
}
static inline V v_sin(V x) { V s, c; v_sincos(x, &s, &c); return s; }
static inline V v_cos(V x) { V s, c; v_sincos(x, &s, &c); return c; }

static inline V v_exp(V x)
{
  /* beyond, the result is 0 or infinite */
  const V y = v_select(v_mask(x > v_all(710.0)), v_all(710.0), v_select(v_mask(x < v_all(-709.0)), v_all(-709.0), x));
  const V t = y * 1.44269504088896338700 + ROUND, k = t - ROUND;
  V r = y - k * 6.93147180369123816490e-01;
  r = r - k * 1.90821492927058770002e-10;
  const V p = 1.0 + r * (1.0 + r * (1.0 / 2 + r * (1.0 / 6 + r * (1.0 / 24 + r * (1.0 / 120 + r * (1.0 / 720 + r * (1.0 / 5040
    + r * (1.0 / 40320 + r * (1.0 / 362880 + r * (1.0 / 3628800 + r * (1.0 / 39916800 + r * (1.0 / 479001600))))))))))));
  const I half = (v_bits(t) << 32) >> 33, rest = ((v_bits(t) << 32) >> 32) - half; /* 2^k in two steps: k may be 1024 */
  const V whole = p * v_value((half + v_i(1023)) << 52) * v_value((rest + v_i(1023)) << 52);
  return v_select(v_mask(x > v_all(709.782712893383973096)), v_all(INFINITY),
    v_select(v_mask(x < v_all(-708.0)), v_all(0.0), v_select(v_mask(x == x), whole, x)));
}

/* fdlibm's, for x > 0; else -infinity for 0, and NaN */
static inline V v_log(V number)
{
  const I tiny = v_mask(number < v_all(0x1p-1022)); /* subnormal */
  const V x = v_select(tiny, number * 0x1p54, number);
  const I above = v_bits(x) - v_i(0x3fe6a09e667f3bcdLL); /* the square root of 1/2: the mantissa is taken from there on */
  const I power = above >> 52;
  const V m = v_value(v_bits(x) - (power << 52)), f = m - 1.0, s = f / (2.0 + f), z = s * s;
  const V k = v_value((power + v_i(0x4338000000000000LL))) - ROUND - v_where(tiny, v_all(54.0)); /* as a double */
  const V R = z * (6.666666666666735130e-01 + z * (3.999999999940941908e-01 + z * (2.857142874366239149e-01
    + z * (2.222219843214978396e-01 + z * (1.818357216161805012e-01 + z * (1.531383769920937332e-01
    + z * 1.479819860511658591e-01))))));
  const V h = 0.5 * f * f;
  const V y = k * 6.93147180369123816490e-01 - ((h - (s * (h + R) + k * 1.90821492927058770002e-10)) - f);
  return v_select(v_mask(x > v_all(0.0)), v_select(v_mask(x < v_all(INFINITY)), y, x),
    v_select(v_mask(x == v_all(0.0)), v_all(-INFINITY), v_all(NAN)));
}

#define ODD 0x9E3779B97F4A7C15ULL
static inline uint64_t mixed(uint64_t x)
{
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}

static inline V v_tanh(V x)
{
  const V a = v_fabs(x), z = x * x;
  const V small = x * (1.0 + z * (-1.0 / 3 + z * (2.0 / 15 + z * (-17.0 / 315 + z * (62.0 / 2835 + z * (-1382.0 / 155925
    + z * (21844.0 / 6081075 + z * (-929569.0 / 638512875))))))));
  const V large = 1.0 - 2.0 / (v_exp(a + a) + 1.0);
  return v_select(v_mask(a < v_all(0.1)), small, v_copysign(large, x));
}

/* Cephes' rational function on [0, 0.66], and on [0.66, 1] less pi/4; the rest by symmetry */
static inline V v_atan2(V y, V x)
{
  const V a = v_fabs(y), b = v_fabs(x), large = v_fmax(a, b), small = v_fmin(a, b);
  const V one = v_if(large > v_all(0.0)); /* infinite both, or zero both */
  const V q = v_select(v_mask(small == large), one, small / large);
  const I middle = v_mask(q > v_all(0.66)), steep = v_mask(a > b), back = v_mask(v_bits(x) < v_i(0));
  const V r = v_select(middle, (q - 1.0) / (q + 1.0), q), z = r * r;
  const V P = -6.485021904942025371773e+01 + z * (-1.228866684490136173410e+02 + z * (-7.500855792314704667340e+01
    + z * (-1.615753718733365076637e+01 + z * -8.750608600031904122785e-01)));
  const V Q = 1.945506571482613964425e+02 + z * (4.853903996359136964868e+02 + z * (4.328810604912902668951e+02
    + z * (1.650270098316988542046e+02 + z * (2.485846490142306297962e+01 + z))));
  V t = r + r * (z * P / Q);
  t = v_select(middle, 7.85398163397448309616e-01 + (t + 3.061616997868382943065e-17), t);
  t = v_select(steep, 1.57079632679489661923e+00 - (t - 6.123233995736765886130e-17), t);
  t = v_select(back, 3.14159265358979323846e+00 - (t - 1.224646799147353177226e-16), t);
  return v_select(v_mask(a == a) & v_mask(b == b), v_copysign(t, y), a + b);
}

#if W == 1
#define V_1(f) static inline V v_##f(V x) { return f(x); }
#define V_2(f) static inline V v_##f(V x, V y) { return f(x, y); }
#else
#define V_1(f) static inline V v_##f(V x) { V r; for (int k = 0; k < W; k++) r[k] = f(x[k]); return r; }
#define V_2(f) static inline V v_##f(V x, V y) { V r; for (int k = 0; k < W; k++) r[k] = f(x[k], y[k]); return r; }
#endif
V_1(tan) V_1(asin) V_1(acos) V_1(atan) V_1(sinh) V_1(cosh) V_1(asinh) V_1(acosh) V_1(atanh) V_1(erf) V_1(log1p)
V_1(expm1) V_1(floor) V_1(ceil) V_2(pow) V_2(fmod) V_2(hypot)

static inline int v_any(I mask)
{
#if W == 1
  return mask != 0;
#else
  int64_t any = 0;
  for (int k = 0; k < W; k++) any |= mask[k];
  return any != 0;
#endif
}
