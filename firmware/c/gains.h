/* Written by Python: docs/from-python-to-your-board.md. */
#include "hgo.h"

static const hgo_standard_config_f32 velocity_config = {
    .k = {3.0f, 2.0f},
    .ell = 100.0f,
    .dt_max = 0.009f,
};

static const hgo_low_power_config_f32 acceleration_config = {
    .alpha = {3.0f, 3.0f, 2.0f},
    .beta = {4.2222223f, 1.0526316f},
    .ell = 200.0f,
    .dt_max = 0.0045f,
};

static const hgo_adaptive_config_f32 oscillator_config = {
    .k = {3.0f, 2.0f},
    .p1 = 20.0f,
    .p2 = 1e-04f,
    .b = 0.25f,
    .dt_max = 0.9f,
};

static const hgo_standard_config_f64 velocity64_config = {
    .k = {3.0, 2.0},
    .ell = 100.0,
    .dt_max = 0.009000000000000001,
};

static const hgo_standard_config_f32 spring_config = {
    .k = {3.0f, 2.0f},
    .ell = 100.0f,
    .dt_max = 0.005053975f,
};
