/* The least that a chip needs for one observer: what it costs in flash is counted here. */

#include "hgo.h"

static hgo_standard2_f32 observer;
volatile float measured, torque;

int start_observer(void)
{
    const hgo_standard_config_f32 config = {.k = {3.0f, 2.0f}, .ell = 100.0f, .dt_max = 0.005f};
    return hgo_standard2_f32_init(&observer, sizeof observer, HGO_VERSION, &config, NULL);
}

/* Called by a timer every millisecond: a control loop around q'' = 4 torque. */
void on_timer(void)
{
    float x_hat[2] = {0.0f, 0.0f}, applied;
    hgo_standard2_f32_correct(&observer, measured);
    hgo_standard2_f32_estimate(&observer, x_hat, 2);
    torque = applied = -8.0f * x_hat[0] - 2.0f * x_hat[1];
    hgo_standard2_f32_predict(&observer, 4.0f * applied, 0.001f);
}
