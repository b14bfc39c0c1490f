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
