/* What flights, crawls and courses share of an episode: randomised robots, actions, observed state, `info`. */
#include "episode.h"

/* Sample a number of a row for a kind of robots. */
static double sample(const sp_draw *row, int32_t kind, sp_generator *generator)
{
    double low = row->low[kind], high = row->high[kind];
    if (!row->is_log) return sp_uniform(generator, low, high);
    double drawn = sp_uniform(generator, log(low), log(high));
    return low == high ? low : exp(drawn);
}

/* Randomise a configuration for this episode; the number of draws depends neither on the strength nor on the kind. */
void sp_draw_robot(const sp_rules *rules, sp_generator *generator, sp_plant_config *config, sp_episode *episode)
{
    double *drawn = episode->drawn;
    episode->kind = rules->kinds > 0 ? (int32_t)sp_integer(generator, 0, rules->kinds) : 0;
    if (rules->kinds > 0 && rules->kind >= 0) episode->kind = rules->kind;
    for (int k = 0; k < rules->draws; k++) {
        const sp_draw *row = &rules->draw[k];
        double *value = (double *)((char *)config + row->at);
        for (int i = 0; i < row->count; i++) {
            double neutral = row->operation == SP_DRAW_SET ? value[i] : row->operation == SP_DRAW_SCALE ? 1.0 : 0.0;
            double draw = neutral + rules->strength * (sample(row, episode->kind, generator) - neutral);
            *drawn++ = draw;
            value[i] = row->operation == SP_DRAW_SET ? draw : row->operation == SP_DRAW_SCALE ? value[i] * draw
                                                                                              : value[i] + draw;
        }
    }
}

/* Set the energy that a configured robot's battery lacks at the reset; its configuration takes a share of `charge`. */
void sp_charge(double charge, sp_plant *plant)
{
    double left = charge * (1.0 - plant->config.actuators.battery_spent);
    plant->spent_wh = (1.0 - left) * SP_USABLE * SP_CAPACITY_WH;
}

/* Set the observed state after a reset. */
void sp_first_look(const sp_robot *robot, const sp_rules *rules, sp_plant *plant, sp_episode *episode)
{
    sp_measurement first;
    sp_robot_state indicated;
    episode->seen = plant->state;
    if (!plant->senses || rules->is_commanded) return; /* a Python controller has its own estimator */
    sp_measure(plant, &first);
    indicated = plant->state;
    sp_copy(indicated.joint_position, first.joint_position, SP_JOINTS);
    sp_copy(indicated.vectoring, first.vectoring, 2 * SP_ROTORS);
    sp_estimator_init(&episode->estimator, &rules->estimator);
    sp_estimator_reset(robot, &episode->estimator, &indicated);
    sp_estimator_update(robot, &episode->estimator, &first, plant->state.thrust, &episode->seen);
}

/* Update the observed state after a control period. */
void sp_look(const sp_robot *robot, const sp_rules *rules, sp_plant *plant, sp_episode *episode)
{
    sp_measurement measurement;
    if (!plant->senses || rules->is_commanded) {
        episode->seen = plant->state;
        return;
    }
    sp_measure(plant, &measurement);
    sp_estimator_update(robot, &episode->estimator, &measurement, episode->command.thrust, &episode->seen);
}

/* Store an action, clipped to [−1, 1]; NaN stays NaN. */
void sp_take_action(const sp_rules *rules, const double *action, sp_episode *episode)
{
    for (int k = 0; k < rules->mode.size; k++) episode->action[k] = sp_clip(action[k], -1.0, 1.0);
}

/* numpy's remainder, which has the sign of the divisor. */
static double wrapped(double x, double period)
{
    double rest = fmod(x, period);
    return rest < 0.0 ? rest + period : rest;
}

/* Compute the action from which `sp_act_directly` makes this command. */
void sp_direct_action(const sp_command *command, const sp_robot *robot, double *action)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        action[i] = 2.0 * command->thrust[i] / robot->max_thrust - 1.0;
        for (int k = 0; k < 2; k++)
            action[SP_ROTORS * (1 + k) + i] =
                (wrapped(command->vectoring[2 * i + k] + SP_PI, SP_TWO_PI) - SP_PI) / SP_PI;
    }
    for (int j = 0; j < SP_JOINTS; j++)
        action[3 * SP_ROTORS + j] = sp_clip(command->joint_position[j] / robot->joint_limit, -1.0, 1.0);
}

/* Scale an observation. */
void sp_scale(const sp_rules *rules, float *observation)
{
    for (int k = 0; rules->is_scaled && k < rules->size; k++) observation[k] = (float)(observation[k] * rules->gain[k]);
}

/* Number of control periods of a step; Python's commands and references are new in each. */
int64_t sp_periods(const sp_rules *rules) { return rules->is_commanded || rules->is_referred ? 1 : rules->hold; }

/* Return whether a quantity is above the limit at which a step of several control periods ends. */
int sp_stops(const sp_rules *rules, const double *quantities, int count)
{
    for (int k = 0; k < count; k++)
        if (quantities[k] > rules->stop[k]) return 1;
    return 0;
}

/* Write the quantities that all tasks use for rewards, failures and success; `ticks` are control ticks since reset. */
void sp_count_episode(const sp_rules *rules, const sp_plant *plant, const sp_episode *episode, int64_t ticks,
                      sp_quantities *q)
{
    int n = rules->mode.size;
    q->ticks = episode->ticks;
    q->time = ticks / SP_CONTROL_RATE;
    q->in_contact = plant->in_contact != 0;
    q->diverged = plant->diverged != 0;
    q->power = plant->power;
    q->effort = sp_row(episode->action, episode->action, n) / n;
}

/* Write the costs of violated constraints; contacts of the parts in `touching` cost. */
static void charge(int32_t violated, int32_t touching, sp_info *info)
{
    info->cost_contact = (violated & touching) != 0;
    info->cost_torque = (violated & SP_VIOLATED_TORQUE) != 0;
    info->cost_duct = (violated & SP_VIOLATED_DUCT) != 0;
    info->cost_blown = (violated & SP_VIOLATED_BLOWN) != 0;
    info->cost = info->cost_contact + info->cost_torque + info->cost_duct + info->cost_blown;
}

double sp_total_thrust(const sp_rules *rules, const double *t)
{
    if (rules->is_commanded) return ((t[0] + t[1]) + (t[2] + t[3])) + ((t[4] + t[5]) + (t[6] + t[7]));
    double sum = 0.0;
    for (int i = 0; i < SP_ROTORS; i++) sum += t[i];
    return sum;
}

/* Write the `info` of a robot and its controller that all tasks share. `allocation` is NULL before the first solution;
 * `touching` are the parts (bits of sp_constraint) whose contact costs. */
void sp_tell(const sp_rules *rules, const sp_plant *plant, const sp_episode *episode, const double *vectoring,
             const sp_allocation *allocation, int32_t touching, sp_info *info)
{
    const sp_robot_state *state = &plant->state;
    double mean = plant->energy_wh > 0.0 ? 3600.0 * plant->energy_wh / state->time : plant->power;
    memset(info, 0, sizeof *info);
    sp_copy(info->thrust_command, episode->has_command ? episode->command.thrust : state->thrust, SP_ROTORS);
    sp_copy(info->thrust, state->thrust, SP_ROTORS);
    sp_copy(info->vectoring_command[0], vectoring, 2 * SP_ROTORS);
    sp_copy(info->vectoring[0], state->vectoring, 2 * SP_ROTORS);
    sp_copy(info->joint_torque, state->joint_torque, SP_JOINTS);
    for (int i = 0; i < SP_ROTORS; i++) {
        info->thrust_factor[i] = 0.5 * (plant->air_factor[2 * i] + plant->air_factor[2 * i + 1]);
    }
    info->total_thrust = sp_total_thrust(rules, state->thrust);
    info->qp_status_code = -1;
    if (allocation != NULL) {
        sp_copy(info->joint_torque_allocated, allocation->joint_torques, SP_JOINTS);
        sp_copy(info->wrench_allocated, allocation->wrench, 6);
        info->qp_status_code = allocation->status;
        info->qp_iterations = allocation->iterations;
        info->qp_slack = allocation->slack;
    }
    sp_copy(info->air_force, plant->air_force_w, 3);
    info->power_w = plant->power;
    info->energy_wh = plant->energy_wh;
    info->endurance_min = 60.0 * SP_USABLE * SP_CAPACITY_WH / mean;
    info->failure_code = episode->failure;
    charge(plant->violated, touching, info);
}
