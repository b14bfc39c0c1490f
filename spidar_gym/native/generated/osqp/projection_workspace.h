/* Generated: the workspace of OSQP for projection. */
#ifndef PROJECTION_WORKSPACE_H
#define PROJECTION_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[24];
    OSQPFloat sol_y[64];
    OSQPFloat sol_prim_inf_cert[64];
    OSQPFloat sol_dual_inf_cert[24];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[25];
    OSQPInt data_P_csc_i[84];
    OSQPFloat data_P_csc_x[84];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[25];
    OSQPInt data_A_csc_i[160];
    OSQPFloat data_A_csc_x[160];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[24];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[64];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[64];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[89];
    OSQPInt linsys_L_i[224];
    OSQPFloat linsys_L_x[224];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[88];
    OSQPInt linsys_P[88];
    OSQPFloat linsys_bp[88];
    OSQPFloat linsys_sol[88];
    OSQPFloat linsys_rho_inv_vec[64];
    OSQPInt linsys_KKT_p[89];
    OSQPInt linsys_KKT_i[308];
    OSQPFloat linsys_KKT_x[308];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[84];
    OSQPInt linsys_AtoKKT[160];
    OSQPInt linsys_rhotoKKT[64];
    OSQPFloat linsys_D[88];
    OSQPInt linsys_etree[88];
    OSQPInt linsys_Lnz[88];
    QDLDL_int linsys_iwork[264];
    QDLDL_bool linsys_bwork[88];
    QDLDL_float linsys_fwork[88];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[64];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[64];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[64];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[24];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[64];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[64];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[88];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[24];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[64];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[64];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[24];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[24];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[64];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[24];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[24];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[24];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[64];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[24];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[24];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[64];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} projection_space;
extern const projection_space projection_SPACE;
static const uint32_t projection_POINTERS[89] = {
    offsetof(projection_space, sol) + offsetof(OSQPSolution, x), offsetof(projection_space, sol) + offsetof(OSQPSolution, y), offsetof(projection_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(projection_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(projection_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(projection_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(projection_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(projection_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(projection_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(projection_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(projection_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(projection_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(projection_space, data_q) + offsetof(OSQPVectorf, values), offsetof(projection_space, data_l) + offsetof(OSQPVectorf, values), offsetof(projection_space, data_u) + offsetof(OSQPVectorf, values), offsetof(projection_space, data) + offsetof(OSQPData, P),
    offsetof(projection_space, data) + offsetof(OSQPData, A), offsetof(projection_space, data) + offsetof(OSQPData, q), offsetof(projection_space, data) + offsetof(OSQPData, l), offsetof(projection_space, data) + offsetof(OSQPData, u),
    offsetof(projection_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(projection_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(projection_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(projection_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(projection_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(projection_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(projection_space, linsys) + offsetof(qdldl_solver, L), offsetof(projection_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(projection_space, linsys) + offsetof(qdldl_solver, P), offsetof(projection_space, linsys) + offsetof(qdldl_solver, bp), offsetof(projection_space, linsys) + offsetof(qdldl_solver, sol), offsetof(projection_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(projection_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(projection_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(projection_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(projection_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(projection_space, linsys) + offsetof(qdldl_solver, D), offsetof(projection_space, linsys) + offsetof(qdldl_solver, etree), offsetof(projection_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(projection_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(projection_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(projection_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(projection_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(projection_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(projection_space, work_x) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_y) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(projection_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(projection_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(projection_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(projection_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(projection_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(projection_space, work) + offsetof(OSQPWorkspace, data), offsetof(projection_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(projection_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(projection_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(projection_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(projection_space, work) + offsetof(OSQPWorkspace, x), offsetof(projection_space, work) + offsetof(OSQPWorkspace, y), offsetof(projection_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(projection_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(projection_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(projection_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(projection_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(projection_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(projection_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(projection_space, work) + offsetof(OSQPWorkspace, Px), offsetof(projection_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(projection_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(projection_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(projection_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(projection_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(projection_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(projection_space, solver) + offsetof(OSQPSolver, settings), offsetof(projection_space, solver) + offsetof(OSQPSolver, solution), offsetof(projection_space, solver) + offsetof(OSQPSolver, info),
    offsetof(projection_space, solver) + offsetof(OSQPSolver, work),
};

#endif
