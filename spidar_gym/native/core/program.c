/* The allocation as a quadratic program: modes as data, blocks of costs and rows, the certified closed form.
 *
 * Unknowns x = f / λ̄. Wrench rows are in units of the robot's weight, torque rows in units of its servo torque limit.
 */
#include "spidar_core.h"
#include "spidar_math.h"
#include "spidar_modes.h" /* generated: modes, and the number of rows of each block */

const sp_mode *sp_find_mode(int32_t kind) { return &SP_MODES[kind]; }

/* A mode of the crawl with a configuration's costs and limits. */
void sp_ground_mode(int32_t kind, const sp_crawler_config *c, sp_mode *mode)
{
    *mode = SP_MODES[kind];
    if (kind == SP_PROGRAM_REST) return;
    mode->costs[0].kind = c->power ? SP_POWER_EFFORT : SP_THRUST_EFFORT;
    mode->costs[1].weight = c->torque_weight;
    for (int i = 0; i < SP_MODE_ROWS; i++) {
        sp_rows *rows = &mode->rows[i];
        if (rows->kind == SP_JOINT_TORQUE_LIMIT) rows->a = c->torque_limit;
        if (rows->kind == SP_FRICTION_PYRAMID) rows->a = c->foot_friction;
        if (rows->kind == SP_CONTACT_WRENCH_RANGE) rows->a = c->peg_friction, rows->b = c->min_normal;
    }
}

static void add_cost(const sp_robot *robot, const sp_cost *cost, const sp_demand *d, int n, double *P, double *q)
{
    double w = cost->weight;
    switch (cost->kind) {
    case SP_THRUST_EFFORT:
        for (int i = 0; i < SP_FORCES; i++) P[i * n + i] += w;
        break;
    case SP_POWER_EFFORT:
        for (int i = 0; i < SP_FORCES; i++) P[i * n + i] += w * d->effort[i / 3];
        break;
    case SP_FOOT_EFFORT:
        for (int i = SP_FORCES; i < n; i++) P[i * n + i] += w;
        break;
    case SP_JOINT_TORQUE_EFFORT:
        for (int j = 0; j < SP_JOINTS; j++) {
            if (!d->lifted[j / 4]) continue;
            const double *T = d->torque_map + n * j;
            for (int a = 0; a < n; a++) {
                if (T[a] == 0.0) continue;
                for (int b = 0; b < n; b++) P[a * n + b] += w * T[a] * T[b];
                q[a] -= w / robot->max_thrust * d->gravity_torque[j] * T[a];
            }
        }
        break;
    default: break;
    }
}

/* A block's own limit, or the robot's if it has none. */
static double limit_of(const sp_rows *rows, double robots) { return sp_finite(&rows->a, 1) ? rows->a : robots; }

static void write_rows(const sp_robot *robot, const sp_rows *rows, const sp_demand *d, int n, double *A, double *l, double *u)
{
    const double force = robot->max_thrust, weight = robot->weight, torque = robot->max_joint_torque;
    double limit;
    switch (rows->kind) {
    case SP_WRENCH_BALANCE: /* [Zhao2025, Eq. 10] */
        for (int r = 0; r < 6; r++) {
            for (int c = 0; c < n; c++) A[r * n + c] = d->thrust_map[r * n + c] * (force / weight);
            l[r] = u[r] = d->wrench[r] / weight;
        }
        break;
    case SP_THRUST_BOX: /* [Zhao2025, Eq. 12] */
        limit = sp_min(limit_of(rows, force), d->thrust_limit) / force;
        for (int i = 0; i < SP_FORCES; i++) {
            A[i * n + i] = 1.0;
            u[i] = d->lost[i / 3] ? 0.0 : limit;
            l[i] = d->lost[i / 3] ? 0.0 : -limit;
        }
        break;
    case SP_JOINT_TORQUE_LIMIT: /* [Zhao2025, Eq. 11, 13] */
        limit = limit_of(rows, torque) / torque;
        for (int j = 0; j < SP_JOINTS; j++) {
            if (!d->lifted[j / 4]) continue;
            for (int c = 0; c < n; c++) A[j * n + c] = d->torque_map[j * n + c] * (force / torque);
            double g = d->gravity_torque[j] / torque;
            u[j] = g + limit;
            l[j] = g - limit;
        }
        break;
    case SP_VECTORING_LOCK: /* cos φ f_y + sin φ f_z = 0 [Zhao2025, Eq. 32] */
        for (int i = 0; i < SP_ROTORS; i++) {
            if (!d->locked[i]) continue;
            A[i * n + 3 * i + 1] = cos(d->phi[i]);
            A[i * n + 3 * i + 2] = sin(d->phi[i]);
            l[i] = u[i] = 0.0;
        }
        break;
    case SP_INTERFERENCE_BOUND: /* {inf}f_x ≥ 0, {sup}f_x ≤ 0 [Zhao2025, Eq. 28-31] */
        for (int i = 0; i < SP_ROTORS; i++) {
            if (!d->restricted[i]) continue;
            double s = sin(d->phi[i]), c = cos(d->phi[i]), inf = sin(d->lower[i]), sup = sin(d->upper[i]);
            double *low = A + i * n + 3 * i, *high = A + (SP_ROTORS + i) * n + 3 * i;
            low[0] = cos(d->lower[i]), low[1] = inf * s, low[2] = -inf * c;
            high[0] = cos(d->upper[i]), high[1] = sup * s, high[2] = -sup * c;
            l[i] = 0.0;
            u[SP_ROTORS + i] = 0.0;
        }
        break;
    case SP_CONTACT_WRENCH_RANGE: { /* [Zhao2025, Eq. 34, 35, 37] in {B} */
        /* w̲ in {B}: a box of wrenches of four pegs [Zhao2025, Eq. 36]; w̄ is −w̲, f_z has no upper bound. */
        double friction = rows->a, least = rows->b, bound = friction * least / (2.0 * sqrt(2.0));
        double tilt = 0.5 * robot->yaw_axis_xy * least - robot->peg_depth * bound;
        double twist = 0.25 * friction * least * robot->yaw_axis_xy * sqrt(2.0);
        double low[6] = {-bound, -bound, least, -tilt, -tilt, -twist}, w[6], lever[3];
        for (int c = 0; c < n; c++) {
            double f[3] = {d->thrust_map[c], d->thrust_map[n + c], d->thrust_map[2 * n + c]};
            sp_cross(d->com_b, f, lever);
            for (int r = 0; r < 3; r++) {
                A[r * n + c] = f[r] * (force / weight);
                A[(3 + r) * n + c] = (d->thrust_map[(3 + r) * n + c] + lever[r]) * (force / weight);
            }
        }
        sp_cross(d->com_b, d->wrench, lever);
        for (int r = 0; r < 3; r++) w[r] = d->wrench[r], w[3 + r] = d->wrench[3 + r] + lever[r];
        for (int r = 0; r < 6; r++) {
            u[r] = (w[r] - low[r]) / weight;
            l[r] = r == 2 ? -SP_INFINITY : (w[r] + low[r]) / weight;
        }
        break;
    }
    case SP_FRICTION_PYRAMID:
        for (int leg = 0; leg < SP_LEGS; leg++) {
            int x = SP_FORCES + 3 * leg;
            for (int k = 0; k < 4; k++) {
                A[(5 * leg + k) * n + x + k / 2] = k % 2 ? -1.0 : 1.0;
                A[(5 * leg + k) * n + x + 2] = rows->a;
                l[5 * leg + k] = 0.0;
            }
            A[(5 * leg + 4) * n + x + 2] = 1.0;
            l[5 * leg + 4] = rows->b / force;
        }
        break;
    default: break;
    }
}

/* Assemble the program of one tick, [Zhao2025, Eq. 9] with constraints, from the mode's blocks. */
void sp_assemble(const sp_robot *robot, const sp_mode *mode, const sp_demand *demand, sp_program *p)
{
    int n = mode->n, m = mode->m, row = 0;
    p->n = n, p->m = m;
    p->radius = sp_min(1.0, demand->thrust_limit / robot->max_thrust);
    sp_zero(p->P, n * n);
    sp_zero(p->q, n);
    sp_zero(p->A, m * n);
    for (int i = 0; i < m; i++) p->l[i] = -SP_INFINITY, p->u[i] = SP_INFINITY;
    for (int i = 0; i < SP_MODE_COSTS; i++) add_cost(robot, &mode->costs[i], demand, n, p->P, p->q);
    for (int i = 0; i < SP_MODE_ROWS; i++) {
        write_rows(robot, &mode->rows[i], demand, n, p->A + row * n, p->l + row, p->u + row);
        row += SP_ROWS_COUNTS[mode->rows[i].kind];
    }
}

/* Write the indices of the rows that the fallback may violate; returns their number. */
int sp_soft_rows(const sp_mode *mode, int32_t *rows)
{
    int count = 0, row = 0;
    for (int i = 0; i < SP_MODE_ROWS; i++) {
        int more = SP_ROWS_COUNTS[mode->rows[i].kind];
        for (int k = 0; k < more && SP_ROWS_ARE_SOFT[mode->rows[i].kind]; k++) rows[count++] = row + k;
        row += more;
    }
    return count;
}

/* Soften a program: `rows` may be violated by slacks s at the cost ½ `price` ‖s‖²; unknowns (x, s). */
void sp_soften(const sp_program *program, const int32_t *rows, int count, double price, sp_program *soft)
{
    int n = program->n, m = program->m, size = n + count;
    soft->n = size, soft->m = m;
    soft->radius = program->radius;
    sp_zero(soft->P, size * size);
    sp_zero(soft->q, size);
    sp_zero(soft->A, m * size);
    for (int i = 0; i < n; i++) sp_copy(soft->P + i * size, program->P + i * n, n);
    for (int i = n; i < size; i++) soft->P[i * size + i] = price;
    sp_copy(soft->q, program->q, n);
    for (int i = 0; i < m; i++) sp_copy(soft->A + i * size, program->A + i * n, n);
    for (int k = 0; k < count; k++) soft->A[rows[k] * size + n + k] = 1.0;
    sp_copy(soft->l, program->l, m);
    sp_copy(soft->u, program->u, m);
}

/* Largest violation of a row at x: 0 if all rows hold, NaN if x is not finite. */
double sp_violation(const sp_program *p, const double *x)
{
    double worst = 0.0;
    for (int i = 0; i < p->m; i++) {
        double r = sp_row(p->A + i * p->n, x, p->n), excess = sp_max(p->l[i] - r, r - p->u[i]);
        if (!(excess <= worst)) worst = excess;
        if (r != r) return r;
    }
    return worst;
}

/* Solve K x = right, K (size, size), by elimination with row pivoting, in place; returns 0 if K is singular. */
static int eliminate(double *K, double *right, int size)
{
    for (int k = 0; k < size; k++) {
        int best = k;
        double largest = fabs(K[k * size + k]);
        for (int i = k + 1; i < size; i++) {
            double candidate = fabs(K[i * size + k]);
            if (candidate > largest) largest = candidate, best = i;
        }
        if (!(largest > 0.0)) return 0;
        if (best != k) {
            double *a = K + k * size, *b = K + best * size;
            for (int j = k; j < size; j++) {
                double swap = a[j];
                a[j] = b[j], b[j] = swap;
            }
            double swap = right[k];
            right[k] = right[best], right[best] = swap;
        }
        double inverse = 1.0 / K[k * size + k];
        const double *from = K + k * size;
        for (int i = k + 1; i < size; i++) {
            double *to = K + i * size, factor = to[k] * inverse;
            if (factor == 0.0) continue;
            for (int j = k + 1; j < size; j++) to[j] -= factor * from[j];
            right[i] -= factor * right[k];
        }
    }
    for (int k = size - 1; k >= 0; k--) {
        double sum = right[k];
        for (int j = k + 1; j < size; j++) sum -= K[k * size + j] * right[j];
        right[k] = sum / K[k * size + k];
    }
    return 1;
}

/* Find the optimum from a guess of the active rows; returns 0 if no optimum is found within `rounds`.
 *
 * Solves the KKT system of the rows assumed active. A point that satisfies every row, with multipliers of the right
 * sign on those rows, satisfies all KKT conditions. Otherwise violated rows become active, rows whose multiplier has
 * the wrong sign become inactive, and the system is solved again.
 *
 * duals: initial guess of the rows' multipliers, of which only the signs are used; NULL for the equalities alone.
 */
int sp_closed_form(const sp_program *p, const double *duals, int rounds, sp_workspace *work, double *x)
{
    int n = p->n, m = p->m, count = 0, signed_rows = duals != NULL;
    int32_t *rows = work->rows;
    double *target = work->target, *signs = work->signs;
    for (int i = 0; i < m; i++)
        if (p->l[i] == p->u[i]) rows[count] = i, target[count] = p->l[i], signs[count++] = 0.0;
    if (duals != NULL)
        for (int i = 0; i < m; i++)
            if (fabs(duals[i]) > SP_DUAL_TOLERANCE && p->l[i] != p->u[i]) {
                rows[count] = i;
                target[count] = duals[i] > 0.0 ? p->u[i] : p->l[i];
                signs[count++] = duals[i] > 0.0 ? 1.0 : -1.0;
            }
    for (int round = 0; round < rounds; round++) {
        int size = n + count, kept = 0, fine = 1;
        if (size > 2 * n || size > 2 * SP_MAX_N) return 0;
        double *K = work->K, *right = work->right;
        sp_zero(K, size * size);
        for (int i = 0; i < n; i++) {
            sp_copy(K + i * size, p->P + i * n, n);
            right[i] = -p->q[i];
        }
        for (int k = 0; k < count; k++) {
            const double *row = p->A + rows[k] * n;
            sp_copy(K + (n + k) * size, row, n);
            for (int i = 0; i < n; i++) K[i * size + n + k] = row[i];
            right[n + k] = target[k];
        }
        if (!eliminate(K, right, size)) return 0;
        for (int k = 0; k < count; k++)
            if (!(signs[k] * right[n + k] >= 0.0)) fine = 0;
        if (!signed_rows) fine = 1;
        int violated = 0;
        for (int i = 0; i < m; i++) {
            double r = sp_row(p->A + i * n, right, n), excess = sp_max(p->l[i] - r, r - p->u[i]);
            work->r[i] = r;
            if (!(excess <= SP_ROW_TOLERANCE) || r != r) violated = 1;
        }
        if (!violated && fine) {
            sp_copy(x, right, n);
            return sp_finite(x, n);
        }
        for (int k = 0; k < count; k++)
            if (!signed_rows || signs[k] * right[n + k] >= 0.0) {
                rows[kept] = rows[k], target[kept] = target[k];
                signs[kept] = signed_rows ? signs[k] : 0.0;
                kept++;
            }
        count = kept;
        for (int i = 0; i < m; i++) {
            double r = work->r[i], excess = sp_max(p->l[i] - r, r - p->u[i]);
            if (excess <= SP_ROW_TOLERANCE && r == r) continue;
            if (count >= 2 * SP_MAX_M) return 0;
            int above = r > p->u[i];
            rows[count] = i, target[count] = above ? p->u[i] : p->l[i];
            signs[count++] = above ? 1.0 : -1.0;
        }
        signed_rows = 1;
    }
    return 0;
}
