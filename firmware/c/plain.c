/* Four observers as one writes them in C without a library, the yardstick of the instruction
 * counts: forward Euler (zoh where it says so), gains folded into the coefficients beforehand, single precision, and the
 * same service as the crate's step: a missing sample (NaN or infinite) is predicted over and
 * reported. No call but powf of the C library. */

#include "plain.h"

#include <math.h>

enum { UPDATED = 0, PREDICTED = 1 };

/* Standard, n = 2: l1 = k1/eps, l2 = k2/eps^2, nothing known of the system. */
int plain_standard2(const struct plain_standard2 *o, float x[2], float y, float dt)
{
    int missing = !isfinite(y);
    float e = missing ? 0.0f : y - x[0];
    float x1 = x[0], x2 = x[1];
    x[0] = x1 + dt * (x2 + o->l[0] * e);
    x[1] = x2 + dt * (o->l[1] * e);
    return missing ? PREDICTED : UPDATED;
}

/* Standard, n = 2, zoh of a fixed period: the gains that place the eigenvalues for it, and the exact
 * chain. In two halves, as a control loop calls it. */
int plain_zoh2_correct(const struct plain_zoh2 *o, float x[2], float y)
{
    if (!isfinite(y))
        return PREDICTED;
    const float e = y - x[0];
    x[0] += o->k[0] * e;
    x[1] += o->k[1] * e;
    return UPDATED;
}

int plain_zoh2_predict(const struct plain_zoh2 *o, float x[2])
{
    x[0] += o->dt * x[1];
    return PREDICTED;
}

/* Low-power, n = 5, on the crackle system: a[i] = alpha_i l, b[i] = beta_i l^2. */
int plain_low_power5(const struct plain_low_power5 *o, struct plain_low_power5_state *z, float y,
                     float dt)
{
    int missing = !isfinite(y);
    const float x1 = z->x[0], x2 = z->x[1], x3 = z->x[2], x4 = z->x[3], x5 = z->x[4];
    const float h1 = z->eta[0], h2 = z->eta[1], h3 = z->eta[2], h4 = z->eta[3];
    float phi = 0.2f * (x1 * x1 - 1.0f) - x2 - x3 - 4.0f * x4 - x5;
    phi = phi < -o->phi_max ? -o->phi_max : phi > o->phi_max ? o->phi_max : phi;
    const float e1 = missing ? 0.0f : y - x1;
    const float e2 = h1 - x2, e3 = h2 - x3, e4 = h3 - x4, e5 = h4 - x5;
    z->x[0] = x1 + dt * (h1 + o->a[0] * e1);
    z->x[1] = x2 + dt * (h2 + o->a[1] * e2);
    z->x[2] = x3 + dt * (h3 + o->a[2] * e3);
    z->x[3] = x4 + dt * (h4 + o->a[3] * e4);
    z->x[4] = x5 + dt * (phi + o->a[4] * e5);
    z->eta[0] = h1 + dt * (h2 + o->b[0] * e1);
    z->eta[1] = h2 + dt * (h3 + o->b[1] * e2);
    z->eta[2] = h3 + dt * (h4 + o->b[2] * e3);
    z->eta[3] = h4 + dt * (phi + o->b[3] * e4);
    return missing ? PREDICTED : UPDATED;
}

/* Adaptive gain, n = 2, with the model f = (nu1 x1, 0). */
int plain_adaptive2(const struct plain_adaptive2 *o, struct plain_adaptive2_state *z, float y,
                    float dt)
{
    int missing = !isfinite(y);
    const float x1 = z->x[0], x2 = z->x[1], r = z->r;
    const float e = missing ? 0.0f : y - x1;
    const float r2 = r * r;
    const float rate = o->p1 * ((e * e - o->p2) * powf(r, o->exponent) + o->p2 / (r2 * r2));
    z->x[0] = x1 + dt * (x2 + o->nu1 * x1 + o->k[0] * (r * e));
    z->x[1] = x2 + dt * (o->k[1] * (r2 * e));
    const float moved = r + dt * rate;
    z->r = moved < 1.0f ? 1.0f : moved;
    return missing ? PREDICTED : UPDATED;
}
