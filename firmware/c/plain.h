/* The yardstick of the instruction counts: see plain.c. */
#ifndef HGO_PLAIN_H
#define HGO_PLAIN_H

struct plain_standard2 {
    float l[2];
};
struct plain_zoh2 {
    float k[2], dt;
};
struct plain_low_power5 {
    float a[5], b[4], phi_max;
};
struct plain_low_power5_state {
    float x[5], eta[4];
};
struct plain_adaptive2 {
    float k[2], p1, p2, exponent, nu1;
};
struct plain_adaptive2_state {
    float x[2], r;
};

int plain_standard2(const struct plain_standard2 *o, float x[2], float y, float dt);
int plain_zoh2_correct(const struct plain_zoh2 *o, float x[2], float y);
int plain_zoh2_predict(const struct plain_zoh2 *o, float x[2]);
int plain_low_power5(const struct plain_low_power5 *o, struct plain_low_power5_state *z, float y,
                     float dt);
int plain_adaptive2(const struct plain_adaptive2 *o, struct plain_adaptive2_state *z, float y,
                    float dt);

#endif
