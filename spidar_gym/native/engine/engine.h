/* The engine: SPIDAR's simulated world around the control core, for one robot or thousands.
 *
 * C99 without writable globals and without allocation. A robot is plain data: an `sp_plant`, or a struct that begins
 * with one. Each thread has an mjModel and an mjData, into which a robot is loaded for a tick. MuJoCo is called through
 * addresses of functions and arrays that Python passes in. So the engine needs no MuJoCo header and is not compiled
 * against a MuJoCo version.
 */
#ifndef SPIDAR_ENGINE_H
#define SPIDAR_ENGINE_H

#include "draws.h"
#include "spidar_core.h"
#include "spidar_engine_structs.h" /* generated */
#include "spidar_math.h"

/* MuJoCo's functions, and numbers of its enumerations. */
typedef struct {
    void (*step)(void *model, void *data);
    void (*forward)(void *model, void *data);
    void (*set_const)(void *model, void *data);
    void (*reset_data)(const void *model, void *data);
    void (*get_state)(const void *model, const void *data, double *row, int kind);
    void (*set_state)(const void *model, void *data, const double *row, int kind);
    void (*contact_force)(const void *model, const void *data, int id, double *wrench);
    int (*eig3)(double *values, double *vectors, double *quat, const double *matrix);
    int64_t state_kind, contact_off; /* mjSTATE_INTEGRATION, mjDSBL_CONTACT */
} sp_mujoco;

/* An mjModel and an mjData with the addresses of their arrays, in the order of `native/mujoco.py`. */
typedef struct {
    const sp_mujoco *mujoco;
    void *model, *data;
    /* of the mjData */
    double *time, *qpos, *qvel, *act, *ctrl, *actuator_force, *qfrc_applied;
    double *qfrc_actuator, *qfrc_bias;
    double *xpos, *xmat, *cvel, *cdof, *subtree_com, *geom_xpos, *geom_xmat;
    int32_t *contacts;
    char **contact;
    char *warnings; /* counts of MuJoCo's warnings by kind; MuJoCo prints the first of each kind */
    /* of the mjModel */
    double *actuator_gear, *actuator_ctrlrange, *actuator_actrange, *actuator_dynprm, *actuator_biasprm;
    double *actuator_forcerange, *dof_frictionloss, *dof_damping, *body_mass, *body_inertia, *body_ipos;
    double *body_iquat, *geom_friction, *geom_pos, *geom_quat, *geom_size, *geom_rbound, *geom_aabb;
    uint8_t *geom_sameframe;
    int32_t *body_geomnum, *geom_type, *disableflags;
    int64_t contact_stride, contact_geoms, contact_frame; /* bytes of an mjContact; offsets of its geoms and axes in it */
    int64_t warning_bytes;
} sp_sim;

/* air.c */
double sp_jet_profile(double s, double r, double w, double core_length, double radius);
double sp_thrust_factor(double inflow, double zero_thrust_speed);
void sp_evaluate_air(const sp_world *world, const sp_sim *sim, const sp_aero_config *config,
                     const sp_recirculation_config *recirculation, const sp_object_config *object, const double *thrust,
                     const double *wind_w, const double *noise, const double *push_w, const double *eddy, sp_air *air);

/* weather.c */
void sp_draw_weather(const sp_disturbances *disturbances, sp_generator *generator, sp_weather *weather);
void sp_advance_weather(const sp_disturbances *disturbances, double time, double dt, sp_generator *generator,
                        sp_weather *weather);
int sp_recirculates(const sp_recirculation_config *config);
void sp_draw_eddy(sp_generator *generator, double *eddy);
void sp_advance_eddy(const sp_recirculation_config *config, double dt, sp_generator *generator, double *eddy);
void sp_advance_noise(double *noise, double sigma, double dt, sp_generator *generator);

/* sensors.c */
void sp_start_sensors(const sp_world *world, const sp_sensor_config *config, const double *offset,
                      const sp_robot_state *state, sp_generator *generator, sp_sensor_memory *memory);
void sp_sample_sensors(const sp_world *world, const sp_sensor_config *config, const double *offset,
                       const sp_robot_state *state, sp_generator *generator, sp_sensor_memory *memory);
void sp_read_sensors(const sp_sensor_config *config, double time, sp_sensor_memory *memory,
                     sp_measurement *measurement);

/* energy.c */
double sp_electrical_power(const double *thrust, const double *joint_torque, const double *joint_velocity);
double sp_voltage(double energy_wh, double power);

/* floor.c */
void sp_lay_floor(const sp_world *world, const sp_ground_config *config, const sp_sim *sim);
double sp_floor_height(const sp_ground_config *config, double x, double y);
double sp_clearance(const sp_world *world, const sp_sim *sim, const sp_plant *plant);
void sp_look_for_contacts(const sp_sim *sim, int wanted);
double sp_hit(const sp_world *world, const sp_sim *sim);
void sp_contact_geoms(const sp_sim *sim, int contact, int32_t *pair);
int sp_with_object(const sp_world *world, const int32_t *pair);
int sp_in_contact(const sp_world *world, const sp_sim *sim);
int32_t sp_violates(const sp_world *world, const sp_sim *sim, int contact);
void sp_touching(const sp_world *world, const sp_sim *sim, const sp_plant *plant, sp_touch *touch);

/* object.c */
void sp_object_scale(const sp_object_config *config, double *scale);
void sp_write_object(const sp_world *world, const sp_object_config *config, const sp_sim *sim);
void sp_place_object(const sp_world *world, const sp_sim *sim, const double *position_w, const double *quat_wo);
void sp_read_object(const sp_world *world, const sp_sim *sim, sp_object_state *state);
void sp_keep_object(const sp_sim *sim, const sp_object_state *state);
void sp_watch_object(const sp_world *world, const sp_sim *sim, int left, double apart, sp_plant *p);

/* body.c: writes a configuration into MuJoCo's model. */
void sp_write_body(const sp_world *world, const sp_body_config *config, const sp_sim *sim);
void sp_write_actuators(const sp_world *world, const sp_actuator_config *config, double joint_speed, const sp_sim *sim);

/* plant.c */
void sp_configure(const sp_world *world, const sp_sim *sim, const sp_plant_config *config, sp_plant *plant);
void sp_enter(const sp_world *world, const sp_sim *sim, sp_plant *plant);
void sp_leave(const sp_sim *sim, sp_plant *plant);
int sp_is_somewhere(const sp_world *world, const sp_sim *sim);
void sp_plant_reset(const sp_world *world, const sp_sim *sim, const double *position_w, const double *quat_wb,
                    const double *joints, const double *vectoring, const double *thrust, const double *motion,
                    const double *object, sp_plant *plant);
void sp_plant_step(const sp_world *world, const sp_sim *sim, const sp_command *command, sp_plant *plant);
void sp_measure(sp_plant *plant, sp_measurement *measurement);

/* engine.c: robots on threads. */

/* An array of MuJoCo's model that may differ between robots: its address in a thread's model, and its size and offset
 * in a robot's copy. */
typedef struct {
    char *here;
    int64_t bytes, there;
} sp_piece;

/* Resources of a thread. A job loads a robot's state into them at its start and stores it at its end. */
typedef struct {
    sp_sim sim;
    sp_room *room;
    const sp_piece *pieces;
    const void *seat;    /* mjData of MuJoCo's pool that identifies the thread; NULL while the slot is free */
    int64_t busy;        /* set while a job runs; still set at the next job if MuJoCo aborted this one */
    const char *carries; /* the copy whose arrays are in its model now; NULL for none */
} sp_thread;

/* Many robots. `first` points to the first and `stride` is the size of one in bytes; each begins with an sp_plant. */
typedef struct sp_engine {
    const sp_world *world;
    int (*apply)(void *batch, const int32_t *ids, int n, void (*job)(const void *, void *, int, void *), void *argument,
                 int save); /* MuJoCo's mjb_apply */
    void *batch;
    sp_thread *threads;
    char *first, *copies; /* copies of the pieces, `copy_bytes` each: one per robot, or one for all */
    int64_t stride, copy_bytes, thread_count, piece_count, own_copies;
    void (*job)(struct sp_engine *engine, sp_thread *thread, int robot);
    void *argument; /* of the job */
    const void *rules; /* of the task; below, inputs and outputs of a tick, one entry per robot */
    sp_goal *goals;
    sp_knot *knots; /* of paths */
    const double *actions;
    float *observations;
    uint8_t *begun; /* whether the step was a reset */
    char *infos, *quantities; /* `info`; quantities for rewards, failures and success */
    int64_t observation_size; /* numbers per robot */
    int64_t goal_room, knot_room, rules_bytes; /* goals, knots, bytes of rules per robot; 0 for shared rules */
} sp_engine;

int sp_run(sp_engine *engine, const int32_t *ids, int n, void (*job)(sp_engine *, sp_thread *, int), void *argument);
sp_plant *sp_plant_of(const sp_engine *engine, int robot);
const void *sp_rules_of(const sp_engine *engine, int robot);
void sp_carry(const sp_engine *engine, sp_thread *thread, int robot);

void sp_become(const sp_engine *engine, sp_thread *thread, int robot, const sp_plant_config *config);
void sp_put_down(const sp_engine *engine, sp_thread *thread, int robot, const sp_plant_config *config);

/* Initial pose of a robot, and `motion` of its torso: velocity of the origin, world; angular velocity, torso axes.
 * `object` is the pose of an object at rest: position of its origin, quaternion. */
typedef struct {
    double position_w[3], quat_wb[4], joint_position[SP_JOINTS], vectoring[2 * SP_ROTORS], thrust[SP_ROTORS], motion[6];
    double object[7];
} sp_pose;

int sp_configure_plants(sp_engine *engine, const int32_t *ids, int n, const sp_plant_config *configs);
int sp_change_plants(sp_engine *engine, const int32_t *ids, int n, const sp_plant_config *configs);
int sp_reset_plants(sp_engine *engine, const int32_t *ids, int n, const sp_pose *poses);
int sp_step_plants(sp_engine *engine, const int32_t *ids, int n, const sp_command *commands);
void sp_keep_now(const sp_engine *engine);
void sp_touching_now(const sp_engine *engine, sp_touch *touch);
int sp_refresh_plants(sp_engine *engine, const int32_t *ids, int n); /* recomputes kinematics and contacts */

/* hover_robot.c. The `lose` functions mark robots as diverged for which MuJoCo failed. Where commands or references
 * come from Python, a step ends before `regard`. */
void sp_draw_flight(const sp_hover_rules *rules, int32_t forms, sp_generator *generator, sp_goal *goals,
                    int64_t goal_room, sp_knot *knots, int64_t knot_room, sp_flight_start *start);
int sp_refer_hover_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_regard_hover_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_show_hover_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_reset_hover_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_step_hover_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_hold_hover_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_lose_hover_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_watch_hover_robots(sp_engine *engine, const int32_t *ids, int n, sp_watch *watches);

/* crawl_robot.c */
int32_t sp_draw_way(const sp_crawl_rules *rules, sp_generator *generator, int64_t most, sp_pose2 *drawn_way);
int sp_show_crawl_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_reset_crawl_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_step_crawl_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_hold_crawl_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_lose_crawl_robots(sp_engine *engine, const int32_t *ids, int n);

/* course_robot.c */
void sp_draw_course(const sp_course_rules *rules, sp_generator *generator, sp_course *course);
int sp_show_course_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_reset_course_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_step_course_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_hold_course_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_lose_course_robots(sp_engine *engine, const int32_t *ids, int n);

/* grasp_robot.c */
void sp_draw_scene(const sp_grasp_rules *rules, sp_generator *generator, sp_grasp_scene *scene);
int sp_show_grasp_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_reset_grasp_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_step_grasp_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_hold_grasp_robots(sp_engine *engine, const int32_t *ids, int n);
int sp_lose_grasp_robots(sp_engine *engine, const int32_t *ids, int n);

#endif
