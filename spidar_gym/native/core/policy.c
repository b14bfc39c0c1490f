/* A learned residual: a small network on what the environment shows it, bounded, and no faster than it may be. */
#include "spidar_core.h"
#include "spidar_math.h"
#include "spidar_policy.h" /* generated: network, normaliser, bounds, washout, authority; no layers without a policy */

/* What flight and crawl cannot know at a policy's first tick: no action before it, no momentum of the legs. */
void sp_policy_reset(sp_policy *policy) { memset(policy, 0, sizeof *policy); }

int sp_policy_kind(void) { return SP_POLICY_KIND; }

/* ---- network ---- */

/* Comparisons are such that what is no number stays none: it must not look like a wish. */
static float activation(float x) { return SP_POLICY_RELU ? (x < 0.0f ? 0.0f : x) : tanhf(x); }
static float output(float x) { return SP_POLICY_SQUASH ? tanhf(x) : (float)sp_clip(x, -1.0, 1.0); }

/* The network's answer, in single precision as it was learned. */
static void evaluate_network(const float *observation, float *answer)
{
    static const int sizes[] = SP_POLICY_SIZES;
    float first[SP_POLICY_WIDTH], second[SP_POLICY_WIDTH], *x = first, *y = second;
    const float *w = SP_POLICY_WEIGHTS;
    for (int i = 0; i < sizes[0]; i++) {
        double n = ((double)observation[i] - SP_POLICY_MEAN[i]) / SP_POLICY_DEVIATION[i];
        x[i] = (float)sp_clip(n, -SP_POLICY_CLIP, SP_POLICY_CLIP);
    }
    for (int k = 0; k < SP_POLICY_LAYERS; k++) {
        const int from = sizes[k], to = sizes[k + 1];
        const float *bias = w + from * to;
        for (int i = 0; i < to; i++) {
            float sum = 0.0f;
            for (int j = 0; j < from; j++) sum += w[from * i + j] * x[j];
            sum += bias[i];
            y[i] = k + 1 < SP_POLICY_LAYERS ? activation(sum) : output(sum);
        }
        float *last = x;
        x = y, y = last;
        w = bias + to;
    }
    memcpy(answer, x, SP_POLICY_ACTIONS * sizeof *answer);
}

/* ---- action ---- */

/* Go towards the network's answer, washed out, no further than a step; what is no number counts as 0. */
static void update_action(sp_policy *policy)
{
    float answer[SP_POLICY_WIDTH];
    evaluate_network(policy->observation, answer);
    for (int k = 0; k < SP_POLICY_ACTIONS; k++) {
        double wish = answer[k], last = policy->action[k];
        if (wish != wish) wish = 0.0;
        policy->slow[k] += SP_POLICY_WASHOUT[k] * (wish - policy->slow[k]);
        wish = sp_clip(wish - policy->slow[k], -1.0, 1.0);
        policy->action[k] = sp_clip(wish, last - SP_POLICY_STEP, last + SP_POLICY_STEP);
    }
}

/* Add a channel's share where the action has it; what is left of the action. */
static const double *add_channel(int32_t channels, int channel, const double *share, double *to, int n)
{
    if (!(channels & channel)) return share;
    for (int k = 0; k < n; k++) to[k] += share[k];
    return share + n;
}

/* What an action of some channels (bits of sp_channel) does: `authority` is what 1 becomes, entry by entry. */
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

/* Thrust of the last command; before the first that of the state. */
static void last_thrust(const sp_robot *robot, int32_t ticked, const double *forces_l, const sp_robot_state *state, double *thrust)
{
    for (int i = 0; i < SP_ROTORS; i++)
        thrust[i] = ticked ? sp_min(sp_norm(forces_l + 3 * i), robot->max_thrust) : state->thrust[i];
}

/* The residual of this tick's flight: neutral without a policy for it. `control` is that of `state`. */
void sp_policy_flight(const sp_robot *robot, sp_policy *policy, const sp_flight *flight, const sp_robot_state *state,
                      const sp_control_state *control, const sp_preview *preview, sp_residual *residual)
{
    double thrust[SP_ROTORS], momentum[3], rate[3];
    *residual = SP_NO_RESIDUAL;
    if (SP_POLICY_KIND != SP_POLICY_FLIGHT) return;
    last_thrust(robot, flight->ticked, flight->memory.forces_l, state, thrust);
    sp_leg_momentum(&control->snapshot, flight->joint_velocity, momentum);
    for (int i = 0; i < 3; i++)
        rate[i] = policy->has_momentum ? (momentum[i] - policy->leg_momentum[i]) * flight->config.rate_hz : 0.0;
    policy->has_momentum = sp_finite(momentum, 3); /* else one lost state would spoil two ticks */
    sp_copy(policy->leg_momentum, momentum, 3);
    sp_observe(flight, state, control, thrust, flight->joint_velocity, momentum, rate, preview->joint_target,
               preview->next_form, preview->time_to_next, policy->action, SP_POLICY_ACTIONS, SP_POLICY_BOUND,
               policy->observation);
    update_action(policy);
    sp_make_residual(policy->action, SP_POLICY_AUTHORITY, SP_POLICY_ACTIONS, SP_POLICY_CHANNELS, residual);
}

/* The residual of this tick on the ground: neutral without a policy for it. `goal` is x, y [m], yaw [rad]. */
void sp_policy_crawl(const sp_robot *robot, sp_policy *policy, const sp_crawl *crawl, const sp_robot_state *state, const double *goal,
                     sp_residual *residual)
{
    double thrust[SP_ROTORS];
    *residual = SP_NO_RESIDUAL;
    if (SP_POLICY_KIND != SP_POLICY_CRAWL) return;
    last_thrust(robot, crawl->ticked, crawl->memory.forces_l, state, thrust);
    sp_observe_crawl(crawl, state, goal, thrust, policy->action, SP_POLICY_ACTIONS, SP_POLICY_BOUND,
                     policy->observation);
    update_action(policy);
    sp_make_residual(policy->action, SP_POLICY_AUTHORITY, SP_POLICY_ACTIONS, SP_POLICY_CHANNELS, residual);
}
