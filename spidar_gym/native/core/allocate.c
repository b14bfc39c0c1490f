/* Demand → forces. Tries, in this order: closed form, OSQP, thrust spheres, softened rows, previous forces. */
#include "spidar_core.h"
#include "spidar_math.h"
#include "spidar_solvers.h" /* generated: sparsity pattern of each program */

/* Solve a program by OSQP from a cold start; returns 1 if solved, 0 if not, −1 if proven infeasible.
 *
 * Writes x and the multipliers (0 if there are none), and adds to `iterations`. The result depends on the program
 * alone: vectors are updated before matrices, OSQP's scaling is off, and ρ is restored afterwards. Without a solution
 * x may hold OSQP's NaN, a large finite number: only the status is valid.
 */
static int solve(int32_t kind, int soft, const sp_program *p, double rho, const sp_allocator_config *config,
                 sp_room *room, double *x, double *duals, int32_t *iterations)
{
    const sp_pattern *kept = soft ? &SP_PATTERNS[kind].soft : &SP_PATTERNS[kind].hard;
    OSQPSolver *solver = soft ? room->soft[kind] : room->hard[kind];
    sp_workspace *work = &room->workspace;
    sp_zero(x, p->n);
    sp_zero(duals, p->m);
    for (int k = 0; k < kept->P_count; k++) work->Px[k] = p->P[kept->P_at[k]];
    for (int k = 0; k < kept->A_count; k++) work->Ax[k] = p->A[kept->A_at[k]];
    solver->settings->max_iter = config->max_iter;
    solver->settings->eps_abs = config->tolerance;
    if (osqp_update_data_vec(solver, p->q, p->l, p->u) != 0) return 0;
    if (osqp_update_data_mat(solver, work->Px, NULL, kept->P_count, work->Ax, NULL, kept->A_count) != 0) return 0;
    if (rho != SP_RHO) osqp_update_rho(solver, rho);
    osqp_cold_start(solver);
    osqp_solve(solver);
    int status = (int)solver->info->status_val;
    *iterations += (int32_t)solver->info->iter;
    if (rho != SP_RHO || solver->info->rho_updates || status != OSQP_SOLVED) osqp_update_rho(solver, SP_RHO);
    sp_copy(x, solver->solution->x, p->n);
    if (status == OSQP_SOLVED || status == OSQP_MAX_ITER_REACHED) sp_copy(duals, solver->solution->y, p->m);
    return status == OSQP_SOLVED ? 1 : status == OSQP_PRIMAL_INFEASIBLE ? -1 : 0;
}

/* Guess the active rows: +1 where x is at a row's upper bound, −1 at its lower bound, else 0. */
static void sides(const sp_program *p, const double *x, double *guess)
{
    for (int i = 0; i < p->m; i++) {
        double r = sp_row(p->A + i * p->n, x, p->n);
        guess[i] = (p->u[i] - r < SP_SIDE_TOLERANCE ? 1.0 : 0.0) - (r - p->l[i] < SP_SIDE_TOLERANCE ? 1.0 : 0.0);
    }
}

static int finite_program(const sp_program *p)
{
    return sp_finite(p->P, p->n * p->n) && sp_finite(p->q, p->n) && sp_finite(p->A, p->m * p->n) &&
           sp_finite(p->l, p->m) && sp_finite(p->u, p->m);
}

/* Shorten a rotor's force to a thrust sphere [N]; returns its thrust. */
double sp_limit_thrust(double most, double *force)
{
    double thrust = sp_norm(force);
    if (!(thrust > most)) return thrust;
    for (int k = 0; k < 3; k++) force[k] *= most / thrust;
    return most;
}

/* Replace entries of the forces that are not finite by 0, and shorten each force to the thrust sphere. */
static void within_sphere(double most, const double *forces_l, double *held)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double f[3];
        for (int k = 0; k < 3; k++) f[k] = sp_finite(forces_l + 3 * i + k, 1) ? forces_l[3 * i + k] : 0.0;
        sp_limit_thrust(most, f);
        sp_copy(held + 3 * i, f, 3);
    }
}

/* Write the allocation of the forces f (n): λ = ‖f‖ [Zhao2025, Eq. 14], limited to the sphere against rounding. */
static void answer(const sp_robot *robot, const sp_mode *mode, const sp_demand *d, const double *f, sp_allocation *a)
{
    int n = mode->n;
    double all[SP_UNKNOWNS], most = sp_min(robot->max_thrust, d->thrust_limit);
    sp_copy(all, f, n);
    for (int i = 0; i < SP_ROTORS; i++) {
        double *own = all + 3 * i;
        if (d->lost[i]) sp_zero(own, 3);
        a->thrust[i] = sp_limit_thrust(most, own);
    }
    sp_copy(a->forces_l, all, SP_FORCES);
    sp_zero(a->foot_forces_f, 3 * SP_LEGS);
    if (n > SP_FORCES) sp_copy(a->foot_forces_f, all + SP_FORCES, 3 * SP_LEGS);
    for (int r = 0; r < 6; r++) {
        a->wrench[r] = sp_row(d->thrust_map + r * n, all, n);
        a->unallocated_wrench[r] = d->wrench[r] - a->wrench[r];
    }
    for (int j = 0; j < SP_JOINTS; j++)
        a->joint_torques[j] = d->gravity_torque[j] - sp_row(d->torque_map + j * n, all, n);
}

/* Repeat the previous rotor forces; foot forces are 0. */
static void hold_forces(const sp_robot *robot, const sp_mode *mode, const sp_demand *d, const double *previous_l, sp_allocation *a)
{
    double held[SP_UNKNOWNS], unmet = 0.0;
    sp_zero(held, SP_UNKNOWNS);
    within_sphere(sp_min(robot->max_thrust, d->thrust_limit), previous_l, held);
    a->status = SP_HELD;
    answer(robot, mode, d, held, a);
    for (int r = 0; r < 6; r++) {
        double miss = fabs(d->wrench[r] - sp_row(d->thrust_map + r * mode->n, held, mode->n)) / robot->weight;
        if (!(miss <= unmet)) unmet = miss;
    }
    a->slack = sp_finite(&unmet, 1) ? unmet : SP_INFINITY;
}

/* The largest ‖f_i‖, in units of λ̄. */
static double largest_thrust(const double *x)
{
    double largest = 0.0;
    for (int i = 0; i < SP_ROTORS; i++) {
        double norm = sp_norm(x + 3 * i);
        if (!(norm <= largest)) largest = norm;
    }
    return largest;
}

/* Find the program's optimum x without the thrust spheres; returns 0 if there is none. Sets the status to projected if
 * the spheres have to be solved for, and to held if a number is not finite.
 */
static int cube_optimum(const sp_mode *mode, const sp_program *p, const int32_t *guess, int guess_rows,
                        const sp_allocator_config *config, sp_room *room, double *x, sp_allocation *a)
{
    sp_workspace *work = &room->workspace;
    double duals[SP_MAX_M], first[SP_MAX_N];
    const double rhos[2] = {SP_RHO, SP_OTHER_RHO};
    int found = 0;
    a->status = SP_CLOSED_FORM;
    if (guess_rows > 0 && guess_rows == p->m) {
        for (int i = 0; i < p->m; i++) duals[i] = guess[i];
        found = sp_closed_form(p, duals, SP_ROUNDS, work, x);
    }
    if (!found) found = sp_closed_form(p, NULL, SP_ROUNDS, work, x);
    if (!found && !finite_program(p)) {
        a->status = SP_HELD;
        return 0;
    }
    for (int attempt = 0; attempt < 2 && !found; attempt++) {
        int result = solve(mode->kind, 0, p, rhos[attempt], config, room, first, duals, &a->iterations);
        int solved = result == 1 && sp_violation(p, first) <= config->check_tolerance;
        found = sp_closed_form(p, duals, SP_MORE_ROUNDS, work, x);
        if (!found && !solved) {
            sides(p, first, duals);
            found = sp_closed_form(p, duals, SP_MORE_ROUNDS, work, x);
        }
        if (!found && solved) sp_copy(x, first, p->n);
        if (solved) a->status = SP_SOLVED, found = 1;
        if (result == -1) break;
    }
    if (!found || !(largest_thrust(x) <= p->radius + SP_SPHERE_TOLERANCE)) a->status = SP_PROJECTED;
    return found;
}

/* Find the optimum x within the thrust spheres, with softened rows if necessary; returns 0 if there is none.
 *
 * cube: whether cube_optimum found an optimum, which then lies outside the spheres.
 */
static int within_spheres(const sp_mode *mode, const sp_program *p, int cube, const sp_allocator_config *config,
                          sp_room *room, double *x, sp_allocation *a)
{
    sp_workspace *work = &room->workspace;
    int32_t rows[SP_MAX_M];
    int found = sp_sphere_optimum(p, NULL, 0, 1.0, work, x, &a->iterations);
    if (found) {
        if (!cube && largest_thrust(x) < p->radius - SP_SIDE_TOLERANCE) a->status = SP_SOLVED; /* the spheres are inactive */
        return 1;
    }
    int count = sp_soft_rows(mode, rows);
    a->status = SP_SOFTENED;
    if (!cube) {
        double duals[SP_MAX_M];
        sp_program *soft = &work->soft;
        sp_soften(p, rows, count, config->price, soft);
        int result = solve(mode->kind, 1, soft, SP_RHO, config, room, x, duals, &a->iterations);
        found = sp_closed_form(soft, duals, SP_MORE_ROUNDS, work, x) ||
                (result == 1 && sp_violation(soft, x) <= config->check_tolerance);
        if (found && largest_thrust(x) <= p->radius + SP_SPHERE_TOLERANCE) {
            for (int k = p->n; k < soft->n; k++) a->slack = sp_max(a->slack, fabs(x[k]));
            return 1;
        }
    }
    found = sp_sphere_optimum(p, rows, count, config->price, work, x, &a->iterations);
    if (found) a->slack = sp_violation(p, x);
    return found;
}

/* Compute the forces for a demand. `guess`: active rows of the last tick, or NULL; if given, the allocation contains
 * the rows that are active now. */
void sp_allocate(const sp_mode *mode, const sp_demand *demand, const double *previous_l, const int32_t *guess,
                 int guess_rows, const sp_allocator_config *config, sp_room *room, sp_allocation *a)
{
    const sp_robot *robot = room->robot;
    sp_workspace *work = &room->workspace;
    sp_program *p = &work->program;
    double x[SP_MAX_N], guessed[SP_MAX_M], f[SP_UNKNOWNS];
    a->iterations = 0;
    a->slack = 0.0;
    a->rows = 0;
    sp_assemble(robot, mode, demand, p);
    int found = cube_optimum(mode, p, guess, guess_rows, config, room, x, a);
    if (a->status == SP_PROJECTED) found = within_spheres(mode, p, found, config, room, x, a);
    if (!found) {
        hold_forces(robot, mode, demand, previous_l, a);
        return;
    }
    for (int k = 0; k < p->n; k++) f[k] = robot->max_thrust * x[k];
    answer(robot, mode, demand, f, a);
    if (guess != NULL) {
        sides(p, x, guessed);
        a->rows = p->m;
        for (int i = 0; i < p->m; i++) a->active[i] = (int32_t)guessed[i];
    }
}

/* Find the valid forces nearest to `wish_l`: the projection's rows and thrust spheres hold, the wrench may change. */
void sp_project(const sp_demand *demand, const double *wish_l, const double *previous_l,
                const sp_allocator_config *config, sp_room *room, sp_allocation *a)
{
    const sp_robot *robot = room->robot;
    sp_workspace *work = &room->workspace;
    const sp_mode *projection = sp_find_mode(SP_PROGRAM_PROJECTION);
    sp_program *p = &work->program;
    double x[SP_MAX_N], f[SP_FORCES];
    a->iterations = 0;
    a->slack = 0.0;
    a->rows = 0;
    sp_assemble(robot, projection, demand, p);
    for (int k = 0; k < SP_FORCES; k++) p->q[k] = -wish_l[k] / robot->max_thrust;
    int found = cube_optimum(projection, p, NULL, 0, config, room, x, a);
    if (a->status == SP_PROJECTED) { /* the spheres are part of this problem */
        found = sp_sphere_optimum(p, NULL, 0, 1.0, work, x, &a->iterations);
        a->status = SP_SOLVED;
    }
    if (!found) {
        hold_forces(robot, projection, demand, previous_l, a);
        a->slack = 0.0;
        return;
    }
    for (int k = 0; k < SP_FORCES; k++) f[k] = robot->max_thrust * x[k];
    answer(robot, projection, demand, f, a);
}
