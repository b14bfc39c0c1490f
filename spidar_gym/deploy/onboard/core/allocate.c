/* Demand → forces: closed form, OSQP, softened program, previous forces, in that order; every answer is checked. */
#include "spidar_core.h"
#include "spidar_math.h"
#include "spidar_model.h"
#include "spidar_solvers.h" /* generated: a workspace of OSQP for each pattern */

#define FORCE_SCALE SP_MAX_THRUST
#define WRENCH_SCALE (SP_TOTAL_MASS * SP_GRAVITY)
#define SIDE_TOLERANCE 1e-5
#define RHO 1.0
#define OTHER_RHO 10.0

/* A cold-started solution: x, multipliers (0 where there are none), iterations; 1 solved, 0 not, −1 proven infeasible.
 *
 * Vectors before matrices, the solver's own scaling off, ρ as it was made: the result depends on the program alone.
 * Where it found none, the solver's NaN is a large finite number, so only the status counts.
 */
static int solve(const sp_solver *kept, const sp_program *p, double rho, int max_iter, double tolerance, sp_room *room,
                 double *x, double *duals, int32_t *iterations)
{
    OSQPSolver *solver = kept->solver;
    sp_zero(x, p->n);
    sp_zero(duals, p->m);
    *iterations = 0;
    for (int k = 0; k < kept->P_count; k++) room->Px[k] = p->P[kept->P_at[k]];
    for (int k = 0; k < kept->A_count; k++) room->Ax[k] = p->A[kept->A_at[k]];
    solver->settings->max_iter = max_iter;
    solver->settings->eps_abs = tolerance;
    if (osqp_update_data_vec(solver, p->q, p->l, p->u) != 0) return 0;
    if (osqp_update_data_mat(solver, room->Px, NULL, kept->P_count, room->Ax, NULL, kept->A_count) != 0) return 0;
    if (rho != RHO) osqp_update_rho(solver, rho);
    osqp_cold_start(solver);
    osqp_solve(solver);
    int status = (int)solver->info->status_val;
    *iterations = (int32_t)solver->info->iter;
    if (rho != RHO || solver->info->rho_updates || status != OSQP_SOLVED) osqp_update_rho(solver, RHO);
    sp_copy(x, solver->solution->x, p->n);
    if (status == OSQP_SOLVED || status == OSQP_MAX_ITER_REACHED) sp_copy(duals, solver->solution->y, p->m);
    return status == OSQP_SOLVED ? 1 : status == OSQP_PRIMAL_INFEASIBLE ? -1 : 0;
}

/* +1 for rows that x brings to their upper bound, −1 for the lower: a guess of the active rows. */
static void sides(const sp_program *p, const double *x, double *guess)
{
    for (int i = 0; i < p->m; i++) {
        double r = 0.0;
        for (int k = 0; k < p->n; k++) r += p->A[i * p->n + k] * x[k];
        guess[i] = (p->u[i] - r < SIDE_TOLERANCE ? 1.0 : 0.0) - (r - p->l[i] < SIDE_TOLERANCE ? 1.0 : 0.0);
    }
}

static int finite_program(const sp_program *p)
{
    return sp_finite(p->P, p->n * p->n) && sp_finite(p->q, p->n) && sp_finite(p->A, p->m * p->n) &&
           sp_finite(p->l, p->m) && sp_finite(p->u, p->m);
}

/* The forces with zeros for what is not finite, within the sphere. */
static void bounded(const double *forces_l, double *held)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double f[3];
        for (int k = 0; k < 3; k++) f[k] = sp_finite(forces_l + 3 * i + k, 1) ? forces_l[3 * i + k] : 0.0;
        double shrink = sp_min(1.0, SP_MAX_THRUST / sp_max(sp_norm(f), 1e-9));
        for (int k = 0; k < 3; k++) held[3 * i + k] = f[k] * shrink;
    }
}

/* What the forces f (n) amount to; rotors beyond the sphere are shortened. */
static void answer(const sp_mode *mode, const sp_demand *d, const double *f, sp_allocation *a)
{
    int n = mode->n;
    double all[SP_UNKNOWNS];
    sp_copy(all, f, n);
    for (int i = 0; i < SP_ROTORS; i++) {
        double *own = all + 3 * i;
        if (d->lost[i]) sp_zero(own, 3);
        double norm = sp_norm(own);
        a->saturated[i] = norm > SP_MAX_THRUST;
        if (norm > SP_MAX_THRUST) {
            double shrink = sp_min(1.0, SP_MAX_THRUST / sp_max(norm, 1e-9));
            for (int k = 0; k < 3; k++) own[k] *= shrink;
        }
        a->thrust[i] = sp_min(norm, SP_MAX_THRUST);
    }
    sp_copy(a->forces_l, all, SP_FORCES);
    sp_zero(a->foot_forces_f, 3 * SP_LEGS);
    if (n > SP_FORCES) sp_copy(a->foot_forces_f, all + SP_FORCES, 3 * SP_LEGS);
    for (int r = 0; r < 6; r++) {
        double sum = 0.0;
        for (int k = 0; k < n; k++) sum += d->thrust_map[r * n + k] * all[k];
        a->wrench[r] = sum;
        a->unallocated_wrench[r] = d->wrench[r] - sum;
    }
    for (int j = 0; j < SP_JOINTS; j++) {
        double sum = 0.0;
        for (int k = 0; k < n; k++) sum += d->torque_map[j * n + k] * all[k];
        a->joint_torques[j] = d->gravity_torque[j] - sum;
    }
}

/* The previous forces; of the feet nothing is known. */
static void hold(const sp_mode *mode, const sp_demand *d, const double *previous_l, int32_t iterations,
                 sp_allocation *a)
{
    double held[SP_UNKNOWNS], unmet = 0.0;
    sp_zero(held, SP_UNKNOWNS);
    bounded(previous_l, held);
    a->status = SP_HELD;
    a->iterations = iterations;
    answer(mode, d, held, a);
    for (int r = 0; r < 6; r++) {
        double miss = 0.0;
        for (int k = 0; k < mode->n; k++) miss += d->thrust_map[r * mode->n + k] * held[k];
        miss = fabs(d->wrench[r] - miss) / WRENCH_SCALE;
        if (!(miss <= unmet)) unmet = miss;
    }
    a->slack = sp_finite(&unmet, 1) ? unmet : SP_INFINITY;
}

void sp_allocate(const sp_mode *mode, const sp_demand *demand, const double *previous_l, const int32_t *guess,
                 int guess_rows, int keep_active, const sp_allocator_config *config, sp_room *room, sp_allocation *a)
{
    sp_program *p = &room->program;
    double x[SP_MAX_N], duals[SP_MAX_M], f[SP_UNKNOWNS];
    int found = 0;
    a->iterations = 0;
    a->slack = 0.0;
    a->rows = 0;
    a->status = SP_CLOSED_FORM;
    sp_assemble(mode, demand, p);
    if (guess_rows > 0 && guess_rows == p->m) {
        for (int i = 0; i < p->m; i++) duals[i] = guess[i];
        found = sp_closed_form(p, duals, 3, 1e-9, room, x);
    }
    if (!found) found = sp_closed_form(p, NULL, 3, 1e-9, room, x);
    if (!found) {
        if (!finite_program(p)) {
            hold(mode, demand, previous_l, 0, a);
            return;
        }
        const double rhos[2] = {RHO, OTHER_RHO};
        int32_t total = 0, more = 0, soft_rows[SP_MAX_M];
        for (int attempt = 0; attempt < 2 && !found; attempt++) {
            double first[SP_MAX_N];
            int result = solve(&SP_SOLVERS[mode->kind].hard, p, rhos[attempt], config->max_iter, config->tolerance,
                               room, first, duals, &more);
            total += more;
            double worst = sp_violation(p, first);
            int solved = result == 1 && worst <= config->check_tolerance;
            int exact = sp_closed_form(p, duals, 8, 1e-9, room, x);
            if (!exact && !solved) {
                sides(p, first, duals);
                exact = sp_closed_form(p, duals, 8, 1e-9, room, x);
            }
            if (exact || solved) {
                if (!exact) sp_copy(x, first, p->n);
                a->status = solved ? SP_SOLVED : SP_CLOSED_FORM;
                found = 1;
            } else if (result == -1) {
                break;
            }
        }
        a->iterations = total;
        if (!found) {
            int count = sp_soft_rows(mode, soft_rows), n = p->n;
            sp_program *soft = &room->soft;
            double first[SP_MAX_N];
            sp_soften(p, soft_rows, count, config->price, soft);
            int result = solve(&SP_SOLVERS[mode->kind].soft, soft, RHO, config->max_iter, config->tolerance, room,
                               first, duals, &more);
            total += more;
            int exact = sp_closed_form(soft, duals, 8, 1e-9, room, x);
            if (!exact) sp_copy(x, first, soft->n);
            if (!exact && !(result == 1 && sp_violation(soft, x) <= config->check_tolerance)) {
                hold(mode, demand, previous_l, total, a);
                return;
            }
            a->iterations = total;
            a->status = SP_SOFTENED;
            for (int k = 0; k < count; k++) a->slack = sp_max(a->slack, fabs(x[n + k]));
        }
    }
    for (int k = 0; k < p->n; k++) f[k] = FORCE_SCALE * x[k];
    answer(mode, demand, f, a);
    if (keep_active) {
        sides(p, x, duals);
        a->rows = p->m;
        for (int i = 0; i < p->m; i++) a->active[i] = (int32_t)duals[i];
    }
}

/* The valid forces nearest to `wish_l`: the rows of the projection and the thrust sphere hold, the wrench balance not.
 *
 * Tangent planes are moved along the sphere, round after round, until the nearest point of the cut polyhedron lies on
 * it; then it is the nearest point of the curved set too.
 */
void sp_project(const sp_mode *projection, const sp_demand *demand, const double *wish_l, const double *previous_l,
                const sp_allocator_config *config, sp_room *room, sp_allocation *a)
{
    sp_program *p = &room->program, *cut = &room->soft;
    double forces[SP_FORCES], normals[SP_FORCES], x[SP_MAX_N], duals[SP_MAX_M], turn[SP_ROTORS];
    int32_t total = 0, more = 0;
    a->slack = 0.0;
    a->rows = 0;
    a->status = SP_CLOSED_FORM;
    sp_assemble(projection, demand, p);
    sp_copy(forces, wish_l, SP_FORCES);
    sp_copy(normals, wish_l, SP_FORCES);
    for (int i = 0; i < SP_ROTORS; i++) turn[i] = SP_MAX_THRUST / sp_max(sp_norm(wish_l + 3 * i), SP_MAX_THRUST);
    for (int round = 0; round < 60; round++) {
        *cut = *p;
        cut->m = p->m + SP_ROTORS;
        for (int k = 0; k < SP_FORCES; k++) cut->q[k] = -wish_l[k] / FORCE_SCALE;
        for (int i = 0; i < SP_ROTORS; i++) {
            double norm = sp_norm(normals + 3 * i), *row = cut->A + (p->m + i) * SP_FORCES;
            sp_zero(row, SP_FORCES);
            cut->l[p->m + i] = -SP_INFINITY;
            cut->u[p->m + i] = SP_INFINITY;
            if (!(norm > SP_MAX_THRUST)) continue;
            for (int k = 0; k < 3; k++) row[3 * i + k] = normals[3 * i + k] / norm;
            cut->u[p->m + i] = SP_MAX_THRUST / FORCE_SCALE;
        }
        if (!finite_program(cut)) {
            hold(projection, demand, previous_l, total, a);
            a->slack = 0.0;
            return;
        }
        if (!sp_closed_form(cut, NULL, 3, 1e-9, room, x)) {
            double first[SP_MAX_N];
            a->status = SP_SOLVED;
            int result = solve(&SP_SOLVERS[SP_PROJECTION].hard, cut, RHO, config->max_iter, config->tolerance, room,
                               first, duals, &more);
            total += more;
            if (!sp_closed_form(cut, duals, 8, 1e-9, room, x)) {
                if (result != 1 || !(sp_violation(cut, first) <= config->check_tolerance)) {
                    hold(projection, demand, previous_l, total, a);
                    a->slack = 0.0;
                    return;
                }
                sp_copy(x, first, SP_FORCES);
            }
        }
        int inside = 1;
        for (int k = 0; k < SP_FORCES; k++) forces[k] = FORCE_SCALE * x[k];
        for (int i = 0; i < SP_ROTORS; i++)
            if (!(sp_norm(forces + 3 * i) <= (1.0 + 1e-8) * SP_MAX_THRUST)) inside = 0;
        if (inside) break;
        for (int i = 0; i < SP_ROTORS; i++) {
            double *f = forces + 3 * i, *normal = normals + 3 * i, ahead[3], norm = sp_norm(f), plane = sp_norm(normal);
            if (!(norm > SP_MAX_THRUST || plane > SP_MAX_THRUST)) {
                sp_copy(normal, f, 3);
                continue;
            }
            for (int k = 0; k < 3; k++) ahead[k] = plane > SP_MAX_THRUST ? normal[k] / plane : f[k] / norm;
            for (int k = 0; k < 3; k++) ahead[k] += turn[i] * (f[k] / norm - ahead[k]);
            double length = sp_norm(ahead);
            for (int k = 0; k < 3; k++) normal[k] = 2.0 * SP_MAX_THRUST * (ahead[k] / length);
        }
    }
    a->iterations = total;
    answer(projection, demand, forces, a);
}
