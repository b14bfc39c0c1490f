/* The free object beside the robot: its part of MuJoCo's model, its pose, and the forces on it. */
#include "engine.h"

static int exists(const sp_world *world) { return world->object >= 0; }

/* Half sizes of the box around the shape. */
void sp_object_scale(const sp_object_config *c, double *scale)
{
    const double *half = c->half_size;
    scale[0] = half[0];
    scale[1] = c->shape == SP_SHAPE_BOX ? half[1] : half[0];
    scale[2] = c->shape == SP_SHAPE_BALL ? half[0] : half[2];
}

/* Principal moments of a uniform solid about its middle, over its mass. */
static void solid(const sp_object_config *c, const double *s, double *moments)
{
    if (c->shape == SP_SHAPE_BALL) {
        moments[0] = moments[1] = moments[2] = 0.4 * s[0] * s[0];
    } else if (c->shape == SP_SHAPE_CYLINDER) {
        moments[0] = moments[1] = s[0] * s[0] / 4.0 + s[2] * s[2] / 3.0;
        moments[2] = s[0] * s[0] / 2.0;
    } else {
        for (int i = 0; i < 3; i++) {
            double a = s[(i + 1) % 3], b = s[(i + 2) % 3];
            moments[i] = (a * a + b * b) / 3.0;
        }
    }
}

/* Write shape, mass and friction into a model with an object. */
void sp_write_object(const sp_world *world, const sp_object_config *c, const sp_sim *sim)
{
    double s[3], moments[3];
    int32_t geom = world->object_geom, body = world->object;
    if (!exists(world)) return;
    sp_object_scale(c, s);
    solid(c, s, moments);
    sim->geom_type[geom] = world->object_type[c->shape];
    double *size = sim->geom_size + 3 * geom;
    sp_copy(size, s, 3);
    if (c->shape == SP_SHAPE_CYLINDER) size[1] = s[2], size[2] = 0.0;
    if (c->shape == SP_SHAPE_BALL) size[1] = size[2] = 0.0;
    sp_copy(sim->geom_aabb + 6 * geom + 3, s, 3);
    sim->geom_rbound[geom] = c->shape == SP_SHAPE_BALL ? s[0] : c->shape == SP_SHAPE_CYLINDER ? sqrt(s[0] * s[0] + s[2] * s[2]) : sp_norm(s);
    sim->geom_friction[3 * geom] = c->friction;
    sim->body_mass[body] = c->mass;
    sp_copy(sim->body_ipos + 3 * body, c->com, 3);
    for (int i = 0; i < 3; i++) sim->body_inertia[3 * body + i] = c->inertia * c->mass * moments[i];
}

/* Place the object at rest. */
void sp_place_object(const sp_world *world, const sp_sim *sim, const double *position_w, const double *quat_wo)
{
    if (!exists(world)) return;
    sp_copy(sim->qpos + SP_QPOS, position_w, 3);
    sp_copy(sim->qpos + SP_QPOS + 3, quat_wo, 4);
}

/* Read the object's state and the forces of the last physics step on it; the robot is loaded. */
void sp_read_object(const sp_world *world, const sp_sim *sim, sp_object_state *o)
{
    if (!exists(world)) return;
    sp_copy(o->position_w, sim->qpos + SP_QPOS, 3);
    sp_copy(o->quat_wo, sim->qpos + SP_QPOS + 3, 4);
    sp_copy(o->velocity_w, sim->qvel + SP_DOFS, 3);
    sp_copy(o->omega_o, sim->qvel + SP_DOFS + 3, 3);
    sp_zero(o->foot_force_w, 3 * SP_LEGS);
    sp_zero(o->floor_force_w, 3);
    for (int k = 0; k < *sim->contacts; k++) {
        int32_t pair[2];
        double wrench[6], frame[9], force[3];
        sp_contact_geoms(sim, k, pair);
        if (!sp_with_object(world, pair)) continue;
        int first = pair[0] == world->object_geom;
        int32_t other = pair[first];
        sim->mujoco->contact_force(sim->model, sim->data, k, wrench);
        memcpy(frame, *sim->contact + k * sim->contact_stride + sim->contact_frame, sizeof frame);
        sp_apply_t(frame, wrench, force); /* on the second geom of the pair */
        int32_t kind = world->geom_kind[other];
        double *sum = kind >= 0 && kind < SP_LEGS ? o->foot_force_w + 3 * kind : o->floor_force_w;
        if (world->geom_touches[other] && !(kind >= 0 && kind < SP_LEGS)) {
            o->is_hit = 1;
            continue;
        }
        for (int i = 0; i < 3; i++) sum[i] += first ? -force[i] : force[i];
    }
}

/* Leave a resting object where it is after a physics step. */
void sp_keep_object(const sp_sim *sim, const sp_object_state *o)
{
    sp_copy(sim->qpos + SP_QPOS, o->position_w, 3);
    sp_copy(sim->qpos + SP_QPOS + 3, o->quat_wo, 4);
    sp_zero(sim->qvel + SP_DOFS, 6);
}

/* Whether every part of the robot is farther than `apart` from the sphere around the object. */
static int is_away(const sp_world *world, const sp_sim *sim, const sp_object_config *c, double apart)
{
    const double *middle = sim->qpos + SP_QPOS;
    double scale[3];
    sp_object_scale(c, scale);
    for (int k = 0; k < world->moving; k++) {
        const double *place = sim->geom_xpos + 3 * world->geom[k];
        double from[3] = {place[0] - middle[0], place[1] - middle[1], place[2] - middle[2]};
        if (!(sp_norm(from) - world->geom_reach[k] - sp_norm(scale) > apart)) return 0;
    }
    return 1;
}

/* Whether the floor holds a standing object against the air with a reserve: by friction, and so that it does not tip. A
 * ball rests between blocks only. */
static int is_held_by_floor(const sp_world *world, const sp_object_config *c, const sp_object_state *o)
{
    const double *F = o->air_force_w, *T = o->air_torque_w, lever = SP_REST_LEVER;
    double pressed = c->mass * SP_GRAVITY - F[2], across = sqrt(F[0] * F[0] + F[1] * F[1]), scale[3];
    int is_ball = c->shape == SP_SHAPE_BALL;
    if (is_ball && world->box[0] < 0) return 0;
    sp_object_scale(c, scale);
    double most = (is_ball ? sp_min(c->friction, 0.5) : c->friction) * pressed * SP_REST_SHARE;
    return across <= most && sqrt(T[0] * T[0] + T[1] * T[1]) + scale[2] * across <= lever * sp_min(scale[0], scale[1]) * pressed &&
           fabs(T[2]) <= lever * most * sp_min(scale[0], scale[1]);
}

/* Find out whether the object stands still and need not be simulated in the next control period: the floor holds it, and
 * the robot is away. `left`: in the last one it was not; the floor's force then balances weight and air. */
void sp_watch_object(const sp_world *world, const sp_sim *sim, int left, double apart, sp_plant *p)
{
    sp_object_state *o = &p->object;
    const sp_object_config *c = &p->config.object;
    double weight = c->mass * SP_GRAVITY;
    if (left) {
        for (int i = 0; i < 3; i++) o->floor_force_w[i] = -o->air_force_w[i];
        o->floor_force_w[2] += weight;
    }
    o->rests = p->floor_R[8] == 1.0 && sp_norm(o->velocity_w) < SP_RESTING && sp_norm(o->omega_o) < SP_RESTING &&
               o->floor_force_w[2] > 0.5 * weight && is_held_by_floor(world, c, o) && is_away(world, sim, c, apart);
}
