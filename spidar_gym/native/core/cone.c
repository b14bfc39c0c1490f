/* Optimum within the thrust spheres, or a proof of infeasibility: a primal-dual interior-point method.
 *
 * No state, a fixed start, a bounded number of steps. Every inequality is g(x) + s = c z with s, z ≥ 0 and s z → 0.
 * Here g is a x − u or l − a x for a side of a row, and ½ (‖f_i‖² − r²) for a sphere of the program's radius r. A row with a compliance c > 0
 * yields by c z. Equalities have no s.
 */
#include "spidar_core.h"
#include "spidar_math.h"

/* y += w a. */
static void axpy(double w, const double *a, int n, double *y)
{
    for (int k = 0; k < n; k++) y[k] += w * a[k];
}

/* Bound r Σ ‖a_i‖ on |a x| for forces within the spheres. */
static double row_bound(const double *a, int n, double radius)
{
    double sum = 0.0;
    for (int i = 0; i < SP_ROTORS; i++) sum += radius * sp_norm(a + 3 * i);
    for (int k = SP_FORCES; k < n; k++) sum += SP_CONE_FAR * fabs(a[k]);
    return sum;
}

/* Factorise K = L D Lᵀ in place without pivoting: K is quasi-definite (its last block is negative definite). */
static int factorise(double *K, int size)
{
    for (int i = 0; i < size; i++) {
        double *row = K + i * size;
        for (int j = 0; j < i; j++) {
            const double *other = K + j * size;
            double sum = row[j];
            for (int k = 0; k < j; k++) sum -= row[k] * other[k]; /* row[k] is still l_k d_k */
            row[j] = sum;
        }
        for (int j = 0; j < i; j++) {
            double scaled = row[j] / K[j * size + j];
            row[i] -= scaled * row[j];
            row[j] = scaled;
        }
        if (!(fabs(row[i]) > 0.0)) return 0;
    }
    return 1;
}

static void substitute(const double *K, int size, double *right)
{
    for (int i = 0; i < size; i++)
        for (int k = 0; k < i; k++) right[i] -= K[i * size + k] * right[k];
    for (int i = 0; i < size; i++) right[i] /= K[i * size + i];
    for (int i = size - 1; i >= 0; i--)
        for (int k = 0; k < i; k++) right[k] -= K[i * size + k] * right[i];
}

/* Find the equality rows, and the sides of other rows that forces within the spheres can reach; returns 0 if a hard row
 * is out of reach. */
static int find_sides(const sp_program *p, const int32_t *soft, int count, double price, sp_cone *c)
{
    double give[SP_MAX_M];
    sp_zero(give, p->m);
    for (int k = 0; k < count; k++) give[soft[k]] = 1.0 / price;
    c->equal = c->sides = 0;
    c->largest = 1.0;
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < p->m; i++) {
            double far = row_bound(p->A + i * p->n, p->n, p->radius), bound = side ? -p->l[i] : p->u[i];
            int same = p->l[i] == p->u[i];
            if (give[i] == 0.0 && bound < -far) return 0;
            if (same ? side : !(bound < far)) continue;
            if (same) {
                c->row[c->equal] = i;
                c->b[c->equal] = bound;
                c->yield[c->equal++] = give[i];
            } else {
                c->side_row[c->sides] = i;
                c->sign[c->sides] = side ? -1.0 : 1.0;
                c->h[c->sides] = bound;
                c->give[c->sides++] = give[i];
            }
            c->largest = sp_max(c->largest, fabs(bound));
        }
    return 1;
}

/* a x of a side or of a sphere's gradient. */
static double side_along(const sp_program *p, const sp_cone *c, int k, const double *x, const double *d)
{
    if (k < c->sides) return c->sign[k] * sp_row(p->A + c->side_row[k] * p->n, d, p->n);
    return sp_dot(x + 3 * (k - c->sides), d + 3 * (k - c->sides));
}

/* y += w a of a side or of a sphere's gradient. */
static void side_add(const sp_program *p, const sp_cone *c, int k, const double *x, double w, double *y)
{
    if (k < c->sides) axpy(w * c->sign[k], p->A + c->side_row[k] * p->n, p->n, y);
    else axpy(w, x + 3 * (k - c->sides), 3, y + 3 * (k - c->sides));
}

/* Write the lower triangle of the Newton step's matrix from D of sides and spheres; spheres add their curvature z. */
static void write_matrix(const sp_program *p, const sp_cone *c, double unit, double *K)
{
    int n = p->n, size = n + c->equal;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) K[i * size + j] = p->P[i * n + j] / unit;
    for (int k = 0; k < c->sides; k++) {
        const double *a = p->A + c->side_row[k] * n;
        for (int i = 0; i < n; i++) {
            if (a[i] == 0.0) continue;
            axpy(c->D[k] * a[i], a, i + 1, K + i * size);
        }
    }
    for (int r = 0; r < SP_ROTORS; r++) {
        int k = c->sides + r;
        const double *f = c->x + 3 * r;
        for (int i = 0; i < 3; i++) {
            double *row = K + (3 * r + i) * size + 3 * r;
            axpy(c->D[k] * f[i], f, i + 1, row);
            row[i] += c->z[k];
        }
    }
    for (int e = 0; e < c->equal; e++) {
        double *row = K + (n + e) * size;
        sp_copy(row, p->A + c->row[e] * n, n);
        sp_zero(row + n, e);
        row[n + e] = -c->yield[e] - SP_CONE_TINY;
    }
}

/* Find the optimum x of a program with the additional constraints ‖f_i‖ ≤ r; returns 0 if the program is infeasible
 * or no optimum was found. Each of the `soft` rows may be violated by v at the cost ½ `price` v². The number of Newton
 * steps is added to `steps`.
 */
int sp_sphere_optimum(const sp_program *p, const int32_t *soft, int count, double price, sp_workspace *work, double *x,
                      int32_t *steps)
{
    sp_cone *c = &work->cone;
    int n = p->n, found = 0;
    double best = SP_CONE_LOOSE, unit = 1.0;
    if (!find_sides(p, soft, count, price, c)) return 0;
    int sides = c->sides, equal = c->equal, all = sides + SP_ROTORS, size = n + equal;
    /* Scale the cost so that multipliers are of order one. */
    for (int k = 0; k < n; k++) unit = sp_max(unit, fabs(p->q[k]));
    if (count > 0) unit = sp_max(unit, price * c->largest);
    for (int e = 0; e < equal; e++) c->yield[e] *= unit, c->y[e] = 0.0;
    for (int k = 0; k < all; k++) {
        c->give[k] = k < sides ? c->give[k] * unit : 0.0;
        c->z[k] = 1.0;
        c->s[k] = k < sides ? sp_max(c->h[k], 1.0) : 1.0;
    }
    sp_zero(c->x, n);
    for (int step = 0; step < SP_CONE_MAX_STEPS; step++, ++*steps) {
        double pull[SP_UNKNOWNS], gradient[SP_UNKNOWNS], proof = 0.0, sum = 0.0, mean = 0.0, worst = 0.0, steep = 0.0;
        sp_zero(pull, n);
        for (int e = 0; e < equal; e++) {
            const double *a = p->A + c->row[e] * n;
            axpy(c->y[e], a, n, pull);
            c->off[e] = sp_row(a, c->x, n) - c->b[e] - c->yield[e] * c->y[e];
            worst = sp_max(worst, fabs(c->off[e]) / c->largest);
            proof += c->b[e] * c->y[e];
            sum += fabs(c->y[e]);
        }
        for (int k = 0; k < all; k++) {
            double g = side_along(p, c, k, c->x, c->x);
            g = k < sides ? g - c->h[k] : 0.5 * (g - p->radius * p->radius);
            c->miss[k] = g + c->s[k] - c->give[k] * c->z[k];
            worst = sp_max(worst, fabs(c->miss[k]));
            mean += c->s[k] * c->z[k] / all;
            if (k >= sides) continue;
            side_add(p, c, k, c->x, c->z[k], pull);
            proof += c->h[k] * c->z[k];
            sum += c->z[k];
        }
        for (int i = 0; i < n; i++) gradient[i] = (sp_row(p->P + i * n, c->x, n) + p->q[i]) / unit + pull[i];
        for (int k = sides; k < all; k++) side_add(p, c, k, c->x, c->z[k], gradient);
        for (int i = 0; i < n; i++) steep = sp_max(steep, fabs(gradient[i]));
        double left = sp_max(worst / SP_CONE_ROWS, sp_max(mean / SP_CONE_PRODUCT, steep / SP_CONE_GRADIENT));
        if (left < best) {
            best = left;
            found = 1;
            sp_copy(x, c->x, n);
        }
        if (best < 1.0 || !sp_finite(gradient, n) || !sp_finite(&mean, 1)) break;
        /* Farkas: a feasible x has pull·x ≤ b·y + h·z, but within the spheres pull·x ≥ −r Σ ‖pull_i‖. */
        if (count == 0 && proof + row_bound(pull, n, p->radius) < -SP_CONE_PROOF * sum) return 0;
        for (int k = 0; k < all; k++) c->D[k] = 1.0 / (c->s[k] / c->z[k] + c->give[k]);
        write_matrix(p, c, unit, work->K);
        if (!factorise(work->K, size)) break;
        double *d = work->right, way = 1.0;
        for (int k = 0; k < all; k++) c->product[k] = c->s[k] * c->z[k];
        for (int aimed = 0; aimed < 2; aimed++) { /* predictor first; its step length sets the corrector's target */
            double fastest = SP_CONE_SHORT, ahead = 0.0;
            sp_copy(d, gradient, n);
            sp_copy(d + n, c->off, equal);
            for (int k = 0; k < all; k++) {
                c->dz[k] = c->D[k] * (c->miss[k] - c->product[k] / c->z[k]);
                side_add(p, c, k, c->x, c->dz[k], d);
            }
            substitute(work->K, size, d);
            for (int k = 0; k < all; k++) {
                c->dz[k] -= c->D[k] * side_along(p, c, k, c->x, d);
                c->ds[k] = -(c->product[k] + c->s[k] * c->dz[k]) / c->z[k];
                fastest = sp_max(fastest, sp_max(-c->dz[k] / c->z[k], -c->ds[k] / c->s[k]));
            }
            way = sp_min(1.0, (aimed ? SP_CONE_SHORT : 1.0) / fastest);
            if (aimed) break;
            for (int k = 0; k < all; k++) ahead += (c->s[k] + way * c->ds[k]) * (c->z[k] + way * c->dz[k]) / all;
            ahead /= mean;
            for (int k = 0; k < all; k++)
                c->product[k] += way * way * c->ds[k] * c->dz[k] - mean * ahead * ahead * ahead; /* damped: may cycle otherwise */
        }
        axpy(-way, d, n, c->x);
        axpy(-way, d + n, equal, c->y);
        axpy(way, c->dz, all, c->z);
        axpy(way, c->ds, all, c->s);
    }
    return found;
}
