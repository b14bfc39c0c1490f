/* Leg kinematics on the ground, and the reach of a stride. */
#include "ground.h"

/* Inverse kinematics: knees up, outer yaw 0; returns 0 if out of reach [Zhao2025, Sec. Crawling Gait]. */
int sp_leg_angles(const sp_robot *robot, const double *feet_b, double *q)
{
    double found[SP_JOINTS], upper = robot->yaw_to_pitch + robot->pitch_to_yaw, lower = robot->pitch_to_foot;
    sp_zero(found, SP_JOINTS);
    for (int leg = 0; leg < SP_LEGS; leg++) {
        double a = azimuth(leg), dx = feet_b[3 * leg] - robot->yaw_axis_radius * cos(a);
        double dy = feet_b[3 * leg + 1] - robot->yaw_axis_radius * sin(a), yaw = wrapped(atan2(dy, dx) - a);
        double out = sqrt(dx * dx + dy * dy) - robot->yaw_to_pitch, down = robot->yaw_axis_z - feet_b[3 * leg + 2];
        double cosine = (out * out + down * down - upper * upper - lower * lower) / (2.0 * upper * lower);
        if (!(cosine >= -1.0 && cosine <= 1.0)) return 0;
        double outer = acos(cosine);
        double inner = atan2(down, out) - atan2(lower * sin(outer), upper + lower * cosine);
        if (sp_max(sp_max(fabs(yaw), fabs(inner)), fabs(outer)) > robot->joint_limit) return 0;
        found[4 * leg] = yaw, found[4 * leg + 1] = inner, found[4 * leg + 3] = outer;
    }
    sp_copy(q, found, SP_JOINTS);
    return 1;
}

/* Forward kinematics: centres of the feet, outer yaw joints included. */
void sp_feet_at(const sp_robot *robot, const double *q, double *feet_b)
{
    for (int leg = 0; leg < SP_LEGS; leg++) {
        double yaw = q[4 * leg], inner = q[4 * leg + 1], twist = q[4 * leg + 2], outer = q[4 * leg + 3];
        double a = azimuth(leg), reach = robot->yaw_to_pitch + robot->pitch_to_foot * cos(outer);
        double x = robot->pitch_to_yaw + reach * cos(twist), y = reach * sin(twist), z = -robot->pitch_to_foot * sin(outer);
        double out = robot->yaw_to_pitch + x * cos(inner) + z * sin(inner), down = -x * sin(inner) + z * cos(inner);
        double c = cos(a + yaw), s = sin(a + yaw);
        feet_b[3 * leg] = robot->yaw_axis_radius * cos(a) + out * c - y * s;
        feet_b[3 * leg + 1] = robot->yaw_axis_radius * sin(a) + out * s + y * c;
        feet_b[3 * leg + 2] = robot->yaw_axis_z + down;
    }
}

/* Positions of the feet when the torso stands on its pegs. */
void sp_home(const sp_robot *robot, const sp_gait_config *c, double *home_b)
{
    double upper = robot->yaw_to_pitch + robot->pitch_to_yaw, lower = robot->pitch_to_foot;
    double reach = robot->yaw_axis_radius + robot->yaw_to_pitch + upper * cos(c->inner) + lower * cos(c->inner + c->outer);
    for (int leg = 0; leg < SP_LEGS; leg++) {
        home_b[3 * leg] = reach * cos(azimuth(leg));
        home_b[3 * leg + 1] = reach * sin(azimuth(leg));
        home_b[3 * leg + 2] = -robot->peg_depth + robot->foot_radius;
    }
}

/* Whether one cycle can cover `way`: every foot is in reach at start and end, torso down and lifted. */
int sp_stride_fits(const sp_robot *robot, const sp_gait_config *c, const double *home_b, sp_pose2 way, double lift_height)
{
    sp_pose2 zero = {0.0, 0.0, 0.0}, ends[2] = {way, zero};
    double heights[2] = {-c->press, lift_height}, feet[3 * SP_LEGS], q[SP_JOINTS];
    if (centred(c)) ends[0] = arc(way, 0.5), ends[1] = arc(way, -0.5);
    for (int e = 0; e < 2; e++)
        for (int h = 0; h < 2; h++) {
            move_points(ends[e], home_b, -heights[h], feet);
            if (!sp_leg_angles(robot, feet, q)) return 0;
        }
    return 1;
}

/* Largest share of `way` within the legs' reach in one cycle, up to SP_MOST_STRIDE. */
double sp_largest_stride(const sp_robot *robot, const sp_crawl *crawl, sp_pose2 way)
{
    const sp_gait_config *c = &crawl->config.gait;
    double low = 0.0, high = 1.0;
    while (high < SP_MOST_STRIDE && sp_stride_fits(robot, c, crawl->home_b, arc(way, high), c->lift_height))
        low = high, high *= 2.0;
    for (int i = 0; i < SP_BISECTIONS; i++) {
        double middle = 0.5 * (low + high);
        if (sp_stride_fits(robot, c, crawl->home_b, arc(way, middle), c->lift_height)) low = middle;
        else high = middle;
    }
    return low;
}
