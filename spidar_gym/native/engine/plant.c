/* One simulated robot: the physics steps of a control period, and what happens between them.
 *
 * Delayed commands arrive at 400 Hz at most; the air is evaluated at 40 Hz, falling thrusts and the joints' play at
 * 80 Hz, the vectoring axes' play at 400 Hz, the sensors at 200 Hz. This order is also that of the draws; loss and
 * jitter of a command are drawn before them.
 */
#include "engine.h"

#define RANGE 2                  /* numbers of an actuator's limits */
#define GAINS 10                 /* numbers of an actuator's dynamics and bias each */
#define FIRST_GIMBAL (SP_ROTORS + SP_JOINTS)

static double gain(const sp_plant *p, int rotor)
{
    return p->config.actuators.thrust_gain * p->config.actuators.module_gain[rotor];
}

/* True minus indicated value of an actuator. */
static double offset(const sp_plant *p, int actuator)
{
    if (actuator < SP_ROTORS) return 0.0;
    if (actuator < FIRST_GIMBAL) return p->config.actuators.joint_offset[actuator - SP_ROTORS];
    return p->config.actuators.vectoring_offset[actuator - FIRST_GIMBAL];
}

/* ---- the robot in MuJoCo's model and data ---- */

/* Apply a configuration to the model and to the robot's record. */
void sp_configure(const sp_world *world, const sp_sim *sim, const sp_plant_config *config, sp_plant *p)
{
    const sp_ground_config *ground = &config->ground;
    double tilt[3] = {ground->slope * sin(ground->heading), -ground->slope * cos(ground->heading), 0.0};
    p->config = *config;
    sp_exp(tilt, p->floor_R);
    p->highest_tile = 0.0;
    for (int k = 0; k < SP_TILES * SP_TILES; k++) p->highest_tile = sp_max(p->highest_tile, ground->tiles[k]);
    p->delay = (int64_t)rint(config->actuators.delay / SP_TIMESTEP);
    p->vectoring_delay = p->delay + (int64_t)rint(config->actuators.vectoring_delay / SP_TIMESTEP);
    sp_write_actuators(world, &config->actuators, config->joint_speed, sim);
    sp_write_body(world, &config->body, sim);
    sp_lay_floor(world, ground, sim);
    sp_write_object(world, &config->object, sim);
    sim->mujoco->set_const(sim->model, sim->data); /* what MuJoCo derives from the masses; the data is overwritten */
}

/* Write the lag of thrusts and the play of joints, which depend on the direction, into the model. Inside its play a
 * servo's spring exerts no torque; outside, the spring starts at the edge of the play. */
static void write_asymmetry(const sp_sim *sim, const sp_plant *p)
{
    const sp_actuator_config *c = &p->config.actuators;
    if (c->spin_down != 1.0)
        for (int i = 0; i < SP_ROTORS; i++)
            sim->actuator_dynprm[GAINS * i] = c->thrust_lag * (p->falling[i] ? c->spin_down : 1.0);
    if (c->backlash > 0.0)
        for (int j = 0; j < SP_JOINTS; j++)
            sim->actuator_biasprm[GAINS * (SP_ROTORS + j)] = -(c->joint_kp * c->servo_stiffness[j]) * p->loose[j];
}

/* Write play and dry friction of the vectoring axes into the model, for the next physics step. In the
 * play, spring and damping exert no torque. The friction is a stiff spring between the axis and the angle at which it
 * sticks, which the axis drags along once the spring carries the friction; with friction the damping acts in the play too,
 * because the axis would otherwise oscillate on that spring. A friction constraint of MuJoCo's would double the time of a
 * step. */
static void write_play(const sp_world *world, const sp_sim *sim, sp_plant *p)
{
    const sp_actuator_config *c = &p->config.actuators;
    double play = c->vectoring_backlash, friction = c->vectoring_friction, way = friction / SP_STICKING;
    if (!(play > 0.0 || friction > 0.0)) return;
    for (int k = 0; k < 2 * SP_ROTORS; k++) {
        double *bias = sim->actuator_biasprm + GAINS * (FIRST_GIMBAL + k), q = sim->qpos[world->joint_qpos[SP_JOINTS + k]];
        double gap = sim->act[FIRST_GIMBAL + k] - q;
        bias[0] = play > 0.0 ? -c->vectoring_kp * sp_clip(gap, -play, play) : 0.0;
        bias[2] = fabs(gap) >= play || friction > 0.0 ? -world->vectoring_kd : 0.0;
        if (!(friction > 0.0)) continue;
        p->sticks[k] = sp_clip(p->sticks[k], q - way, q + way);
        bias[0] += SP_STICKING * (p->sticks[k] - q);
    }
}

static void limit_torque(const sp_sim *sim, sp_plant *p, const double *limit)
{
    for (int j = 0; j < SP_JOINTS; j++) {
        double *range = sim->actuator_forcerange + RANGE * (SP_ROTORS + j);
        p->torque_limit[j] = limit[j];
        range[1] = sp_min(limit[j], p->config.actuators.max_joint_torque);
        range[0] = -range[1];
    }
}

/* Load a robot into a thread's simulation, whose model has its configuration. */
void sp_enter(const sp_world *world, const sp_sim *sim, sp_plant *p)
{
    sim->mujoco->set_state(sim->model, sim->data, p->row, (int)sim->mujoco->state_kind);
    limit_torque(sim, p, p->torque_limit);
    write_asymmetry(sim, p);
    write_play(world, sim, p);
}

/* Store the state of a loaded robot. */
void sp_leave(const sp_sim *sim, sp_plant *p)
{
    sim->mujoco->get_state(sim->model, sim->data, p->row, (int)sim->mujoco->state_kind);
}

/* Whether the state of a loaded robot is finite. A NaN never disappears again, and MuJoCo's contact detection takes a
 * second with one. */
int sp_is_somewhere(const sp_world *world, const sp_sim *sim)
{
    int more = world->object >= 0;
    return sp_finite(sim->qpos, SP_QPOS + 7 * more) && sp_finite(sim->qvel, SP_DOFS + 6 * more);
}

/* ---- reading the state ---- */

static void read_state(const sp_world *world, const sp_sim *sim, const sp_plant *p, sp_robot_state *s)
{
    s->time = *sim->time;
    sp_copy(s->position_w, sim->qpos, 3);
    sp_copy(s->quat_wb, sim->qpos + 3, 4);
    sp_copy(s->velocity_w, sim->qvel, 3);
    sp_copy(s->omega_b, sim->qvel + 3, 3);
    for (int j = 0; j < SP_JOINTS; j++) {
        s->joint_position[j] = sim->qpos[world->joint_qpos[j]];
        s->joint_velocity[j] = sim->qvel[world->joint_dof[j]];
        s->vectoring[j] = sim->qpos[world->joint_qpos[SP_JOINTS + j]];
        s->vectoring_velocity[j] = sim->qvel[world->joint_dof[SP_JOINTS + j]];
        s->joint_torque[j] = sim->actuator_force[SP_ROTORS + j];
    }
    for (int i = 0; i < SP_ROTORS; i++) s->thrust[i] = sim->act[i] * gain(p, i);
}

static double power(const sp_sim *sim, const sp_robot_state *s)
{
    return sp_electrical_power(sim->act, s->joint_torque, s->joint_velocity);
}

/* ---- what happens between physics steps ---- */

/* Apply the commands whose delay is over. */
static void deliver(const sp_sim *sim, sp_plant *p)
{
    for (int k = 0; k < p->pending_count; k++) {
        const sp_pending *command = &p->pending[(p->pending_first + k) % SP_MAX_PENDING];
        if (command->due <= p->clock) sp_copy(sim->ctrl, command->target, FIRST_GIMBAL);
        if (command->vectoring_due <= p->clock)
            sp_copy(sim->ctrl + FIRST_GIMBAL, command->target + FIRST_GIMBAL, 2 * SP_ROTORS);
    }
    while (p->pending_count && p->pending[p->pending_first].vectoring_due <= p->clock) {
        p->pending_first = (p->pending_first + 1) % SP_MAX_PENDING;
        p->pending_count--;
    }
    /* A failed vectoring servo holds its angle, whatever the command. */
    if (p->is_stuck) sp_copy(sim->ctrl + FIRST_GIMBAL + 2 * (p->disturbances.lost_rotor - 1), p->stuck, 2);
}

/* Advance noise, wind, pushes and recirculation, and evaluate the air. */
static void blow(const sp_world *world, const sp_sim *sim, sp_plant *p, sp_air *air)
{
    const sp_actuator_config *c = &p->config.actuators;
    const sp_disturbances *d = &p->disturbances;
    double dt = SP_AIR_STEPS * SP_TIMESTEP, thrust[SP_ROTORS], wind_w[3];
    if (c->thrust_noise > 0.0) sp_advance_noise(p->noise, c->thrust_noise, dt, &p->generator);
    if (d->wind > 0.0 || d->push > 0.0) sp_advance_weather(d, *sim->time, dt, &p->generator, &p->weather);
    for (int i = 0; i < SP_ROTORS; i++) thrust[i] = sim->act[i] * gain(p, i);
    for (int i = 0; i < 3; i++) wind_w[i] = p->weather.mean_w[i] + p->weather.gust_w[i];
    int recirculates = sp_recirculates(&p->config.recirculation);
    if (recirculates) sp_advance_eddy(&p->config.recirculation, dt, &p->generator, p->eddy);
    sp_evaluate_air(world, sim, &p->config.aero, &p->config.recirculation, &p->config.object, thrust, wind_w, p->noise,
                    p->weather.push_w, recirculates ? p->eddy : NULL, air);
    sp_copy(sim->qfrc_applied, air->generalized, SP_DOFS);
    if (world->object < 0) return;
    sp_copy(sim->qfrc_applied + SP_DOFS, air->object_force_w, 3);
    sp_apply_t(sim->xmat + 9 * world->object, air->object_torque_w, sim->qfrc_applied + SP_DOFS + 3);
    sp_copy(p->object.air_force_w, air->object_force_w, 3);
    sp_copy(p->object.air_torque_w, air->object_torque_w, 3);
}

static void keep_air(const sp_air *air, sp_plant *p)
{
    sp_copy(p->air_force_w, air->generalized, 3);
    sp_copy(p->air_factor, air->thrust_factor, SP_DUCTS);
}

/* Update which thrusts fall and where each joint is in its play. */
static void lean(const sp_world *world, const sp_sim *sim, sp_plant *p)
{
    double play = p->config.actuators.backlash;
    for (int i = 0; i < SP_ROTORS; i++) p->falling[i] = sim->ctrl[i] < sim->act[i];
    for (int j = 0; j < SP_JOINTS; j++)
        p->loose[j] = sp_clip(sim->act[SP_ROTORS + j] - sim->qpos[world->joint_qpos[j]], -play, play);
    write_asymmetry(sim, p);
}

static int is_asymmetric(const sp_actuator_config *c) { return c->backlash > 0.0 || c->spin_down != 1.0; }

/* Write true minus indicated angles. */
static void sensor_offsets(const sp_plant *p, double *offsets)
{
    for (int j = 0; j < SP_ANGLES; j++) offsets[j] = offset(p, SP_ROTORS + j);
}

static void sample(const sp_world *world, const sp_sim *sim, sp_plant *p)
{
    sp_robot_state state;
    double offsets[SP_ANGLES];
    read_state(world, sim, p, &state);
    sensor_offsets(p, offsets);
    sp_sample_sensors(world, &p->config.sensors, offsets, &state, &p->generator, &p->sensors);
}

/* ---- a control period ---- */

/* Write the thrusts of a command, limited to what board and modules deliver at the present voltage. */
static void limit_thrust(const sp_world *world, const double *thrust, const sp_plant *p, double *target)
{
    const sp_actuator_config *c = &p->config.actuators;
    double most = c->max_thrust, largest = 0.0, share = 1.0;
    if (c->battery) most = sp_min(most, world->battery_share * sp_battery_thrust(sp_voltage(p->spent_wh + p->energy_wh, p->power)));
    for (int i = 0; i < SP_ROTORS; i++) largest = sp_max(largest, thrust[i]);
    if (c->board_scaling && largest > most) share = most / largest;
    for (int i = 0; i < SP_ROTORS; i++) {
        target[i] = sp_min(share * thrust[i], most / gain(p, i));
        if (p->config.idle_thrust > 0.0) target[i] = sp_max(target[i], p->config.idle_thrust);
    }
}

/* Queue a command for the actuators, unless it is lost. */
static void dispatch(const sp_world *world, const sp_sim *sim, const sp_command *command, sp_plant *p)
{
    const sp_actuator_config *c = &p->config.actuators;
    const sp_disturbances *d = &p->disturbances;
    sp_pending *sent = &p->pending[(p->pending_first + p->pending_count) % SP_MAX_PENDING];
    double *target = sent->target;
    int lost = c->loss > 0.0 && sp_random(&p->generator) < c->loss;
    int64_t late = c->jitter > 0.0 ? (int64_t)rint(sp_uniform(&p->generator, 0.0, c->jitter) / SP_TIMESTEP) : 0;
    limit_thrust(world, command->thrust, p, target);
    sp_copy(target + SP_ROTORS, command->joint_position, SP_JOINTS);
    sp_copy(target + FIRST_GIMBAL, command->vectoring, 2 * SP_ROTORS);
    if (d->lost_rotor && *sim->time >= d->fault_time - 1e-9) {
        int k = d->lost_rotor - 1;
        if (d->fault == SP_DISTURBANCES_FAULT_THRUST) {
            target[k] = 0.0;
        } else if (!p->is_stuck) {
            p->is_stuck = 1;
            for (int i = 0; i < 2; i++) p->stuck[i] = sim->qpos[world->joint_qpos[SP_JOINTS + 2 * k + i]];
        }
    }
    for (int k = 0; k < SP_ACTUATORS; k++) target[k] += offset(p, k);
    sent->due = p->clock + p->delay + late;
    if (p->pending_count) { /* no command overtakes the one before it */
        int64_t before = p->pending[(p->pending_first + p->pending_count - 1) % SP_MAX_PENDING].due;
        if (sent->due < before) sent->due = before;
    }
    sent->vectoring_due = sent->due + p->vectoring_delay - p->delay;
    if (!lost) p->pending_count++;
    deliver(sim, p);
    if (!lost && memcmp(command->joint_torque_limit, p->torque_limit, sizeof p->torque_limit))
        limit_torque(sim, p, command->joint_torque_limit);
}

/* Return the violated constraints of a loaded robot whose state has been read, as bits of sp_constraint. */
static int32_t violations(const sp_world *world, const sp_sim *sim, const sp_plant *p)
{
    int32_t bits = 0;
    for (int k = 0; k < *sim->contacts; k++) bits |= sp_violates(world, sim, k);
    for (int j = 0; j < SP_JOINTS; j++) {
        double limit = sp_min(p->torque_limit[j], p->config.actuators.max_joint_torque);
        if (fabs(p->state.joint_torque[j]) >= limit - SP_AT_LIMIT) bits |= SP_VIOLATED_TORQUE;
    }
    for (int i = 0; i < SP_ROTORS; i++)
        if (0.5 * (p->air_factor[2 * i] + p->air_factor[2 * i + 1]) < SP_BLOWN_FACTOR) bits |= SP_VIOLATED_BLOWN;
    return bits;
}

/* Advance a loaded robot by one control period. If it diverges, `state` and power keep their last values. */
void sp_plant_step(const sp_world *world, const sp_sim *sim, const sp_command *command, sp_plant *p)
{
    double square = 0.0, period;
    int asymmetric = is_asymmetric(&p->config.actuators), substeps = p->config.substeps, blown = 0;
    int boxed = world->box[0] >= 0, accompanied = world->object >= 0, far, left;
    sp_air air;
    period = substeps * SP_TIMESTEP;
    p->hit = 0.0;
    dispatch(world, sim, command, p);
    far = p->clearance > SP_FASTEST * period;
    left = far && p->object.rests; /* the object stands still and stays where it is */
    sp_look_for_contacts(sim, !far || (accompanied && !left));
    for (int k = 0; k < substeps && sp_is_somewhere(world, sim); k++) {
        sim->mujoco->step(sim->model, sim->data);
        p->clock++;
        if (left) sp_keep_object(sim, &p->object);
        write_play(world, sim, p);
        if (boxed && *sim->contacts) p->hit = sp_max(p->hit, sp_hit(world, sim));
        if (p->pending_count) deliver(sim, p);
        if (p->has_air && p->clock % SP_AIR_STEPS == 0) {
            blow(world, sim, p, &air);
            blown = 1;
        }
        if (asymmetric && p->clock % SP_SERVO_STEPS == 0) lean(world, sim, p);
        if (p->senses && p->clock % SP_IMU_STEPS == 0) sample(world, sim, p);
    }
    p->in_contact = sp_in_contact(world, sim);
    p->clearance = sp_clearance(world, sim, p);
    for (int k = 0; k < SP_QPOS + 7 * accompanied; k++) square += sim->qpos[k] * sim->qpos[k];
    for (int k = 0; k < SP_DOFS + 6 * accompanied; k++) square += sim->qvel[k] * sim->qvel[k];
    p->diverged = !(square < 1e12);
    if (p->diverged) return;
    if (blown) keep_air(&air, p);
    read_state(world, sim, p, &p->state);
    sp_read_object(world, sim, &p->object);
    if (accompanied) sp_watch_object(world, sim, left, SP_FASTEST * period, p);
    p->power = power(sim, &p->state);
    p->energy_wh += p->power * period / 3600.0;
    p->violated |= violations(world, sim, p);
}

/* Place a configured robot, servos at their setpoints and at rest, and leave it loaded. Disturbances and generator are
 * read from the plant. `motion` is the velocity of the torso's origin, world, and its angular velocity, torso axes;
 * NULL at rest. `object` is the pose of the object; NULL leaves it at the origin. */
void sp_plant_reset(const sp_world *world, const sp_sim *sim, const double *position_w, const double *quat_wb,
                    const double *joints, const double *vectoring, const double *thrust, const double *motion,
                    const double *object, sp_plant *p)
{
    const sp_actuator_config *c = &p->config.actuators;
    int weather = p->disturbances.wind > 0.0 || p->disturbances.push > 0.0, recirculates;
    double target[SP_ACTUATORS], limit[SP_JOINTS], offsets[SP_ANGLES];
    sp_air air;
    sim->mujoco->set_state(sim->model, sim->data, world->start, (int)sim->mujoco->state_kind);
    p->clock = 0;
    p->pending_first = p->pending_count = 0;
    memset(p->pending, 0, sizeof p->pending); /* cleared, so that equal robots have equal bytes */
    memset(&p->sensors, 0, sizeof p->sensors);
    sp_zero(p->stuck, 2);
    p->diverged = p->is_stuck = p->violated = 0;
    p->power = p->energy_wh = p->hit = 0.0;
    memset(&p->object, 0, sizeof p->object);
    sp_zero(p->noise, SP_ROTORS);
    sp_zero(p->air_force_w, 3);
    for (int k = 0; k < SP_DUCTS; k++) p->air_factor[k] = 1.0;
    memset(p->falling, 0, sizeof p->falling);
    sp_zero(p->loose, SP_JOINTS);
    memset(&p->weather, 0, sizeof p->weather);
    p->weather.next_push = HUGE_VAL;
    sp_zero(p->eddy, 6);
    recirculates = sp_recirculates(&p->config.recirculation);
    p->has_air = p->config.aero.wake || weather || c->thrust_noise > 0.0 || recirculates;
    p->senses = p->config.sense;
    sp_copy(target, thrust, SP_ROTORS);
    sp_copy(target + SP_ROTORS, joints, SP_JOINTS);
    sp_copy(target + FIRST_GIMBAL, vectoring, 2 * SP_ROTORS);
    for (int k = 0; k < SP_ACTUATORS; k++) target[k] += offset(p, k);
    sp_copy(sim->qpos, position_w, 3);
    sp_copy(sim->qpos + 3, quat_wb, 4);
    for (int j = 0; j < SP_ANGLES; j++) sim->qpos[world->joint_qpos[j]] = target[SP_ROTORS + j];
    if (motion != NULL) sp_copy(sim->qvel, motion, 6);
    if (object != NULL) sp_place_object(world, sim, object, object + 3);
    sp_copy(sim->act, target, SP_ACTUATORS);
    sp_copy(sim->ctrl, target, SP_ACTUATORS);
    for (int j = 0; j < SP_JOINTS; j++) limit[j] = world->max_joint_torque;
    limit_torque(sim, p, limit);
    sp_look_for_contacts(sim, 1);
    write_asymmetry(sim, p);
    for (int k = 0; k < 2 * SP_ROTORS; k++) p->sticks[k] = sim->qpos[world->joint_qpos[SP_JOINTS + k]];
    write_play(world, sim, p);
    sim->mujoco->forward(sim->model, sim->data);
    p->in_contact = sp_in_contact(world, sim);
    p->clearance = sp_clearance(world, sim, p);
    if (weather) sp_draw_weather(&p->disturbances, &p->generator, &p->weather);
    if (recirculates) sp_draw_eddy(&p->generator, p->eddy);
    if (p->has_air) {
        blow(world, sim, p, &air);
        keep_air(&air, p);
    }
    if (is_asymmetric(c)) lean(world, sim, p);
    read_state(world, sim, p, &p->state);
    sp_read_object(world, sim, &p->object);
    p->power = power(sim, &p->state);
    if (!p->senses) return;
    sensor_offsets(p, offsets);
    sp_start_sensors(world, &p->config.sensors, offsets, &p->state, &p->generator, &p->sensors);
}

/* Return the readings of the sensors since the last call. */
void sp_measure(sp_plant *p, sp_measurement *measurement)
{
    sp_read_sensors(&p->config.sensors, p->state.time, &p->sensors, measurement);
}
