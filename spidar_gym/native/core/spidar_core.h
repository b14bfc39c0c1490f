/* SPIDAR's controllers for flight and crawl: the simulator and the robot run the same code.
 *
 * C99 without heap, written globals, input or output. Every struct is plain data. Resetting a controller clears all its
 * memory. The temporary data of a tick, OSQP's included, are in a workspace (`sp_room`): each thread has its own, and
 * nothing in it outlives a tick. The robot's numbers are data too (`sp_robot`); the export freezes them as SP_ROBOT.
 * Frames: w world, b torso, c CoG with torso axes, l axes of the link that carries a rotor, f floor. SI units.
 */
#ifndef SPIDAR_CORE_H
#define SPIDAR_CORE_H

#include <stddef.h>
#include <stdint.h>

#include "spidar_structs.h" /* generated: every struct, and the constants shared by Python and C */

/* Workspace of one thread: robot, OSQP solvers of each program (hard and soft), memory for linear algebra. */
typedef struct {
    const sp_robot *robot;
    void *hard[SP_PROGRAMS], *soft[SP_PROGRAMS];
    sp_workspace workspace;
} sp_room;

/* room.c */
size_t sp_solvers_size(void);
void sp_make_room(const sp_robot *robot, void *memory, sp_room *room); /* memory as of malloc; outlives room */

/* tree.c */
void sp_snapshot_at(const sp_robot *robot, const double *q, const double *R_wb, const double *vectoring, sp_snapshot *snapshot);
void sp_link_attitudes(const sp_robot *robot, const double *q, double R_bl[SP_ROTORS][9]);

/* rotor.c */
double sp_battery_thrust(double voltage);
void sp_vectoring_to_force(const double *thrust, const double *vectoring, double *forces_l);
void sp_aim(const double *R_bl, const double *force_b, double sine, double cosine, double *thrust, double *angles);
void sp_act_in_torso_axes(const double *action, const double *authority, int size, double trim,
                          const double *R_bl, const sp_robot *robot, double *vectoring, double *forces_l, double *offset,
                          sp_command *command);
void sp_command_joints(const double *target, const sp_robot *robot, double joint_speed, double *joints,
                       double *joint_velocity, sp_command *command);
void sp_act_directly(const double *action, const sp_robot *robot, double joint_speed, double *vectoring,
                     double *forces_l, double *joints, double *joint_velocity, sp_command *command);
void sp_thrust_map(const sp_snapshot *snapshot, double *Q, int stride);
void sp_torque_map(const sp_snapshot *snapshot, double *T, int stride);
void sp_point(const double *force_l, double phi0, double theta0, const double *held, double min_force, double *angles);
void sp_nominal_vectoring(const sp_snapshot *snapshot, const double *present, double *nominal);
void sp_update_lock(const sp_lock *previous, const int32_t *restricted, const double *nominal,
                    const sp_snapshot *snapshot, const double *present, const sp_lock_config *config, sp_lock *lock);
void sp_follow(const double *forces_l, const sp_lock *lock, const double *present, double step, double *vectoring);

/* interference.c */
void sp_no_interference(sp_interference *bounds);
void sp_find_interference(const sp_snapshot *snapshot, const double *nominal, const sp_interference *previous,
                          const sp_interference_config *config, const sp_disc *disc, sp_interference *bounds);

/* grip.c */
void sp_grip_torque(const sp_robot *robot, const sp_grip *grip, const sp_snapshot *snapshot, const double *R_wb,
                    const double *position_w, const sp_residual *residual, double *torque);
void sp_grip_carried(const sp_robot *robot, const sp_grip *grip, const sp_snapshot *snapshot, const double *R_wb,
                     const double *position_w, double *wrench);
void sp_grip_disc(const sp_grip *grip, const sp_snapshot *snapshot, const double *R_wb, const double *position_w,
                  sp_disc *disc);

/* grasp.c */
void sp_open_claw(const sp_robot *robot, double half_width, double *form); /* form around an object */
const char *sp_refuse_object(const sp_robot *robot, const sp_waypoint *order); /* NULL: the claw can hold it */
void sp_grasp_begin(const sp_robot *robot, sp_grasper *grasper, const sp_waypoint *target, const sp_seen *seen,
                    const double *pose_w, const double *form);
void sp_grasp_carry(sp_grasper *grasper, const sp_waypoint *order);
void sp_grasp_place(sp_grasper *grasper, double floor_w);
/* Stop where the feet press, for the end of a mission; returns 1 and the height of the surface where it stood, infinite
 * once it was lifted, 0 if it need not be put down. */
int sp_grasp_put_down(sp_grasper *grasper, double *surface_w);
void sp_grasp_release(sp_grasper *grasper);
void sp_grasp_stop(sp_grasper *grasper);
void sp_grasp_abandon(sp_grasper *grasper);
void sp_grasp_steer(const sp_robot *robot, sp_grasper *grasper, const sp_waypoint *target, const double *action,
                    const double *pose_w, const double *form, double seconds);
void sp_grasp_order(const sp_grasp_scene *scene, double mass, sp_waypoint *order);
/* Least equal force of four feet that holds the object of a scene [N]. */
#define SP_TOLD (-1.0) /* true mass and friction in the orders */
int sp_grasp_rule(const sp_grasp_scene *scene, const sp_seen *seen, int idle, double grip, sp_rule_memory *memory,
                  sp_waypoint *orders); /* number of orders, 0 or 4 */
int sp_grasp_presses(const sp_grasper *grasper);
int sp_grasp_leaves(const sp_grasper *grasper);
int sp_grasp_waits(const sp_grasper *grasper);
void sp_grasp_step(const sp_robot *robot, sp_grasper *grasper, const sp_robot_state *state, double yaw, double lift,
                   const sp_seen *seen, double dt, sp_setting *aim, double *rate); /* seen: NULL if it is not */

/* program.c */
const sp_mode *sp_find_mode(int32_t kind); /* kind: of sp_program_kind, flight modes first */
void sp_ground_mode(int32_t kind, const sp_crawler_config *config, sp_mode *mode);
void sp_assemble(const sp_robot *robot, const sp_mode *mode, const sp_demand *demand, sp_program *program);
int sp_soft_rows(const sp_mode *mode, int32_t *rows);
void sp_soften(const sp_program *program, const int32_t *rows, int count, double price, sp_program *soft);
double sp_violation(const sp_program *program, const double *x);
int sp_closed_form(const sp_program *program, const double *duals, int rounds, sp_workspace *work, double *x);

/* cone.c */
int sp_sphere_optimum(const sp_program *program, const int32_t *soft, int count, double price, sp_workspace *work,
                      double *x, int32_t *steps);

/* allocate.c */
void sp_allocate(const sp_mode *mode, const sp_demand *demand, const double *previous_l, const int32_t *guess,
                 int guess_rows, const sp_allocator_config *config, sp_room *room, sp_allocation *allocation);
void sp_project(const sp_demand *demand, const double *wish_l, const double *previous_l,
                const sp_allocator_config *config, sp_room *room, sp_allocation *allocation);
double sp_limit_thrust(double most, double *force);

/* flight.c */
void sp_flight_init(sp_flight *flight, const sp_controller_config *config);
void sp_flight_reset(const sp_robot *robot, sp_flight *flight, const sp_robot_state *state, const double *joint_position, const double *trim);
void sp_flight_resume(const sp_robot *robot, sp_flight *flight, const sp_robot_state *state, const sp_command *command);
void sp_rest_vectoring(const sp_robot *robot, const sp_controller_config *config, const double *q, double *vectoring);
void sp_compute_state(const sp_robot *robot, const sp_robot_state *state, const sp_reference *reference, sp_control_state *control);
void sp_plan_joints(const sp_robot *robot, const sp_flight *flight, const double *wanted, double scale, double *following,
                    double *rate);
void sp_flight_step(sp_flight *flight, const sp_robot_state *state, const sp_reference *reference,
                    const sp_residual *residual, const sp_control_state *control, const sp_grip *grip, sp_room *room,
                    sp_command *command);
void sp_flight_allocate(sp_flight *flight, const sp_robot_state *state, const sp_reference *reference, const double *wrench,
                        sp_room *room, double *thrust, double *vectoring); /* the allocation alone */

/* compensation.c */
void sp_leg_momentum(const sp_snapshot *snapshot, const double *velocity, double *h);
double sp_torque_observer_gain(const sp_compensation_config *config);
void sp_compensate(const sp_robot *robot, sp_flight *flight, const sp_robot_state *state, const sp_reference *reference,
                   const double *joints, double *wrench);
void sp_lead_forces(const double *forces_l, const sp_snapshot *snapshot, const double *omega_b, const double *velocity,
                    double lead, double *led);
void sp_ramp_joints(const double *command, const double *velocity, const double *target, double speed, double ramp,
                    double dt, double *following, double *rate);

/* path.c: knots are sorted by time; before the first and after the last knot the path rests at that knot */
void sp_path_at(const sp_knot *knots, int n, double time, double *pose, double *rate, double *acceleration);
void sp_preview_path(const sp_knot *knots, int n, double time, sp_preview *preview);
void sp_follow_path(const sp_knot *knots, int n, double time, sp_reference *reference);
void sp_begin_legs(const double *point, double speed, int along, double yaw, double begin, sp_knot *knots, int room,
                   sp_legs *legs); /* all knots are counted, the first `room` are written */
void sp_leg_to(const double *point, sp_knot *knots, int room, sp_legs *legs);
int sp_path_lemniscate(double half_width, double speed, double seconds, const double *position_w, double direction,
                       int along, double begin, sp_knot *knots, int room);
double sp_ease(double u);
int sp_path_from_motion(const sp_knot *begin, const double *end, double speed, sp_knot *knots);
void sp_path_spline(sp_knot *knots, int n, double speed, int along, double yaw, double begin);

/* legs.c */
int sp_leg_angles(const sp_robot *robot, const double *feet_b, double *q);
void sp_feet_at(const sp_robot *robot, const double *q, double *feet_b);
void sp_home(const sp_robot *robot, const sp_gait_config *config, double *home_b);
int sp_stride_fits(const sp_robot *robot, const sp_gait_config *config, const double *home_b, sp_pose2 way, double lift_height);
double sp_largest_stride(const sp_robot *robot, const sp_crawl *crawl, sp_pose2 way); /* as a share of `way` */

/* gait.c */
void sp_gait_reset(sp_crawl *crawl, const double *position_w, const double *R_wb, const double *q);
int sp_gait_move(const sp_robot *robot, sp_crawl *crawl, sp_pose2 way, int cycles);
int sp_gait_lift(sp_crawl *crawl, const int32_t *legs, double angle, double seconds);
int sp_gait_stand(const sp_robot *robot, sp_crawl *crawl, double height, double seconds);
int sp_gait_done(const sp_crawl *crawl);
sp_program_kind sp_gait_mode(const sp_crawl *crawl);
void sp_gait_lifted(const sp_crawl *crawl, int32_t *lifted);
void sp_gait_step(const sp_robot *robot, sp_crawl *crawl, const double *position_w, const double *R_wb, const double *q,
                  const sp_residual *residual, double *plan);

/* crawl.c */
void sp_crawl_init(const sp_robot *robot, sp_crawl *crawl, const sp_crawler_config *config);
void sp_crawl_reset(sp_crawl *crawl, const sp_robot_state *state);
void sp_crawl_step(sp_crawl *crawl, const sp_robot_state *state, const sp_residual *residual, sp_room *room,
                   sp_command *command);

/* manager.c: both gaits */
void sp_manager_init(const sp_robot *robot, sp_manager *manager, const sp_manager_config *config);
void sp_manager_reset(const sp_robot *robot, sp_manager *manager, const sp_robot_state *state);
void sp_manager_begin_in_air(const sp_robot *robot, sp_manager *manager, const sp_robot_state *state); /* after a reset */
void sp_manager_steer(const sp_robot *robot, sp_manager *manager, const sp_robot_state *state, const sp_waypoint *target,
                      const double *action, double seconds);
int32_t sp_manager_situation(const sp_manager *manager); /* sp_situation */
int sp_manager_airborne(const sp_manager *manager);
int sp_manager_done(const sp_manager *manager);
int sp_manager_command(sp_manager *manager, const sp_waypoint *command);
int sp_manager_interrupt(sp_manager *manager, const sp_waypoint *commands, int n);
const char *sp_cannot_follow(int32_t kind, int32_t *situation);
/* End the mission: come to rest on the floor from any phase, without an object. */
void sp_manager_end(sp_manager *manager);
void sp_manager_step(sp_manager *manager, const sp_robot_state *state, const sp_residual *residual, const sp_seen *seen,
                     sp_room *room, sp_command *command); /* seen: object to grasp, NULL if it is not seen */

/* pilot.c: courses */
double sp_course_floor(const sp_course *course, double x);
double sp_course_end(const sp_course *course);
void sp_target_form(const sp_target *target, double *q);
void sp_take_target(const double *action, const sp_course *course, const double *position_w, sp_target *target);
void sp_pilot_follow(const sp_target *target, const sp_robot_state *state, const sp_course *course, sp_manager *manager,
                     sp_pilot *pilot);
sp_target sp_course_rule(const sp_course *course, const double *position_w, const double *q, int32_t phase, int flies,
                         int crawls);

/* estimate.c */
void sp_estimator_init(sp_estimator *estimator, const sp_estimator_config *config);
void sp_estimator_reset(const sp_robot *robot, sp_estimator *estimator, const sp_robot_state *state);
void sp_estimator_update(const sp_robot *robot, sp_estimator *estimator, const sp_measurement *measurement, const double *thrust,
                         sp_robot_state *state);

/* observe.c */
int sp_observe(const sp_flight *flight, const sp_robot_state *state, const sp_control_state *control,
               const double *thrust, const double *joint_velocity, const double *leg_momentum,
               const double *leg_momentum_rate, const sp_preview *preview, int has_path, const double *previous_action,
               int action_size, const double *bound, float *observation);
int sp_observe_crawl(const sp_crawl *crawl, const sp_robot_state *state, const double *goal, const double *thrust,
                     const double *previous_action, int action_size, int ticks, const double *bound,
                     float *observation);
int sp_observe_grasp(const sp_robot *robot, const sp_manager *manager, const sp_grasp_scene *scene, const sp_seen *seen,
                     const sp_robot_state *state, const sp_command *last, double charge, double time_left,
                     const double *previous_action, int action_size, const double *bound, float *observation);
int sp_observe_course(const sp_robot *robot, const sp_manager *manager, const sp_pilot *pilot, const sp_course *course,
                      const sp_robot_state *state, const sp_command *last, double charge, double time_left,
                      const double *previous_action, int action_size, const double *bound, float *observation);

/* policy.c: call it before the controller's step and pass the residual to that step, NULL if the policy is off.
 * Reset the policy whenever it is switched on. */
void sp_make_residual(const double *action, const double *authority, int n, int32_t channels, sp_residual *residual);
void sp_network(const float *weights, const int32_t *sizes, int layers, int relu, int has_skip, const float *input, float *work,
                int width, float *answer);
int sp_policy_kind(void); /* sp_policy_target */
void sp_policy_reset(sp_policy *policy);
void sp_policy_flight(const sp_robot *robot, sp_policy *policy, const sp_flight *flight, const sp_robot_state *state,
                      const sp_control_state *control, const sp_preview *preview, sp_residual *residual);
void sp_policy_direct(const sp_robot *robot, sp_policy *policy, sp_flight *flight, const sp_robot_state *state,
                      const sp_control_state *control, const sp_preview *preview, sp_command *command);
void sp_policy_crawl_direct(const sp_robot *robot, sp_policy *policy, sp_crawl *crawl, const sp_robot_state *state,
                            const double *goal, sp_command *command);
void sp_policy_crawl(const sp_robot *robot, sp_policy *policy, const sp_crawl *crawl, const sp_robot_state *state, const double *goal,
                     sp_residual *residual);

/* border.c */
extern const sp_residual SP_NO_RESIDUAL;
const char *sp_interface(void); /* digest of structs, robot and sources */
int sp_valid_state(const sp_robot_state *state);
int sp_valid_reference(const sp_reference *reference);
const sp_residual *sp_usable_residual(const sp_residual *residual);
void sp_make_command(const double *thrust, const double *vectoring, const double *joints, double limit,
                     sp_command *command);

#endif
