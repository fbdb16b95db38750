/* Runs one double-precision observer of hgo.h.
 *
 *     driver NAME < the configuration, then call, y, phi and dt of every call, all doubles
 *
 * A call is 0: step, 1: correct, 2: predict. Writes the step limits, of step and of correct and
 * predict, then the status and the memory after every call, all doubles. The first limit takes the
 * place of a dt_max of 0.
 *
 *     driver NAME loop < the configuration, then dt and the number of samples, all doubles
 *
 * Closes a loop around a pendulum by an observer of order 2 and writes its q and w, and the memory
 * after every correction. */

#include "hgo.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static int refused(int32_t status, const hgo_error *error)
{
    fprintf(stderr, "%s: %s = %g: %s\n", hgo_status_text(status), error->parameter, error->value,
            error->allowed);
    return 3;
}

struct pendulum {
    double q, w;
};

/* q'' = u - w/2 - 9.81 sin q, ten steps in a period. */
static void move(struct pendulum *p, double u, double dt)
{
    const double h = dt / 10.0;
    int i;
    for (i = 0; i < 10; ++i) {
        p->w += h * (u - 0.5 * p->w - 9.81 * sin(p->q));
        p->q += h * p->w;
    }
}

/* A stiff controller, which moves the pendulum to and fro. */
static double control(const double *x_hat, int k)
{
    const double wanted = k % 200 < 100 ? 0.3 : -0.3;
    return -400.0 * (x_hat[0] - wanted) - 40.0 * x_hat[1];
}

#define RUN(NAME, CONFIG, MEMORY)                                                                  \
    static int loop_##NAME(hgo_##NAME *state)                                                      \
    {                                                                                              \
        struct pendulum p = {1.0, 0.0};                                                            \
        double given[2], out[MEMORY];                                                              \
        int k;                                                                                     \
        if (fread(given, sizeof given, 1, stdin) != 1) return 2;                                   \
        for (k = 0; k < (int)given[1]; ++k) {                                                      \
            double u, phi;                                                                         \
            if (hgo_##NAME##_correct(state, p.q) != HGO_UPDATED) return 4;                         \
            if (hgo_##NAME##_estimate(state, out, MEMORY) != HGO_OK) return 4;                     \
            fwrite(&p, sizeof p, 1, stdout);                                                       \
            fwrite(out, sizeof out, 1, stdout);                                                    \
            u = control(out, k);                                                                   \
            phi = u - 0.5 * out[1] - 9.81 * sin(out[0]);                                           \
            if (hgo_##NAME##_predict(state, phi, given[0]) != HGO_PREDICTED) return 4;             \
            move(&p, u, given[0]);                                                                 \
        }                                                                                          \
        return 0;                                                                                  \
    }                                                                                              \
                                                                                                   \
    static int run_##NAME(int loop)                                                                \
    {                                                                                              \
        static hgo_##NAME state;                                                                   \
        hgo_##CONFIG##_config_f64 config;                                                          \
        hgo_error error;                                                                           \
        double call[4], out[1 + MEMORY], limits[2];                                                \
        int32_t status;                                                                            \
        if (fread(&config, sizeof config, 1, stdin) != 1) return 2;                                \
        status = hgo_##NAME##_step_limit(&config, &limits[0], &error);                             \
        if (status != HGO_OK) return refused(status, &error);                                      \
        status = hgo_##NAME##_predict_limit(&config, &limits[1], &error);                          \
        if (status != HGO_OK) return refused(status, &error);                                      \
        if (config.dt_max == 0.0) config.dt_max = limits[0];                                       \
        status = hgo_##NAME##_init(&state, sizeof state, HGO_VERSION, &config, &error);            \
        if (status != HGO_OK) return refused(status, &error);                                      \
        if (loop) return loop_##NAME(&state);                                                      \
        fwrite(limits, sizeof limits, 1, stdout);                                                  \
        while (fread(call, sizeof call, 1, stdin) == 1) {                                          \
            out[0] = call[0] == 0.0   ? hgo_##NAME##_step(&state, call[1], call[2], call[3])       \
                     : call[0] == 1.0 ? hgo_##NAME##_correct(&state, call[1])                      \
                                      : hgo_##NAME##_predict(&state, call[2], call[3]);            \
            status = hgo_##NAME##_estimate(&state, out + 1, MEMORY);                               \
            if (status != HGO_OK) return refused(status, &error);                                  \
            fwrite(out, sizeof out, 1, stdout);                                                    \
        }                                                                                          \
        return 0;                                                                                  \
    }

#define EACH(X)                                                                                    \
    X(standard2_f64, standard, HGO_STANDARD2_F64_MEMORY)                                           \
    X(standard3_f64, standard, HGO_STANDARD3_F64_MEMORY)                                           \
    X(standard4_f64, standard, HGO_STANDARD4_F64_MEMORY)                                           \
    X(standard5_f64, standard, HGO_STANDARD5_F64_MEMORY)                                           \
    X(adaptive2_f64, adaptive, HGO_ADAPTIVE2_F64_MEMORY)                                           \
    X(adaptive3_f64, adaptive, HGO_ADAPTIVE3_F64_MEMORY)                                           \
    X(adaptive4_f64, adaptive, HGO_ADAPTIVE4_F64_MEMORY)                                           \
    X(adaptive5_f64, adaptive, HGO_ADAPTIVE5_F64_MEMORY)                                           \
    X(dead_zone2_f64, adaptive, HGO_DEAD_ZONE2_F64_MEMORY)                                         \
    X(dead_zone3_f64, adaptive, HGO_DEAD_ZONE3_F64_MEMORY)                                         \
    X(dead_zone4_f64, adaptive, HGO_DEAD_ZONE4_F64_MEMORY)                                         \
    X(dead_zone5_f64, adaptive, HGO_DEAD_ZONE5_F64_MEMORY)                                         \
    X(low_power2_f64, low_power, HGO_LOW_POWER2_F64_MEMORY)                                        \
    X(low_power3_f64, low_power, HGO_LOW_POWER3_F64_MEMORY)                                        \
    X(low_power4_f64, low_power, HGO_LOW_POWER4_F64_MEMORY)                                        \
    X(low_power5_f64, low_power, HGO_LOW_POWER5_F64_MEMORY)                                        \
    X(peaking_free2_f64, peaking_free, HGO_PEAKING_FREE2_F64_MEMORY)                               \
    X(peaking_free3_f64, peaking_free, HGO_PEAKING_FREE3_F64_MEMORY)                               \
    X(peaking_free4_f64, peaking_free, HGO_PEAKING_FREE4_F64_MEMORY)                               \
    X(peaking_free5_f64, peaking_free, HGO_PEAKING_FREE5_F64_MEMORY)

EACH(RUN)

int main(int argc, char **argv)
{
#define CHOOSE(NAME, CONFIG, MEMORY)                                                               \
    if (argc >= 2 && strcmp(argv[1], #NAME) == 0) return run_##NAME(argc > 2);
    EACH(CHOOSE)
    fprintf(stderr, "which observer?\n");
    return 2;
}
