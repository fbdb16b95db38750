/* Runs one double-precision observer of hgo.h over steps from standard input.
 *
 *     driver NAME < the configuration, then y, phi and dt of every step, all doubles
 *
 * Writes the step limit, then the status and the memory after every step, all doubles. The limit
 * takes the place of a dt_max of 0. */

#include "hgo.h"

#include <stdio.h>
#include <string.h>

#define RUN(NAME, CONFIG, MEMORY)                                                                  \
    static int run_##NAME(void)                                                                    \
    {                                                                                              \
        static hgo_##NAME state;                                                                   \
        hgo_##CONFIG##_config_f64 config;                                                          \
        hgo_error error;                                                                           \
        double step[3], out[1 + MEMORY], limit = 0.0;                                              \
        int32_t status;                                                                            \
        if (fread(&config, sizeof config, 1, stdin) != 1) return 2;                                \
        status = hgo_##NAME##_step_limit(&config, &limit, &error);                                 \
        if (status != HGO_OK) return refused(status, &error);                                      \
        if (config.dt_max == 0.0) config.dt_max = limit;                                           \
        status = hgo_##NAME##_init(&state, sizeof state, HGO_VERSION, &config, &error);            \
        if (status != HGO_OK) return refused(status, &error);                                      \
        fwrite(&limit, sizeof limit, 1, stdout);                                                   \
        while (fread(step, sizeof step, 1, stdin) == 1) {                                          \
            out[0] = hgo_##NAME##_step(&state, step[0], step[1], step[2]);                         \
            status = hgo_##NAME##_estimate(&state, out + 1, MEMORY);                               \
            if (status != HGO_OK) return refused(status, &error);                                  \
            fwrite(out, sizeof out, 1, stdout);                                                    \
        }                                                                                          \
        return 0;                                                                                  \
    }

static int refused(int32_t status, const hgo_error *error)
{
    fprintf(stderr, "%s: %s = %g: %s\n", hgo_status_text(status), error->parameter, error->value,
            error->allowed);
    return 3;
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
    if (argc == 2 && strcmp(argv[1], #NAME) == 0) return run_##NAME();
    EACH(CHOOSE)
    fprintf(stderr, "which observer?\n");
    return 2;
}
