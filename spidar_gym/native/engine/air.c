/* Aerodynamics: sixteen ducted jets with their effect on other rotors, links and torso, ram drag, ground effect, wind,
 * recirculation.
 *
 * docs/concepts/air.md has the equations with their sources. Forces are evaluated at the kinematics of the latest
 * physics step, which are one step old, and held until the next evaluation.
 */
#include "engine.h"

#define STATIONS_A_LINK 3
#define TORSO_STATIONS 5
#define DISC_POINTS 5
#define ALL_JETS ((1u << SP_DUCTS) - 1)

/* Speed of the air at distance s behind a duct's exit and r from its axis, w at the exit: a core that shrinks to a point
 * over `core_length` diameters inside a Gaussian shear layer whose width follows from ∫ ρ u² dA = T at every s; beyond
 * the core the jet spreads and slows down with 1/s. */
double sp_jet_profile(double s, double r, double w, double core_length, double radius)
{
    if (!(s > SP_JET_NEAR)) return 0.0;
    double core = 2.0 * core_length * radius, stretch = sp_max(s, core) / core;
    double r_core = sp_max(radius - radius / core * s, 0.0), square = r_core * r_core;
    double width = sqrt((0.5 * SP_PI - 2.0) * square + 2.0 * radius * radius) - sqrt(0.5 * SP_PI) * r_core;
    double beyond = sp_max(r - r_core, 0.0) / sp_max(width * stretch, 1e-9);
    return w / stretch * exp(-beyond * beyond);
}

/* Thrust over the thrust at rest of a duct whose motor keeps its speed: linear-lift blade element T = K (V_z − V_d) with
 * momentum balance T = ρ A V_e (V_e − V); μ = V / w, ε = V_e / w, χ = V_z / w, g = 1 / (χ − 1). */
double sp_thrust_factor(double inflow, double zero_thrust_speed)
{
    double g = 1.0 / (zero_thrust_speed - 1.0), m = inflow - g;
    double epsilon = 0.5 * (m + sqrt(m * m + 4.0 * zero_thrust_speed * g));
    return sp_clip(epsilon * (epsilon - inflow), 0.0, 1.3);
}

/* The thrust factor, interpolated linearly in a table with a thousand entries per unit, of which only two are computed.
 * The committed flights used this table; its error is below 1e-6. */
static double tabled_factor(double inflow, double zero_thrust_speed)
{
    double last = rint(1200.0 * zero_thrust_speed) - 1.0, at = sp_clip(floor(1000.0 * inflow), -2000.0, last);
    double x0 = at / 1000.0, x1 = (at + 1.0) / 1000.0, f0 = sp_thrust_factor(x0, zero_thrust_speed);
    if (at == last || inflow <= x0) return f0;
    return f0 + (sp_thrust_factor(x1, zero_thrust_speed) - f0) / (x1 - x0) * (inflow - x0);
}

/* A station, i.e. a point at which the air is evaluated. */
typedef struct {
    const double *R;            /* attitude of its body */
    double p[3], air[3], F[3];  /* position from the robot's CoG [m]; relative air velocity [m/s]; force [N] */
    int32_t owner;              /* module whose jets do not act on it, −1 for the torso */
} station;

static void place(station *s, const sp_sim *sim, int32_t body, const double *origin, double along, double across,
                  const double *wind_w)
{
    const double *x = sim->xpos + 3 * body, *v = sim->cvel + 6 * body;
    s->R = sim->xmat + 9 * body;
    for (int i = 0; i < 3; i++) s->p[i] = x[i] + along * s->R[3 * i] + across * s->R[3 * i + 1] - origin[i];
    /* wind − (v + ω × p) = wind − v + p × ω */
    double turn[3];
    sp_cross(s->p, v, turn);
    for (int i = 0; i < 3; i++) s->air[i] = wind_w[i] - v[3 + i] + turn[i];
}

/* Add the jets of other modules, which blow along −axis, to the air velocity at a station; bit j of `jets` is jet j. */
static void add_wake(station *s, int duct, const sp_world *world, const double *up, const double (*exits)[3],
                     const double *w, double core_length, uint32_t jets)
{
    static const double weights[DISC_POINTS] = {0.25, 0.1875, 0.1875, 0.1875, 0.1875};
    double disc = sqrt(2.0 / 3.0) * world->propeller_radius, flow[3] = {0.0, 0.0, 0.0}, fastest = 0.0;
    const double offsets[DISC_POINTS][2] = {{0, 0}, {disc, 0}, {0, disc}, {-disc, 0}, {0, -disc}};
    for (int j = 0; j < SP_DUCTS; j++) {
        if (s->owner == j / 2 || !(jets >> j & 1)) continue;
        const double *axis = up + 3 * j;
        double from[3] = {s->p[0] - exits[j][0], s->p[1] - exits[j][1], s->p[2] - exits[j][2]};
        double behind = -sp_dot(from, axis), reach = SP_REACH + SP_SPREAD * behind;
        if (!(behind > -SP_REACH) || !(sp_dot(from, from) - behind * behind < reach * reach)) continue;
        double speed = 0.0;
        for (int k = 0; k < (duct ? DISC_POINTS : 1); k++) {
            double x[3], a = duct ? offsets[k][0] : 0.0, b = duct ? offsets[k][1] : 0.0;
            for (int i = 0; i < 3; i++) x[i] = from[i] + a * s->R[3 * i] + b * s->R[3 * i + 1];
            double along = -sp_dot(x, axis), r = sqrt(sp_max(sp_dot(x, x) - along * along, 0.0));
            speed += (duct ? weights[k] : 1.0) * sp_jet_profile(along, r, w[j], core_length, world->propeller_radius);
        }
        for (int i = 0; i < 3; i++) flow[i] += speed * axis[i];
        fastest = sp_max(fastest, speed);
    }
    /* Jets that meet add up, but to at most 1.2 times the speed of the fastest: jets on one line would otherwise count
     * twice. */
    double limit = sp_min(1.0, 1.2 * fastest / sp_max(sp_norm(flow), 1e-9));
    for (int i = 0; i < 3; i++) s->air[i] -= limit * flow[i];
}

/* Return the height of the surface vertically below a point: the highest box whose top is lower, else the floor. */
static double top_under(const sp_world *world, const sp_sim *sim, const double *p)
{
    double highest = 0.0;
    for (int k = 0; world->box[0] >= 0 && k < SP_BOXES; k++) {
        const double *at = sim->geom_pos + 3 * world->box[k], *half = sim->geom_size + 3 * world->box[k];
        const double *quat = sim->geom_quat + 4 * world->box[k];
        double c = quat[0] * quat[0] - quat[2] * quat[2], s = 2.0 * quat[0] * quat[2], x = p[0] - at[0];
        if (fabs(x) > half[0] * c || fabs(p[1] - at[1]) > half[1]) continue;
        double top = at[2] + half[2] / c - x * s / c;
        if (top < p[2]) highest = sp_max(highest, top);
    }
    return highest;
}

/* Return the share of its thrust that a module keeps below others. `ducts` are the stations of the ducts. */
static double stacked(const station *ducts, const double *up, int module, double loss)
{
    double kept = 1.0;
    for (int j = 0; j < SP_ROTORS; j++) {
        double from[3];
        if (j == module) continue;
        for (int i = 0; i < 3; i++)
            from[i] = 0.5 * (ducts[2 * j].p[i] + ducts[2 * j + 1].p[i] - ducts[2 * module].p[i] - ducts[2 * module + 1].p[i]);
        double above = sp_dot(from, up), square = sp_dot(from, from) - above * above;
        if (above > 0.0) kept -= loss * exp(-square / (SP_STACKING_RADIUS * SP_STACKING_RADIUS));
    }
    return sp_max(kept, 0.0);
}

/* Return the distance of a point from the nearest surface: the floor's plane or a box [m]. */
static double nearest_surface(const sp_world *world, const sp_sim *sim, const double *p)
{
    double nearest = sp_max(p[2], 0.0);
    for (int k = 0; world->box[0] >= 0 && k < SP_BOXES; k++) {
        const double *at = sim->geom_pos + 3 * world->box[k], *half = sim->geom_size + 3 * world->box[k];
        double from[3] = {p[0] - at[0], p[1] - at[1], p[2] - at[2]}, R[9], inside[3];
        sp_from_quat(sim->geom_quat + 4 * world->box[k], R);
        sp_apply_t(R, from, inside);
        for (int i = 0; i < 3; i++) inside[i] = sp_max(fabs(inside[i]) - half[i], 0.0);
        nearest = sp_min(nearest, sp_norm(inside));
    }
    return nearest;
}

/* Add the recirculating air to the air velocity at the stations: U + Ω × p, in proportion to the jets' mean speed. */
static void add_eddy(station *all, const sp_world *world, const sp_sim *sim, const sp_recirculation_config *c,
                     const double *eddy, double speed)
{
    double scale = speed, U[3], turn[3], swirl[3];
    if (c->near > 0.0) {
        double d = nearest_surface(world, sim, sim->subtree_com + 3 * world->torso);
        scale *= 1.0 + c->near * exp(-d / SP_NEAR_LENGTH);
    }
    for (int i = 0; i < 3; i++) {
        U[i] = scale * (c->mean_flow[i] + (i < 2 ? c->flow_xy : c->flow_z) * eddy[i]);
        turn[i] = scale * (c->mean_turn[i] + (i < 2 ? c->turn_xy : c->turn_z) * eddy[3 + i]);
    }
    for (int k = 0; k < SP_STATIONS; k++) {
        sp_cross(turn, all[k].p, swirl);
        for (int i = 0; i < 3; i++) all[k].air[i] += U[i] + swirl[i];
    }
}

/* `factor` with ground effect: within four radii of the floor along the jet, tilted by less than 60°. */
static double near_ground(double factor, double centre_z, double up_z, const sp_world *world, double strength)
{
    double R = world->propeller_radius, height = centre_z + world->duct_z * up_z;
    double h = sp_max(height / sp_max(up_z, 0.5), 0.5 * R);
    if (!(up_z > 0.5 && h < 4.0 * R)) return factor;
    double ratio = R / (4.0 * h);
    return factor * (1.0 + strength * (ratio * ratio));
}

/* Return the jets that reach a ball, by bits. */
static uint32_t jets_towards(const double *centre, double radius, const double *up, const double (*exits)[3])
{
    uint32_t jets = 0;
    for (int j = 0; j < SP_DUCTS; j++) {
        double from[3] = {centre[0] - exits[j][0], centre[1] - exits[j][1], centre[2] - exits[j][2]};
        double behind = -sp_dot(from, up + 3 * j), away = sqrt(sp_max(sp_dot(from, from) - behind * behind, 0.0));
        double reach = SP_REACH + SP_SPREAD * sp_max(behind + radius, 0.0);
        if (behind + radius > 0.0 && away < reach + radius) jets |= 1u << j;
    }
    return jets;
}

/* The jets that reach a face and blow towards it, by bits; `face` of the cube that is mapped onto the object: its axis,
 * then its side. All in the object's axes. */
static uint32_t jets_at(int face, int is_flat, const double *scale, uint32_t near, const double *up, const double (*exits)[3])
{
    double centre[3] = {0.0, 0.0, 0.0}, size[3] = {scale[0], scale[1], scale[2]}, side = face % 2 ? -1.0 : 1.0;
    int axis = face / 2;
    if (!near) return 0;
    centre[axis] = side * size[axis] * (is_flat ? 1.0 : 0.5);
    size[axis] *= is_flat ? 0.0 : 0.5;
    near &= jets_towards(centre, sp_norm(size), up, exits);
    for (int j = 0; j < SP_DUCTS && is_flat; j++)
        if (!(side * up[3 * j + axis] > 0.0)) near &= ~(1u << j);
    return near;
}

/* Evaluate the pressure of jets and wind on the object: c ½ ρ (V·n)² along −n on each windward patch, on which only the
 * jets act that blow towards it. Where c is 2, a jet that meets a face loses all of its momentum along the normal. */
static void push_object(const sp_world *world, const sp_sim *sim, const sp_aero_config *config,
                        const sp_object_config *object, const double *origin, const double *wind_w, const double *up_w,
                        const double (*exits_w)[3], const double *w, sp_air *out)
{
    static const double level[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const double *at = sim->xpos + 3 * world->object, *R = sim->xmat + 9 * world->object;
    const double *twist = sim->cvel + 6 * world->object, *com = sim->subtree_com + 3 * world->object;
    double scale[3], up[3 * SP_DUCTS], exits[SP_DUCTS][3], force[3] = {0, 0, 0}, torque[3] = {0, 0, 0};
    double lever_w[3], turn[3], air_w[3], air[3], omega[3];
    sp_object_scale(object, scale);
    for (int i = 0; i < 3; i++) lever_w[i] = at[i] - com[i];
    sp_cross(lever_w, twist, turn); /* wind − (v + ω × p) = wind − v + p × ω */
    for (int i = 0; i < 3; i++) air_w[i] = wind_w[i] - twist[3 + i] + turn[i];
    sp_apply_t(R, air_w, air);
    sp_apply_t(R, twist, omega);
    for (int j = 0; j < SP_DUCTS && config->wake; j++) {
        double from[3];
        for (int i = 0; i < 3; i++) from[i] = exits_w[j][i] + origin[i] - at[i];
        sp_apply_t(R, from, exits[j]);
        sp_apply_t(R, up_w + 3 * j, up + 3 * j);
    }
    const double middle[3] = {0.0, 0.0, 0.0};
    uint32_t near = config->wake ? jets_towards(middle, sp_norm(scale), up, (const double(*)[3])exits) : 0;
    int is_still = sp_norm(air) + sp_norm(omega) * sp_norm(scale) < SP_STILL_AIR;
    for (int face = 0; face < SP_FACES; face++) {
        int axis = face / 2, is_flat = object->shape == SP_SHAPE_BOX || (object->shape == SP_SHAPE_CYLINDER && axis == 2);
        uint32_t jets = jets_at(face, is_flat, scale, near, up, (const double(*)[3])exits);
        if (!jets && is_still) continue;
        double area = 0.5 * SP_AIR_DENSITY * object->pressure * scale[(axis + 1) % 3] * scale[(axis + 2) % 3];
        for (int k = face * SP_FACE_PATCHES; k < (face + 1) * SP_FACE_PATCHES; k++) {
            const double *row = world->patch[object->shape][k], *normal = row + 3;
            station s = {.R = level, .owner = -1, .p = {scale[0] * row[0], scale[1] * row[1], scale[2] * row[2]}};
            sp_cross(s.p, omega, turn);
            for (int i = 0; i < 3; i++) s.air[i] = air[i] + turn[i];
            uint32_t blowing = jets;
            for (int j = 0; j < SP_DUCTS && blowing && !is_flat; j++)
                if (!(sp_dot(up + 3 * j, normal) > 0.0)) blowing &= ~(1u << j);
            if (blowing) add_wake(&s, 0, world, up, (const double(*)[3])exits, w, config->core_length, blowing);
            double into = -sp_dot(s.air, normal);
            if (!(into > 0.0)) continue;
            double pressed = into * into * row[6] * area, push[3], about[3];
            for (int i = 0; i < 3; i++) push[i] = -pressed * normal[i];
            sp_cross(s.p, push, about);
            for (int i = 0; i < 3; i++) force[i] += push[i], torque[i] += about[i];
        }
    }
    sp_apply(R, force, out->object_force_w);
    sp_apply(R, torque, out->object_torque_w);
}

/* Evaluate the forces of the air: `thrust` in still air and `noise` per module [N], wind [m/s] and push [N], world; the
 * state of the recirculation's eddy, NULL without. */
void sp_evaluate_air(const sp_world *world, const sp_sim *sim, const sp_aero_config *config,
                     const sp_recirculation_config *recirculation, const sp_object_config *object, const double *thrust,
                     const double *wind_w, const double *noise, const double *push_w, const double *eddy, sp_air *out)
{
    const double *origin = sim->subtree_com + 3 * world->torso, half = 0.5 * SP_AIR_DENSITY;
    double area = SP_PI * (world->propeller_radius * world->propeller_radius), radius = world->torso_radius;
    double up[3 * SP_DUCTS], exits[SP_DUCTS][3], w[SP_DUCTS], lifts[SP_DUCTS];
    station all[SP_STATIONS], *s = all;
    double wrench[SP_MAX_BODIES][6];
    for (int k = 0; k < SP_DUCTS; k++, s++) {
        place(s, sim, world->module_body[k / 2], origin, 0.0, k % 2 ? -world->duct_offset_y : world->duct_offset_y,
              wind_w);
        s->owner = k / 2;
        lifts[k] = 0.5 * sp_max(thrust[k / 2], 2.0 * SP_JET_LEAST_THRUST);
        w[k] = sqrt(lifts[k] * (1.0 / (SP_AIR_DENSITY * area)));
        for (int i = 0; i < 3; i++) {
            up[3 * k + i] = s->R[3 * i + 2];
            exits[k][i] = s->p[i] + world->duct_z * up[3 * k + i];
        }
    }
    for (int k = 0; k < SP_ROTORS; k++)
        for (int i = 0; i < STATIONS_A_LINK; i++, s++) {
            place(s, sim, world->link_body[k], origin, world->link_scale[k] * world->link_station[i], 0.0, wind_w);
            s->owner = k;
        }
    const double rim = 0.7 * radius, places[TORSO_STATIONS][2] = {{0, 0}, {rim, 0}, {0, rim}, {-rim, 0}, {0, -rim}};
    for (int k = 0; k < TORSO_STATIONS; k++, s++) {
        place(s, sim, world->torso, origin, places[k][0], places[k][1], wind_w);
        s->owner = -1;
    }
    int still = !config->wake && eddy == NULL && wind_w[0] == 0.0 && wind_w[1] == 0.0 && wind_w[2] == 0.0;
    if (eddy != NULL) {
        double sum = 0.0;
        for (int k = 0; k < SP_DUCTS; k++) sum += lifts[k];
        add_eddy(all, world, sim, recirculation, eddy, sqrt(sum / (SP_DUCTS * SP_AIR_DENSITY * area)));
    }
    if (world->object >= 0)
        push_object(world, sim, config, object, origin, wind_w, up, (const double(*)[3])exits, w, out);
    double lowest = HUGE_VAL;
    for (int k = 0; k < SP_STATIONS; k++) {
        if (config->wake)
            add_wake(&all[k], k < SP_DUCTS, world, up, (const double(*)[3])exits, w, config->core_length, ALL_JETS);
        else if (still) sp_zero(all[k].air, 3);
    }
    for (int k = 0; k < SP_DUCTS; k++) lowest = sp_min(lowest, all[k].p[2] + origin[2] + world->duct_z * up[3 * k + 2]);
    int boxed = world->box[0] >= 0;
    int ground = config->wake && config->ground_effect != 0.0 && (boxed || !(lowest > 4.0 * world->propeller_radius));
    /* Ducts: drag of the shroud, lift lost to the inflow, and ram drag ρ A w V⊥, since the air that a duct swallows
     * leaves along its axis. */
    double kept = 1.0;
    s = all;
    for (int k = 0; k < SP_DUCTS; k++, s++) {
        const double *V = s->air, *axis = up + 3 * k;
        double axial = sp_dot(V, axis), ram = SP_AIR_DENSITY * area * w[k];
        double factor = tabled_factor(-axial / w[k], config->zero_thrust_speed);
        if (ground) {
            double height = s->p[2] + origin[2], centre[3] = {s->p[0] + origin[0], s->p[1] + origin[1], height};
            if (boxed) height -= top_under(world, sim, centre);
            factor = near_ground(factor, height, axis[2], world, config->ground_effect);
        }
        if (config->stacking_loss > 0.0) { /* the same for both ducts of a module */
            if (k % 2 == 0) kept = stacked(all, axis, k / 2, config->stacking_loss);
            factor *= kept;
        }
        double lift = lifts[k] * (factor - 1.0) + 0.5 * noise[k / 2] - ram * axial;
        double drag = half * config->duct_drag_area * sp_norm(V) + ram;
        for (int i = 0; i < 3; i++) s->F[i] = drag * V[i] + lift * axis[i];
        out->thrust_factor[k] = factor;
    }
    for (int k = 0; k < STATIONS_A_LINK * SP_ROTORS; k++, s++) { /* flow along a rod exerts no force */
        double rod[3] = {s->R[0], s->R[3], s->R[6]}, along = sp_dot(s->air, rod), V[3];
        for (int i = 0; i < 3; i++) V[i] = s->air[i] - along * rod[i];
        double drag = half * SP_BLUFF * SP_LINK_SEGMENT * world->link_width[k % STATIONS_A_LINK] * sp_norm(V);
        drag *= world->link_scale[k / STATIONS_A_LINK];
        for (int i = 0; i < 3; i++) s->F[i] = drag * V[i];
    }
    double share = half * SP_BLUFF / TORSO_STATIONS, edge = share * 2.0 * radius * world->torso_height;
    double face = share * SP_PI * (radius * radius);
    for (int k = 0; k < TORSO_STATIONS; k++, s++) {
        double V[3];
        sp_apply_t(s->R, s->air, V);
        double speed = sp_norm(V), F[3] = {edge * speed * V[0], edge * speed * V[1], face * speed * V[2]};
        sp_apply(s->R, F, s->F);
        if (k == 0)
            for (int i = 0; i < 3; i++) s->F[i] += push_w[i];
    }
    /* Generalised forces: wrenches about one point add up along the tree, from the leaves to the torso. */
    memset(wrench, 0, sizeof wrench);
    for (int k = 0; k < SP_STATIONS; k++) {
        int32_t link = (k - SP_DUCTS) / STATIONS_A_LINK;
        int32_t body = k < SP_DUCTS ? world->module_body[k / 2] : link < SP_ROTORS ? world->link_body[link] : world->torso;
        double torque[3];
        sp_cross(all[k].p, all[k].F, torque);
        for (int i = 0; i < 3; i++) {
            wrench[body][i] += torque[i];
            wrench[body][3 + i] += all[k].F[i];
            out->forces_w[3 * k + i] = all[k].F[i];
            out->points_w[3 * k + i] = all[k].p[i] + origin[i];
        }
    }
    for (int body = world->bodies - 1; body > 0; body--) {
        for (int k = 0; k < world->body_dofnum[body]; k++) {
            int dof = world->body_dofadr[body] + k;
            out->generalized[dof] = sp_row(sim->cdof + 6 * dof, wrench[body], 6);
        }
        int32_t parent = world->body_parent[body];
        for (int i = 0; i < 6; i++) wrench[parent][i] += wrench[body][i];
    }
}
