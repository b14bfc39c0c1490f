/* Functions shared by gait, legs and courses: planar poses (x, y, yaw), leg azimuths. */
#ifndef SPIDAR_GROUND_H
#define SPIDAR_GROUND_H

#include "spidar_core.h"
#include "spidar_math.h"

/* ---- planar poses ---- */

/* Compose `pose` with `next`, which is relative to it. */
static inline sp_pose2 then(sp_pose2 pose, sp_pose2 next)
{
    double c = cos(pose.yaw), s = sin(pose.yaw);
    return (sp_pose2){pose.x + c * next.x - s * next.y, pose.y + s * next.x + c * next.y, pose.yaw + next.yaw};
}

static inline sp_pose2 inverse(sp_pose2 pose)
{
    double c = cos(pose.yaw), s = sin(pose.yaw);
    return (sp_pose2){-c * pose.x - s * pose.y, s * pose.x - c * pose.y, -pose.yaw};
}

/* Pose after a share of the arc of constant curvature from the origin to `pose`. */
static inline sp_pose2 arc(sp_pose2 pose, double share)
{
    if (fabs(pose.yaw) < SP_STRAIGHT) return (sp_pose2){share * pose.x, share * pose.y, share * pose.yaw};
    double half = 0.5 * pose.yaw, k = half / tan(half);
    double vx = k * pose.x + half * pose.y, vy = -half * pose.x + k * pose.y, a = share * pose.yaw;
    double s = sin(a) / pose.yaw, c = (1.0 - cos(a)) / pose.yaw;
    return (sp_pose2){s * vx - c * vy, c * vx + s * vy, a};
}

/* Transform points (4, 3) from the frame of `pose` to the origin's, and raise them by `dz`. */
static inline void move_points(sp_pose2 pose, const double *points, double dz, double *moved)
{
    double c = cos(pose.yaw), s = sin(pose.yaw);
    for (int i = 0; i < SP_LEGS; i++) {
        double x = points[3 * i], y = points[3 * i + 1];
        moved[3 * i] = c * x - s * y + pose.x;
        moved[3 * i + 1] = s * x + c * y + pose.y;
        moved[3 * i + 2] = points[3 * i + 2] + dz;
    }
}

static inline sp_pose2 planar_pose(const double *position_w, const double *R)
{
    return (sp_pose2){position_w[0], position_w[1], atan2(R[3], R[0])};
}

static inline double length(double x, double y) { return sqrt(x * x + y * y); }

static inline double wrapped(double angle) { return remainder(angle, SP_TWO_PI); }

/* ---- legs ---- */

static inline double azimuth(int leg) { return SP_PI / 4.0 + leg * SP_HALF_PI; }

static inline int centred(const sp_gait_config *c) { return c->stride == SP_GAIT_CONFIG_STRIDE_CENTRED; }

#endif
