/* Learned policies: a small network evaluated on the environment's observation. A residual is limited in size and rate.
 * A direct policy commands the robot, in torso axes if SP_POLICY_TORSO, as in spidar_gym/policies/torso.py. */
#include "spidar_core.h"
#include "spidar_math.h"
#include "spidar_policy.h" /* generated: network, normaliser, bounds, washout, authority; no layers without a policy */

/* Clear the memory: no previous action, no leg momentum. */
void sp_policy_reset(sp_policy *policy) { memset(policy, 0, sizeof *policy); }

int sp_policy_kind(void) { return SP_POLICY_KIND; }

/* ---- network ---- */

/* Computed in double precision: the libraries' tanhf differ in the last bit, tanh rounded to a float does not. */
static float squash(float x) { return (float)tanh((double)x); }
/* The comparisons preserve NaN, so that NaN does not become an action. */
static float output(float x) { return SP_POLICY_SQUASH ? squash(x) : (float)sp_clip(x, -1.0, 1.0); }

/* y = W x + b in blocks of outputs, each sum in the order of the inputs; returns the address of the next weights. */
static const float *multiply(const float *w, const float *x, int from, int to, float *y)
{
    const int blocks = (to + SP_NETWORK_BLOCK - 1) / SP_NETWORK_BLOCK;
    for (int i = 0; i < blocks; i++) {
        float sum[SP_NETWORK_BLOCK] = {0.0f};
        for (int j = 0; j < from; j++, w += SP_NETWORK_BLOCK)
            for (int k = 0; k < SP_NETWORK_BLOCK; k++) sum[k] += w[k] * x[j];
        memcpy(y + SP_NETWORK_BLOCK * i, sum, sizeof sum);
    }
    for (int i = 0; i < SP_NETWORK_BLOCK * blocks; i++) y[i] += w[i];
    return w + SP_NETWORK_BLOCK * blocks;
}

/* Evaluate a network up to its last layer in single precision, as in training; the same bits on every processor.
 * `sizes` has the input and the outputs of each layer, `w` the layers one after the other (then the matrix from the
 * input to the output if `has_skip`), `work` room for twice the widest layer in whole blocks. */
void sp_network(const float *w, const int32_t *sizes, int layers, int relu, int has_skip, const float *input, float *work, int width,
                float *answer)
{
    float *x = work, *y = work + width;
    memcpy(x, input, sizes[0] * sizeof *x);
    for (int k = 0; k < layers; k++) {
        w = multiply(w, x, sizes[k], sizes[k + 1], y);
        for (int i = 0; i < sizes[k + 1] && k + 1 < layers; i++) y[i] = relu ? (y[i] < 0.0f ? 0.0f : y[i]) : squash(y[i]);
        float *last = x;
        x = y, y = last;
    }
    if (has_skip) {
        multiply(w, input, sizes[0], sizes[layers], y);
        for (int i = 0; i < sizes[layers]; i++) x[i] += y[i];
    }
    memcpy(answer, x, sizes[layers] * sizeof *answer);
}

/* Evaluate the policy's network on what it is shown; outputs that it lacks are 0. */
static void evaluate_network(const double *shown, float *answer)
{
    static const int32_t sizes[] = SP_POLICY_SIZES;
    float input[SP_POLICY_WIDTH], work[2 * SP_POLICY_WIDTH];
    for (int i = 0; i < sizes[0]; i++) {
        double n = (shown[i] - SP_POLICY_MEAN[i]) / SP_POLICY_DEVIATION[i];
        input[i] = (float)sp_clip(n, -SP_POLICY_CLIP, SP_POLICY_CLIP);
    }
    memset(answer, 0, SP_POLICY_ACTIONS * sizeof *answer);
    sp_network(SP_POLICY_WEIGHTS, sizes, SP_POLICY_LAYERS, SP_POLICY_RELU, SP_POLICY_SKIP, input, work, SP_POLICY_WIDTH, answer);
}

/* ---- torso axes ---- */

/* Transform vectors from link to torso axes. */
static void turn_out(const sp_snapshot *s, const double *vectors_l, double *vectors_b)
{
    for (int i = 0; i < SP_ROTORS; i++) sp_apply(s->R_bl[i], vectors_l + 3 * i, vectors_b + 3 * i);
}

/* Compute thrust vectors in link axes from sines and cosines of φ₁, θ₁ …; `length` is NULL for unit vectors. */
static void directions(const float *sine, const float *cosine, const float *length, double *to)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double n = length == NULL ? 1.0 : length[i], s = sine[2 * i], c = cosine[2 * i], along = cosine[2 * i + 1];
        to[3 * i] = n * sine[2 * i + 1];
        to[3 * i + 1] = n * (-s * along);
        to[3 * i + 2] = n * (c * along);
    }
}

/* Track the commanded joint angles: the last action's, or the speed-limited ones on the way; the measured angles before
 * the first action. Values that are not finite are ignored. */
static void follow_joints(sp_policy *policy)
{
    const float *measured = policy->observation + SP_POLICY_AT_JOINTS, *velocity = policy->observation + SP_POLICY_AT_SPEEDS;
    for (int j = 0; j < SP_JOINTS; j++) {
        double asked = SP_POLICY_JOINT_LIMIT * policy->observation[SP_POLICY_AT_ACTION + 3 * SP_ROTORS + j];
        double moved = fabs(velocity[j]) < SP_POLICY_SURE ? asked : policy->joints[j] + velocity[j] / SP_CONTROL_RATE;
        double to = policy->has_joints ? moved : measured[j];
        if (sp_finite(&to, 1)) policy->joints[j] = to;
    }
    policy->has_joints = 1;
}

/* Write the inputs of a network in torso axes; returns their number. */
static int torso_features(const sp_policy *policy, const sp_snapshot *snapshot, double *to)
{
    const float *seen = policy->observation;
    double vectors[3 * SP_ROTORS];
    int at = 0;
    for (int k = 0; k < SP_POLICY_KEPT_SIZE; k++) to[at++] = seen[SP_POLICY_KEPT[k]];
    directions(seen + SP_POLICY_AT_SINE, seen + SP_POLICY_AT_COSINE, NULL, vectors);
    turn_out(snapshot, vectors, to + at);
    at += 3 * SP_ROTORS;
    directions(seen + SP_POLICY_AT_COMMAND_SINE, seen + SP_POLICY_AT_COMMAND_COSINE, seen + SP_POLICY_AT_THRUST, vectors);
    turn_out(snapshot, vectors, to + at);
    at += 3 * SP_ROTORS;
    for (int i = 0; i < SP_ROTORS; i++)
        for (int k = 0; k < 3; k++) to[at++] = snapshot->R_bl[i][3 * k];
    for (int j = 0; j < SP_JOINTS; j++) to[at++] = policy->joints[j];
    return at;
}

/* Convert the outputs of a network in torso axes to a direct action. */
static void torso_action(const sp_robot *robot, const sp_policy *policy, const sp_snapshot *snapshot, const float *said,
                         double *action)
{
    const float *seen = policy->observation;
    double velocity[SP_JOINTS], form[SP_JOINTS], joints[SP_JOINTS], rate[SP_JOINTS];
    for (int i = 0; i < SP_ROTORS; i++) {
        double f_b[3], thrust, angles[2];
        for (int k = 0; k < 3; k++) f_b[k] = SP_POLICY_FORCE * said[3 * i + k];
        f_b[2] += robot->weight / SP_ROTORS;
        sp_aim(snapshot->R_bl[i], f_b, seen[SP_POLICY_AT_COMMAND_SINE + 2 * i], seen[SP_POLICY_AT_COMMAND_COSINE + 2 * i],
               &thrust, angles);
        action[i] = 2.0 * thrust / robot->max_thrust - 1.0;
        action[SP_ROTORS + i] = angles[0] / SP_PI;
        action[2 * SP_ROTORS + i] = angles[1] / SP_PI;
    }
    for (int j = 0; j < SP_JOINTS; j++) {
        velocity[j] = seen[SP_POLICY_AT_SPEEDS + j];
        form[j] = policy->joints[j] + seen[SP_POLICY_AT_ASIDE + j] + SP_POLICY_OFFSET * said[3 * SP_ROTORS + j];
    }
    double speed = 0.0;
    for (int j = 0; j < SP_JOINTS; j++) speed = sp_max(speed, fabs(velocity[j]));
    speed = sp_min(SP_POLICY_SPEED, speed + SP_POLICY_ACCELERATION / SP_CONTROL_RATE);
    sp_ramp_joints(policy->joints, velocity, form, speed, speed / SP_POLICY_ACCELERATION, 1.0 / SP_CONTROL_RATE, joints, rate);
    for (int j = 0; j < SP_JOINTS; j++) action[3 * SP_ROTORS + j] = joints[j] / robot->joint_limit;
    for (int k = 0; k < SP_POLICY_ACTIONS; k++) action[k] = (float)sp_clip(action[k], -1.0, 1.0);
}

/* ---- the external force ---- */

/* Estimate the external force in torso axes: the part of the acceleration not explained by commands and weight; see
 * spidar_gym/policies/external.py. If a value is not finite, the force is kept and the estimation restarts. */
static void look_for_force(const sp_robot *robot, sp_policy *policy, const sp_snapshot *snapshot)
{
    const float *seen = policy->observation, *error = seen + SP_POLICY_AT_ATTITUDE;
    double forces[SP_FORCES], force[3] = {0.0}, up[3] = {error[1], -error[0], 1.0};
    directions(seen + SP_POLICY_AT_COMMAND_SINE, seen + SP_POLICY_AT_COMMAND_COSINE, seen + SP_POLICY_AT_THRUST, forces);
    turn_out(snapshot, forces, forces);
    for (int i = 0; i < SP_ROTORS; i++)
        for (int k = 0; k < 3; k++) force[k] += forces[3 * i + k];
    double sum = sp_dot(force, up);
    for (int k = 0; k < 3; k++) sum += seen[SP_POLICY_AT_VELOCITY + k] + seen[SP_POLICY_AT_INTEGRAL + k];
    if (!sp_finite(&sum, 1)) {
        policy->has_velocity = 0;
        return;
    }
    for (int k = 0; k < 3; k++) {
        double velocity = -seen[SP_POLICY_AT_VELOCITY + k];
        double share = policy->has_velocity ? SP_POLICY_ROTOR_SHARE : 1.0;
        policy->force[k] += share * (force[k] - policy->force[k]);
        double gained = robot->weight / robot->gravity * SP_CONTROL_RATE * (velocity - policy->velocity[k]);
        double pull = policy->has_velocity ? gained - policy->force[k] + robot->weight * up[k] : 0.0;
        policy->external[k] = pull;
        policy->external[3 + k] = fabs(pull);
        if (!policy->has_first) policy->external[6 + k] = fabsf(seen[SP_POLICY_AT_INTEGRAL + k]);
        policy->velocity[k] = velocity;
    }
    policy->has_velocity = policy->has_first = 1;
}

/* ---- inputs of the network ---- */

/* Evaluate the network for the observation in `policy`; only torso axes and the external force need `snapshot`. */
static void answer_to(const sp_robot *robot, sp_policy *policy, const sp_snapshot *snapshot, float *answer)
{
    double shown[SP_POLICY_WIDTH];
    int at = 0;
    if (SP_POLICY_TORSO) {
        follow_joints(policy);
        at = torso_features(policy, snapshot, shown);
    } else
        for (const float *seen = policy->observation; at < SP_POLICY_SEES; at++)
            shown[at] = SP_POLICY_SCALED ? (float)(seen[at] * SP_POLICY_GAIN[at]) : seen[at];
    if (SP_POLICY_EXTERNAL) {
        look_for_force(robot, policy, snapshot);
        for (int k = 0; k < SP_POLICY_EXTERNAL; k++) shown[at++] = policy->external[k];
    }
    for (int k = 0; k < SP_POLICY_TRACES; k++) {
        int of = SP_POLICY_TRACED[k];
        double now = of < SP_POLICY_SEES ? policy->observation[of] : policy->external[of - SP_POLICY_SEES];
        double next = policy->traces[k] + SP_POLICY_TRACE_SHARE[k] * (now - policy->traces[k]);
        if (sp_finite(&next, 1)) policy->traces[k] = next; /* ignore values that are not finite */
        shown[at++] = policy->traces[k];
    }
    evaluate_network(shown, answer);
}

/* ---- action ---- */

/* Move the action towards the network's output, high-passed (washout), by at most SP_POLICY_STEP; NaN counts as 0. */
static void update_action(const sp_robot *robot, sp_policy *policy, const sp_snapshot *snapshot)
{
    float answer[SP_POLICY_WIDTH];
    answer_to(robot, policy, snapshot, answer);
    for (int k = 0; k < SP_POLICY_ACTIONS; k++) {
        double wish = output(answer[k]), last = policy->action[k];
        if (wish != wish) wish = 0.0;
        policy->slow[k] += SP_POLICY_WASHOUT[k] * (wish - policy->slow[k]);
        wish = sp_clip(wish - policy->slow[k], -1.0, 1.0);
        policy->action[k] = sp_clip(wish, last - SP_POLICY_STEP, last + SP_POLICY_STEP);
    }
}

/* Add a channel's entries if the action has the channel; returns the entries that follow. */
static const double *add_channel(int32_t channels, int channel, const double *share, double *to, int n)
{
    if (!(channels & channel)) return share;
    for (int k = 0; k < n; k++) to[k] += share[k];
    return share + n;
}

/* Convert an action of `channels` (bits of sp_channel) to a residual; `authority` scales each entry. */
void sp_make_residual(const double *action, const double *authority, int n, int32_t channels, sp_residual *r)
{
    double share[SP_MAX_ENTRIES] = {0.0};
    const double *next = share;
    *r = SP_NO_RESIDUAL;
    for (int k = 0; k < n; k++) share[k] = authority[k] * action[k];
    next = add_channel(channels, SP_CHANNEL_WRENCH, next, r->wrench, 6);
    next = add_channel(channels, SP_CHANNEL_JOINT_OFFSET, next, r->joint_offset, SP_JOINTS);
    next = add_channel(channels, SP_CHANNEL_JOINT_SPEED_SCALE, next, &r->joint_speed_scale, 1);
    next = add_channel(channels, SP_CHANNEL_FORCES, next, r->forces_l, SP_FORCES);
    next = add_channel(channels, SP_CHANNEL_GAIT, next, &r->joint_speed_scale, 1);
    next = add_channel(channels, SP_CHANNEL_GAIT, next, &r->raise_scale, 1);
    next = add_channel(channels, SP_CHANNEL_GAIT, next, &r->stride_scale, 1);
    next = add_channel(channels, SP_CHANNEL_GAIT, next, &r->lift_scale, 1);
    add_channel(channels, SP_CHANNEL_LEG_FORCES, next, r->leg_forces_b, 3 * SP_LEGS);
    r->has_forces_l = (channels & SP_CHANNEL_FORCES) != 0;
    r->has_leg_forces_b = (channels & SP_CHANNEL_LEG_FORCES) != 0;
}

/* ---- flight and crawl ---- */

/* Thrust of the last command; before the first tick the state's thrust. */
static void last_thrust(const sp_robot *robot, int32_t ticked, const double *forces_l, const sp_robot_state *state, double *thrust)
{
    for (int i = 0; i < SP_ROTORS; i++)
        thrust[i] = ticked ? sp_min(sp_norm(forces_l + 3 * i), robot->max_thrust) : state->thrust[i];
}

/* Write the environment's observation of this tick's flight. `control` is computed from `state`. */
static void look(const sp_robot *robot, sp_policy *policy, const sp_flight *flight, const sp_robot_state *state,
                 const sp_control_state *control, const sp_preview *preview)
{
    double thrust[SP_ROTORS], momentum[3], rate[3];
    last_thrust(robot, flight->ticked, flight->memory.forces_l, state, thrust);
    sp_leg_momentum(&control->snapshot, flight->joint_velocity, momentum);
    for (int i = 0; i < 3; i++)
        rate[i] = policy->has_momentum ? (momentum[i] - policy->leg_momentum[i]) * flight->config.rate_hz : 0.0;
    policy->has_momentum = sp_finite(momentum, 3); /* an invalid state must not affect the next tick */
    sp_copy(policy->leg_momentum, momentum, 3);
    sp_observe(flight, state, control, thrust, flight->joint_velocity, momentum, rate, preview, 0, policy->action,
               SP_POLICY_ACTIONS, SP_POLICY_BOUND, policy->observation);
}

/* Compute the residual of a flight tick; neutral without a flight policy. */
void sp_policy_flight(const sp_robot *robot, sp_policy *policy, const sp_flight *flight, const sp_robot_state *state,
                      const sp_control_state *control, const sp_preview *preview, sp_residual *residual)
{
    *residual = SP_NO_RESIDUAL;
    if (SP_POLICY_KIND != SP_POLICY_FLIGHT) return;
    look(robot, policy, flight, state, control, preview);
    update_action(robot, policy, &control->snapshot);
    sp_make_residual(policy->action, SP_POLICY_AUTHORITY, SP_POLICY_ACTIONS, SP_POLICY_CHANNELS, residual);
}

/* ---- without a controller ---- */

/* Whether the network is evaluated in this tick; between decisions its action is held. */
static int decides(sp_policy *policy)
{
    int due = policy->ticks % SP_POLICY_HOLD == 0;
    policy->ticks = (policy->ticks + 1) % (SP_POLICY_HOLD * SP_CLOCK_TICKS);
    return due;
}

/* Evaluate a direct policy; NaN counts as 0. */
static void decide(const sp_robot *robot, sp_policy *policy, const sp_snapshot *snapshot)
{
    float answer[SP_POLICY_WIDTH];
    answer_to(robot, policy, snapshot, answer);
    if (SP_POLICY_TORSO) torso_action(robot, policy, snapshot, answer, policy->action);
    else
        for (int k = 0; k < SP_POLICY_ACTIONS; k++) policy->action[k] = output(answer[k]);
    for (int k = 0; k < SP_POLICY_ACTIONS; k++)
        if (policy->action[k] != policy->action[k]) policy->action[k] = 0.0;
}

/* Compute the command of a flight tick from a direct policy, without a controller. The memory of `flight` stores the
 * command and the servo motion within the tick. Does nothing without a direct policy. */
void sp_policy_direct(const sp_robot *robot, sp_policy *policy, sp_flight *flight, const sp_robot_state *state,
                      const sp_control_state *control, const sp_preview *preview, sp_command *command)
{
    sp_flight_memory *memory = &flight->memory;
    if (SP_POLICY_KIND != SP_POLICY_DIRECT) return;
    look(robot, policy, flight, state, control, preview);
    if (decides(policy)) decide(robot, policy, &control->snapshot);
    if (SP_POLICY_IN_TORSO_AXES) {
        double target[SP_JOINTS], joints[SP_JOINTS];
        sp_act_in_torso_axes(policy->action, SP_POLICY_AUTHORITY, SP_POLICY_ACTIONS, SP_POLICY_TRIM, control->snapshot.R_bl[0],
                             robot, memory->vectoring, memory->forces_l, target, command);
        for (int j = 0; j < SP_JOINTS; j++) target[j] += preview->joint_target[j];
        sp_plan_joints(robot, flight, target, 1.0, joints, flight->joint_velocity);
        sp_copy(memory->joint_position, joints, SP_JOINTS);
        sp_make_command(command->thrust, memory->vectoring, joints, robot->max_joint_torque, command);
    } else
        sp_act_directly(policy->action, robot, flight->config.joint_speed, memory->vectoring, memory->forces_l,
                        memory->joint_position, flight->joint_velocity, command);
    sp_copy(memory->joint_velocity, flight->joint_velocity, SP_JOINTS);
    flight->ticked = 1;
}

/* Compute the command of a crawl tick from a direct policy in torso axes, without a controller; does nothing without
 * one. `goal` is x, y [m], yaw [rad]. */
void sp_policy_crawl_direct(const sp_robot *robot, sp_policy *policy, sp_crawl *crawl, const sp_robot_state *state,
                            const double *goal, sp_command *command)
{
    double thrust[SP_ROTORS], R_bl[SP_ROTORS][9], lying[SP_JOINTS], target[SP_JOINTS];
    sp_crawl_memory *memory = &crawl->memory;
    if (SP_POLICY_KIND != SP_POLICY_CRAWL_DIRECT) return;
    last_thrust(robot, crawl->ticked, memory->forces_l, state, thrust);
    sp_observe_crawl(crawl, state, goal, thrust, policy->action, SP_POLICY_ACTIONS, policy->ticks,
                     SP_POLICY_BOUND, policy->observation);
    if (decides(policy)) decide(robot, policy, NULL);
    sp_link_attitudes(robot, state->joint_position, R_bl);
    sp_act_in_torso_axes(policy->action, SP_POLICY_AUTHORITY, SP_POLICY_ACTIONS, SP_POLICY_TRIM, R_bl[0], robot,
                         memory->vectoring, memory->forces_l, target, command);
    sp_leg_angles(robot, crawl->home_b, lying);
    for (int j = 0; j < SP_JOINTS; j++) target[j] += lying[j];
    sp_command_joints(target, robot, crawl->config.joint_speed, memory->joint_position, NULL, command);
    crawl->ticked = 1;
}

/* ---- crawl ---- */

/* Compute the residual of a crawl tick; neutral without a crawl policy. `goal` is x, y [m], yaw [rad]. */
void sp_policy_crawl(const sp_robot *robot, sp_policy *policy, const sp_crawl *crawl, const sp_robot_state *state, const double *goal,
                     sp_residual *residual)
{
    double thrust[SP_ROTORS];
    *residual = SP_NO_RESIDUAL;
    if (SP_POLICY_KIND != SP_POLICY_CRAWL) return;
    last_thrust(robot, crawl->ticked, crawl->memory.forces_l, state, thrust);
    sp_observe_crawl(crawl, state, goal, thrust, policy->action, SP_POLICY_ACTIONS, -1, SP_POLICY_BOUND,
                     policy->observation);
    update_action(robot, policy, NULL);
    sp_make_residual(policy->action, SP_POLICY_AUTHORITY, SP_POLICY_ACTIONS, SP_POLICY_CHANNELS, residual);
}
