/* The floor (flat, sloped or of tiles) and its contacts with the robot: forces, slip, clearance.
 *
 * The results serve rewards, metrics and failures. No controller receives them, as the robot has no touch sensor.
 */
#include "engine.h"

/* Whether a row of a configuration is a box. */
static int is_box(const double *row) { return row[3] > 0.0 && row[4] > 0.0 && row[5] > 0.0; }

/* Write the boxes of a configuration into a model that has boxes. They are the last geoms of the world's body, which ends
 * with the last one in use, so that MuJoCo does not compare the others with the robot in every step. */
static void put_up_boxes(const sp_world *world, const sp_ground_config *c, const sp_sim *sim)
{
    int used = 0;
    for (int k = 0; k < SP_BOXES; k++)
        if (is_box(c->boxes + 7 * k)) used = k + 1;
    if (world->box[0] >= 0) sim->body_geomnum[0] = world->box[0] + used;
    for (int k = 0; world->box[0] >= 0 && k < SP_BOXES; k++) {
        const double *row = c->boxes + 7 * k, *place = is_box(row) ? row : SP_NOWHERE;
        int32_t geom = world->box[k];
        double *quat = sim->geom_quat + 4 * geom;
        sp_copy(sim->geom_pos + 3 * geom, place, 3);
        sp_copy(sim->geom_size + 3 * geom, place + 3, 3);
        sp_copy(sim->geom_aabb + 6 * geom + 3, place + 3, 3);
        sim->geom_rbound[geom] = sp_norm(place + 3);
        sp_zero(quat, 4);
        quat[0] = cos(0.5 * row[6]);
        quat[2] = sin(0.5 * row[6]);
        sim->geom_sameframe[geom] = 0;
    }
}

/* Write the floor into a model that has tiles and boxes if the configuration has. */
void sp_lay_floor(const sp_world *world, const sp_ground_config *c, const sp_sim *sim)
{
    double tilt[3] = {c->slope * sin(c->heading), -c->slope * cos(c->heading), 0.0}, R[9], quat[4];
    int uneven = world->tile[0] >= 0;
    put_up_boxes(world, c, sim);
    sp_exp(tilt, R);
    sp_to_quat(R, quat);
    for (int k = 0; uneven && k < SP_TILES * SP_TILES; k++) {
        double place[3] = {(k / SP_TILES + 0.5 - SP_TILES / 2) * SP_TILE, (k % SP_TILES + 0.5 - SP_TILES / 2) * SP_TILE,
                           c->tiles[k] - SP_TILE_DEPTH};
        int32_t geom = world->tile[k];
        sp_apply(R, place, sim->geom_pos + 3 * geom);
        sp_copy(sim->geom_quat + 4 * geom, quat, 4);
        sim->geom_sameframe[geom] = 0;
    }
    double depth[3] = {0.0, 0.0, uneven ? -SP_TILE_DEPTH : 0.0};
    sp_apply(R, depth, sim->geom_pos + 3 * world->floor);
    sp_copy(sim->geom_quat + 4 * world->floor, quat, 4);
    sim->geom_sameframe[world->floor] = 0; /* or MuJoCo would take the floor's frame for the world's */
}

/* Height of the floor under a point, floor axes. */
double sp_floor_height(const sp_ground_config *c, double x, double y)
{
    double i = floor(x / SP_TILE) + SP_TILES / 2, j = floor(y / SP_TILE) + SP_TILES / 2;
    if (!(i >= 0.0 && i < SP_TILES && j >= 0.0 && j < SP_TILES)) return -SP_TILE_DEPTH;
    return c->tiles[SP_TILES * (int)i + (int)j];
}

/* Return the distance from a point to a box of a configuration. */
static double to_box(const double *row, const double *point)
{
    const double c = cos(row[6]), s = sin(row[6]), x = point[0] - row[0], z = point[2] - row[2];
    const double place[3] = {c * x - s * z, point[1] - row[1], s * x + c * z};
    double beyond[3];
    for (int i = 0; i < 3; i++) beyond[i] = sp_max(fabs(place[i]) - row[3 + i], 0.0);
    return sp_norm(beyond);
}

/* Return a lower bound of the robot's distance to the boxes: each of its geoms is in a sphere, all are in one round the
 * torso. */
static double beside_boxes(const sp_world *world, const sp_sim *sim, const double *boxes, double least)
{
    const double *centre = sim->xpos + 3 * world->torso;
    double reach = 0.0, apart[3];
    for (int k = 0; k < world->moving; k++) {
        for (int i = 0; i < 3; i++) apart[i] = sim->geom_xpos[3 * world->geom[k] + i] - centre[i];
        reach = sp_max(reach, sp_norm(apart) + world->geom_reach[k]);
    }
    for (int k = 0; k < SP_BOXES; k++) {
        const double *row = boxes + 7 * k;
        if (!is_box(row) || to_box(row, centre) - reach >= least) continue;
        for (int j = 0; j < world->moving; j++) {
            double distance = to_box(row, sim->geom_xpos + 3 * world->geom[j]) - world->geom_reach[j];
            if (!(distance >= least)) least = distance;
        }
    }
    return least;
}

/* Return a lower bound of the robot's height over the highest tile and of its distance to the boxes. */
double sp_clearance(const sp_world *world, const sp_sim *sim, const sp_plant *plant)
{
    double normal[3] = {plant->floor_R[2], plant->floor_R[5], plant->floor_R[8]}, least = HUGE_VAL;
    for (int k = 0; k < world->moving; k++) {
        double height = sp_dot(sim->geom_xpos + 3 * world->geom[k], normal) - world->geom_reach[k];
        if (!(height >= least)) least = height;
    }
    least -= plant->highest_tile;
    return world->box[0] >= 0 ? beside_boxes(world, sim, plant->config.ground.boxes, least) : least;
}

/* Switch MuJoCo's contact detection on or off; with the floor far below the result is the same without it. */
void sp_look_for_contacts(const sp_sim *sim, int wanted)
{
    if (wanted) *sim->disableflags &= (int32_t)~sim->mujoco->contact_off;
    else *sim->disableflags |= (int32_t)sim->mujoco->contact_off;
}

/* Read the two geoms of a contact. */
void sp_contact_geoms(const sp_sim *sim, int contact, int32_t *pair)
{
    memcpy(pair, *sim->contact + contact * sim->contact_stride + sim->contact_geoms, 2 * sizeof *pair);
}

/* Whether a contact is one of the object. */
int sp_with_object(const sp_world *world, const int32_t *pair)
{
    return world->object >= 0 && (pair[0] == world->object_geom || pair[1] == world->object_geom);
}

/* Whether the robot touches floor or boxes; the robot is loaded. */
int sp_in_contact(const sp_world *world, const sp_sim *sim)
{
    int32_t pair[2];
    if (world->object < 0) return *sim->contacts > 0;
    for (int k = 0; k < *sim->contacts; k++) {
        sp_contact_geoms(sim, k, pair);
        if (!sp_with_object(world, pair)) return 1;
    }
    return 0;
}

/* Return the largest contact force of the last physics step on anything but feet and pegs; the robot is loaded. */
double sp_hit(const sp_world *world, const sp_sim *sim)
{
    double hardest = 0.0, wrench[6];
    for (int k = 0; k < *sim->contacts; k++) {
        int32_t pair[2];
        sp_contact_geoms(sim, k, pair);
        if (sp_with_object(world, pair)) continue;
        for (int i = 0; i < 2; i++) {
            if (pair[i] < 0 || !world->geom_touches[pair[i]]) continue;
            int32_t kind = world->geom_kind[pair[i]];
            if (kind >= 0 && kind < SP_BALLS) continue;
            sim->mujoco->contact_force(sim->model, sim->data, k, wrench);
            hardest = sp_max(hardest, sp_norm(wrench));
        }
    }
    return hardest;
}

/* Return the parts of the robot in a contact as bits of sp_constraint; the robot is loaded. */
int32_t sp_violates(const sp_world *world, const sp_sim *sim, int contact)
{
    int32_t bits = 0, pair[2];
    sp_contact_geoms(sim, contact, pair);
    int held = sp_with_object(world, pair);
    for (int i = 0; i < 2; i++) {
        if (pair[i] < 0 || !world->geom_touches[pair[i]]) continue;
        int32_t kind = world->geom_kind[pair[i]];
        if (held && kind >= 0 && kind < SP_LEGS) continue; /* feet hold the object */
        bits |= kind == SP_BALLS ? SP_VIOLATED_DUCT : kind >= 0 ? SP_VIOLATED_FOOT : SP_VIOLATED_PART;
    }
    return bits;
}

/* Evaluate the floor contacts of a loaded robot. */
void sp_touching(const sp_world *world, const sp_sim *sim, const sp_plant *plant, sp_touch *touch)
{
    const double *R = plant->floor_R, normal[3] = {R[2], R[5], R[8]};
    memset(touch, 0, sizeof *touch);
    touch->hit = plant->hit;
    for (int k = 0; k < *sim->contacts; k++) {
        int32_t pair[2];
        sp_contact_geoms(sim, k, pair);
        if (sp_with_object(world, pair)) continue;
        for (int i = 0; i < 2; i++) {
            int32_t kind = pair[i] >= 0 ? world->geom_kind[pair[i]] : -1;
            if (kind == SP_BALLS) touch->ducts = 1;
            else if (kind >= 0) touch->balls[kind] = 1;
        }
    }
    for (int k = 0; k < 2 * SP_LEGS; k++) { /* the peg's or foot's lowest point moves with its body */
        if (!touch->balls[k]) continue;
        const double *twist = sim->cvel + 6 * world->ball_body[k], *centre = sim->geom_xpos + 3 * world->ball[k];
        const double *origin = sim->subtree_com + 3 * world->torso;
        double lever[3], v[3];
        for (int i = 0; i < 3; i++) lever[i] = centre[i] - origin[i] - world->ball_radius[k] * normal[i];
        sp_cross(twist, lever, v);
        for (int i = 0; i < 3; i++) v[i] += twist[3 + i];
        double across = sp_dot(normal, v);
        touch->slip[k] = sqrt(sp_max(sp_dot(v, v) - across * across, 0.0));
    }
    touch->duct_clearance = HUGE_VAL;
    for (int k = 0; k < SP_DUCTS; k++) {
        const double *centre = sim->geom_xpos + 3 * world->duct[k], *axes = sim->geom_xmat + 9 * world->duct[k];
        double axis[3] = {axes[2], axes[5], axes[8]}, upright = fabs(sp_dot(axis, normal)), own[3];
        double low = sp_dot(centre, normal) - world->duct_radius[k] * sqrt(sp_max(0.0, 1.0 - upright * upright)) -
                     world->duct_half[k] * upright;
        if (plant->highest_tile > 0.0) {
            sp_apply_t(R, centre, own);
            low -= sp_floor_height(&plant->config.ground, own[0], own[1]);
        }
        touch->duct_clearance = sp_min(touch->duct_clearance, low);
    }
}
