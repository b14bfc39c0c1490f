/* Episodes: functions that flights, crawls and courses share. */
#ifndef SPIDAR_EPISODE_H
#define SPIDAR_EPISODE_H

#include "engine.h"

void sp_draw_robot(const sp_rules *rules, sp_generator *generator, sp_plant_config *config, sp_episode *episode);
void sp_charge(double charge, sp_plant *plant);
void sp_first_look(const sp_robot *robot, const sp_rules *rules, sp_plant *plant, sp_episode *episode);
void sp_look(const sp_robot *robot, const sp_rules *rules, sp_plant *plant, sp_episode *episode);
void sp_take_action(const sp_rules *rules, const double *action, sp_episode *episode);
void sp_direct_action(const sp_command *command, const sp_robot *robot, double *action);
/* Sum of the thrusts; for a Python controller in NumPy's order, with which its published rows were computed. */
double sp_total_thrust(const sp_rules *rules, const double *thrust);
void sp_tell(const sp_rules *rules, const sp_plant *plant, const sp_episode *episode, const double *vectoring,
             const sp_allocation *allocation, int32_t touching, sp_info *info);
#define SP_IN_THE_AIR (SP_VIOLATED_FOOT | SP_VIOLATED_DUCT | SP_VIOLATED_PART) /* parts whose contact costs */
#define SP_ON_THE_FLOOR (SP_VIOLATED_DUCT | SP_VIOLATED_PART)
void sp_scale(const sp_rules *rules, float *observation);
int64_t sp_periods(const sp_rules *rules);
int sp_stops(const sp_rules *rules, const double *quantities, int count);
void sp_count_episode(const sp_rules *rules, const sp_plant *plant, const sp_episode *episode, int64_t ticks,
                      sp_quantities *quantities);

#endif
