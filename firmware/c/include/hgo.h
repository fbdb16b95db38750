/* hgo.h: high-gain observers for C11 and C++11. Link with libhgo.a and -Wl,--gc-sections.
 *
 * Written by firmware/c/header.py from firmware/c/src; do not edit.
 *
 * An observer estimates y and its derivatives, x_hat_1 = y, x_hat_2 = dy/dt and so on, from noisy
 * samples of y. A type is a law, an order n and a precision. For position and velocity in float:
 *
 *     static hgo_standard2_f32 observer;
 *     const hgo_standard_config_f32 config = {.k = {3.0f, 2.0f}, .ell = 50.0f, .dt_max = 0.02f};
 *     hgo_error error;
 *     int32_t status =
 *         hgo_standard2_f32_init(&observer, sizeof observer, HGO_VERSION, &config, &error);
 *
 * The model, d^n y/dt^n = phi, is evaluated by the caller from the estimate and the inputs and is
 * passed as a number; 0 makes a differentiator. There are two ways to use a state; use one of them
 * for each state.
 *
 * A control loop needs the present estimate. At every sample, for example in a timer interrupt,
 *
 *     hgo_standard2_f32_correct(&observer, y);              the present sample is used
 *     hgo_standard2_f32_estimate(&observer, x_hat, 2);      the present estimate
 *     u = control(x_hat);                                   compute the input and apply it
 *     phi = model(x_hat, u);                                under the input that is applied now
 *     hgo_standard2_f32_predict(&observer, phi, 0.001f);    over the period that begins
 *
 * phi and dt of predict belong to the period that begins, and so does the input within phi. Where
 * its length is not known beforehand (a callback), phi is kept, and predict is called at the
 * beginning of the next call, before correct, with the time that has passed.
 *
 * The papers' recursion is one call a sample, whose estimate is that of the next sample's time:
 *
 *     status = hgo_standard2_f32_step(&observer, y, phi, 0.001f);
 *     hgo_standard2_f32_estimate(&observer, x_hat, 2);
 *
 * phi and dt of step belong to the period from this sample to the next one; phi is computed from
 * the estimate before the step. An input that is computed from the estimate after it comes one
 * period too late for this phi: that is what correct and predict are for.
 *
 * The law is discretised by forward Euler (in Python: method="euler", with timing="current" for
 * correct and predict, timing="predictor" for step). Coefficients, gains and step limits come from
 * the Python package hgo_rs, see docs/from-python-to-your-board.md; the laws and their papers
 * stand in docs/ too. What is tied to one model (the sampled-data observer of a Van der Pol
 * oscillator, the reduced-order observer of a ship), collections and the other discretisations are
 * for Rust only.
 *
 * Every function returns a code: >= 0 is what became of the sample or the period, < 0 what was
 * refused, with no state changed. Nothing allocates, blocks, panics or calls another library, but
 * memcpy and its like. A state is the caller's and holds no pointer: it may be copied and moved.
 * One context at a time may use a state; different states are independent.
 *
 * Refused are NULL and unaligned pointers, states that are too small, never made or of another
 * type, and another version's header. A pointer that is wrong otherwise cannot be recognised. */

#ifndef HGO_H
#define HGO_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define HGO_ASSERT(holds) static_assert(holds, "the layout of hgo.h and of libhgo.a")
extern "C" {
#else
#define HGO_ASSERT(holds) _Static_assert(holds, "the layout of hgo.h and of libhgo.a")
#endif

/* Version of this header, for init. */
#define HGO_VERSION 2

/* Codes: what became of a sample or a period, and what a function refused. */
enum {
    /* what a function that takes no sample or time returns when it has done its work */
    HGO_OK = 0,
    /* done: the sample was used */
    HGO_UPDATED = 0,
    /* the sample is missing (NaN or infinite): predicted over it */
    HGO_PREDICTED = 1,
    /* phi, or what a step makes of it, is not finite: the estimate was held */
    HGO_MODEL_UNDEFINED = 2,
    /* dt is above dt_max: predicted over the sample as over a missing one */
    HGO_STEP_TOO_LONG = 3,
    /* dt is zero, negative, NaN or infinite: no step was taken */
    HGO_STEP_REFUSED = 4,
    /* the memory is not finite any more: restart */
    HGO_DIVERGED = 5,
    /* a pointer is NULL */
    HGO_NULL_POINTER = -1,
    /* a pointer is not aligned for its type */
    HGO_UNALIGNED = -2,
    /* size is below the state's: pass sizeof of the state */
    HGO_STATE_TOO_SMALL = -3,
    /* header and library differ in version: pass HGO_VERSION, rebuild both */
    HGO_WRONG_VERSION = -4,
    /* a number is outside its range: init and step_limit name it */
    HGO_BAD_PARAMETER = -5,
    /* not a state of this type that init has made */
    HGO_NOT_INITIALISED = -6,
    /* n is not the order, nor within the length of the memory */
    HGO_BUFFER_LENGTH = -7,
};

/* Which parameter init refused, and why. */
typedef struct {
    /* name as in the configuration, NUL-terminated */
    char parameter[16];
    /* the range that it must lie in, NUL-terminated */
    char allowed[112];
    /* its value; of an array that is refused as a whole, the first entry */
    double value;
} hgo_error;
HGO_ASSERT(sizeof(hgo_error) == 136);

/* How many steps ended in which code; they stop at UINT32_MAX. */
typedef struct {
    /* HGO_UPDATED */
    uint32_t updated;
    /* HGO_PREDICTED */
    uint32_t predicted;
    /* HGO_MODEL_UNDEFINED */
    uint32_t model_undefined;
    /* HGO_STEP_TOO_LONG */
    uint32_t step_too_long;
    /* HGO_STEP_REFUSED */
    uint32_t step_refused;
    /* HGO_DIVERGED */
    uint32_t diverged;
} hgo_step_counts;
HGO_ASSERT(sizeof(hgo_step_counts) == 24);

/* The version of the library, to be compared with HGO_VERSION. */
uint32_t hgo_version(void);

/* What a code means, NUL-terminated; for every number, and never NULL. */
const char *hgo_status_text(int32_t status);

/* --- Configurations ------------------------------------------------------- */

/* Standard observer with a fixed gain. */
typedef struct {
    /* k_1 ... k_n, 0 beyond n; s^n + k_1 s^(n-1) + ... + k_n must be stable */
    float k[5];
    /* gain [1/s], > 0 */
    float ell;
    /* longest step [s], > 0: at most step_limit, or predict_limit where predict is called */
    float dt_max;
} hgo_standard_config_f32;
HGO_ASSERT(sizeof(hgo_standard_config_f32) == 28);

/* Standard observer with a fixed gain. */
typedef struct {
    /* k_1 ... k_n, 0 beyond n; s^n + k_1 s^(n-1) + ... + k_n must be stable */
    double k[5];
    /* gain [1/s], > 0 */
    double ell;
    /* longest step [s], > 0: at most step_limit, or predict_limit where predict is called */
    double dt_max;
} hgo_standard_config_f64;
HGO_ASSERT(sizeof(hgo_standard_config_f64) == 56);

/* Standard observer with a gain r >= 1 that moves: adaptive, or with a dead zone. */
typedef struct {
    /* k_1 ... k_n, 0 beyond n; s^n + k_1 s^(n-1) + ... + k_n must be stable */
    float k[5];
    /* speed of the gain [1/s per squared unit of y], > 0 */
    float p1;
    /* squared output error [squared unit of y] beyond which the gain grows, > 0 */
    float p2;
    /* exponent, between 0 and 1/2 */
    float b;
    /* longest step at r = 1 [s], > 0: at most step_limit, or predict_limit where predict is called;
     * at r it is dt_max/r */
    float dt_max;
} hgo_adaptive_config_f32;
HGO_ASSERT(sizeof(hgo_adaptive_config_f32) == 36);

/* Standard observer with a gain r >= 1 that moves: adaptive, or with a dead zone. */
typedef struct {
    /* k_1 ... k_n, 0 beyond n; s^n + k_1 s^(n-1) + ... + k_n must be stable */
    double k[5];
    /* speed of the gain [1/s per squared unit of y], > 0 */
    double p1;
    /* squared output error [squared unit of y] beyond which the gain grows, > 0 */
    double p2;
    /* exponent, between 0 and 1/2 */
    double b;
    /* longest step at r = 1 [s], > 0: at most step_limit, or predict_limit where predict is called;
     * at r it is dt_max/r */
    double dt_max;
} hgo_adaptive_config_f64;
HGO_ASSERT(sizeof(hgo_adaptive_config_f64) == 72);

/* Low-power observer with a fixed gain. */
typedef struct {
    /* alpha_1 ... alpha_n; 0 beyond n */
    float alpha[5];
    /* beta_1 ... beta_(n-1); 0 beyond n - 1 */
    float beta[4];
    /* gain [1/s], > 0 */
    float ell;
    /* longest step [s], > 0: at most step_limit, or predict_limit where predict is called */
    float dt_max;
} hgo_low_power_config_f32;
HGO_ASSERT(sizeof(hgo_low_power_config_f32) == 44);

/* Low-power observer with a fixed gain. */
typedef struct {
    /* alpha_1 ... alpha_n; 0 beyond n */
    double alpha[5];
    /* beta_1 ... beta_(n-1); 0 beyond n - 1 */
    double beta[4];
    /* gain [1/s], > 0 */
    double ell;
    /* longest step [s], > 0: at most step_limit, or predict_limit where predict is called */
    double dt_max;
} hgo_low_power_config_f64;
HGO_ASSERT(sizeof(hgo_low_power_config_f64) == 88);

/* Peaking-free observer with a fixed gain. */
typedef struct {
    /* alpha_1 ... alpha_n; 0 beyond n */
    float alpha[5];
    /* beta_1 ... beta_(n-1); 0 beyond n - 1 */
    float beta[4];
    /* bounds of |x_2| ... |x_n| [unit of the state], > 0; 0 beyond n - 1 */
    float saturation[4];
    /* gain [1/s], > 0 */
    float ell;
    /* longest step [s], > 0: at most step_limit, or predict_limit where predict is called */
    float dt_max;
} hgo_peaking_free_config_f32;
HGO_ASSERT(sizeof(hgo_peaking_free_config_f32) == 60);

/* Peaking-free observer with a fixed gain. */
typedef struct {
    /* alpha_1 ... alpha_n; 0 beyond n */
    double alpha[5];
    /* beta_1 ... beta_(n-1); 0 beyond n - 1 */
    double beta[4];
    /* bounds of |x_2| ... |x_n| [unit of the state], > 0; 0 beyond n - 1 */
    double saturation[4];
    /* gain [1/s], > 0 */
    double ell;
    /* longest step [s], > 0: at most step_limit, or predict_limit where predict is called */
    double dt_max;
} hgo_peaking_free_config_f64;
HGO_ASSERT(sizeof(hgo_peaking_free_config_f64) == 120);

/* --- Observers ------------------------------------------------------------
 *
 * Each type has these functions. HGO_..._SIZE is the size of its state in bytes, on
 * every processor; HGO_..._MEMORY is the length of its memory, whose last number is the
 * time that the next correct is for.
 *
 * _init: Make a state of `size` bytes from a configuration, with the estimate 0. `error` may be
 *     NULL; after HGO_BAD_PARAMETER it says what was refused.
 * _step_limit: Write the stability limit of step [s], above which dt_max must not be, for the law
 *     of a configuration; its dt_max is not read. `error` may be NULL.
 * _predict_limit: The same for correct and predict, whose limit is another one: mostly about half.
 * _step: Use the present sample y (NaN: it is missing) and advance by dt [s], the time until the
 *     next sample: the papers' recursion, one call for each sample. phi: the model's n-th
 *     derivative of y over that time, computed from the estimate before this step and from the
 *     inputs; 0 without a model. The estimate is then the prediction for the next sample.
 * _correct: Use the present sample y (NaN: it is missing, and nothing changes). The estimate is
 *     then that of its time. The correction covers the period of the last predict; without one, as
 *     at the start, it changes nothing.
 * _predict: Predict over the coming period of dt [s], without a sample: HGO_PREDICTED. phi: the
 *     model's n-th derivative of y over it, computed from the present estimate and from the inputs
 *     applied in it; 0 without a model. After a period above dt_max the next sample is not used,
 *     and correct returns HGO_STEP_TOO_LONG.
 * _estimate: Copy the first n numbers of the memory: x_hat_1 ... x_hat_n, which estimate y and its
 *     derivatives now (after correct), or at the next sample (after step and predict). A larger n,
 *     up to the length of the memory, gives what the law remembers beside: eta_1 ... eta_(n-1) or
 *     r, and last the time [s] that the next correction is for.
 * _restart: Start again at time 0 from an estimate of n numbers, n the order, or from a whole
 *     memory; every number finite, r at least 1, the time not negative. The counts go on.
 * _counts: Copy the counts of what step and correct ended in, one a sample, and of what predict
 *     refused or held.
 */

/* Standard observer, fixed gain: memory x_hat, time. */

#define HGO_STANDARD2_F32_SIZE 76
#define HGO_STANDARD2_F32_MEMORY 3
typedef struct { uint32_t opaque[HGO_STANDARD2_F32_SIZE / 4]; } hgo_standard2_f32;
int32_t hgo_standard2_f32_init(hgo_standard2_f32 *state, size_t size, uint32_t version,
    const hgo_standard_config_f32 *config, hgo_error *error);
int32_t hgo_standard2_f32_step_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard2_f32_predict_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard2_f32_step(hgo_standard2_f32 *state, float y, float phi, float dt);
int32_t hgo_standard2_f32_correct(hgo_standard2_f32 *state, float y);
int32_t hgo_standard2_f32_predict(hgo_standard2_f32 *state, float phi, float dt);
int32_t hgo_standard2_f32_estimate(const hgo_standard2_f32 *state, float *x_hat, size_t n);
int32_t hgo_standard2_f32_restart(hgo_standard2_f32 *state, const float *x_hat, size_t n);
int32_t hgo_standard2_f32_counts(const hgo_standard2_f32 *state, hgo_step_counts *counts);

#define HGO_STANDARD3_F32_SIZE 84
#define HGO_STANDARD3_F32_MEMORY 4
typedef struct { uint32_t opaque[HGO_STANDARD3_F32_SIZE / 4]; } hgo_standard3_f32;
int32_t hgo_standard3_f32_init(hgo_standard3_f32 *state, size_t size, uint32_t version,
    const hgo_standard_config_f32 *config, hgo_error *error);
int32_t hgo_standard3_f32_step_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard3_f32_predict_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard3_f32_step(hgo_standard3_f32 *state, float y, float phi, float dt);
int32_t hgo_standard3_f32_correct(hgo_standard3_f32 *state, float y);
int32_t hgo_standard3_f32_predict(hgo_standard3_f32 *state, float phi, float dt);
int32_t hgo_standard3_f32_estimate(const hgo_standard3_f32 *state, float *x_hat, size_t n);
int32_t hgo_standard3_f32_restart(hgo_standard3_f32 *state, const float *x_hat, size_t n);
int32_t hgo_standard3_f32_counts(const hgo_standard3_f32 *state, hgo_step_counts *counts);

#define HGO_STANDARD4_F32_SIZE 92
#define HGO_STANDARD4_F32_MEMORY 5
typedef struct { uint32_t opaque[HGO_STANDARD4_F32_SIZE / 4]; } hgo_standard4_f32;
int32_t hgo_standard4_f32_init(hgo_standard4_f32 *state, size_t size, uint32_t version,
    const hgo_standard_config_f32 *config, hgo_error *error);
int32_t hgo_standard4_f32_step_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard4_f32_predict_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard4_f32_step(hgo_standard4_f32 *state, float y, float phi, float dt);
int32_t hgo_standard4_f32_correct(hgo_standard4_f32 *state, float y);
int32_t hgo_standard4_f32_predict(hgo_standard4_f32 *state, float phi, float dt);
int32_t hgo_standard4_f32_estimate(const hgo_standard4_f32 *state, float *x_hat, size_t n);
int32_t hgo_standard4_f32_restart(hgo_standard4_f32 *state, const float *x_hat, size_t n);
int32_t hgo_standard4_f32_counts(const hgo_standard4_f32 *state, hgo_step_counts *counts);

#define HGO_STANDARD5_F32_SIZE 100
#define HGO_STANDARD5_F32_MEMORY 6
typedef struct { uint32_t opaque[HGO_STANDARD5_F32_SIZE / 4]; } hgo_standard5_f32;
int32_t hgo_standard5_f32_init(hgo_standard5_f32 *state, size_t size, uint32_t version,
    const hgo_standard_config_f32 *config, hgo_error *error);
int32_t hgo_standard5_f32_step_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard5_f32_predict_limit(const hgo_standard_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_standard5_f32_step(hgo_standard5_f32 *state, float y, float phi, float dt);
int32_t hgo_standard5_f32_correct(hgo_standard5_f32 *state, float y);
int32_t hgo_standard5_f32_predict(hgo_standard5_f32 *state, float phi, float dt);
int32_t hgo_standard5_f32_estimate(const hgo_standard5_f32 *state, float *x_hat, size_t n);
int32_t hgo_standard5_f32_restart(hgo_standard5_f32 *state, const float *x_hat, size_t n);
int32_t hgo_standard5_f32_counts(const hgo_standard5_f32 *state, hgo_step_counts *counts);

#define HGO_STANDARD2_F64_SIZE 128
#define HGO_STANDARD2_F64_MEMORY 3
typedef struct { uint64_t opaque[HGO_STANDARD2_F64_SIZE / 8]; } hgo_standard2_f64;
int32_t hgo_standard2_f64_init(hgo_standard2_f64 *state, size_t size, uint32_t version,
    const hgo_standard_config_f64 *config, hgo_error *error);
int32_t hgo_standard2_f64_step_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard2_f64_predict_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard2_f64_step(hgo_standard2_f64 *state, double y, double phi, double dt);
int32_t hgo_standard2_f64_correct(hgo_standard2_f64 *state, double y);
int32_t hgo_standard2_f64_predict(hgo_standard2_f64 *state, double phi, double dt);
int32_t hgo_standard2_f64_estimate(const hgo_standard2_f64 *state, double *x_hat, size_t n);
int32_t hgo_standard2_f64_restart(hgo_standard2_f64 *state, const double *x_hat, size_t n);
int32_t hgo_standard2_f64_counts(const hgo_standard2_f64 *state, hgo_step_counts *counts);

#define HGO_STANDARD3_F64_SIZE 144
#define HGO_STANDARD3_F64_MEMORY 4
typedef struct { uint64_t opaque[HGO_STANDARD3_F64_SIZE / 8]; } hgo_standard3_f64;
int32_t hgo_standard3_f64_init(hgo_standard3_f64 *state, size_t size, uint32_t version,
    const hgo_standard_config_f64 *config, hgo_error *error);
int32_t hgo_standard3_f64_step_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard3_f64_predict_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard3_f64_step(hgo_standard3_f64 *state, double y, double phi, double dt);
int32_t hgo_standard3_f64_correct(hgo_standard3_f64 *state, double y);
int32_t hgo_standard3_f64_predict(hgo_standard3_f64 *state, double phi, double dt);
int32_t hgo_standard3_f64_estimate(const hgo_standard3_f64 *state, double *x_hat, size_t n);
int32_t hgo_standard3_f64_restart(hgo_standard3_f64 *state, const double *x_hat, size_t n);
int32_t hgo_standard3_f64_counts(const hgo_standard3_f64 *state, hgo_step_counts *counts);

#define HGO_STANDARD4_F64_SIZE 160
#define HGO_STANDARD4_F64_MEMORY 5
typedef struct { uint64_t opaque[HGO_STANDARD4_F64_SIZE / 8]; } hgo_standard4_f64;
int32_t hgo_standard4_f64_init(hgo_standard4_f64 *state, size_t size, uint32_t version,
    const hgo_standard_config_f64 *config, hgo_error *error);
int32_t hgo_standard4_f64_step_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard4_f64_predict_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard4_f64_step(hgo_standard4_f64 *state, double y, double phi, double dt);
int32_t hgo_standard4_f64_correct(hgo_standard4_f64 *state, double y);
int32_t hgo_standard4_f64_predict(hgo_standard4_f64 *state, double phi, double dt);
int32_t hgo_standard4_f64_estimate(const hgo_standard4_f64 *state, double *x_hat, size_t n);
int32_t hgo_standard4_f64_restart(hgo_standard4_f64 *state, const double *x_hat, size_t n);
int32_t hgo_standard4_f64_counts(const hgo_standard4_f64 *state, hgo_step_counts *counts);

#define HGO_STANDARD5_F64_SIZE 176
#define HGO_STANDARD5_F64_MEMORY 6
typedef struct { uint64_t opaque[HGO_STANDARD5_F64_SIZE / 8]; } hgo_standard5_f64;
int32_t hgo_standard5_f64_init(hgo_standard5_f64 *state, size_t size, uint32_t version,
    const hgo_standard_config_f64 *config, hgo_error *error);
int32_t hgo_standard5_f64_step_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard5_f64_predict_limit(const hgo_standard_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_standard5_f64_step(hgo_standard5_f64 *state, double y, double phi, double dt);
int32_t hgo_standard5_f64_correct(hgo_standard5_f64 *state, double y);
int32_t hgo_standard5_f64_predict(hgo_standard5_f64 *state, double phi, double dt);
int32_t hgo_standard5_f64_estimate(const hgo_standard5_f64 *state, double *x_hat, size_t n);
int32_t hgo_standard5_f64_restart(hgo_standard5_f64 *state, const double *x_hat, size_t n);
int32_t hgo_standard5_f64_counts(const hgo_standard5_f64 *state, hgo_step_counts *counts);

/* Standard observer, adaptive gain: memory x_hat, r, time. */

#define HGO_ADAPTIVE2_F32_SIZE 92
#define HGO_ADAPTIVE2_F32_MEMORY 4
typedef struct { uint32_t opaque[HGO_ADAPTIVE2_F32_SIZE / 4]; } hgo_adaptive2_f32;
int32_t hgo_adaptive2_f32_init(hgo_adaptive2_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_adaptive2_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive2_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive2_f32_step(hgo_adaptive2_f32 *state, float y, float phi, float dt);
int32_t hgo_adaptive2_f32_correct(hgo_adaptive2_f32 *state, float y);
int32_t hgo_adaptive2_f32_predict(hgo_adaptive2_f32 *state, float phi, float dt);
int32_t hgo_adaptive2_f32_estimate(const hgo_adaptive2_f32 *state, float *x_hat, size_t n);
int32_t hgo_adaptive2_f32_restart(hgo_adaptive2_f32 *state, const float *x_hat, size_t n);
int32_t hgo_adaptive2_f32_counts(const hgo_adaptive2_f32 *state, hgo_step_counts *counts);

#define HGO_ADAPTIVE3_F32_SIZE 100
#define HGO_ADAPTIVE3_F32_MEMORY 5
typedef struct { uint32_t opaque[HGO_ADAPTIVE3_F32_SIZE / 4]; } hgo_adaptive3_f32;
int32_t hgo_adaptive3_f32_init(hgo_adaptive3_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_adaptive3_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive3_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive3_f32_step(hgo_adaptive3_f32 *state, float y, float phi, float dt);
int32_t hgo_adaptive3_f32_correct(hgo_adaptive3_f32 *state, float y);
int32_t hgo_adaptive3_f32_predict(hgo_adaptive3_f32 *state, float phi, float dt);
int32_t hgo_adaptive3_f32_estimate(const hgo_adaptive3_f32 *state, float *x_hat, size_t n);
int32_t hgo_adaptive3_f32_restart(hgo_adaptive3_f32 *state, const float *x_hat, size_t n);
int32_t hgo_adaptive3_f32_counts(const hgo_adaptive3_f32 *state, hgo_step_counts *counts);

#define HGO_ADAPTIVE4_F32_SIZE 108
#define HGO_ADAPTIVE4_F32_MEMORY 6
typedef struct { uint32_t opaque[HGO_ADAPTIVE4_F32_SIZE / 4]; } hgo_adaptive4_f32;
int32_t hgo_adaptive4_f32_init(hgo_adaptive4_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_adaptive4_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive4_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive4_f32_step(hgo_adaptive4_f32 *state, float y, float phi, float dt);
int32_t hgo_adaptive4_f32_correct(hgo_adaptive4_f32 *state, float y);
int32_t hgo_adaptive4_f32_predict(hgo_adaptive4_f32 *state, float phi, float dt);
int32_t hgo_adaptive4_f32_estimate(const hgo_adaptive4_f32 *state, float *x_hat, size_t n);
int32_t hgo_adaptive4_f32_restart(hgo_adaptive4_f32 *state, const float *x_hat, size_t n);
int32_t hgo_adaptive4_f32_counts(const hgo_adaptive4_f32 *state, hgo_step_counts *counts);

#define HGO_ADAPTIVE5_F32_SIZE 116
#define HGO_ADAPTIVE5_F32_MEMORY 7
typedef struct { uint32_t opaque[HGO_ADAPTIVE5_F32_SIZE / 4]; } hgo_adaptive5_f32;
int32_t hgo_adaptive5_f32_init(hgo_adaptive5_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_adaptive5_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive5_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_adaptive5_f32_step(hgo_adaptive5_f32 *state, float y, float phi, float dt);
int32_t hgo_adaptive5_f32_correct(hgo_adaptive5_f32 *state, float y);
int32_t hgo_adaptive5_f32_predict(hgo_adaptive5_f32 *state, float phi, float dt);
int32_t hgo_adaptive5_f32_estimate(const hgo_adaptive5_f32 *state, float *x_hat, size_t n);
int32_t hgo_adaptive5_f32_restart(hgo_adaptive5_f32 *state, const float *x_hat, size_t n);
int32_t hgo_adaptive5_f32_counts(const hgo_adaptive5_f32 *state, hgo_step_counts *counts);

#define HGO_ADAPTIVE2_F64_SIZE 160
#define HGO_ADAPTIVE2_F64_MEMORY 4
typedef struct { uint64_t opaque[HGO_ADAPTIVE2_F64_SIZE / 8]; } hgo_adaptive2_f64;
int32_t hgo_adaptive2_f64_init(hgo_adaptive2_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_adaptive2_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive2_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive2_f64_step(hgo_adaptive2_f64 *state, double y, double phi, double dt);
int32_t hgo_adaptive2_f64_correct(hgo_adaptive2_f64 *state, double y);
int32_t hgo_adaptive2_f64_predict(hgo_adaptive2_f64 *state, double phi, double dt);
int32_t hgo_adaptive2_f64_estimate(const hgo_adaptive2_f64 *state, double *x_hat, size_t n);
int32_t hgo_adaptive2_f64_restart(hgo_adaptive2_f64 *state, const double *x_hat, size_t n);
int32_t hgo_adaptive2_f64_counts(const hgo_adaptive2_f64 *state, hgo_step_counts *counts);

#define HGO_ADAPTIVE3_F64_SIZE 176
#define HGO_ADAPTIVE3_F64_MEMORY 5
typedef struct { uint64_t opaque[HGO_ADAPTIVE3_F64_SIZE / 8]; } hgo_adaptive3_f64;
int32_t hgo_adaptive3_f64_init(hgo_adaptive3_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_adaptive3_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive3_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive3_f64_step(hgo_adaptive3_f64 *state, double y, double phi, double dt);
int32_t hgo_adaptive3_f64_correct(hgo_adaptive3_f64 *state, double y);
int32_t hgo_adaptive3_f64_predict(hgo_adaptive3_f64 *state, double phi, double dt);
int32_t hgo_adaptive3_f64_estimate(const hgo_adaptive3_f64 *state, double *x_hat, size_t n);
int32_t hgo_adaptive3_f64_restart(hgo_adaptive3_f64 *state, const double *x_hat, size_t n);
int32_t hgo_adaptive3_f64_counts(const hgo_adaptive3_f64 *state, hgo_step_counts *counts);

#define HGO_ADAPTIVE4_F64_SIZE 192
#define HGO_ADAPTIVE4_F64_MEMORY 6
typedef struct { uint64_t opaque[HGO_ADAPTIVE4_F64_SIZE / 8]; } hgo_adaptive4_f64;
int32_t hgo_adaptive4_f64_init(hgo_adaptive4_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_adaptive4_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive4_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive4_f64_step(hgo_adaptive4_f64 *state, double y, double phi, double dt);
int32_t hgo_adaptive4_f64_correct(hgo_adaptive4_f64 *state, double y);
int32_t hgo_adaptive4_f64_predict(hgo_adaptive4_f64 *state, double phi, double dt);
int32_t hgo_adaptive4_f64_estimate(const hgo_adaptive4_f64 *state, double *x_hat, size_t n);
int32_t hgo_adaptive4_f64_restart(hgo_adaptive4_f64 *state, const double *x_hat, size_t n);
int32_t hgo_adaptive4_f64_counts(const hgo_adaptive4_f64 *state, hgo_step_counts *counts);

#define HGO_ADAPTIVE5_F64_SIZE 208
#define HGO_ADAPTIVE5_F64_MEMORY 7
typedef struct { uint64_t opaque[HGO_ADAPTIVE5_F64_SIZE / 8]; } hgo_adaptive5_f64;
int32_t hgo_adaptive5_f64_init(hgo_adaptive5_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_adaptive5_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive5_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_adaptive5_f64_step(hgo_adaptive5_f64 *state, double y, double phi, double dt);
int32_t hgo_adaptive5_f64_correct(hgo_adaptive5_f64 *state, double y);
int32_t hgo_adaptive5_f64_predict(hgo_adaptive5_f64 *state, double phi, double dt);
int32_t hgo_adaptive5_f64_estimate(const hgo_adaptive5_f64 *state, double *x_hat, size_t n);
int32_t hgo_adaptive5_f64_restart(hgo_adaptive5_f64 *state, const double *x_hat, size_t n);
int32_t hgo_adaptive5_f64_counts(const hgo_adaptive5_f64 *state, hgo_step_counts *counts);

/* Standard observer, gain with a dead zone: memory x_hat, r, time. */

#define HGO_DEAD_ZONE2_F32_SIZE 92
#define HGO_DEAD_ZONE2_F32_MEMORY 4
typedef struct { uint32_t opaque[HGO_DEAD_ZONE2_F32_SIZE / 4]; } hgo_dead_zone2_f32;
int32_t hgo_dead_zone2_f32_init(hgo_dead_zone2_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_dead_zone2_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone2_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone2_f32_step(hgo_dead_zone2_f32 *state, float y, float phi, float dt);
int32_t hgo_dead_zone2_f32_correct(hgo_dead_zone2_f32 *state, float y);
int32_t hgo_dead_zone2_f32_predict(hgo_dead_zone2_f32 *state, float phi, float dt);
int32_t hgo_dead_zone2_f32_estimate(const hgo_dead_zone2_f32 *state, float *x_hat, size_t n);
int32_t hgo_dead_zone2_f32_restart(hgo_dead_zone2_f32 *state, const float *x_hat, size_t n);
int32_t hgo_dead_zone2_f32_counts(const hgo_dead_zone2_f32 *state, hgo_step_counts *counts);

#define HGO_DEAD_ZONE3_F32_SIZE 100
#define HGO_DEAD_ZONE3_F32_MEMORY 5
typedef struct { uint32_t opaque[HGO_DEAD_ZONE3_F32_SIZE / 4]; } hgo_dead_zone3_f32;
int32_t hgo_dead_zone3_f32_init(hgo_dead_zone3_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_dead_zone3_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone3_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone3_f32_step(hgo_dead_zone3_f32 *state, float y, float phi, float dt);
int32_t hgo_dead_zone3_f32_correct(hgo_dead_zone3_f32 *state, float y);
int32_t hgo_dead_zone3_f32_predict(hgo_dead_zone3_f32 *state, float phi, float dt);
int32_t hgo_dead_zone3_f32_estimate(const hgo_dead_zone3_f32 *state, float *x_hat, size_t n);
int32_t hgo_dead_zone3_f32_restart(hgo_dead_zone3_f32 *state, const float *x_hat, size_t n);
int32_t hgo_dead_zone3_f32_counts(const hgo_dead_zone3_f32 *state, hgo_step_counts *counts);

#define HGO_DEAD_ZONE4_F32_SIZE 108
#define HGO_DEAD_ZONE4_F32_MEMORY 6
typedef struct { uint32_t opaque[HGO_DEAD_ZONE4_F32_SIZE / 4]; } hgo_dead_zone4_f32;
int32_t hgo_dead_zone4_f32_init(hgo_dead_zone4_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_dead_zone4_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone4_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone4_f32_step(hgo_dead_zone4_f32 *state, float y, float phi, float dt);
int32_t hgo_dead_zone4_f32_correct(hgo_dead_zone4_f32 *state, float y);
int32_t hgo_dead_zone4_f32_predict(hgo_dead_zone4_f32 *state, float phi, float dt);
int32_t hgo_dead_zone4_f32_estimate(const hgo_dead_zone4_f32 *state, float *x_hat, size_t n);
int32_t hgo_dead_zone4_f32_restart(hgo_dead_zone4_f32 *state, const float *x_hat, size_t n);
int32_t hgo_dead_zone4_f32_counts(const hgo_dead_zone4_f32 *state, hgo_step_counts *counts);

#define HGO_DEAD_ZONE5_F32_SIZE 116
#define HGO_DEAD_ZONE5_F32_MEMORY 7
typedef struct { uint32_t opaque[HGO_DEAD_ZONE5_F32_SIZE / 4]; } hgo_dead_zone5_f32;
int32_t hgo_dead_zone5_f32_init(hgo_dead_zone5_f32 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f32 *config, hgo_error *error);
int32_t hgo_dead_zone5_f32_step_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone5_f32_predict_limit(const hgo_adaptive_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone5_f32_step(hgo_dead_zone5_f32 *state, float y, float phi, float dt);
int32_t hgo_dead_zone5_f32_correct(hgo_dead_zone5_f32 *state, float y);
int32_t hgo_dead_zone5_f32_predict(hgo_dead_zone5_f32 *state, float phi, float dt);
int32_t hgo_dead_zone5_f32_estimate(const hgo_dead_zone5_f32 *state, float *x_hat, size_t n);
int32_t hgo_dead_zone5_f32_restart(hgo_dead_zone5_f32 *state, const float *x_hat, size_t n);
int32_t hgo_dead_zone5_f32_counts(const hgo_dead_zone5_f32 *state, hgo_step_counts *counts);

#define HGO_DEAD_ZONE2_F64_SIZE 160
#define HGO_DEAD_ZONE2_F64_MEMORY 4
typedef struct { uint64_t opaque[HGO_DEAD_ZONE2_F64_SIZE / 8]; } hgo_dead_zone2_f64;
int32_t hgo_dead_zone2_f64_init(hgo_dead_zone2_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_dead_zone2_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone2_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone2_f64_step(hgo_dead_zone2_f64 *state, double y, double phi, double dt);
int32_t hgo_dead_zone2_f64_correct(hgo_dead_zone2_f64 *state, double y);
int32_t hgo_dead_zone2_f64_predict(hgo_dead_zone2_f64 *state, double phi, double dt);
int32_t hgo_dead_zone2_f64_estimate(const hgo_dead_zone2_f64 *state, double *x_hat, size_t n);
int32_t hgo_dead_zone2_f64_restart(hgo_dead_zone2_f64 *state, const double *x_hat, size_t n);
int32_t hgo_dead_zone2_f64_counts(const hgo_dead_zone2_f64 *state, hgo_step_counts *counts);

#define HGO_DEAD_ZONE3_F64_SIZE 176
#define HGO_DEAD_ZONE3_F64_MEMORY 5
typedef struct { uint64_t opaque[HGO_DEAD_ZONE3_F64_SIZE / 8]; } hgo_dead_zone3_f64;
int32_t hgo_dead_zone3_f64_init(hgo_dead_zone3_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_dead_zone3_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone3_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone3_f64_step(hgo_dead_zone3_f64 *state, double y, double phi, double dt);
int32_t hgo_dead_zone3_f64_correct(hgo_dead_zone3_f64 *state, double y);
int32_t hgo_dead_zone3_f64_predict(hgo_dead_zone3_f64 *state, double phi, double dt);
int32_t hgo_dead_zone3_f64_estimate(const hgo_dead_zone3_f64 *state, double *x_hat, size_t n);
int32_t hgo_dead_zone3_f64_restart(hgo_dead_zone3_f64 *state, const double *x_hat, size_t n);
int32_t hgo_dead_zone3_f64_counts(const hgo_dead_zone3_f64 *state, hgo_step_counts *counts);

#define HGO_DEAD_ZONE4_F64_SIZE 192
#define HGO_DEAD_ZONE4_F64_MEMORY 6
typedef struct { uint64_t opaque[HGO_DEAD_ZONE4_F64_SIZE / 8]; } hgo_dead_zone4_f64;
int32_t hgo_dead_zone4_f64_init(hgo_dead_zone4_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_dead_zone4_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone4_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone4_f64_step(hgo_dead_zone4_f64 *state, double y, double phi, double dt);
int32_t hgo_dead_zone4_f64_correct(hgo_dead_zone4_f64 *state, double y);
int32_t hgo_dead_zone4_f64_predict(hgo_dead_zone4_f64 *state, double phi, double dt);
int32_t hgo_dead_zone4_f64_estimate(const hgo_dead_zone4_f64 *state, double *x_hat, size_t n);
int32_t hgo_dead_zone4_f64_restart(hgo_dead_zone4_f64 *state, const double *x_hat, size_t n);
int32_t hgo_dead_zone4_f64_counts(const hgo_dead_zone4_f64 *state, hgo_step_counts *counts);

#define HGO_DEAD_ZONE5_F64_SIZE 208
#define HGO_DEAD_ZONE5_F64_MEMORY 7
typedef struct { uint64_t opaque[HGO_DEAD_ZONE5_F64_SIZE / 8]; } hgo_dead_zone5_f64;
int32_t hgo_dead_zone5_f64_init(hgo_dead_zone5_f64 *state, size_t size, uint32_t version,
    const hgo_adaptive_config_f64 *config, hgo_error *error);
int32_t hgo_dead_zone5_f64_step_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone5_f64_predict_limit(const hgo_adaptive_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_dead_zone5_f64_step(hgo_dead_zone5_f64 *state, double y, double phi, double dt);
int32_t hgo_dead_zone5_f64_correct(hgo_dead_zone5_f64 *state, double y);
int32_t hgo_dead_zone5_f64_predict(hgo_dead_zone5_f64 *state, double phi, double dt);
int32_t hgo_dead_zone5_f64_estimate(const hgo_dead_zone5_f64 *state, double *x_hat, size_t n);
int32_t hgo_dead_zone5_f64_restart(hgo_dead_zone5_f64 *state, const double *x_hat, size_t n);
int32_t hgo_dead_zone5_f64_counts(const hgo_dead_zone5_f64 *state, hgo_step_counts *counts);

/* Low-power observer, fixed gain: memory x_hat, eta, time. */

#define HGO_LOW_POWER2_F32_SIZE 92
#define HGO_LOW_POWER2_F32_MEMORY 4
typedef struct { uint32_t opaque[HGO_LOW_POWER2_F32_SIZE / 4]; } hgo_low_power2_f32;
int32_t hgo_low_power2_f32_init(hgo_low_power2_f32 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f32 *config, hgo_error *error);
int32_t hgo_low_power2_f32_step_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power2_f32_predict_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power2_f32_step(hgo_low_power2_f32 *state, float y, float phi, float dt);
int32_t hgo_low_power2_f32_correct(hgo_low_power2_f32 *state, float y);
int32_t hgo_low_power2_f32_predict(hgo_low_power2_f32 *state, float phi, float dt);
int32_t hgo_low_power2_f32_estimate(const hgo_low_power2_f32 *state, float *x_hat, size_t n);
int32_t hgo_low_power2_f32_restart(hgo_low_power2_f32 *state, const float *x_hat, size_t n);
int32_t hgo_low_power2_f32_counts(const hgo_low_power2_f32 *state, hgo_step_counts *counts);

#define HGO_LOW_POWER3_F32_SIZE 108
#define HGO_LOW_POWER3_F32_MEMORY 6
typedef struct { uint32_t opaque[HGO_LOW_POWER3_F32_SIZE / 4]; } hgo_low_power3_f32;
int32_t hgo_low_power3_f32_init(hgo_low_power3_f32 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f32 *config, hgo_error *error);
int32_t hgo_low_power3_f32_step_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power3_f32_predict_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power3_f32_step(hgo_low_power3_f32 *state, float y, float phi, float dt);
int32_t hgo_low_power3_f32_correct(hgo_low_power3_f32 *state, float y);
int32_t hgo_low_power3_f32_predict(hgo_low_power3_f32 *state, float phi, float dt);
int32_t hgo_low_power3_f32_estimate(const hgo_low_power3_f32 *state, float *x_hat, size_t n);
int32_t hgo_low_power3_f32_restart(hgo_low_power3_f32 *state, const float *x_hat, size_t n);
int32_t hgo_low_power3_f32_counts(const hgo_low_power3_f32 *state, hgo_step_counts *counts);

#define HGO_LOW_POWER4_F32_SIZE 124
#define HGO_LOW_POWER4_F32_MEMORY 8
typedef struct { uint32_t opaque[HGO_LOW_POWER4_F32_SIZE / 4]; } hgo_low_power4_f32;
int32_t hgo_low_power4_f32_init(hgo_low_power4_f32 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f32 *config, hgo_error *error);
int32_t hgo_low_power4_f32_step_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power4_f32_predict_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power4_f32_step(hgo_low_power4_f32 *state, float y, float phi, float dt);
int32_t hgo_low_power4_f32_correct(hgo_low_power4_f32 *state, float y);
int32_t hgo_low_power4_f32_predict(hgo_low_power4_f32 *state, float phi, float dt);
int32_t hgo_low_power4_f32_estimate(const hgo_low_power4_f32 *state, float *x_hat, size_t n);
int32_t hgo_low_power4_f32_restart(hgo_low_power4_f32 *state, const float *x_hat, size_t n);
int32_t hgo_low_power4_f32_counts(const hgo_low_power4_f32 *state, hgo_step_counts *counts);

#define HGO_LOW_POWER5_F32_SIZE 140
#define HGO_LOW_POWER5_F32_MEMORY 10
typedef struct { uint32_t opaque[HGO_LOW_POWER5_F32_SIZE / 4]; } hgo_low_power5_f32;
int32_t hgo_low_power5_f32_init(hgo_low_power5_f32 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f32 *config, hgo_error *error);
int32_t hgo_low_power5_f32_step_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power5_f32_predict_limit(const hgo_low_power_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_low_power5_f32_step(hgo_low_power5_f32 *state, float y, float phi, float dt);
int32_t hgo_low_power5_f32_correct(hgo_low_power5_f32 *state, float y);
int32_t hgo_low_power5_f32_predict(hgo_low_power5_f32 *state, float phi, float dt);
int32_t hgo_low_power5_f32_estimate(const hgo_low_power5_f32 *state, float *x_hat, size_t n);
int32_t hgo_low_power5_f32_restart(hgo_low_power5_f32 *state, const float *x_hat, size_t n);
int32_t hgo_low_power5_f32_counts(const hgo_low_power5_f32 *state, hgo_step_counts *counts);

#define HGO_LOW_POWER2_F64_SIZE 160
#define HGO_LOW_POWER2_F64_MEMORY 4
typedef struct { uint64_t opaque[HGO_LOW_POWER2_F64_SIZE / 8]; } hgo_low_power2_f64;
int32_t hgo_low_power2_f64_init(hgo_low_power2_f64 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f64 *config, hgo_error *error);
int32_t hgo_low_power2_f64_step_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power2_f64_predict_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power2_f64_step(hgo_low_power2_f64 *state, double y, double phi, double dt);
int32_t hgo_low_power2_f64_correct(hgo_low_power2_f64 *state, double y);
int32_t hgo_low_power2_f64_predict(hgo_low_power2_f64 *state, double phi, double dt);
int32_t hgo_low_power2_f64_estimate(const hgo_low_power2_f64 *state, double *x_hat, size_t n);
int32_t hgo_low_power2_f64_restart(hgo_low_power2_f64 *state, const double *x_hat, size_t n);
int32_t hgo_low_power2_f64_counts(const hgo_low_power2_f64 *state, hgo_step_counts *counts);

#define HGO_LOW_POWER3_F64_SIZE 192
#define HGO_LOW_POWER3_F64_MEMORY 6
typedef struct { uint64_t opaque[HGO_LOW_POWER3_F64_SIZE / 8]; } hgo_low_power3_f64;
int32_t hgo_low_power3_f64_init(hgo_low_power3_f64 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f64 *config, hgo_error *error);
int32_t hgo_low_power3_f64_step_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power3_f64_predict_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power3_f64_step(hgo_low_power3_f64 *state, double y, double phi, double dt);
int32_t hgo_low_power3_f64_correct(hgo_low_power3_f64 *state, double y);
int32_t hgo_low_power3_f64_predict(hgo_low_power3_f64 *state, double phi, double dt);
int32_t hgo_low_power3_f64_estimate(const hgo_low_power3_f64 *state, double *x_hat, size_t n);
int32_t hgo_low_power3_f64_restart(hgo_low_power3_f64 *state, const double *x_hat, size_t n);
int32_t hgo_low_power3_f64_counts(const hgo_low_power3_f64 *state, hgo_step_counts *counts);

#define HGO_LOW_POWER4_F64_SIZE 224
#define HGO_LOW_POWER4_F64_MEMORY 8
typedef struct { uint64_t opaque[HGO_LOW_POWER4_F64_SIZE / 8]; } hgo_low_power4_f64;
int32_t hgo_low_power4_f64_init(hgo_low_power4_f64 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f64 *config, hgo_error *error);
int32_t hgo_low_power4_f64_step_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power4_f64_predict_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power4_f64_step(hgo_low_power4_f64 *state, double y, double phi, double dt);
int32_t hgo_low_power4_f64_correct(hgo_low_power4_f64 *state, double y);
int32_t hgo_low_power4_f64_predict(hgo_low_power4_f64 *state, double phi, double dt);
int32_t hgo_low_power4_f64_estimate(const hgo_low_power4_f64 *state, double *x_hat, size_t n);
int32_t hgo_low_power4_f64_restart(hgo_low_power4_f64 *state, const double *x_hat, size_t n);
int32_t hgo_low_power4_f64_counts(const hgo_low_power4_f64 *state, hgo_step_counts *counts);

#define HGO_LOW_POWER5_F64_SIZE 256
#define HGO_LOW_POWER5_F64_MEMORY 10
typedef struct { uint64_t opaque[HGO_LOW_POWER5_F64_SIZE / 8]; } hgo_low_power5_f64;
int32_t hgo_low_power5_f64_init(hgo_low_power5_f64 *state, size_t size, uint32_t version,
    const hgo_low_power_config_f64 *config, hgo_error *error);
int32_t hgo_low_power5_f64_step_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power5_f64_predict_limit(const hgo_low_power_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_low_power5_f64_step(hgo_low_power5_f64 *state, double y, double phi, double dt);
int32_t hgo_low_power5_f64_correct(hgo_low_power5_f64 *state, double y);
int32_t hgo_low_power5_f64_predict(hgo_low_power5_f64 *state, double phi, double dt);
int32_t hgo_low_power5_f64_estimate(const hgo_low_power5_f64 *state, double *x_hat, size_t n);
int32_t hgo_low_power5_f64_restart(hgo_low_power5_f64 *state, const double *x_hat, size_t n);
int32_t hgo_low_power5_f64_counts(const hgo_low_power5_f64 *state, hgo_step_counts *counts);

/* Peaking-free observer (hard clips), fixed gain: memory x_hat, eta, time. */

#define HGO_PEAKING_FREE2_F32_SIZE 100
#define HGO_PEAKING_FREE2_F32_MEMORY 4
typedef struct { uint32_t opaque[HGO_PEAKING_FREE2_F32_SIZE / 4]; } hgo_peaking_free2_f32;
int32_t hgo_peaking_free2_f32_init(hgo_peaking_free2_f32 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f32 *config, hgo_error *error);
int32_t hgo_peaking_free2_f32_step_limit(const hgo_peaking_free_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free2_f32_predict_limit(const hgo_peaking_free_config_f32 *config,
    float *dt_max, hgo_error *error);
int32_t hgo_peaking_free2_f32_step(hgo_peaking_free2_f32 *state, float y, float phi, float dt);
int32_t hgo_peaking_free2_f32_correct(hgo_peaking_free2_f32 *state, float y);
int32_t hgo_peaking_free2_f32_predict(hgo_peaking_free2_f32 *state, float phi, float dt);
int32_t hgo_peaking_free2_f32_estimate(const hgo_peaking_free2_f32 *state, float *x_hat, size_t n);
int32_t hgo_peaking_free2_f32_restart(hgo_peaking_free2_f32 *state, const float *x_hat, size_t n);
int32_t hgo_peaking_free2_f32_counts(const hgo_peaking_free2_f32 *state, hgo_step_counts *counts);

#define HGO_PEAKING_FREE3_F32_SIZE 120
#define HGO_PEAKING_FREE3_F32_MEMORY 6
typedef struct { uint32_t opaque[HGO_PEAKING_FREE3_F32_SIZE / 4]; } hgo_peaking_free3_f32;
int32_t hgo_peaking_free3_f32_init(hgo_peaking_free3_f32 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f32 *config, hgo_error *error);
int32_t hgo_peaking_free3_f32_step_limit(const hgo_peaking_free_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free3_f32_predict_limit(const hgo_peaking_free_config_f32 *config,
    float *dt_max, hgo_error *error);
int32_t hgo_peaking_free3_f32_step(hgo_peaking_free3_f32 *state, float y, float phi, float dt);
int32_t hgo_peaking_free3_f32_correct(hgo_peaking_free3_f32 *state, float y);
int32_t hgo_peaking_free3_f32_predict(hgo_peaking_free3_f32 *state, float phi, float dt);
int32_t hgo_peaking_free3_f32_estimate(const hgo_peaking_free3_f32 *state, float *x_hat, size_t n);
int32_t hgo_peaking_free3_f32_restart(hgo_peaking_free3_f32 *state, const float *x_hat, size_t n);
int32_t hgo_peaking_free3_f32_counts(const hgo_peaking_free3_f32 *state, hgo_step_counts *counts);

#define HGO_PEAKING_FREE4_F32_SIZE 140
#define HGO_PEAKING_FREE4_F32_MEMORY 8
typedef struct { uint32_t opaque[HGO_PEAKING_FREE4_F32_SIZE / 4]; } hgo_peaking_free4_f32;
int32_t hgo_peaking_free4_f32_init(hgo_peaking_free4_f32 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f32 *config, hgo_error *error);
int32_t hgo_peaking_free4_f32_step_limit(const hgo_peaking_free_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free4_f32_predict_limit(const hgo_peaking_free_config_f32 *config,
    float *dt_max, hgo_error *error);
int32_t hgo_peaking_free4_f32_step(hgo_peaking_free4_f32 *state, float y, float phi, float dt);
int32_t hgo_peaking_free4_f32_correct(hgo_peaking_free4_f32 *state, float y);
int32_t hgo_peaking_free4_f32_predict(hgo_peaking_free4_f32 *state, float phi, float dt);
int32_t hgo_peaking_free4_f32_estimate(const hgo_peaking_free4_f32 *state, float *x_hat, size_t n);
int32_t hgo_peaking_free4_f32_restart(hgo_peaking_free4_f32 *state, const float *x_hat, size_t n);
int32_t hgo_peaking_free4_f32_counts(const hgo_peaking_free4_f32 *state, hgo_step_counts *counts);

#define HGO_PEAKING_FREE5_F32_SIZE 160
#define HGO_PEAKING_FREE5_F32_MEMORY 10
typedef struct { uint32_t opaque[HGO_PEAKING_FREE5_F32_SIZE / 4]; } hgo_peaking_free5_f32;
int32_t hgo_peaking_free5_f32_init(hgo_peaking_free5_f32 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f32 *config, hgo_error *error);
int32_t hgo_peaking_free5_f32_step_limit(const hgo_peaking_free_config_f32 *config, float *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free5_f32_predict_limit(const hgo_peaking_free_config_f32 *config,
    float *dt_max, hgo_error *error);
int32_t hgo_peaking_free5_f32_step(hgo_peaking_free5_f32 *state, float y, float phi, float dt);
int32_t hgo_peaking_free5_f32_correct(hgo_peaking_free5_f32 *state, float y);
int32_t hgo_peaking_free5_f32_predict(hgo_peaking_free5_f32 *state, float phi, float dt);
int32_t hgo_peaking_free5_f32_estimate(const hgo_peaking_free5_f32 *state, float *x_hat, size_t n);
int32_t hgo_peaking_free5_f32_restart(hgo_peaking_free5_f32 *state, const float *x_hat, size_t n);
int32_t hgo_peaking_free5_f32_counts(const hgo_peaking_free5_f32 *state, hgo_step_counts *counts);

#define HGO_PEAKING_FREE2_F64_SIZE 176
#define HGO_PEAKING_FREE2_F64_MEMORY 4
typedef struct { uint64_t opaque[HGO_PEAKING_FREE2_F64_SIZE / 8]; } hgo_peaking_free2_f64;
int32_t hgo_peaking_free2_f64_init(hgo_peaking_free2_f64 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f64 *config, hgo_error *error);
int32_t hgo_peaking_free2_f64_step_limit(const hgo_peaking_free_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free2_f64_predict_limit(const hgo_peaking_free_config_f64 *config,
    double *dt_max, hgo_error *error);
int32_t hgo_peaking_free2_f64_step(hgo_peaking_free2_f64 *state, double y, double phi, double dt);
int32_t hgo_peaking_free2_f64_correct(hgo_peaking_free2_f64 *state, double y);
int32_t hgo_peaking_free2_f64_predict(hgo_peaking_free2_f64 *state, double phi, double dt);
int32_t hgo_peaking_free2_f64_estimate(const hgo_peaking_free2_f64 *state, double *x_hat, size_t n);
int32_t hgo_peaking_free2_f64_restart(hgo_peaking_free2_f64 *state, const double *x_hat, size_t n);
int32_t hgo_peaking_free2_f64_counts(const hgo_peaking_free2_f64 *state, hgo_step_counts *counts);

#define HGO_PEAKING_FREE3_F64_SIZE 216
#define HGO_PEAKING_FREE3_F64_MEMORY 6
typedef struct { uint64_t opaque[HGO_PEAKING_FREE3_F64_SIZE / 8]; } hgo_peaking_free3_f64;
int32_t hgo_peaking_free3_f64_init(hgo_peaking_free3_f64 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f64 *config, hgo_error *error);
int32_t hgo_peaking_free3_f64_step_limit(const hgo_peaking_free_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free3_f64_predict_limit(const hgo_peaking_free_config_f64 *config,
    double *dt_max, hgo_error *error);
int32_t hgo_peaking_free3_f64_step(hgo_peaking_free3_f64 *state, double y, double phi, double dt);
int32_t hgo_peaking_free3_f64_correct(hgo_peaking_free3_f64 *state, double y);
int32_t hgo_peaking_free3_f64_predict(hgo_peaking_free3_f64 *state, double phi, double dt);
int32_t hgo_peaking_free3_f64_estimate(const hgo_peaking_free3_f64 *state, double *x_hat, size_t n);
int32_t hgo_peaking_free3_f64_restart(hgo_peaking_free3_f64 *state, const double *x_hat, size_t n);
int32_t hgo_peaking_free3_f64_counts(const hgo_peaking_free3_f64 *state, hgo_step_counts *counts);

#define HGO_PEAKING_FREE4_F64_SIZE 256
#define HGO_PEAKING_FREE4_F64_MEMORY 8
typedef struct { uint64_t opaque[HGO_PEAKING_FREE4_F64_SIZE / 8]; } hgo_peaking_free4_f64;
int32_t hgo_peaking_free4_f64_init(hgo_peaking_free4_f64 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f64 *config, hgo_error *error);
int32_t hgo_peaking_free4_f64_step_limit(const hgo_peaking_free_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free4_f64_predict_limit(const hgo_peaking_free_config_f64 *config,
    double *dt_max, hgo_error *error);
int32_t hgo_peaking_free4_f64_step(hgo_peaking_free4_f64 *state, double y, double phi, double dt);
int32_t hgo_peaking_free4_f64_correct(hgo_peaking_free4_f64 *state, double y);
int32_t hgo_peaking_free4_f64_predict(hgo_peaking_free4_f64 *state, double phi, double dt);
int32_t hgo_peaking_free4_f64_estimate(const hgo_peaking_free4_f64 *state, double *x_hat, size_t n);
int32_t hgo_peaking_free4_f64_restart(hgo_peaking_free4_f64 *state, const double *x_hat, size_t n);
int32_t hgo_peaking_free4_f64_counts(const hgo_peaking_free4_f64 *state, hgo_step_counts *counts);

#define HGO_PEAKING_FREE5_F64_SIZE 296
#define HGO_PEAKING_FREE5_F64_MEMORY 10
typedef struct { uint64_t opaque[HGO_PEAKING_FREE5_F64_SIZE / 8]; } hgo_peaking_free5_f64;
int32_t hgo_peaking_free5_f64_init(hgo_peaking_free5_f64 *state, size_t size, uint32_t version,
    const hgo_peaking_free_config_f64 *config, hgo_error *error);
int32_t hgo_peaking_free5_f64_step_limit(const hgo_peaking_free_config_f64 *config, double *dt_max,
    hgo_error *error);
int32_t hgo_peaking_free5_f64_predict_limit(const hgo_peaking_free_config_f64 *config,
    double *dt_max, hgo_error *error);
int32_t hgo_peaking_free5_f64_step(hgo_peaking_free5_f64 *state, double y, double phi, double dt);
int32_t hgo_peaking_free5_f64_correct(hgo_peaking_free5_f64 *state, double y);
int32_t hgo_peaking_free5_f64_predict(hgo_peaking_free5_f64 *state, double phi, double dt);
int32_t hgo_peaking_free5_f64_estimate(const hgo_peaking_free5_f64 *state, double *x_hat, size_t n);
int32_t hgo_peaking_free5_f64_restart(hgo_peaking_free5_f64 *state, const double *x_hat, size_t n);
int32_t hgo_peaking_free5_f64_counts(const hgo_peaking_free5_f64 *state, hgo_step_counts *counts);

#ifdef __cplusplus
}
#endif
#endif
