/* SPIDAR's controller in flight and on the ground: what the simulator flies is what the robot runs.
 *
 * C99, no heap, no globals, no input or output. Every struct is plain data; a new controller is a reset one.
 * Frames: w world, b torso, c CoG with torso axes, l axes of the link that carries a rotor, f floor. SI units.
 */
#ifndef SPIDAR_CORE_H
#define SPIDAR_CORE_H

#include <stdint.h>

#include "spidar_structs.h" /* generated: what crosses the border, and configurations */

#define SP_LEGS 4
#define SP_ROTORS 8
#define SP_JOINTS 16
#define SP_FORCES 24   /* unknowns: rotor forces in link axes */
#define SP_UNKNOWNS 36 /* … and the floor's forces on the feet */
#define SP_MAX_N 80    /* unknowns of the largest softened program */
#define SP_MAX_M 80    /* rows of the largest program */
#define SP_MAX_OBSERVATION 512 /* numbers that a policy sees, */
#define SP_MAX_ACTION 24       /* and that it answers, */
#define SP_MAX_WIDTH 1024      /* and of the widest layer between them */
#define SP_INFINITY 1e30

/* Model quantities at one configuration, torso axes. */
typedef struct {
    double mass;                        /* [kg] */
    double com_b[3];                    /* CoG from the torso's origin [m] */
    double inertia_c[9];                /* centroidal inertia [kg m²] */
    double R_bl[SP_ROTORS][9];          /* attitude of each rotor's link */
    double rotor_c[SP_ROTORS][3];       /* rotor centres from the CoG [m] */
    double J_rotor[SP_ROTORS][3 * SP_JOINTS]; /* ∂(rotor centre)/∂q, torso held fixed */
    double joint_axes[3 * SP_JOINTS];   /* direction of each joint's axis, (3, 16) */
    double gravity_torque[SP_JOINTS];   /* holds the links without thrust [Nm] */
    double momentum_map[6 * SP_JOINTS]; /* momentum about the CoG per joint velocity, (6, 16) */
    double feet_b[SP_LEGS][3];          /* centres of the foot spheres from the torso's origin [m] */
    double J_foot[SP_LEGS][3 * SP_JOINTS]; /* ∂(centre)/∂q */
} sp_snapshot;

/* Which rotors have their φ held, and where. */
typedef struct {
    int32_t vertical[SP_ROTORS], active[SP_ROTORS];
    double phi[SP_ROTORS];
} sp_lock;

/* The valid vectoring range of each rotor. */
typedef struct {
    int32_t restricted[SP_ROTORS];
    double lower[SP_ROTORS], upper[SP_ROTORS];
    int32_t side[SP_ROTORS];
} sp_interference;

/* Blocks of a mode: kinds of cost and of rows, each with its numbers. */
typedef enum {
    SP_NO_COST, SP_THRUST_EFFORT, SP_POWER_EFFORT, SP_JOINT_TORQUE_EFFORT, SP_FOOT_EFFORT
} sp_cost_kind;
typedef enum {
    SP_NO_ROWS, SP_WRENCH_BALANCE, SP_THRUST_BOX, SP_JOINT_TORQUE_LIMIT, SP_VECTORING_LOCK, SP_INTERFERENCE_BOUND,
    SP_CONTACT_WRENCH_RANGE, SP_FRICTION_PYRAMID
} sp_rows_kind;
typedef enum { SP_PAPER, SP_AS_FLOWN, SP_PROJECTION, SP_REST, SP_LEG, SP_ALL_LEGS, SP_STANCE, SP_PROGRAMS } sp_program_kind;

typedef struct {
    sp_cost_kind kind;
    double weight;
} sp_cost;
typedef struct {
    sp_rows_kind kind;
    double a, b; /* limit, or friction and least normal force */
} sp_rows;
typedef struct {
    sp_program_kind kind; /* which pattern, so which workspace of the solver */
    int32_t feet_carry, n, m;
    sp_cost costs[4];
    sp_rows rows[6];
} sp_mode;

/* What one tick asks of the allocation. */
typedef struct {
    double wrench[6];
    double thrust_map[6 * SP_UNKNOWNS];         /* (6, n) */
    double torque_map[SP_JOINTS * SP_UNKNOWNS]; /* (16, n) */
    double gravity_torque[SP_JOINTS];
    int32_t locked[SP_ROTORS];
    double phi[SP_ROTORS];
    int32_t restricted[SP_ROTORS];
    double lower[SP_ROTORS], upper[SP_ROTORS];
    int32_t lost[SP_ROTORS], lifted[SP_LEGS];
    double com_b[3], R_bf[9], effort[SP_ROTORS];
} sp_demand;

/* min ½ xᵀ P x + qᵀ x subject to l ≤ A x ≤ u; P (n, n) and A (m, n) row-major with stride n. */
typedef struct {
    int32_t n, m;
    double P[SP_MAX_N * SP_MAX_N], q[SP_MAX_N], A[SP_MAX_M * SP_MAX_N], l[SP_MAX_M], u[SP_MAX_M];
} sp_program;

typedef enum { SP_CLOSED_FORM, SP_SOLVED, SP_SOFTENED, SP_HELD } sp_status;

/* The answer of one tick. */
typedef struct {
    double forces_l[SP_FORCES];
    double foot_forces_f[3 * SP_LEGS];
    double thrust[SP_ROTORS];
    double joint_torques[SP_JOINTS];
    double wrench[6], unallocated_wrench[6];
    int32_t saturated[SP_ROTORS];
    int32_t status; /* sp_status */
    int32_t iterations;
    double slack;
    int32_t rows;              /* how many of the next are meant */
    int32_t active[SP_MAX_M];  /* +1 where a row is at its upper bound, −1 at its lower */
} sp_allocation;

/* Room for the linear algebra of a tick; nothing in it outlives one. */
typedef struct {
    sp_program program, soft;
    double K[4 * SP_MAX_N * SP_MAX_N], right[2 * SP_MAX_N], r[SP_MAX_M];
    int32_t pivot[2 * SP_MAX_N], rows[2 * SP_MAX_M];
    double target[2 * SP_MAX_M], signs[2 * SP_MAX_M];
    double Px[SP_MAX_N * SP_MAX_N], Ax[SP_MAX_M * SP_MAX_N];
} sp_room;

/* Errors of the centroidal motion, desired − actual. */
typedef struct {
    double position_w[3], velocity_w[3], attitude[3], omega_b[3];
} sp_motion_error;

/* What the compensations remember. */
typedef struct {
    double servo_position[SP_JOINTS], servo_velocity[SP_JOINTS];
    int32_t has_momentum, has_observed;
    double momentum[3], torque[3], observed_momentum[6], delivered_w[6], external_w[6];
} sp_compensation_memory;

/* All that the flight controller remembers from one tick to the next. */
typedef struct {
    double position_integral_w[3], attitude_integral[3];
    sp_lock lock;
    sp_interference interference;
    double vectoring[2 * SP_ROTORS], forces_l[SP_FORCES], joint_position[SP_JOINTS];
    double unallocated_w[3], unallocated_torque[3], joint_velocity[SP_JOINTS];
    sp_compensation_memory compensation;
} sp_flight_memory;

/* What the controller makes of a state. */
typedef struct {
    double R_wb[9];
    sp_snapshot snapshot;
    sp_motion_error error;
} sp_percept;

/* The flight controller. */
typedef struct {
    sp_controller_config config;
    sp_flight_memory memory;
    sp_mode mode, projection;
    double dt;
    int32_t ticked; /* whether there is a last tick */
    sp_percept percept;
    sp_demand demand;
    double wrench_desired[6], joint_velocity[SP_JOINTS];
    sp_allocation allocation;
    sp_room room;
} sp_flight;

/* Planar poses. */
typedef struct {
    double x, y, yaw;
} sp_planar;

typedef enum { SP_CYCLE, SP_LIFT, SP_STAND } sp_phases;
typedef enum {
    SP_DONE, SP_SPOOL, SP_RAISE, SP_SWING, SP_LOWER, SP_BRACE, SP_UP, SP_FORWARD, SP_DOWN, SP_SETTLE, SP_HOLD
} sp_phase;

/* One run through some phases. */
typedef struct {
    int32_t phases; /* sp_phases */
    int32_t has_target;
    sp_planar target;
    int32_t legs[SP_LEGS]; /* 1 where the leg is lifted */
    int32_t has_angle, has_height;
    double angle, height, seconds;
} sp_step;

#define SP_MAX_STEPS 256

/* All that the gait remembers. */
typedef struct {
    sp_step steps[SP_MAX_STEPS];
    int32_t first, count; /* a ring: the present step first */
    double plan[SP_JOINTS], position_w[3], slow_w[3], R_wb[9], joints[SP_JOINTS];
    int32_t phase, index;
    double time, still;
    double target[SP_JOINTS], landing[SP_JOINTS], highest[SP_JOINTS], start[SP_JOINTS];
    double floor_R[9], floor_w[3], feet_f[3 * SP_LEGS];
    sp_planar way;
    double share, height, lift, expected[3], yaw, trim[3];
    int32_t rested, timeouts;
    sp_planar planned;
} sp_gait_memory;

/* All that the allocation on the ground remembers. */
typedef struct {
    sp_lock lock;
    double vectoring[2 * SP_ROTORS], forces_l[SP_FORCES], joint_torque[SP_JOINTS], joint_position[SP_JOINTS];
    int32_t mode; /* sp_program_kind */
    double force_gap[SP_FORCES], torque_gap[SP_JOINTS], gap, effort[SP_ROTORS];
    int32_t rows, active[SP_MAX_M];
} sp_crawl_memory;

/* The crawl's controller. */
typedef struct {
    sp_crawler_config config;
    sp_gait_memory gait;
    sp_crawl_memory memory;
    sp_mode modes[SP_PROGRAMS], projection;
    double dt, home_b[3 * SP_LEGS];
    int32_t ticked;
    double R_wb[9];
    sp_snapshot snapshot;
    sp_demand demand;
    sp_allocation allocation;
    sp_room room;
} sp_crawl;

#define SP_HISTORY 32
#define SP_ANGLES (SP_JOINTS + 2 * SP_ROTORS)

/* The state estimator. */
typedef struct {
    sp_estimator_config config;
    double time, R_wb[9], position_w[3], velocity_w[3], omega_b[3], gyro_bias[3], accelerometer_bias[3];
    double past_time[SP_HISTORY], past_position_w[SP_HISTORY][3], past_R_wb[SP_HISTORY][9];
    double encoder_time, angles[SP_ANGLES], rates[SP_ANGLES];
} sp_estimator;

/* What the entries of a policy's action are: channels, in this order. */
typedef enum {
    SP_CHANNEL_WRENCH = 1,
    SP_CHANNEL_JOINT_OFFSET = 2,
    SP_CHANNEL_JOINT_SPEED_SCALE = 4,
    SP_CHANNEL_FORCES = 8,
    SP_CHANNEL_GAIT = 16, /* phase rate, raise, stride, lift height */
    SP_CHANNEL_LEG_FORCES = 32
} sp_channel;

/* What a policy in flight is told of the plan. */
typedef struct {
    double joint_target[SP_JOINTS], next_form[SP_JOINTS]; /* to reach now, and after it (the same if none) [rad] */
    double time_to_next;                                  /* until then; 60 if there is none [s] */
} sp_preview;

/* What a learned policy remembers: its last action, as it was applied, and what leads to the next. */
typedef struct {
    int32_t has_momentum;
    double action[SP_MAX_ACTION], leg_momentum[3]; /* in [−1, 1]; [Nms] */
    double slow[SP_MAX_ACTION];                    /* low-passed answers that the washout takes away */
    float observation[SP_MAX_OBSERVATION];         /* what it saw last */
} sp_policy;

/* tree.c */
void sp_tree(const double *q, const double *R_wb, const double *vectoring, sp_snapshot *snapshot);

/* rotor.c */
void sp_vectoring_to_force(const double *thrust, const double *vectoring, double *forces_l);
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
                          const sp_interference_config *config, sp_interference *bounds);

/* program.c */
void sp_flight_mode(int32_t allocation, sp_mode *mode);
void sp_ground_mode(sp_program_kind kind, const sp_crawler_config *config, sp_mode *mode);
void sp_projection_mode(sp_mode *mode);
void sp_assemble(const sp_mode *mode, const sp_demand *demand, sp_program *program);
int sp_soft_rows(const sp_mode *mode, int32_t *rows);
void sp_soften(const sp_program *program, const int32_t *rows, int count, double price, sp_program *soft);
double sp_violation(const sp_program *program, const double *x);
int sp_closed_form(const sp_program *program, const double *duals, int rounds, double tolerance, sp_room *room,
                   double *x);

/* allocate.c */
void sp_allocate(const sp_mode *mode, const sp_demand *demand, const double *previous_l, const int32_t *guess,
                 int guess_rows, int keep_active, const sp_allocator_config *config, sp_room *room,
                 sp_allocation *allocation);
void sp_project(const sp_mode *projection, const sp_demand *demand, const double *wish_l, const double *previous_l,
                const sp_allocator_config *config, sp_room *room, sp_allocation *allocation);

/* flight.c */
void sp_flight_init(sp_flight *flight, const sp_controller_config *config);
void sp_flight_reset(sp_flight *flight, const sp_robot_state *state, const double *joint_position, const double *trim);
void sp_rest_vectoring(const sp_controller_config *config, const double *q, double *vectoring);
void sp_leg_momentum(const sp_snapshot *snapshot, const double *velocity, double *h);
void sp_perceive(const sp_robot_state *state, const sp_reference *reference, sp_percept *percept);
void sp_flight_step(sp_flight *flight, const sp_robot_state *state, const sp_reference *reference,
                    const sp_residual *residual, const sp_percept *percept, sp_command *command);

/* legs.c */
int sp_leg_angles(const double *feet_b, double *q);
void sp_feet_at(const double *q, double *feet_b);
void sp_home(const sp_gait_config *config, double *home_b);
int sp_lying_pose(const sp_gait_config *config, double *q);
int sp_stride_fits(const sp_gait_config *config, const double *home_b, sp_planar way, double lift_height);
double sp_largest_stride(const sp_crawl *crawl, sp_planar way); /* as a share of the way */

/* gait.c */
void sp_gait_reset(sp_crawl *crawl, const double *position_w, const double *R_wb, const double *q);
int sp_gait_move(sp_crawl *crawl, sp_planar way, int cycles);
int sp_gait_lift(sp_crawl *crawl, const int32_t *legs, double angle, double seconds);
int sp_gait_stand(sp_crawl *crawl, double height, double seconds);
int sp_gait_done(const sp_crawl *crawl);
sp_program_kind sp_gait_mode(const sp_crawl *crawl);
void sp_gait_lifted(const sp_crawl *crawl, int32_t *lifted);
void sp_gait_step(sp_crawl *crawl, const double *position_w, const double *R_wb, const double *q,
                  const sp_residual *residual, double *plan);

/* crawl.c */
void sp_crawl_init(sp_crawl *crawl, const sp_crawler_config *config);
void sp_crawl_reset(sp_crawl *crawl, const sp_robot_state *state);
void sp_crawl_step(sp_crawl *crawl, const sp_robot_state *state, const sp_residual *residual, sp_command *command);

/* estimate.c */
void sp_estimator_init(sp_estimator *estimator, const sp_estimator_config *config);
void sp_estimator_reset(sp_estimator *estimator, const sp_robot_state *state);
void sp_estimator_update(sp_estimator *estimator, const sp_measurement *measurement, const double *thrust,
                         sp_robot_state *state);

/* observe.c */
int sp_observe(const sp_flight *flight, const sp_robot_state *state, const sp_percept *percept, const double *thrust,
               const double *joint_velocity, const double *leg_momentum, const double *leg_momentum_rate,
               const double *joint_target, const double *next_form, double time_to_next, const double *previous_action,
               int action_size, const double *bound, float *observation);
int sp_observe_crawl(const sp_crawl *crawl, const sp_robot_state *state, const double *goal, const double *thrust,
                     const double *previous_action, int action_size, const double *bound, float *observation);

/* policy.c: called before the controller's step, which gets the residual, or NULL where the policy is switched off;
 * reset whenever it is switched on. */
enum { SP_POLICY_NONE = -1, SP_POLICY_FLIGHT = 0, SP_POLICY_CRAWL = 1 };
int sp_policy_kind(void); /* one of these */
void sp_policy_reset(sp_policy *policy);
void sp_policy_flight(sp_policy *policy, const sp_flight *flight, const sp_robot_state *state,
                      const sp_percept *percept, const sp_preview *preview, sp_residual *residual);
void sp_policy_crawl(sp_policy *policy, const sp_crawl *crawl, const sp_robot_state *state, const double *goal,
                     sp_residual *residual);

/* about.c */
const char *sp_interface(void);           /* digest of structs, robot and sources */

/* border.c */
int sp_valid_state(const sp_robot_state *state);
int sp_valid_reference(const sp_reference *reference);
int sp_valid_residual(const sp_residual *residual);
void sp_give(const double *thrust, const double *vectoring, const double *joints, double limit,
             sp_command *command);

#endif
