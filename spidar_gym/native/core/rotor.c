/* Vectoring geometry: force ↔ (λ, φ, θ), the branch nearest to the present angles, the lock near a vertical link. */
#include "spidar_core.h"
#include "spidar_math.h"

/* Python's a % b for b > 0. */
static double modulo(double a, double b)
{
    double r = fmod(a, b);
    return r < 0.0 ? r + b : r;
}

/* Largest thrust of a module [N] at a voltage of the battery under load [V]: 31.8 N at 22.2 V, 40.5 N at 25.2 V [JSK]. */
double sp_battery_thrust(double voltage)
{
    return sp_max(0.0, SP_BATTERY_THRUST + SP_THRUST_PER_VOLT * (voltage - SP_BATTERY_VOLTAGE));
}

/* f = λ (sin θ, −sin φ cos θ, cos φ cos θ) [Zhao2025, Eq. 1]. */
void sp_vectoring_to_force(const double *thrust, const double *vectoring, double *forces_l)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double phi = vectoring[2 * i], theta = vectoring[2 * i + 1], c = cos(theta);
        forces_l[3 * i] = thrust[i] * sin(theta);
        forces_l[3 * i + 1] = thrust[i] * (-sin(phi) * c);
        forces_l[3 * i + 2] = thrust[i] * (cos(phi) * c);
    }
}

/* Q: forces in link axes → wrench in {CoG} [Zhao2025, Eq. 2]. */
void sp_thrust_map(const sp_snapshot *s, double *Q, int stride)
{
    for (int i = 0; i < SP_ROTORS; i++)
        for (int k = 0; k < 3; k++) {
            double column[3] = {s->R_bl[i][k], s->R_bl[i][3 + k], s->R_bl[i][6 + k]}, torque[3];
            sp_cross(s->rotor_c[i], column, torque);
            for (int r = 0; r < 3; r++) {
                Q[stride * r + 3 * i + k] = column[r];
                Q[stride * (3 + r) + 3 * i + k] = torque[r];
            }
        }
}

/* T: Σ J_rᵀ f of forces in link axes, the thrust's share of [Zhao2025, Eq. 5]. */
void sp_torque_map(const sp_snapshot *s, double *T, int stride)
{
    for (int i = 0; i < SP_ROTORS; i++)
        for (int j = 0; j < SP_JOINTS; j++)
            for (int k = 0; k < 3; k++) {
                double sum = 0.0;
                for (int r = 0; r < 3; r++) sum += s->R_bl[i][3 * r + k] * s->J_rotor[i][SP_JOINTS * r + j];
                T[stride * j + 3 * i + k] = sum;
            }
}

/* Angles (φ, θ) that point a module along its force [Zhao2025, Eq. 15, 16]; `held` is the locked φ, or NULL. */
void sp_point(const double *f, double phi0, double theta0, const double *held, double min_force, double *angles)
{
    double phi, along;
    if (held == NULL) {
        phi = atan2(-f[1], f[2]);
        along = sqrt(f[1] * f[1] + f[2] * f[2]);
    } else {
        phi = *held;
        along = -f[1] * sin(phi) + f[2] * cos(phi);
    }
    if (f[0] * f[0] + along * along < min_force * min_force) {
        angles[0] = held == NULL ? phi0 : *held;
        angles[1] = theta0;
        return;
    }
    double theta = atan2(f[0], along), way;
    if (held == NULL) {
        way = phi - phi0;
        if (fabs(way) > SP_HALF_PI) {
            double turns = rint(way / SP_PI);
            phi -= SP_PI * turns;
            if (fmod(fabs(turns), 2.0) != 0.0) theta = SP_PI - theta;
        }
    }
    way = theta - theta0;
    if (!(way >= -SP_PI && way <= SP_PI)) theta -= SP_TWO_PI * rint(way / SP_TWO_PI);
    angles[0] = phi;
    angles[1] = theta;
}

/* Angles (φ̂, θ̂) that point each rotor along the torso's z axis [Zhao2025, Sec. Interrotor Aerointerference]. */
void sp_nominal_vectoring(const sp_snapshot *s, const double *present, double *nominal)
{
    for (int i = 0; i < SP_ROTORS; i++)
        sp_point(s->R_bl[i] + 6, present[2 * i], present[2 * i + 1], NULL, 0.0, nominal + 2 * i);
}

/* Target of φ for a rotor near a vertical link: towards the plane that is tangential about the CoG. */
static double vertical_target(const sp_snapshot *s, int i, double phi_hat, double held, double up,
                              const sp_lock_config *config)
{
    double x = s->rotor_c[i][0], y = s->rotor_c[i][1];
    double y_x = s->R_bl[i][1], z_x = s->R_bl[i][2], y_y = s->R_bl[i][4], z_y = s->R_bl[i][5];
    double tangential = atan2(y_x * y - y_y * x, z_y * x - z_x * y), lean = acos(sp_min(1.0, fabs(up)));
    double bias = i / 2 % 2 == 0 ? SP_TURN_BIAS : -SP_TURN_BIAS;
    if (lean < 0.5 * config->leave) {
        double off = modulo(held - tangential + SP_HALF_PI + bias, SP_PI) - SP_HALF_PI - bias;
        double room = SP_HALF_PI - config->most;
        return held + sp_max(-room, sp_min(room, off)) - off;
    }
    double weight = sp_max(0.0, 1.0 - lean / config->leave), way = modulo(tangential - phi_hat, SP_PI);
    double back = SP_PI - way;
    double forward = phi_hat + sp_min(sp_min(way, config->most), sp_max(config->least, weight * way));
    double backward = phi_hat - sp_min(sp_min(back, config->most), sp_max(config->least, weight * back));
    return fabs(backward - held) + bias < fabs(forward - held) ? backward : forward;
}

/* Advance the lock of φ by one tick; `present` are the angles last commanded. */
void sp_update_lock(const sp_lock *previous, const int32_t *restricted, const double *nominal, const sp_snapshot *s,
                    const double *present, const sp_lock_config *config, sp_lock *lock)
{
    double enter = cos(config->enter), leave = cos(config->leave), slew = config->slew;
    sp_lock next;
    for (int i = 0; i < SP_ROTORS; i++) {
        double up = s->R_bl[i][6], held = previous->active[i] ? previous->phi[i] : present[2 * i];
        double target = nominal[2 * i];
        int upright = fabs(up) > (previous->vertical[i] ? leave : enter);
        if (upright) target = restricted[i] ? held : vertical_target(s, i, target, held, up, config);
        double rest = target - held; /* to the nearest of target + kπ: both branches lie in the same plane */
        if (fabs(rest) > SP_HALF_PI) rest -= SP_PI * rint(rest / SP_PI);
        int active = upright || restricted[i] || (previous->active[i] && fabs(rest) > config->release);
        if (active) held += sp_clip(rest, -slew, slew);
        next.vertical[i] = upright;
        next.active[i] = active;
        next.phi[i] = held;
    }
    *lock = next;
}

/* Angles for the forces: φ is held if locked, and no angle moves by more than `step` from the present one. */
void sp_follow(const double *forces_l, const sp_lock *lock, const double *present, double step, double *vectoring)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double angles[2];
        sp_point(forces_l + 3 * i, present[2 * i], present[2 * i + 1], lock->active[i] ? &lock->phi[i] : NULL,
                 SP_MIN_FORCE, angles);
        for (int k = 0; k < 2; k++) {
            double from = present[2 * i + k];
            vectoring[2 * i + k] = from + sp_clip(angles[k] - from, -step, step);
        }
    }
}

/* λ, φ and θ of a module whose thrust is a force in torso axes. Of the two pairs (φ, θ), the one with φ closer to the
 * last is used. φ, which is undefined for a thrust along its axis, is that of the force plus SP_AIM_HOLD times its length
 * along the last φ. `sine` and `cosine` are those of the last φ. */
void sp_aim(const double *R_bl, const double *force_b, double sine, double cosine, double *thrust, double *angles)
{
    double f[3];
    sp_apply_t(R_bl, force_b, f);
    double held = SP_AIM_HOLD * sp_norm(f), side = cosine * f[2] - sine * f[1] < 0.0 ? -1.0 : 1.0;
    angles[0] = atan2(held * sine - side * f[1], held * cosine + side * f[2]);
    double along = cos(angles[0]) * f[2] - sin(angles[0]) * f[1];
    *thrust = hypot(f[0], along);
    angles[1] = atan2(f[0], along);
}

/* Turn an angle the short way to the wanted one. */
static double turned(double angle, double wanted) { return angle + (modulo(wanted - angle + SP_PI, SP_TWO_PI) - SP_PI); }

/* Convert an action in torso axes, scaled by `authority` to [N] and [rad], to thrusts, vectoring angles and `offset`.
 * Its first 24 entries are forces of the rotors beyond an equal part of `trim` times the weight; more entries, if any,
 * are offsets of the joints. `R_bl` has the links' attitudes. Updates the controller's memory (vectoring, forces). */
void sp_act_in_torso_axes(const double *action, const double *authority, int size, double trim,
                          const double *R_bl, const sp_robot *robot, double *vectoring, double *forces_l, double *offset,
                          sp_command *command)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double f[3], *angle = vectoring + 2 * i, aimed[2], thrust;
        for (int k = 0; k < 3; k++) f[k] = authority[3 * i + k] * action[3 * i + k];
        f[2] += trim * robot->weight / SP_ROTORS;
        sp_aim(R_bl + 9 * i, f, sin(angle[0]), cos(angle[0]), &thrust, aimed);
        if (!(thrust < SP_MIN_FORCE))
            for (int k = 0; k < 2; k++) angle[k] = turned(angle[k], aimed[k]);
        command->thrust[i] = sp_min(thrust, robot->max_thrust);
    }
    sp_copy(command->vectoring, vectoring, 2 * SP_ROTORS);
    sp_vectoring_to_force(command->thrust, vectoring, forces_l);
    for (int j = 0; j < SP_JOINTS; j++) {
        int k = SP_FORCES + j;
        offset[j] = k < size ? authority[k] * action[k] : 0.0;
    }
}

/* Command joint angles, slewed by the servos. Updates the controller's memory with the joints' speed-limited motion
 * within this tick, and `joint_velocity`, if not NULL, with its rate. */
void sp_command_joints(const double *target, const sp_robot *robot, double joint_speed, double *joints,
                       double *joint_velocity, sp_command *command)
{
    double reach = joint_speed / SP_CONTROL_RATE;
    for (int j = 0; j < SP_JOINTS; j++) {
        command->joint_position[j] = sp_clip(target[j], -robot->joint_limit, robot->joint_limit);
        command->joint_torque_limit[j] = robot->max_joint_torque;
        double step = sp_min(sp_max(command->joint_position[j] - joints[j], -reach), reach);
        joints[j] += step;
        if (joint_velocity != NULL) joint_velocity[j] = step * SP_CONTROL_RATE;
    }
}

/* Convert a direct action to a command, without a controller. Updates the controller's memory (vectoring, forces,
 * joints) with the joints' speed-limited motion within this tick, and `joint_velocity`, if not NULL, with its rate. */
void sp_act_directly(const double *action, const sp_robot *robot, double joint_speed, double *vectoring,
                     double *forces_l, double *joints, double *joint_velocity, sp_command *command)
{
    double target[SP_JOINTS];
    for (int i = 0; i < SP_ROTORS; i++) {
        command->thrust[i] = 0.5 * robot->max_thrust * (1.0 + action[i]);
        for (int k = 0; k < 2; k++) {
            double *angle = vectoring + 2 * i + k;
            *angle = turned(*angle, SP_PI * action[SP_ROTORS * (1 + k) + i]);
            command->vectoring[2 * i + k] = *angle;
        }
    }
    for (int j = 0; j < SP_JOINTS; j++) target[j] = robot->joint_limit * action[3 * SP_ROTORS + j];
    sp_command_joints(target, robot, joint_speed, joints, joint_velocity, command);
    sp_vectoring_to_force(command->thrust, vectoring, forces_l);
}
