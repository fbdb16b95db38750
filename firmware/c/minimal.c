/* The least that a chip needs for one observer: what it costs in flash is counted here. */

#include "hgo.h"

static hgo_standard2_f32 observer;
volatile float measured, velocity;

int start_observer(void)
{
    const hgo_standard_config_f32 config = {.k = {3.0f, 2.0f}, .ell = 100.0f, .dt_max = 0.01f};
    return hgo_standard2_f32_init(&observer, sizeof observer, HGO_VERSION, &config, NULL);
}

/* Called by a timer every millisecond. */
void on_timer(void)
{
    float x_hat[2];
    hgo_standard2_f32_step(&observer, measured, 0.0f, 0.001f);
    if (hgo_standard2_f32_estimate(&observer, x_hat, 2) == HGO_OK) velocity = x_hat[1];
}
