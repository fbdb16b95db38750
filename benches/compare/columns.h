/* A block of runs in columns: a `real` is one number of each of `RUNS` runs, and + - * / act on all.
 *
 * A block fills one register of the widest instructions that the compiler may use. Elementary
 * functions are polynomials on short intervals, good to a few units in the last place on the
 * arguments named; nothing else is handled.
 */
#include <stdint.h>
#ifdef __SSE2__
#include <immintrin.h>
#endif

#if defined __AVX512F__
#define RUNS 8
#define WIDE(function) _mm512_##function
#elif defined __AVX__
#define RUNS 4
#define WIDE(function) _mm256_##function
#else
#define RUNS 2
#define WIDE(function) _mm_##function
#endif

/* A step is a long chain of operations: a kernel takes `BLOCKS` blocks in turn, so that the processor
   works on one while another's chain waits. */
#define EACH _Pragma("GCC unroll 8") for (int q = 0; q < BLOCKS; q++)

typedef double real __attribute__((vector_size(8 * RUNS)));
typedef uint64_t word __attribute__((vector_size(8 * RUNS)));

/* Unaligned: rows of NumPy arrays. */
typedef double real_at __attribute__((vector_size(8 * RUNS), aligned(8), may_alias));
typedef uint64_t word_at __attribute__((vector_size(8 * RUNS), aligned(8), may_alias));

#define LOAD(p) (*(const real_at *)(p))
#define STORE(p, x) (*(real_at *)(p) = (x))

/* Row i of an array (n, runs), at block q of the runs from `run` on. What a run starts from is read
   from such an array: of starts that it knows GCC sees that they are alike, and moves one block for
   all. */
#define AT(array, i) ((array) + (i) * runs + run + RUNS * q)
#define INLINE static inline __attribute__((always_inline))

INLINE real all(double x) { return x - (real){0}; }
INLINE real magnitude(real a) { return (real)((word)a & ~((word){0} + (1ull << 63))); }

/* yes where the mask (a comparison) holds, else no. */
INLINE real choose(word mask, real yes, real no) {
  return (real)(((word)yes & mask) | ((word)no & ~mask));
}

/* What GCC does not find by itself: one instruction each. */
#ifdef __SSE2__
INLINE real larger(real a, real b) { return WIDE(max_pd)(a, b); }
INLINE real smaller(real a, real b) { return WIDE(min_pd)(a, b); }
INLINE real root(real a) { return WIDE(sqrt_pd)(a); }
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
  word below = n & 0xFFFFFFFFull;
#ifdef __AVX2__
  below = (word)_mm256_blend_epi32((__m256i)n, _mm256_setzero_si256(), 0xAA);
#endif
  real high = (real)((n >> 32) | 0x4530000000000000ull); /* 2^84 + 2^32 (n >> 32) */
  real low = (real)(below | 0x4330000000000000ull);      /* 2^52 + n mod 2^32 */
  return (high - 0x1.00000001p84) + low;
#endif
}

/* The generator xoshiro256++ of Blackman and Vigna, one stream a run. */
typedef struct { word s[4]; } stream;

INLINE stream stream_of(const uint64_t *words, int64_t runs) { /* the first of (4, runs) */
  stream g;
  for (int j = 0; j < 4; j++) g.s[j] = *(const word_at *)(words + j * runs);
  return g;
}
INLINE word turned(word x, int by) { return (x << by) | (x >> (64 - by)); }
INLINE word bits(stream *g) { /* the highest 53 of the next 64 */
  word *s = g->s, result = turned(s[0] + s[3], 23) + s[0], t = s[1] << 17;
  s[2] ^= s[0], s[3] ^= s[1], s[1] ^= s[2], s[0] ^= s[3], s[2] ^= t, s[3] = turned(s[3], 45);
  return result >> 11;
}
INLINE real uniform(stream *g) { return number(bits(g)) * 0x1p-53; } /* [0, 1) */

/* Chebyshev's polynomials of sin(x)/x up to pi/2 and to pi/4, cos(x), 2 artanh(x)/x and atan(x)/x
   in x^2, of exp(x) in x: mpmath.chebyfit(f, interval, terms), relative errors below 2^-54. */
static const double SINE_FAR[] = {
  0x1.0000000000000p+0, -0x1.5555555555555p-3, 0x1.11111111110bcp-7,
  -0x1.a01a01a0147f4p-13, 0x1.71de3a528d19bp-19, -0x1.ae6454d07634cp-26,
  0x1.6123ccd99b00cp-33, -0x1.ae439ef902726p-41, 0x1.883864938575ap-49};
static const double SINE[] = {
  0x1.0000000000000p+0, -0x1.5555555555543p-3, 0x1.111111110f3dcp-7,
  -0x1.a01a019ba956dp-13, 0x1.71de3530aa14dp-19, -0x1.ae5e37e850d20p-26,
  0x1.5d87699eb6a31p-33};
static const double COSINE[] = {
  0x1.0000000000000p+0, -0x1.0000000000000p-1, 0x1.5555555555536p-5,
  -0x1.6c16c16c13a05p-10, 0x1.a01a019b1e24dp-16, -0x1.27e4f727f10b7p-22,
  0x1.1ee96d0192650p-29, -0x1.8f762711e61e0p-37};
static const double EXPONENTIAL[] = {
  0x1.0000000000000p+0, 0x1.0000000000000p+0, 0x1.0000000000011p-1,
  0x1.555555555555ap-3, 0x1.555555554f0cfp-5, 0x1.111111110f225p-7,
  0x1.6c16c187fbe02p-10, 0x1.a01a01b14378fp-13, 0x1.a01991ac8730ap-16,
  0x1.71ddf5749d126p-19, 0x1.28b4057f44145p-22, 0x1.af631d0059becp-26};
static const double LOGARITHM[] = {
  0x1.0000000000000p+1, 0x1.55555555555aep-1, 0x1.999999997aeaap-2,
  0x1.2492494513f76p-2, 0x1.c71c50004ffddp-3, 0x1.7466994f20a7cp-3,
  0x1.3999bf614de60p-3, 0x1.2f4d88c4fad06p-3};
static const double ARCTANGENT[] = {
  0x1.0000000000000p+0, -0x1.5555555555481p-2, 0x1.999999996d307p-3,
  -0x1.24924907fa636p-3, 0x1.c71c5f4b9c2adp-4, -0x1.7459b99bfc19bp-4,
  0x1.3ab708d770276p-4, -0x1.0b3340fe2ed9ap-4, 0x1.78be0a9b1dd1fp-5};

/* Horner's scheme, which takes the fewest operations; one term of all blocks after the other. */
#define SUM_OF(series, x, sum) sum_of(series, sizeof series / sizeof *series, x, sum)
INLINE void sum_of(const double *series, int terms, const real x[BLOCKS], real sum[BLOCKS]) {
  EACH sum[q] = all(series[terms - 1]);
#pragma GCC unroll 16
  for (int i = terms - 2; i >= 0; i--) EACH sum[q] = series[i] + sum[q] * x[q];
}

/* ln x, x > 0 and normal: x = 2^k (1 + f), 1/sqrt 2 <= 1 + f < sqrt 2, 2 artanh(f/(2 + f)). */
INLINE void ln(const real x[BLOCKS], real y[BLOCKS]) {
  real k[BLOCKS], s[BLOCKS], z[BLOCKS];
  EACH {
    word lifted = (word)x[q] + (0x3FF0000000000000ull - 0x3FE6A09E667F3BCDull);
    k[q] = (real)(0x4330000000000000ull | (lifted >> 52)) - (0x1p52 + 1023.0);
    real f = (real)((lifted & 0x000FFFFFFFFFFFFFull) + 0x3FE6A09E667F3BCDull) - 1.0;
    s[q] = f / (f + 2.0);
  }
  EACH z[q] = s[q] * s[q];
  SUM_OF(LOGARITHM, z, y);
  EACH y[q] = k[q] * 0x1.62e42fefa39efp-1 + s[q] * y[q];
}

/* exp x, |x| < 700: x = n ln 2 + r. */
INLINE void exponential(const real x[BLOCKS], real y[BLOCKS]) {
  real r[BLOCKS], power[BLOCKS];
  EACH {
    real shifted = x[q] * 0x1.71547652b82fep0 + 0x1.8p52, n = shifted - 0x1.8p52;
    r[q] = (x[q] - n * 0x1.62e42fee00000p-1) - n * 0x1.a39ef35793c76p-33;
    power[q] = (real)(((word)shifted << 52) + 0x3FF0000000000000ull);
  }
  SUM_OF(EXPONENTIAL, r, y);
  EACH y[q] *= power[q];
}

/* sin x and cos x, |x| < 1e5: the nearest multiple of pi/2 is taken off. */
INLINE void turn(const real x[BLOCKS], real sine[BLOCKS], real cosine[BLOCKS]) {
  real r[BLOCKS], z[BLOCKS], s[BLOCKS], c[BLOCKS];
  word quarter[BLOCKS];
  EACH {
    real shifted = x[q] * 0x1.45f306dc9c883p-1 + 0x1.8p52, n = shifted - 0x1.8p52;
    r[q] = (x[q] - n * 0x1.921fb54400000p0) - n * 0x1.0b4611a626331p-34, z[q] = r[q] * r[q];
    quarter[q] = (word)shifted;
  }
  SUM_OF(SINE, z, s);
  SUM_OF(COSINE, z, c);
  EACH {
    word odd = -(quarter[q] & 1);
    s[q] *= r[q];
    sine[q] = (real)((word)choose(odd, c[q], s[q]) ^ ((quarter[q] >> 1) << 63));
    cosine[q] = (real)((word)choose(odd, s[q], c[q]) ^ (((quarter[q] + 1) >> 1) << 63));
  }
}

/* atan(top/bottom), bottom not 0: the ratio or its inverse, less 0, 1/2 or 1 by the addition
   theorem. */
INLINE void arctangent(const real top[BLOCKS], const real bottom[BLOCKS], real angle[BLOCKS]) {
  word sign[BLOCKS], inverted[BLOCKS];
  real at_c[BLOCKS], s[BLOCKS], z[BLOCKS];
  EACH {
    sign[q] = ((word)top[q] ^ (word)bottom[q]) & (1ull << 63);
    real a = magnitude(top[q]), b = magnitude(bottom[q]);
    inverted[q] = (word)(a > b);
    real p = smaller(a, b), r = larger(a, b);
    word high = (word)(p > 0.75 * r), middle = (word)(p > 0.25 * r);
    real c = choose(high, all(1.0), (real)((word)all(0.5) & middle));
    at_c[q] = (real)((word)all(0x1.dac670561bb4fp-2) & middle);
    at_c[q] = choose(high, all(0x1.921fb54442d18p-1), at_c[q]);
    s[q] = (p - c * r) / (r + c * p);
  }
  EACH z[q] = s[q] * s[q];
  SUM_OF(ARCTANGENT, z, angle);
  EACH {
    real found = at_c[q] + s[q] * angle[q];
    angle[q] = (real)((word)choose(inverted[q], 0x1.921fb54442d18p0 - found, found) ^ sign[q]);
  }
}

/* A standard normal value, Box and Muller: cos(2 pi u) = -sin(2 pi (1/4 - |u - 1/2|)). */
INLINE void normal(stream g[BLOCKS], real value[BLOCKS]) {
  real u1[BLOCKS], angle[BLOCKS], z[BLOCKS], sine[BLOCKS];
  EACH {
    u1[q] = number(bits(&g[q]) + 1) * 0x1p-53;
    angle[q] = 0x1.921fb54442d18p2 * (magnitude(uniform(&g[q]) - 0.5) - 0.25);
    z[q] = angle[q] * angle[q];
  }
  ln(u1, value);
  SUM_OF(SINE_FAR, z, sine);
  EACH value[q] = root(-2.0 * value[q]) * (angle[q] * sine[q]);
}
