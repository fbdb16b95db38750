/* Observers in C, on a computer and on a board: what to copy, and what to expect.
 *
 * The same text comes out everywhere; firmware/c/example.py builds, runs and compares. gains.h was
 * written by Python, see docs/from-python-to-your-board.md. */

#include "gains.h"
#include "hgo.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { SAMPLES = 2000, MISSING = 700, LATE = 1200 };

/* States are the caller's: here they are static, so that no heap and little stack is needed. */
static hgo_standard2_f32 velocity;
static hgo_low_power3_f32 acceleration;
static hgo_adaptive2_f32 oscillator;
static hgo_standard2_f64 velocity64;
static hgo_standard2_f32 spring;

static int surprises;

static void expect(const char *what, int32_t status, int32_t expected)
{
    if (status != expected) {
        printf("%s: %" PRId32 " (%s), not %" PRId32 "\n", what, status, hgo_status_text(status),
               expected);
        ++surprises;
    }
}

/* A position of arcs of parabolas, one period in 400 samples; exact in float. */
static double sample(int k)
{
    const int p = k % 400, q = p % 200, arc = q * (200 - q);
    return (p < 200 ? arc : -arc) / 8192.0;
}

static int start(void)
{
    hgo_error error = {{0}, {0}, 0.0};
    const int32_t status = hgo_standard2_f32_init(&velocity, sizeof velocity, HGO_VERSION,
                                                  &velocity_config, &error);
    if (status != HGO_OK) {
        printf("velocity: %s: %s = %g: %s\n", hgo_status_text(status), error.parameter,
               error.value, error.allowed);
        return 0;
    }
    /* Who does not want to print passes NULL for the error. */
    return hgo_low_power3_f32_init(&acceleration, sizeof acceleration, HGO_VERSION,
                                   &acceleration_config, NULL) == HGO_OK
        && hgo_adaptive2_f32_init(&oscillator, sizeof oscillator, HGO_VERSION,
                                  &oscillator_config, NULL) == HGO_OK
        && hgo_standard2_f64_init(&velocity64, sizeof velocity64, HGO_VERSION,
                                  &velocity64_config, NULL) == HGO_OK
        && hgo_standard2_f32_init(&spring, sizeof spring, HGO_VERSION, &spring_config, NULL)
               == HGO_OK;
}

/* What an interrupt does where the estimate is only looked at: one step a sample. */
static void take(int k)
{
    const double position = k == MISSING ? (double)NAN : sample(k);
    const double dt = k == LATE ? 0.02 : 0.001; /* the timer came late once */
    const int32_t in_time = k == MISSING ? HGO_PREDICTED : HGO_UPDATED;
    const int32_t expected = k == LATE ? HGO_STEP_TOO_LONG : in_time;
    const float y = (float)position, dt32 = (float)dt;
    float x_hat[2];

    expect("velocity", hgo_standard2_f32_step(&velocity, y, 0.0f, dt32), expected);
    expect("acceleration", hgo_low_power3_f32_step(&acceleration, y, 0.0f, dt32), expected);

    /* This one knows that it watches an oscillator: phi = -w^2 x_1. Its gain is low: for it, dt is
     * never too long. */
    hgo_adaptive2_f32_estimate(&oscillator, x_hat, 2);
    expect("oscillator", hgo_adaptive2_f32_step(&oscillator, y, -246.0f * x_hat[0], dt32), in_time);

    expect("velocity64", hgo_standard2_f64_step(&velocity64, position, 0.0, dt), expected);
}

/* What an interrupt of a control loop does: correct, apply an input, predict under this input. */
static void steer(void)
{
    static float position = 1.0f, speed = 0.0f; /* of the plant: a spring with a motor */
    float x_hat[2], u, phi;

    expect("spring", hgo_standard2_f32_correct(&spring, position), HGO_UPDATED);
    hgo_standard2_f32_estimate(&spring, x_hat, 2);
    u = -30.0f * x_hat[0] - 8.0f * x_hat[1];      /* computed, and applied from now on */
    phi = u - 0.5f * x_hat[1] - 9.81f * x_hat[0]; /* what it does in the period that begins */
    expect("spring", hgo_standard2_f32_predict(&spring, phi, 0.001f), HGO_PREDICTED);

    speed += 0.001f * (u - 0.5f * speed - 9.81f * position);
    position += 0.001f * speed;
}

static void show(const char *name, int i, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    printf("%-12s %d  %16.9g  %08" PRIx32 "\n", name, i + 1, (double)value, bits);
}

static void show64(const char *name, int i, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    printf("%-12s %d  %16.9g  %08" PRIx32 "%08" PRIx32 "\n", name, i + 1, value,
           (uint32_t)(bits >> 32), (uint32_t)bits);
}

static void finish(void)
{
    float x_hat[3];
    double x_hat64[2];
    hgo_step_counts counts;
    int i;

    expect("estimate", hgo_standard2_f32_estimate(&velocity, x_hat, 2), HGO_OK);
    for (i = 0; i < 2; ++i) show("velocity", i, x_hat[i]);
    expect("estimate", hgo_low_power3_f32_estimate(&acceleration, x_hat, 3), HGO_OK);
    for (i = 0; i < 3; ++i) show("acceleration", i, x_hat[i]);
    /* One number more than the order: behind x_hat the memory holds the gain r. */
    expect("estimate", hgo_adaptive2_f32_estimate(&oscillator, x_hat, 3), HGO_OK);
    for (i = 0; i < 3; ++i) show("oscillator", i, x_hat[i]);
    expect("estimate", hgo_standard2_f64_estimate(&velocity64, x_hat64, 2), HGO_OK);
    for (i = 0; i < 2; ++i) show64("velocity64", i, x_hat64[i]);
    expect("estimate", hgo_standard2_f32_estimate(&spring, x_hat, 2), HGO_OK);
    for (i = 0; i < 2; ++i) show("spring", i, x_hat[i]);

    expect("counts", hgo_standard2_f32_counts(&velocity, &counts), HGO_OK);
    printf("%" PRIu32 " updated, %" PRIu32 " predicted, %" PRIu32 " too long\n", counts.updated,
           counts.predicted, counts.step_too_long);
}

/* What cannot be right is refused, with no state changed. */
static void mistakes(void)
{
    hgo_standard2_f32 other;
    hgo_standard_config_f32 config = velocity_config;
    hgo_error error;
    float x_hat[2] = {0.0f, 0.0f};
    void *odd = (unsigned char *)&other + 1;
    const size_t size = sizeof other;

    memset(&other, 0, sizeof other);
    expect("never made", hgo_standard2_f32_step(&other, 0.0f, 0.0f, 0.001f), HGO_NOT_INITIALISED);
    expect("NULL state", hgo_standard2_f32_init(NULL, size, HGO_VERSION, &config, &error),
           HGO_NULL_POINTER);
    expect("NULL config", hgo_standard2_f32_init(&other, size, HGO_VERSION, NULL, &error),
           HGO_NULL_POINTER);
    expect("unaligned", hgo_standard2_f32_init(odd, size, HGO_VERSION, &config, &error),
           HGO_UNALIGNED);
    expect("too small", hgo_standard2_f32_init(&other, size - 1, HGO_VERSION, &config, &error),
           HGO_STATE_TOO_SMALL);
    expect("version", hgo_standard2_f32_init(&other, size, HGO_VERSION + 1, &config, &error),
           HGO_WRONG_VERSION);
    config.ell = -1.0f;
    expect("gain", hgo_standard2_f32_init(&other, size, HGO_VERSION, &config, &error),
           HGO_BAD_PARAMETER);
    printf("refused: %s = %g: %s\n", error.parameter, error.value, error.allowed);
    expect("still not made", hgo_standard2_f32_estimate(&other, x_hat, 2), HGO_NOT_INITIALISED);
    expect("length", hgo_standard2_f32_estimate(&velocity, x_hat, 1), HGO_BUFFER_LENGTH);
    expect("dt", hgo_standard2_f32_step(&velocity, 0.0f, 0.0f, -1.0f), HGO_STEP_REFUSED);
}

int main(void)
{
    int k;
    if (hgo_version() != HGO_VERSION || !start()) {
        puts("no observers");
        return 1;
    }
    for (k = 0; k < SAMPLES; ++k) {
        take(k);
        steer();
    }
    finish();
    mistakes();
    puts(surprises == 0 ? "all as expected" : "not as expected");
    return surprises != 0;
}
