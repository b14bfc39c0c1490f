/* The crawl: commands → cycles → phases → joint setpoints and allocation mode [Zhao2025, Sec. Crawling Gait].
 *
 * Its inputs are the torso's pose and the joint angles, no forces. Touchdown is a threshold on them, because neither
 * feet nor torso have a touch sensor.
 */
#include "ground.h"

/* ---- commands ---- */

static sp_step *step_at(sp_gait_memory *m, int k) { return &m->steps[(m->first + k) % SP_MAX_STEPS]; }

/* Append a step of all legs to the queue. */
static sp_step *append_step(sp_gait_memory *m, sp_phases phases)
{
    sp_step *step = step_at(m, m->count++);
    memset(step, 0, sizeof *step);
    step->phases = phases;
    for (int leg = 0; leg < SP_LEGS; leg++) step->legs[leg] = 1;
    return step;
}

/* Append an arc by the displacement `way`, relative to the end of the queued commands, in `cycles` cycles; 0 is the
 * fewest that reach and configuration allow. Returns the number of steps, or 0 if the displacement is out of reach or
 * not finite, or the queue is full. */
int sp_gait_move(const sp_robot *robot, sp_crawl *crawl, sp_pose2 way, int cycles)
{
    sp_gait_memory *m = &crawl->gait;
    double numbers[3] = {way.x, way.y, way.yaw};
    if (!sp_finite(numbers, 3) || cycles < 0) return 0;
    double share = sp_largest_stride(robot, crawl, way), distance = length(way.x, way.y);
    if (share <= 0.0) return 0;
    if (cycles == 0) {
        const sp_gait_config *c = &crawl->config.gait;
        double wanted = sp_max(sp_max(distance / c->max_distance, fabs(way.yaw) / c->max_turn), 1.0 / share);
        if (!(wanted < SP_MAX_STEPS)) return 0;
        cycles = (int)sp_max(1.0, ceil(wanted - 1e-6));
    } else if (share * cycles < 1.0 - 1e-9) {
        return 0;
    }
    if (m->count + cycles > SP_MAX_STEPS) return 0;
    for (int k = 0; k < cycles; k++) {
        sp_step *step = append_step(m, SP_CYCLE);
        step->has_target = 1;
        step->target = then(m->planned, arc(way, (k + 1.0) / cycles));
    }
    m->planned = then(m->planned, way);
    return cycles;
}

/* Append: raise legs in place, hold, lower them. Returns 0 if an argument is invalid or the queue is full. */
int sp_gait_lift(sp_crawl *crawl, const int32_t *legs, double angle, double seconds)
{
    sp_gait_memory *m = &crawl->gait;
    int any = 0;
    for (int leg = 0; leg < SP_LEGS; leg++) any |= legs[leg] != 0;
    if (!any || !(angle >= 0.0) || !(seconds >= 0.0) || !sp_finite(&angle, 1) || !sp_finite(&seconds, 1)) return 0;
    if (m->count == SP_MAX_STEPS) return 0;
    sp_step *step = append_step(m, SP_LIFT);
    for (int leg = 0; leg < SP_LEGS; leg++) step->legs[leg] = legs[leg] != 0;
    step->has_angle = 1;
    step->angle = angle;
    step->seconds = seconds;
    return 1;
}

/* Append: lift the torso, hold, lower it. Returns 0 if that is invalid, out of reach, or the queue is full. */
int sp_gait_stand(const sp_robot *robot, sp_crawl *crawl, double height, double seconds)
{
    sp_gait_memory *m = &crawl->gait;
    sp_pose2 here = {0.0, 0.0, 0.0};
    if (!(height >= 0.0) || !(seconds >= 0.0) || !sp_finite(&height, 1) || !sp_finite(&seconds, 1)) return 0;
    if (!sp_stride_fits(robot, &crawl->config.gait, crawl->home_b, here, height) || m->count == SP_MAX_STEPS) return 0;
    sp_step *step = append_step(m, SP_STAND);
    step->has_height = 1;
    step->height = height;
    step->seconds = seconds;
    return 1;
}

/* ---- present phase ---- */

int sp_gait_done(const sp_crawl *crawl) { return crawl->gait.phase == SP_DONE && crawl->gait.count == 0; }

static int legs_up(int phase)
{
    return phase == SP_SPOOL || phase == SP_RAISE || phase == SP_SWING || phase == SP_LOWER;
}

static int on_feet(int phase)
{
    return phase == SP_BRACE || phase == SP_UP || phase == SP_FORWARD || phase == SP_DOWN;
}

sp_program_kind sp_gait_mode(const sp_crawl *crawl)
{
    const sp_gait_memory *m = &crawl->gait;
    const sp_step *step = &m->steps[m->first];
    if (legs_up(m->phase) || (m->phase == SP_HOLD && step->phases == SP_LIFT)) {
        int count = 0;
        for (int leg = 0; leg < SP_LEGS; leg++) count += step->legs[leg];
        return count == SP_LEGS ? SP_PROGRAM_LEGS : SP_PROGRAM_LEG;
    }
    return on_feet(m->phase) || m->phase == SP_HOLD ? SP_PROGRAM_STANCE : SP_PROGRAM_REST;
}

void sp_gait_lifted(const sp_crawl *crawl, int32_t *lifted)
{
    sp_program_kind mode = sp_gait_mode(crawl);
    for (int leg = 0; leg < SP_LEGS; leg++)
        lifted[leg] = mode == SP_PROGRAM_STANCE ||
                      (mode != SP_PROGRAM_REST && crawl->gait.steps[crawl->gait.first].legs[leg]);
}

/* ---- targets ---- */

/* Joint angles for the torso at a share of its displacement and a height, with trim; returns 0 if out of reach. */
static int torso_angles(const sp_robot *robot, const sp_gait_memory *m, double share, double height, double *q)
{
    double feet[3 * SP_LEGS];
    sp_pose2 pose = arc(m->way, share);
    pose.x += m->trim[0], pose.y += m->trim[1], pose.yaw += m->trim[2];
    move_points(inverse(pose), m->feet_f, -height, feet);
    return sp_leg_angles(robot, feet, q);
}

/* The torso lies on the floor: set targets to the joint angles, and the floor's frame to the torso's pose. */
static void lie(sp_gait_memory *m)
{
    sp_copy(m->plan, m->joints, SP_JOINTS);
    sp_copy(m->target, m->joints, SP_JOINTS);
    sp_copy(m->floor_w, m->position_w, 3);
    sp_copy(m->floor_R, m->R_wb, 9);
}

/* Displacement to the step's target in floor axes: along a slope it is longer than its horizontal projection. */
static sp_pose2 way_to(const sp_gait_memory *m, const sp_step *step)
{
    sp_pose2 here = planar_pose(m->floor_w, m->floor_R), way = {0.0, 0.0, 0.0};
    if (!step->has_target) return way;
    const double *R = m->floor_R;
    double dx = step->target.x - here.x, dy = step->target.y - here.y, det = R[0] * R[4] - R[1] * R[3];
    way.x = (R[4] * dx - R[1] * dy) / det;
    way.y = (R[0] * dy - R[3] * dx) / det;
    way.yaw = wrapped(step->target.yaw - here.yaw);
    return way;
}

/* Compute the joint targets of the lifted legs. */
static void footsteps(const sp_robot *robot, sp_crawl *crawl, const sp_step *step, const sp_residual *residual)
{
    sp_gait_memory *m = &crawl->gait;
    const sp_gait_config *c = &crawl->config.gait;
    double landing[SP_JOINTS], angle = step->has_angle ? step->angle : c->raise_angle * residual->raise_scale;
    sp_pose2 way = arc(way_to(m, step), sp_max(0.0, residual->stride_scale));
    sp_copy(landing, m->plan, SP_JOINTS);
    if (step->has_target) {
        double feet[3 * SP_LEGS];
        while (length(way.x, way.y) + fabs(way.yaw) > 1e-6 && !sp_stride_fits(robot, c, crawl->home_b, way, c->lift_height))
            way = arc(way, SP_GAIT_SHORTEN);
        move_points(arc(way, centred(c) ? 0.5 : 1.0), crawl->home_b, -c->press, feet);
        sp_leg_angles(robot, feet, landing);
    }
    sp_copy(m->start, m->plan, SP_JOINTS);
    sp_copy(m->highest, landing, SP_JOINTS);
    for (int k = 1; k < SP_JOINTS; k += 4) m->highest[k] = sp_min(m->plan[k], landing[k]) - angle;
    for (int j = 0; j < SP_JOINTS; j++) m->landing[j] = step->legs[j / 4] ? landing[j] : m->plan[j];
}

/* Store where the feet stand, and compute the torso's displacement and lift. */
static void stance(const sp_robot *robot, sp_crawl *crawl, const sp_step *step, const sp_residual *residual)
{
    sp_gait_memory *m = &crawl->gait;
    double q[SP_JOINTS];
    m->way = arc(way_to(m, step), sp_max(0.0, residual->stride_scale));
    sp_feet_at(robot, m->joints, m->feet_f);
    m->share = m->height = m->yaw = 0.0;
    sp_zero(m->trim, 3);
    sp_zero(m->expected, 3);
    m->lift = (step->has_height ? step->height : crawl->config.gait.lift_height) * residual->lift_scale;
    while (m->lift > SP_GAIT_LEAST_LIFT && !torso_angles(robot, m, 1.0, m->lift, q)) m->lift *= SP_GAIT_SHORTEN;
    while (crawl->config.gait.corrections > 0 && length(m->way.x, m->way.y) + fabs(m->way.yaw) > 1e-6) {
        if (torso_angles(robot, m, 1.0, m->lift, q) && torso_angles(robot, m, 1.0, -crawl->config.gait.press, q)) break;
        m->way = arc(m->way, SP_GAIT_SHORTEN);
    }
    sp_copy(m->target, torso_angles(robot, m, 1.0, 0.0, q) ? q : m->plan, SP_JOINTS);
}

/* Whether the present cycle is the last one of all moves in the queue that follow each other. */
static int is_last(const sp_gait_memory *m)
{
    return m->count <= 1 || !m->steps[(m->first + 1) % SP_MAX_STEPS].has_target;
}

/* Return how far the torso has missed the goal of a move in its last cycle, half a radian is a metre [m]; 0 where it
 * has not, or no correction is left. */
static double missed(const sp_crawl *crawl)
{
    const sp_gait_memory *m = &crawl->gait;
    const sp_step *step = &m->steps[m->first];
    if (!step->has_target || m->corrected >= crawl->config.gait.corrections || !is_last(m)) return 0.0;
    sp_pose2 here = planar_pose(m->position_w, m->R_wb);
    double turn = fabs(wrapped(step->target.yaw - here.yaw));
    double distance = length(step->target.x - here.x, step->target.y - here.y);
    return distance > SP_GAIT_MISSED || turn > SP_GAIT_MISSED_TURN ? sp_max(distance, 0.5 * turn) : 0.0;
}

/* Begin a phase of the present step; after its last phase begin the next step, or finish. */
static void enter(const sp_robot *robot, sp_crawl *crawl, int index, const sp_residual *residual)
{
    sp_gait_memory *m = &crawl->gait;
    sp_step *step = step_at(m, 0);
    if (SP_STEP_PHASES[step->phases][index] < 0) {
        double miss = missed(crawl);
        index = 0;
        if (miss > 0.0) {
            m->corrected++;
            /* Feet that stand where they should move the torso over this distance without steps. */
            if (miss <= crawl->config.gait.trim_limit)
                while (SP_STEP_PHASES[step->phases][index] != SP_BRACE) index++;
        } else {
            m->corrected = 0;
            m->first = (m->first + 1) % SP_MAX_STEPS;
            m->count--;
        }
        if (m->count == 0) {
            m->phase = SP_DONE;
            m->index = 0;
            m->time = 0.0;
            return;
        }
        step = step_at(m, 0);
    }
    int phase = SP_STEP_PHASES[step->phases][index];
    if (phase == SP_SETTLE && crawl->config.gait.settle_time == 0.0 && m->count > 1) {
        enter(robot, crawl, index + 1, residual);
        return;
    }
    m->rested = m->phase == SP_DONE || m->phase == SP_SETTLE;
    m->phase = phase;
    m->index = index;
    m->time = m->still = 0.0;
    if (phase == SP_SPOOL || phase == SP_BRACE || phase == SP_SETTLE) lie(m);
    if (phase == SP_SPOOL) {
        footsteps(robot, crawl, step, residual);
    } else if (phase == SP_RAISE || phase == SP_SWING) {
        for (int j = 0; j < SP_JOINTS; j++) {
            int raised = j % 4 == 1 && step->legs[j / 4];
            if (phase == SP_RAISE) m->target[j] = raised ? m->highest[j] : m->plan[j];
            else if (!raised) m->target[j] = m->landing[j];
        }
    } else if (phase == SP_LOWER) {
        sp_copy(m->target, m->landing, SP_JOINTS);
    } else if (phase == SP_BRACE) {
        stance(robot, crawl, step, residual);
    }
}

/* ---- the ends of the phases ---- */

static int still(sp_gait_memory *m, int there, double duration, double dt)
{
    m->still = there ? m->still + dt : 0.0;
    return m->still >= duration - 1e-9;
}

/* Largest |a − b| over the joints of the lifted legs that `which` (a bit mask of 4) selects. */
static double farthest(const sp_step *step, const double *a, const double *b, int which)
{
    double most = 0.0;
    for (int j = 0; j < SP_JOINTS; j++)
        if (step->legs[j / 4] && which >> (j % 4) & 1) most = sp_max(most, fabs(a[j] - b[j]));
    return most;
}

/* Compute the expected minus the filtered planar pose of the torso; returns the absolute height error. */
static double pose_error(const sp_gait_memory *m, double *error)
{
    double d[3], seen[3];
    for (int i = 0; i < 3; i++) d[i] = m->position_w[i] - m->floor_w[i];
    sp_apply_t(m->floor_R, d, seen);
    error[0] = m->expected[0] - seen[0];
    error[1] = m->expected[1] - seen[1];
    error[2] = m->expected[2] - m->yaw;
    return fabs(m->height - seen[2]);
}

/* Whether corrections are left to do what the torso, at rest for `stall_time`, has not done. */
static int stalled(sp_crawl *crawl)
{
    sp_gait_memory *m = &crawl->gait;
    double away = 0.0;
    if (crawl->config.gait.corrections == 0) return 0;
    for (int i = 0; i < 3; i++) away = sp_max(away, fabs(m->position_w[i] - m->slow_w[i]));
    return still(m, away < SP_GAIT_AGREE, crawl->config.gait.stall_time, crawl->dt);
}

static int ended(sp_crawl *crawl, double joint_rate)
{
    sp_gait_memory *m = &crawl->gait;
    const sp_gait_config *c = &crawl->config.gait;
    const sp_step *step = step_at(m, 0);
    double error[3], depth, spool = m->rested ? c->start_time : c->spool_time, dt = crawl->dt;
    int quiet = joint_rate < SP_GAIT_STILL;
    switch (m->phase) {
    case SP_SPOOL:
    case SP_BRACE: return m->time >= spool - 1e-9;
    case SP_SETTLE: return m->time >= c->settle_time - 1e-9;
    case SP_HOLD: return m->time >= step->seconds - 1e-9;
    case SP_RAISE: {
        double least = HUGE_VAL;
        for (int leg = 0; leg < SP_LEGS; leg++) {
            int k = 4 * leg + 1;
            if (!step->legs[leg]) continue;
            least = sp_min(least, (m->start[k] - m->plan[k]) / sp_max(m->start[k] - m->highest[k], 1e-6));
        }
        if (least < c->swing_at - 1e-6) return 0;
        if (c->swing_at < 1.0 || farthest(step, m->joints, m->highest, 2) <= SP_GAIT_NEAR) return 1;
        return still(m, quiet, c->stall_time, dt);
    }
    case SP_SWING:
        if (farthest(step, m->plan, m->landing, 9) > c->lower_at) return 0;
        if (farthest(step, m->joints, m->landing, 9) <= c->lower_at) return 1;
        return still(m, quiet, c->stall_time, dt);
    case SP_LOWER: {
        double off = 0.0;
        for (int j = 0; j < SP_JOINTS; j++) off = sp_max(off, fabs(m->plan[j] - m->landing[j]));
        int there = off < 1e-9 && farthest(step, m->joints, m->landing, 2) < 3.0 * SP_GAIT_NEAR;
        if (there && !quiet && c->corrections > 0) {
            m->still += SP_GAIT_SWINGING * dt;
            return m->still >= c->leg_touch_time - 1e-9;
        }
        return still(m, there && quiet, c->leg_touch_time, dt);
    }
    case SP_UP: return m->height >= c->forward_at * m->lift - 1e-9;
    case SP_FORWARD: {
        if (m->share < c->down_at - 1e-9) return 0;
        pose_error(m, error);
        sp_pose2 wanted = arc(m->way, m->share); /* ahead of the torso, which would be lowered short of the goal */
        int ahead = c->corrections > 0 && is_last(m) &&
                    length(wanted.x - m->expected[0], wanted.y - m->expected[1]) > c->arrival;
        /* An error beyond the trim remains for the next cycle. */
        return (length(error[0], error[1]) <= c->arrival && fabs(error[2]) <= c->arrival && !ahead) ||
               c->down_at < 1.0 || m->time >= 0.5 * c->timeout || stalled(crawl);
    }
    case SP_DOWN: {
        double d[3], up[3] = {m->floor_R[2], m->floor_R[5], m->floor_R[8]};
        depth = pose_error(m, error);
        for (int i = 0; i < 3; i++) d[i] = m->position_w[i] - m->slow_w[i];
        int planned = m->height <= -c->press + 1e-9 && m->share >= 1.0;
        if (!planned && c->corrections > 0) return stalled(crawl);
        return still(m, planned && fabs(sp_dot(d, up)) < SP_GAIT_AGREE && depth < SP_GAIT_MAX_DEPTH,
                     c->torso_touch_time, dt);
    }
    default: return 0;
    }
}

/* ---- motion of the torso ---- */

/* Move the contact points: a leg that turns down by an angle rolls its ball outwards by radius × angle. */
static void roll(const sp_robot *robot, sp_gait_memory *m, const double *before)
{
    double turned = arc(m->way, m->share).yaw;
    for (int leg = 0; leg < SP_LEGS; leg++) {
        int k = 4 * leg;
        double turn = m->plan[k + 1] - before[k + 1] + (m->plan[k + 3] - before[k + 3]);
        double out = robot->foot_radius * turn, heading = azimuth(leg) + m->plan[k] + turned;
        m->feet_f[3 * leg] += out * cos(heading);
        m->feet_f[3 * leg + 1] += out * sin(heading);
    }
}

/* Advance the torso's plan as fast as the joint speed allows. */
static void push(const sp_robot *robot, sp_crawl *crawl, double speed)
{
    sp_gait_memory *m = &crawl->gait;
    const sp_gait_config *c = &crawl->config.gait;
    double now[SP_JOINTS], ahead[SP_JOINTS], wanted[SP_JOINTS], before[SP_JOINTS], step_reach = speed * crawl->dt;
    double distance = sp_max(sp_max(length(m->way.x, m->way.y), 0.5 * fabs(m->way.yaw)), 1e-6);
    double goal_height = m->phase == SP_BRACE ? 0.0 : m->phase == SP_DOWN ? -c->press : m->lift;
    double goal_share = m->phase == SP_FORWARD || m->phase == SP_DOWN ? 1.0 : m->share;
    double climb = goal_height - m->height, advance = (goal_share - m->share) * distance;
    double longest = sp_max(fabs(climb), fabs(advance));
    if (torso_angles(robot, m, m->share, m->height, now) && longest > 0.0) {
        /* A trial step measures how far the joints turn; the step is then as long as the joint speed allows. */
        double trial = sp_min(longest, SP_GAIT_TRIAL), turn = 1e-9;
        if (torso_angles(robot, m, m->share + sp_clip(advance, -trial, trial) / distance,
                         m->height + sp_clip(climb, -trial, trial), ahead)) {
            double most = 0.0;
            for (int j = 0; j < SP_JOINTS; j++) most = sp_max(most, fabs(ahead[j] - now[j]));
            turn = sp_max(most, turn);
            double step = sp_min(longest, trial * step_reach / turn);
            m->height += sp_clip(climb, -step, step);
            m->share += sp_clip(advance, -step, step) / distance;
            if (fabs(climb) <= step) m->height = goal_height;
            if (fabs(advance) <= step) m->share = goal_share;
        }
    }
    if (!torso_angles(robot, m, m->share, m->height, wanted)) return;
    sp_copy(before, m->plan, SP_JOINTS);
    for (int j = 0; j < SP_JOINTS; j++) m->plan[j] = before[j] + sp_clip(wanted[j] - before[j], -step_reach, step_reach);
    if (c->rolling) roll(robot, m, before);
}

/* Filter the torso's yaw, and update the expected value of its filtered pose. */
static void track(sp_crawl *crawl)
{
    sp_gait_memory *m = &crawl->gait;
    double turned[9], share = 1.0 - exp(-crawl->dt / SP_GAIT_RESPONSE_TIME);
    sp_product_t(m->floor_R, m->R_wb, turned);
    m->yaw += (1.0 - exp(-crawl->dt / SP_GAIT_FILTER_TIME)) * (atan2(turned[3], turned[0]) - m->yaw);
    sp_pose2 wanted = arc(m->way, m->share);
    double pose[3] = {wanted.x, wanted.y, wanted.yaw};
    for (int i = 0; i < 3; i++) m->expected[i] += share * (pose[i] - m->expected[i]);
}

/* Integrate the trim: feet are balls that roll when legs turn, so the torso moves less than the kinematics predict. */
static void trim(sp_crawl *crawl)
{
    sp_gait_memory *m = &crawl->gait;
    const sp_gait_config *c = &crawl->config.gait;
    double error[3], limits[3] = {c->trim_limit, c->trim_limit, 2.0 * c->trim_limit};
    if (m->phase != SP_FORWARD || c->trim_gain == 0.0) return;
    pose_error(m, error);
    for (int i = 0; i < 3; i++)
        m->trim[i] = sp_clip(m->trim[i] + c->trim_gain * crawl->dt * error[i], -limits[i], limits[i]);
}

/* Reset: the robot lies on the floor, without commands. */
void sp_gait_reset(sp_crawl *crawl, const double *position_w, const double *R_wb, const double *q)
{
    sp_gait_memory *m = &crawl->gait;
    memset(m, 0, sizeof *m);
    sp_copy(m->plan, q, SP_JOINTS);
    sp_copy(m->joints, q, SP_JOINTS);
    sp_copy(m->position_w, position_w, 3);
    sp_copy(m->slow_w, position_w, 3);
    sp_copy(m->R_wb, R_wb, 9);
    m->phase = SP_DONE;
    m->rested = 1;
    m->planned = planar_pose(position_w, R_wb);
    lie(m);
}

/* One tick: compute the joint setpoints `plan`. */
void sp_gait_step(const sp_robot *robot, sp_crawl *crawl, const double *position_w, const double *R_wb, const double *q,
                  const sp_residual *residual, double *plan)
{
    sp_gait_memory *m = &crawl->gait;
    const sp_gait_config *c = &crawl->config.gait;
    double dt = crawl->dt, rate = 0.0;
    double share = 1.0 - exp(-dt / SP_GAIT_FILTER_TIME), slow = 1.0 - exp(-dt / SP_GAIT_SLOW_TIME);
    for (int j = 0; j < SP_JOINTS; j++) {
        double turn = share * (q[j] - m->joints[j]);
        m->joints[j] += turn;
        rate = sp_max(rate, fabs(turn));
    }
    sp_copy(m->R_wb, R_wb, 9);
    for (int i = 0; i < 3; i++) {
        m->position_w[i] += share * (position_w[i] - m->position_w[i]);
        m->slow_w[i] += slow * (position_w[i] - m->slow_w[i]);
    }
    m->time += dt;
    if (m->phase == SP_DONE && m->count > 0) enter(robot, crawl, 0, residual);
    if (m->phase != SP_DONE) {
        double speed = crawl->config.joint_speed * sp_max(0.0, residual->joint_speed_scale);
        if (on_feet(m->phase) || (m->phase == SP_HOLD && sp_gait_mode(crawl) == SP_PROGRAM_STANCE)) {
            track(crawl);
            trim(crawl);
            push(robot, crawl, speed);
        } else if (legs_up(m->phase) || m->phase == SP_HOLD) {
            for (int j = 0; j < SP_JOINTS; j++)
                m->plan[j] += sp_clip(m->target[j] - m->plan[j], -speed * dt, speed * dt);
        }
        int over = ended(crawl, rate / dt);
        if (!over && m->time >= c->timeout && m->phase != SP_HOLD && m->phase != SP_SPOOL && m->phase != SP_BRACE &&
            m->phase != SP_SETTLE) {
            m->timeouts++;
            over = 1;
        }
        if (over) enter(robot, crawl, m->index + 1, residual);
    }
    sp_copy(plan, m->plan, SP_JOINTS);
}
