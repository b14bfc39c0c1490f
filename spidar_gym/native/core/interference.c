/* Inter-rotor interference: restricted rotors and the bounds of their θ [Zhao2025, Eq. 18-27, 33]. */
#include "spidar_core.h"
#include "spidar_math.h"

#define SUBSETS 32

void sp_no_interference(sp_interference *bounds)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        bounds->restricted[i] = 0;
        bounds->lower[i] = -HUGE_VAL;
        bounds->upper[i] = HUGE_VAL;
        bounds->side[i] = 1;
    }
}

/* Angles ψ at which a jet meets a target in the plane [Zhao2025, Eq. 20, 21, 23]. */
static void forbidden_interval(double x, double z, double radius, double target_radius, double *low, double *high)
{
    double below = -z, right = x + target_radius, left = x - target_radius;
    *low = -(atan2(right, below) + atan2(radius, sqrt(right * right + below * below)));
    *high = -(atan2(left, below) - atan2(radius, sqrt(left * left + below * below)));
}

void sp_find_interference(const sp_snapshot *s, const double *nominal, const sp_interference *previous,
                          const sp_interference_config *config, const sp_disc *disc, sp_interference *bounds)
{
    double tan_alpha = tan(config->alpha), tan_horizon = tan(config->horizon);
    sp_interference next;
    sp_no_interference(&next);
    memcpy(next.side, previous->side, sizeof next.side);
    for (int i = 0; i < SP_ROTORS; i++) {
        double subsets[SUBSETS][2] = {{-SP_HALF_PI, SP_HALF_PI}}, yx = 0.0, yy = 0.0;
        int count = 1, met = 0;
        const double *own = s->rotor_c[i];
        for (int k = 0; k <= SP_ROTORS + (disc != NULL); k++) { /* the last targets are the torso's disc and a further one */
            double torso[3] = {-s->com_b[0], -s->com_b[1], -s->com_b[2]};
            const double *target = k < SP_ROTORS ? s->rotor_c[k] : k == SP_ROTORS ? torso : disc->centre_c;
            double radius = k < SP_ROTORS ? config->rotor_radius : k == SP_ROTORS ? config->torso_radius : disc->radius;
            double below = own[2] - target[2], dx = target[0] - own[0], dy = target[1] - own[1];
            int wide = k > SP_ROTORS;
            if (below <= 0.0 || (wide && !(below > SP_DISC_NEAREST && below < SP_DISC_FARTHEST))) continue;
            if (yx == 0.0 && yy == 0.0) {
                /* y axis of the nominal thrust frame, R_bl Rx(φ̂) ŷ, horizontal. */
                double c = cos(nominal[2 * i]), n = sin(nominal[2 * i]);
                yx = c * s->R_bl[i][1] + n * s->R_bl[i][2];
                yy = c * s->R_bl[i][4] + n * s->R_bl[i][5];
                double length = sqrt(yx * yx + yy * yy);
                yx /= length;
                yy /= length;
            }
            /* [Zhao2025, Eq. 22]: too far off along φ, or too far to the side for the jet to reach it at hover. */
            double along = fabs(dx * yx + dy * yy), across = fabs(dx * yy - dy * yx);
            if (wide ? along >= radius + config->rotor_radius || across >= radius + tan_horizon * below
                     : along >= tan_alpha * below || across >= tan_horizon * below)
                continue;
            double low, high, kept[SUBSETS][2];
            int left = 0;
            met = 1;
            forbidden_interval(dx * yy - dy * yx, -below, config->rotor_radius, radius, &low, &high);
            for (int j = 0; j < count; j++) {
                double start = subsets[j][0], end = subsets[j][1];
                double parts[2][2] = {{start, low < end ? low : end}, {high > start ? high : start, end}};
                for (int p = 0; p < 2; p++)
                    if (parts[p][1] - parts[p][0] >= config->width && left < SUBSETS) sp_copy(kept[left++], parts[p], 2);
            }
            memcpy(subsets, kept, (size_t)left * sizeof kept[0]);
            count = left;
        }
        if (!met) continue;
        int best = -1;
        double least = HUGE_VAL;
        for (int j = 0; j < count; j++) { /* the subset that needs the least tilt [Zhao2025, Eq. 26, 27] */
            double low = subsets[j][0], high = subsets[j][1], tilt = low > 0.0 ? low : high < 0.0 ? -high : 0.0;
            if ((low > 0.0 && previous->side[i] < 0) || (high < 0.0 && previous->side[i] > 0)) tilt += config->tie;
            if (tilt < least) least = tilt, best = j;
        }
        if (best < 0) continue;
        double low = subsets[best][0], high = subsets[best][1];
        next.side[i] = -low <= high ? 1 : -1;
        next.restricted[i] = sp_min(-low, high) < config->theta + (previous->restricted[i] ? config->hysteresis : 0.0);
        next.lower[i] = low + nominal[2 * i + 1];
        next.upper[i] = high + nominal[2 * i + 1];
    }
    *bounds = next;
}
