/* Disturbances: wind with turbulence, pushes, the eddy of the recirculation, and thrust noise.
 *
 * First-order Dryden turbulence [MIL-F-8785C]; pushes of 0.2 s, each in a random direction. The order of the draws
 * determines what a seed produces.
 */
#include "engine.h"

void sp_draw_weather(const sp_disturbances *d, sp_generator *generator, sp_weather *weather)
{
    memset(weather, 0, sizeof *weather);
    double azimuth = sp_uniform(generator, -SP_PI, SP_PI);
    weather->mean_w[0] = d->wind * cos(azimuth);
    weather->mean_w[1] = d->wind * sin(azimuth);
    for (int i = 0; i < 3; i++) weather->gust_w[i] = d->wind * SP_WIND_INTENSITY[i] * sp_normal(generator);
    weather->next_push = d->push > 0.0 ? sp_uniform(generator, 0.0, SP_PUSH_EVERY[1]) : HUGE_VAL;
}

/* Advance the weather by `dt` [s] to `time` [s]: w ← w e^{−V dt/L} + σ √(1 − e^{−2 V dt/L}) n, V = max(wind, 1 m/s). */
void sp_advance_weather(const sp_disturbances *d, double time, double dt, sp_generator *generator, sp_weather *weather)
{
    if (d->wind > 0.0)
        for (int i = 0; i < 3; i++) {
            double decay = exp(-sp_max(d->wind, 1.0) * dt / SP_WIND_LENGTH[i]);
            double spread = d->wind * SP_WIND_INTENSITY[i] * sqrt(1.0 - decay * decay);
            weather->gust_w[i] = decay * weather->gust_w[i] + spread * sp_normal(generator);
        }
    if (time >= weather->next_push - 1e-9) {
        double direction[3];
        for (int i = 0; i < 3; i++) direction[i] = sp_normal(generator);
        double scale = d->push / sp_norm(direction);
        for (int i = 0; i < 3; i++) weather->push_w[i] = scale * direction[i];
        weather->push_end = time + SP_PUSH_SECONDS;
        weather->next_push = time + sp_uniform(generator, SP_PUSH_EVERY[0], SP_PUSH_EVERY[1]);
    } else if (time >= weather->push_end - 1e-9) {
        sp_zero(weather->push_w, 3);
    }
}

/* Whether there is any recirculation. */
int sp_recirculates(const sp_recirculation_config *c)
{
    int any = c->flow_xy != 0.0 || c->flow_z != 0.0 || c->turn_xy != 0.0 || c->turn_z != 0.0;
    for (int i = 0; i < 3; i++) any |= c->mean_flow[i] != 0.0 || c->mean_turn[i] != 0.0;
    return any;
}

/* Sample the eddy in its stationary state: six numbers of mean 0 and variance 1, of U, then of Ω. */
void sp_draw_eddy(sp_generator *generator, double *eddy)
{
    for (int i = 0; i < 6; i++) eddy[i] = sp_normal(generator);
}

/* Advance the eddy by `dt` [s]: x ← x e^{−dt/T} + √(1 − e^{−2 dt/T}) n. */
void sp_advance_eddy(const sp_recirculation_config *c, double dt, sp_generator *generator, double *eddy)
{
    for (int i = 0; i < 6; i++) {
        double decay = exp(-dt / (i < 3 ? c->flow_seconds : c->turn_seconds));
        eddy[i] = decay * eddy[i] + sqrt(1.0 - decay * decay) * sp_normal(generator);
    }
}

/* The next sample of each module's thrust noise, first order, of standard deviation `sigma` [N], `dt` [s] later. */
void sp_advance_noise(double *noise, double sigma, double dt, sp_generator *generator)
{
    double decay = exp(-SP_TWO_PI * SP_NOISE_BANDWIDTH * dt), spread = sigma * sqrt(1.0 - decay * decay);
    for (int i = 0; i < SP_ROTORS; i++) noise[i] = decay * noise[i] + spread * sp_normal(generator);
}
