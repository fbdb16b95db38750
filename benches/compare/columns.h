/* Eight runs in columns: a `real` is one number of each of eight runs, and + - * / act on all.
 *
 * GCC and Clang make of it what the processor has: one AVX-512 register, two of AVX2, four of SSE2.
 * Elementary functions are Taylor series on short intervals, good to a few units in the last place
 * on the arguments named; nothing else is handled.
 */
#include <stdint.h>
#ifdef __AVX__
#include <immintrin.h>
#endif

#define RUNS 8

/* Where a step is one long chain of operations, a kernel takes several blocks of eight in turn, so
   that the processor works on one while another's chain waits. */
#define EACH for (int q = 0; q < BLOCKS; q++)

typedef double real __attribute__((vector_size(8 * RUNS)));
typedef uint64_t word __attribute__((vector_size(8 * RUNS)));

/* Unaligned: rows of NumPy arrays. */
typedef double real_at __attribute__((vector_size(8 * RUNS), aligned(8), may_alias));
typedef uint64_t word_at __attribute__((vector_size(8 * RUNS), aligned(8), may_alias));

#define LOAD(p) (*(const real_at *)(p))
#define STORE(p, x) (*(real_at *)(p) = (x))
#define INLINE static inline __attribute__((always_inline))

INLINE real all(double x) { return x - (real){0}; }
INLINE real magnitude(real a) { return (real)((word)a & ~((word){0} + (1ull << 63))); }

/* yes where the mask (a comparison) holds, else no. */
INLINE real choose(word mask, real yes, real no) {
  return (real)(((word)yes & mask) | ((word)no & ~mask));
}

/* What GCC does not find by itself: one instruction each. */
#if defined __AVX512F__
INLINE real larger(real a, real b) { return (real)_mm512_max_pd((__m512d)a, (__m512d)b); }
INLINE real smaller(real a, real b) { return (real)_mm512_min_pd((__m512d)a, (__m512d)b); }
INLINE real root(real a) { return (real)_mm512_sqrt_pd((__m512d)a); }
#elif defined __AVX__
typedef union { real all; __m256d half[2]; } halves;
#define BY_HALVES(function, ...) \
  for (int i = 0; i < 2; i++) c.half[i] = function(__VA_ARGS__)
INLINE real larger(real a, real b) {
  halves p = {a}, q = {b}, c;
  BY_HALVES(_mm256_max_pd, p.half[i], q.half[i]);
  return c.all;
}
INLINE real smaller(real a, real b) {
  halves p = {a}, q = {b}, c;
  BY_HALVES(_mm256_min_pd, p.half[i], q.half[i]);
  return c.all;
}
INLINE real root(real a) {
  halves p = {a}, c;
  BY_HALVES(_mm256_sqrt_pd, p.half[i]);
  return c.all;
}
#else
INLINE real larger(real a, real b) { return choose((word)(a > b), a, b); }
INLINE real smaller(real a, real b) { return choose((word)(a < b), a, b); }
INLINE real root(real a) {
  for (int i = 0; i < RUNS; i++) a[i] = __builtin_sqrt(a[i]);
  return a;
}
#endif

/* Whole numbers below 2^53 as doubles. */
INLINE real number(word n) {
#ifdef __AVX512DQ__
  return __builtin_convertvector(n, real);
#else
  real high = (real)((n >> 32) | 0x4530000000000000ull);        /* 2^84 + 2^32 (n >> 32) */
  real low = (real)((n & 0xFFFFFFFFull) | 0x4330000000000000ull); /* 2^52 + n mod 2^32 */
  return (high - 0x1.00000001p84) + low;
#endif
}

/* The generator xoshiro256++ of Blackman and Vigna, one stream a run. */
typedef struct { word s[4]; } stream;

INLINE stream stream_of(const uint64_t *words, int64_t runs, int64_t run) {
  stream g;
  for (int j = 0; j < 4; j++) g.s[j] = *(const word_at *)(words + j * runs + run);
  return g;
}
INLINE word turned(word x, int by) { return (x << by) | (x >> (64 - by)); }
INLINE word bits(stream *g) { /* the highest 53 of the next 64 */
  word *s = g->s, result = turned(s[0] + s[3], 23) + s[0], t = s[1] << 17;
  s[2] ^= s[0], s[3] ^= s[1], s[1] ^= s[2], s[0] ^= s[3], s[2] ^= t, s[3] = turned(s[3], 45);
  return result >> 11;
}
INLINE real uniform(stream *g) { return number(bits(g)) * 0x1p-53; } /* [0, 1) */

/* Taylor series: sin(x)/x and cos(x) in x^2, exp(x) in x, 2 artanh(x)/x and atan(x)/x in x^2. */
static const double SINE[] = {
  1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0,
  1.0 / 362880.0, -1.0 / 39916800.0, 1.0 / 6227020800.0, -1.0 / 1307674368000.0,
  1.0 / 355687428096000.0, -1.0 / 121645100408832000.0, 1.0 / 51090942171709440000.0};
static const double COSINE[] = {
  1.0, -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0,
  1.0 / 40320.0, -1.0 / 3628800.0, 1.0 / 479001600.0, -1.0 / 87178291200.0,
  1.0 / 20922789888000.0, -1.0 / 6402373705728000.0};
static const double EXPONENTIAL[] = {
  1.0, 1.0 / 1.0, 1.0 / 2.0, 1.0 / 6.0,
  1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0,
  1.0 / 40320.0, 1.0 / 362880.0, 1.0 / 3628800.0, 1.0 / 39916800.0,
  1.0 / 479001600.0, 1.0 / 6227020800.0};
static const double LOGARITHM[] = {
  2.0, 2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0,
  2.0 / 9.0, 2.0 / 11.0, 2.0 / 13.0, 2.0 / 15.0,
  2.0 / 17.0, 2.0 / 19.0, 2.0 / 21.0};
static const double ARCTANGENT[] = {
  1.0, -1.0 / 3.0, 1.0 / 5.0, -1.0 / 7.0,
  1.0 / 9.0, -1.0 / 11.0, 1.0 / 13.0, -1.0 / 15.0,
  1.0 / 17.0, -1.0 / 19.0, 1.0 / 21.0, -1.0 / 23.0,
  1.0 / 25.0, -1.0 / 27.0};

/* Estrin's scheme: pairs, pairs of pairs, ... so that no sum waits long for another. */
INLINE real sum_of(const double *series, int terms, real x) {
  real part[16];
#pragma GCC unroll 16
  for (int i = 0; i < 16; i++) part[i] = all(i < terms ? series[i] : 0.0);
#pragma GCC unroll 4
  for (int left = terms; left > 1; left = (left + 1) / 2, x *= x) {
#pragma GCC unroll 16
    for (int i = 0; i < left / 2; i++) part[i] = part[2 * i] + part[2 * i + 1] * x;
    if (left & 1) part[left / 2] = part[left - 1];
  }
  return part[0];
}

/* ln x, x > 0 and normal: x = 2^k (1 + f), 1/sqrt 2 <= 1 + f < sqrt 2, 2 artanh(f/(2 + f)). */
INLINE real ln(real x) {
  word lifted = (word)x + (0x3FF0000000000000ull - 0x3FE6A09E667F3BCDull);
  real k = (real)(0x4330000000000000ull | (lifted >> 52)) - (0x1p52 + 1023.0);
  real f = (real)((lifted & 0x000FFFFFFFFFFFFFull) + 0x3FE6A09E667F3BCDull) - 1.0;
  real s = f / (f + 2.0);
  return k * 0x1.62e42fefa39efp-1 + s * sum_of(LOGARITHM, 11, s * s);
}

/* exp x, |x| < 700: x = n ln 2 + r. */
INLINE real exponential(real x) {
  real shifted = x * 0x1.71547652b82fep0 + 0x1.8p52, n = shifted - 0x1.8p52;
  real r = (x - n * 0x1.62e42fee00000p-1) - n * 0x1.a39ef35793c76p-33;
  return sum_of(EXPONENTIAL, 14, r) * (real)(((word)shifted << 52) + 0x3FF0000000000000ull);
}

/* sin x, |x| <= pi/2. */
INLINE real sine_near(real x) { return x * sum_of(SINE, 11, x * x); }

/* sin x and cos x, |x| < 1e5: the nearest multiple of pi/2 is taken off. */
INLINE void turn(real x, real *sine, real *cosine) {
  real shifted = x * 0x1.45f306dc9c883p-1 + 0x1.8p52, n = shifted - 0x1.8p52;
  real r = (x - n * 0x1.921fb54400000p0) - n * 0x1.0b4611a626331p-34, z = r * r;
  real s = r * sum_of(SINE, 9, z), c = sum_of(COSINE, 10, z);
  word quarter = (word)shifted, odd = -(quarter & 1);
  *sine = (real)((word)choose(odd, c, s) ^ ((quarter >> 1) << 63));
  *cosine = (real)((word)choose(odd, s, c) ^ (((quarter + 1) >> 1) << 63));
}

/* atan(top/bottom), bottom not 0: the ratio or its inverse, less 0, 1/2 or 1 by the addition
   theorem. */
INLINE real arctangent(real top, real bottom) {
  word sign = ((word)top ^ (word)bottom) & (1ull << 63);
  real a = magnitude(top), b = magnitude(bottom);
  word inverted = (word)(a > b);
  real p = choose(inverted, b, a), q = choose(inverted, a, b);
  word high = (word)(p > 0.75 * q), middle = (word)(p > 0.25 * q);
  real c = choose(high, all(1.0), choose(middle, all(0.5), all(0.0)));
  real at_c = choose(middle, all(0x1.dac670561bb4fp-2), all(0.0));
  at_c = choose(high, all(0x1.921fb54442d18p-1), at_c);
  real s = (p - c * q) / (q + c * p);
  real angle = at_c + s * sum_of(ARCTANGENT, 14, s * s);
  return (real)((word)choose(inverted, 0x1.921fb54442d18p0 - angle, angle) ^ sign);
}

/* A standard normal value, Box and Muller: cos(2 pi u) = -sin(2 pi (1/4 - |u - 1/2|)). */
INLINE real normal(stream *g) {
  real u1 = number(bits(g) + 1) * 0x1p-53, u2 = uniform(g);
  real angle = 0x1.921fb54442d18p2 * (magnitude(u2 - 0.5) - 0.25);
  return root(-2.0 * ln(u1)) * sine_near(angle);
}
